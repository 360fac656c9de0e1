"""Recordings of the rotating platform, sampled from its world without instruments: minutes of campaign in a second.

The platform is turned as a pattern's table says, both chains are read at (k + 1/2) / f_s, and what the encoder
believes is written beside it. The bundle says nothing of what is hidden.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.campaign.bundle.bundle import write_bundle
from rigctl.campaign.recording import ChannelInfo, Header, ImportReport, Recording, RunRecord
from rigctl.core.arrays import FloatArray
from rigctl.experiments.rotating_platform.observe.patterns import Pattern, named_pattern
from simulators.clock import VirtualClock
from simulators.motion import MotionAxis
from simulators.wiring import TriggerLine, VoltageLine
from simulators.worlds.platform_settings import PlatformSettings
from simulators.worlds.rotating_platform import RotatingPlatform

Columns = dict[str, FloatArray]

GAINS = {
    "gain_q_a_v_per_m_s2": 846.73,
    "gain_q_b_v_per_m_s2": 804.32,
    "gain_dm1_y_v_per_m_s2": 805.0,
    "gain_dm1_z_v_per_m_s2": 825.0,
}
BIASES = {"bias_q_a_v": 0.2221, "bias_q_b_v": -0.0527}
BREAK_S = 600.0
_CHUNK = 1 << 16


@dataclass(frozen=True)
class SampledRun:
    """One run: a pattern and its period, how many, and what the pendulum is told.

    `mask_short_s` ends the mask so much before the motion; `forward` turns on instead of back, a half turn takes
    `rotation_s`. A scan dwells `dwell_s` at each of `angles_deg`.
    """

    pattern: str = "c"
    period_s: float = 60.0
    periods: int = 30
    rate_hz: float = 10.0
    external: str = "constant"
    v_z_v: float = 0.0
    v_y_v: float = 0.0
    external_period_s: float = math.nan
    guard_s: float = 0.0
    mask_short_s: float = 0.0
    forward: bool = False
    rotation_s: float | None = None
    angles_deg: tuple[float, ...] = ()
    dwell_s: float = 60.0

    @property
    def table(self) -> Pattern:
        """When the platform rests."""
        return named_pattern(self.pattern, self.period_s, self.rotation_s, guard_s=self.guard_s)

    @property
    def samples(self) -> int:
        """Of the whole run."""
        return round(self.rate_hz * (self.dwell_s * len(self.angles_deg) or self.period_s * self.periods))


Spoil = Callable[[int, Columns], Columns]
"""What happens to the samples of run number n on the way to the file."""


def sampled(settings: PlatformSettings, runs: Sequence[SampledRun], spoil: Spoil | None = None) -> Recording:
    """The runs one after another in one world, ten minutes between them."""
    clock, axis, trigger = VirtualClock(), MotionAxis(history_s=1e7), TriggerLine()
    inputs = {"dm1_y_v": VoltageLine(), "dm1_z_v": VoltageLine()}
    world = RotatingPlatform(settings, clock, axis, trigger, inputs)
    records, columns, start_s = [], {}, 0.0
    for number, run in enumerate(runs, start=1):
        samples = _run(world, axis, trigger, inputs, run, number, start_s)
        run_id = f"r{number:02d}"
        columns[run_id] = spoil(number, samples) if spoil else samples
        records.append(RunRecord(run_id, run_id, "", _conditions(run, samples, start_s)))
        start_s += run.samples / run.rate_hz + BREAK_S
    header = Header(
        "rotating-platform",
        title="bias rejection",
        started="2026-11-21T01:00:00Z",
        constants={"g_m_s2": settings.g_m_s2, **GAINS, **BIASES},
        channels={name: ChannelInfo("V", "accelerometer", full_scale=10.0) for name in ("q_a_v", "q_b_v")},
    )
    return Recording(header, tuple(records), columns, ImportReport(len(records)))


def record(settings: PlatformSettings, runs: Sequence[SampledRun], path: Path, spoil: Spoil | None = None) -> None:
    """The same as a bundle."""
    write_bundle(sampled(settings, runs, spoil), path)


def _run(
    world: RotatingPlatform,
    axis: MotionAxis,
    trigger: TriggerLine,
    inputs: Mapping[str, VoltageLine],
    run: SampledRun,
    number: int,
    start_s: float,
) -> Columns:
    inputs["dm1_y_v"].drive(start_s, lambda t: np.full_like(t, run.v_y_v))
    command = _command(run, start_s)
    inputs["dm1_z_v"].drive(start_s, command)
    count = run.samples
    t_s = start_s + (np.arange(count) + 0.5) / run.rate_hz
    moving = _scan(axis, run, start_s, t_s) if run.angles_deg else _modulate(axis, run, start_s, t_s)
    world.announce_run(number)
    trigger.begin(float(t_s[0]), 1.0 / run.rate_hz, count)
    chunks = [t_s[at : at + _CHUNK] for at in range(0, count, _CHUNK)]
    q_a, q_b = (np.concatenate([world.chain_v(name)(part) for part in chunks]) for name in ("q_a_v", "q_b_v"))
    return {
        "t_s": t_s - start_s,
        "theta_deg": axis.sample(t_s)[0],
        "q_a_v": q_a,
        "q_b_v": q_b,
        "dm1_y_v": np.full(count, run.v_y_v),
        "dm1_z_v": command(t_s),
        "moving": moving,
        "temperature_c": world.temperature_c(t_s),
    }


def _modulate(axis: MotionAxis, run: SampledRun, start_s: float, t_s: FloatArray) -> FloatArray:
    table, moving = run.table, np.zeros(t_s.size)
    first = 0.0 if table.dwells[0].sign > 0 else 180.0
    axis.move_to(start_s - 60.0, first, 10.0, 10.0)
    # A pattern that begins within a turn ends within it too: the last turn before the first period is left out.
    for number in range(run.periods):
        for turn in table.turns:
            begin_s = start_s + number * run.period_s + turn.start_s
            now_deg = axis.position(begin_s)
            target = now_deg + 180.0 if run.forward else (0.0 if turn.to_sign > 0 else 180.0)
            axis.turn_to(begin_s, target, table.rotation_s)
            moving[(t_s >= begin_s) & (t_s < begin_s + table.rotation_s - run.mask_short_s)] = 1.0
    if table.dwells[0].start_s > 0.0:
        moving[t_s < start_s + table.dwells[0].start_s] = 1.0
    return moving


def _scan(axis: MotionAxis, run: SampledRun, start_s: float, t_s: FloatArray) -> FloatArray:
    moving = np.zeros(t_s.size)
    for number, angle_deg in enumerate(run.angles_deg):
        begin_s = start_s + number * run.dwell_s
        end_s = axis.turn_to(begin_s, angle_deg, 5.0)
        moving[(t_s >= begin_s) & (t_s < end_s)] = 1.0
    return moving


def _command(run: SampledRun, start_s: float) -> Callable[[FloatArray], FloatArray]:
    def volts(t: FloatArray) -> FloatArray:
        if run.external == "constant":
            return np.full_like(t, run.v_z_v)
        turns = (t - start_s) / run.external_period_s
        if run.external == "sine":
            return np.asarray(run.v_z_v * np.sin(2.0 * np.pi * turns))
        return np.asarray(run.v_z_v * (4.0 * np.abs((turns - 0.25) % 1.0 - 0.5) - 1.0))

    return volts


def _conditions(run: SampledRun, samples: Columns, start_s: float) -> dict[str, Any]:
    return {
        "pattern": "scan" if run.angles_deg else run.pattern,
        "modulation_period_s": math.nan if run.angles_deg else run.period_s,
        "sample_rate_hz": run.rate_hz,
        "external": run.external,
        "v_z_v": run.v_z_v,
        "external_period_s": run.external_period_s,
        "temperature_c": float(samples["temperature_c"].mean()),
        "start_s": start_s,
        **({"guard_s": run.guard_s} if run.guard_s else {}),
    }
