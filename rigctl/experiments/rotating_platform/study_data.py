"""What a study of the rotating platform works on: the runs of a recording, reduced, and runs that are proposed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache, partial
from typing import Any

import numpy as np

from rigctl.analysis.kept import Kept
from rigctl.campaign.recording import RunSource
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ConfigError, DataError
from rigctl.experiments.rotating_platform.model.recorded_runs import Recorded
from rigctl.experiments.rotating_platform.observe.cells import Cells
from rigctl.experiments.rotating_platform.observe.channel_runs import (
    ChannelRun,
    channel_run,
    channel_runs,
    noise_recipe,
)
from rigctl.experiments.rotating_platform.observe.cutter import cells_of
from rigctl.experiments.rotating_platform.observe.line_spectra import Spectra
from rigctl.experiments.rotating_platform.observe.observables import known_start_s
from rigctl.experiments.rotating_platform.observe.patterns import MODULATED, Pattern, named_pattern
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS, Chains, chains
from rigctl.experiments.rotating_platform.observe.reducer import Reducer
from rigctl.experiments.rotating_platform.observe.run_noise import RunNoise
from rigctl.experiments.rotating_platform.observe.store_reduction import PlatformRun, contents_of, reduction, scan
from rigctl.workbench.study import Proposal

PATTERNS = ("b", "c")
# Periods and levels of the paper; of its patterns those that a drifting bias does not leak through.
PERIODS_S = (60.0, 300.0, 1200.0)
LEVELS_V = (0.0, 0.5, 1.0, 1.5)
TURNS_S = (2.5, 3.2)
"""Half turns that are faster than usual: what is left of a motion goes as their third power."""

LASTS_S = 3600.0
"""About so long is a run that is proposed."""

SAMPLE_RATE_HZ = 10.0
BETWEEN_S = 120.0
"""Setting the tilt and waiting until the pendulum is at rest."""

_UNIT = Chains(
    gain_v_per_m_s2={"z": 1.0, "y": 1.0},
    command_v_per_m_s2={"z": 1.0, "y": 1.0},
    bias_v={},
    full_scale_v={"z": math.inf, "y": math.inf},
    g_m_s2=9.81,
)


# Each question that is asked about proposals asks about the same ones.
@lru_cache(maxsize=64)
def imagined_cells(
    pattern: Pattern,
    periods: int,
    sample_rate_hz: float = SAMPLE_RATE_HZ,
    *,
    c_z_m_s2: float = 0.0,
    c_y_m_s2: float = 0.0,
    mask_short_s: float = 0.0,
    forward: bool = False,
) -> Cells:
    """The cells of a run of `periods` with nothing read; half turns are cycloids, back and forth or all `forward`.

    `mask_short_s` ends the mask so much before the motion.
    """
    samples_made = round(periods * pattern.period_s * sample_rate_hz)
    t_s: FloatArray = np.asarray((np.arange(samples_made) + 0.5) / sample_rate_hz)
    theta, moving = _course(pattern, periods, t_s, mask_short_s, forward)
    # Readings are not known; all that is asked of a proposal are derivatives and sigmas.
    nothing = np.zeros(t_s.size)
    samples = {
        "t_s": t_s,
        "q_a_v": nothing,
        "q_b_v": nothing,
        "theta_deg": np.rad2deg(theta),
        "moving": moving,
        "dm1_z_v": np.full(t_s.size, c_z_m_s2),
        "dm1_y_v": np.full(t_s.size, c_y_m_s2),
    }
    given = {"guard_s": pattern.guard_s, "lead_s": pattern.lead_s}
    return cells_of([samples], _UNIT, pattern.period_s, sample_rate_hz, **given)


def _course(
    pattern: Pattern, periods: int, t_s: FloatArray, mask_short_s: float, forward: bool
) -> tuple[FloatArray, FloatArray]:
    stop = 0.0 if pattern.dwells[0].sign > 0 else math.pi
    theta, moving = np.full(t_s.size, stop), np.zeros(t_s.size)
    # A pattern that begins in the middle of a turn (a) has no dwell before.
    moving[t_s < pattern.dwells[0].start_s] = 1.0
    for number in range(periods):
        for turn in pattern.turns:
            begin_s = number * pattern.period_s + turn.start_s
            target = stop + math.pi if forward else (0.0 if turn.to_sign > 0 else math.pi)
            end_s = begin_s + pattern.rotation_s
            begin, masked, end = np.searchsorted(t_s, (begin_s, end_s - mask_short_s, end_s))
            phase = 2.0 * np.pi * (t_s[begin:end] - begin_s) / pattern.rotation_s
            theta[begin:end] = stop + (target - stop) * (phase - np.sin(phase)) / (2.0 * np.pi)
            theta[end:] = target
            moving[begin:masked] = 1.0
            stop = target
    return theta, moving


def options(seen: Sequence[PlatformRun]) -> list[Proposal]:
    """Patterns, periods and tilts for the next runs, of an hour each; a tilt across too, which few runs have.

    At the shortest period, faster turns, and turns that all go forward: then the stop says nothing of the direction.
    """
    tilts = [*((level, 0.0) for level in LEVELS_V), (0.0, 1.0)]
    ways: list[dict[str, Any]] = [*({"rotation_s": turn_s} for turn_s in TURNS_S), {"turning": "forward"}]
    proposals = []
    for name in PATTERNS:
        proposals += [_proposal(seen, name, period_s, *tilt) for period_s in PERIODS_S for tilt in tilts]
        proposals += [_proposal(seen, name, PERIODS_S[0], *tilts[-1], **way) for way in ways]
    return proposals


def _proposal(
    seen: Sequence[PlatformRun], pattern: str, period_s: float, v_z: float, v_y: float, **way: Any
) -> Proposal:
    periods = max(round(LASTS_S / period_s), 3)
    settings = {
        "pattern": pattern,
        "modulation_period_s": period_s,
        "periods": periods,
        "v_z_v": v_z,
        "v_y_v": v_y,
        "sample_rate_hz": seen[-1].cells.sample_rate_hz if seen else SAMPLE_RATE_HZ,
        **way,
    }
    return Proposal(settings, periods * period_s + BETWEEN_S)


def imagined_channels(proposals: Sequence[Proposal], seen: Sequence[ChannelRun], chains: Chains) -> list[ChannelRun]:
    """The proposed runs in both channels, with the noise of the last run there was."""
    channels: list[ChannelRun] = []
    noises: dict[str, RunNoise] = {each.channel: each.noise for each in seen}
    # After everything there is: drifts and tides go on in time.
    later_s = max((_end_s(each.run) for each in seen), default=0.0) + BETWEEN_S
    for number, proposal in enumerate(proposals, start=1):
        given = proposal.settings
        cells = _cells(given, chains)
        conditions = {**given, "external": "constant", "temperature_c": math.nan, "start_s": later_s}
        run = PlatformRun(f"next {number}", conditions, cells)
        channels += [channel_run(run, Reducer(cells, channel), noises[channel]) for channel in CHANNELS]
    return channels


def _cells(given: Mapping[str, Any], chains: Chains) -> Cells:
    name = str(given["pattern"])
    if name == "custom":
        raise ConfigError("a custom pattern cannot be proposed: name a, b, c or c_tm")
    return imagined_cells(
        named_pattern(name, float(given["modulation_period_s"]), given.get("rotation_s")),
        int(given["periods"]),
        float(given.get("sample_rate_hz", SAMPLE_RATE_HZ)),
        c_z_m_s2=float(given["v_z_v"]) / chains.command_v_per_m_s2["z"],
        c_y_m_s2=float(given.get("v_y_v", 0.0)) / chains.command_v_per_m_s2["y"],
        forward=given.get("turning") == "forward",
    )


def _end_s(run: PlatformRun) -> float:
    return known_start_s(run.conditions) + run.cells.periods * run.cells.period_s


@dataclass(frozen=True)
class ReducedRuns:
    """All valid runs with some lines taken off their samples; `left_out` says by run_id why one is not among them."""

    runs: tuple[PlatformRun, ...]
    channels: Recorded
    spectra: Spectra
    left_out: Mapping[str, str]


class RecordedRuns:
    """The runs of a recording, reduced once for each set of lines that are taken off their samples."""

    def __init__(self, source: RunSource) -> None:
        self.source = source
        self.reduced = cache(partial(_reduced, source))
        """All runs without these lines; `DataError` when there are none."""


def _reduced(source: RunSource, lines_hz: tuple[float, ...]) -> ReducedRuns:
    reduced = reduction(source, lines_hz).sorted_by(contents_of)
    channels, refused = channel_runs(reduced.runs, Kept(source, noise_recipe(lines_hz)))
    left_out = {**reduced.left_out, **refused}
    if not channels:
        modulated = [record for record in source.runs() if record.conditions["pattern"] in MODULATED]
        invalid = [f"run {record.run_id} is invalid: {record.reason}" for record in modulated if not record.valid]
        why = next(iter([*left_out.values(), *invalid]), "it has no modulated run")
        raise DataError(f"no valid run could be reduced: {why}")
    runs = tuple({each.run.run_id: each.run for each in channels}.values())
    spectra = scan(source, runs, lines_hz)
    recorded = Recorded(tuple(channels), chains(source.header).g_m_s2, peaks=spectra.peaks)
    return ReducedRuns(runs, recorded, spectra, left_out)


class PlatformData:
    """Recorded runs, and `proposals` as if they had been made after them."""

    def __init__(self, recorded: RecordedRuns, proposals: Sequence[Proposal] = ()) -> None:
        self.recorded = recorded
        self._extended = cache(partial(_with_proposals, recorded, proposals)) if proposals else None

    def channels(self, lines_hz: tuple[float, ...] = ()) -> Recorded:
        """All runs in both channels, with these lines taken off the samples of the recorded ones."""
        return self._extended(lines_hz) if self._extended else self.recorded.reduced(lines_hz).channels

    @cached_property
    def temperature_varies_within_runs(self) -> bool:
        """Whether the temperature is known everywhere and changes within at least one run."""
        channels = self.channels()
        varies = any(np.ptp(each.run.cells.state[:, 2]) > 0.0 for each in channels.channels)
        return varies and bool(np.isfinite(channels.chain["z"].temperature).all())

    @cached_property
    def times_are_known(self) -> bool:
        """Whether every run says when it began."""
        starts_s = [float(each.run.conditions.get("start_s", np.nan)) for each in self.channels().channels]
        return bool(np.isfinite(starts_s).all())


def _with_proposals(recorded: RecordedRuns, proposals: Sequence[Proposal], lines_hz: tuple[float, ...]) -> Recorded:
    made = recorded.reduced(lines_hz).channels
    further = imagined_channels(proposals, made.channels, chains(recorded.source.header))
    imagined = frozenset(each.run.run_id for each in further)
    return replace(made, channels=(*made.channels, *further), imagined=imagined)
