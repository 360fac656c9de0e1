"""Recordings made by the simulated world itself, sampled directly: no instrument, no procedure, no model."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from rigctl.campaign.recording import Header, ImportReport, LaserInfo, Recording, RunRecord
from simulators.clock import VirtualClock
from simulators.motion import MotionAxis
from simulators.wiring import TriggerLine
from simulators.worlds.accelerometer_bench import AccelerometerBench
from simulators.worlds.bench_settings import BenchSettings, GroundNoiseSettings, isa_twin

G = 9.803
FACES = {
    # Cube faces towards the heads at +x, +y, +z: k, i, j in pendulum; j, i, -k in flag.
    ("X", "pendulum"): ("z", "x", "y"),
    ("X", "flag"): ("y", "x", "-z"),
    ("Y", "pendulum"): ("x", "y", "z"),
    ("Y", "flag"): ("z", "y", "-x"),
    ("Z", "pendulum"): ("y", "z", "x"),
    ("Z", "flag"): ("x", "z", "-y"),
}


@dataclass(frozen=True)
class Setting:
    """One run to be made."""

    theta_deg: float
    frequency_hz: float = 0.6
    approach: int = 1
    amplitude_mm: float = 5.0


@dataclass(frozen=True)
class Made:
    """A recording, and of each mounting null [deg] and rotation [rad] as nature has them, by parameter name."""

    recording: Recording
    truth: dict[str, float]


def grid(
    angles: Sequence[float] = (-1.2, -0.4, 0.5, 1.3), frequencies: Sequence[float] = (0.3, 0.5, 0.6)
) -> list[Setting]:
    """Angles by frequencies in a scrambled order, reached from both sides."""
    settings = [
        Setting(theta, f, approach=1 - 2 * ((i + j) % 2))
        for i, theta in enumerate(angles)
        for j, f in enumerate(frequencies)
    ]
    order = np.random.default_rng(5).permutation(len(settings))
    return [settings[i] for i in order]


def world(quiet: float = 0.01, laser_noise_um: float = 5e-4, **changes: Any) -> BenchSettings:
    """The twin without its roll and resonance, and a hundredth of its noise."""
    twin = isa_twin(seed=3)
    sensors = {
        name: sensor.model_copy(
            update={c: sensor.response(c).model_copy(update={"ideal": True}) for c in ("pendulum", "flag")}
        )
        for name, sensor in twin.sensors.items()
    }
    lasers = {name: head.model_copy(update={"noise_um": laser_noise_um}) for name, head in twin.lasers.items()}
    given = {
        **twin.model_dump(),
        "sensors": {name: sensor.model_dump() for name, sensor in sensors.items()},
        "lasers": {name: head.model_dump() for name, head in lasers.items()},
        "ground": GroundNoiseSettings(asd_m_s2_rthz=1e-6 * quiet, bump_asd_m_s2_rthz=0.0).model_dump(),
        "effects": {},
        **changes,
    }
    return BenchSettings.model_validate(given)


def measured(
    settings: BenchSettings,
    runs: Sequence[Setting],
    mountings: Sequence[tuple[str, str, int]] = (("X", "flag", 1),),
    cycles: int = 6,
    period_s: float = 0.02,
) -> Made:
    """Every run in every mounting, on the world's virtual clock."""
    clock, rotation, linear, trigger = VirtualClock(), MotionAxis(), MotionAxis(), TriggerLine()
    bench = AccelerometerBench(settings, clock, rotation, linear, trigger)

    def wait_until(at_s: float) -> None:
        clock.sleep_s(at_s - clock.now_s())

    records: list[RunRecord] = []
    columns: dict[str, dict[str, Any]] = {}
    for axis, configuration, mounting in mountings:
        wait_until(rotation.move_to(clock.now_s(), 0.0, 20.0, 80.0))
        wait_until(bench.remount(axis, configuration, mounting))
        wait_until(bench.level())
        for run in runs:
            for angle in (run.theta_deg - 0.5 * run.approach, run.theta_deg):
                wait_until(rotation.move_to(clock.now_s(), angle, 20.0, 80.0))
            linear.place(clock.now_s(), -run.amplitude_mm)
            linear.oscillate(clock.now_s(), run.frequency_hz, [run.amplitude_mm], math.inf)
            run_id = str(len(records) + 1)
            bench.announce_run(len(records) + 1)
            count = round(cycles / run.frequency_hz / period_s)
            first_s = clock.now_s() + 20.0
            trigger.begin(first_s, period_s, count)
            wait_until(first_s + count * period_s)
            edges = trigger.edges(-math.inf, math.inf)[-count:]
            middle = np.array([0.5 * (edges[0] + edges[-1])])
            faces = FACES[axis, configuration]
            conditions = {
                "axis": axis,
                "configuration": configuration,
                "mounting": mounting,
                "theta_deg": run.theta_deg,
                "approach": run.approach,
                "frequency_hz": run.frequency_hz,
                "amplitude_mm": run.amplitude_mm,
                "temperature_c": float(bench.temperature_c(middle)[0]),
                "start_s": float(edges[0]),
                **{f"laser_{i}_face": face for i, face in enumerate(faces, start=1)},
            }
            records.append(RunRecord(run_id, run_id, "", conditions))
            columns[run_id] = {
                "t_s": edges - edges[0],
                "stage_x_mm": linear.sample(edges)[0],
                "accel_v": bench.accelerometer_v(edges),
                **{head: bench.displacement_mm(head)(edges) for head in settings.lasers},
            }
    lasers = {head: LaserInfo(tilt_deg=laser.tilt_deg) for head, laser in settings.lasers.items()}
    header = Header("sensing-axis", constants={"g_m_s2": G, "gain_v_per_m_s2": 100.0}, lasers=lasers)
    return Made(Recording(header, records, columns, ImportReport(len(records))), _truth(bench))


def _truth(bench: AccelerometerBench) -> dict[str, float]:
    found = {}
    mountings: Any = bench.truth()["mountings"]
    for each in mountings:
        label = f"[{each['axis']},{each['configuration']},{each['mounting']}]"
        found[f"theta0{label}"] = each["theta0_deg"]
        found.update({f"delta_{c}{label}": value for c, value in zip("xyz", each["delta_rad"], strict=True)})
    return found


WIDE_DEG = (-140.0, -75.0, -20.0, -1.0, 1.2, 35.0, 90.0, 160.0)


@pytest.fixture
def measure() -> Callable[..., Made]:
    """`measure(effects, wide=False, runs=, mountings=, **settings)`: a recording of a world with these effects."""

    def made(
        effects: dict[str, dict[str, float]],
        wide: bool = False,
        runs: Sequence[Setting] | None = None,
        mountings: Sequence[tuple[str, str, int]] = (("X", "flag", 1),),
        cycles: int = 6,
        **changes: Any,
    ) -> Made:
        chosen = runs or (grid(WIDE_DEG, (0.3, 0.6)) if wide else grid())
        return measured(world(effects=effects, **changes), chosen, mountings, cycles)

    return made
