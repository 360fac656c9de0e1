"""What a study of the null search works on: the runs of a recording, and imagined ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property, partial
from math import degrees, radians

import numpy as np

from rigctl.campaign.recording import RunSource
from rigctl.core.arrays import FloatArray
from rigctl.experiments.sensing_axis.model.chain import Origins
from rigctl.experiments.sensing_axis.model.model import origins_of
from rigctl.experiments.sensing_axis.observe.observables import HARMONICS, Amplitudes, RunObservables, heads_of
from rigctl.experiments.sensing_axis.observe.recorded import recorded_calibration
from rigctl.experiments.sensing_axis.observe.reduction import ACCEL
from rigctl.experiments.sensing_axis.observe.set_points import ROOM_S, SOON_S, Limits, last_of
from rigctl.experiments.sensing_axis.observe.store_reduction import line_scan, reduction
from rigctl.files.package import HeadSettings, Package
from rigctl.workbench.study import Proposal

_NOMINAL_V_RTHZ, _NOMINAL_M_RTHZ, _NOMINAL_DC_V = 3e-4, 1e-8, 1e-3
"""Of noise, before anything has been measured."""

_NOMINAL_C = 20.0

Place = tuple[str, str, int]


def imagined(proposals: Sequence[Proposal], runs: Sequence[RunObservables], limits: Limits) -> list[RunObservables]:
    """Proposals as runs soon after `runs`, in the mounting used last; amplitudes are zero, sigmas as they will be.

    Settings may say also `start_s`; before there are any runs also `axis`, `configuration` and `mounting`.
    """
    # A plan asks before there is a recording.
    common = _after_recorded(runs, limits) if runs else _before_any_run(limits)
    noise = _Noise(runs)
    wait_s = _waits_s(proposals)
    return [_imagined(each, f"imagined {i}", common, noise, wait_s) for i, each in enumerate(proposals)]


@dataclass(frozen=True)
class _Conditions:
    """What runs to come have in common: `place` None where proposals say it, `start_s` NaN where no time is known."""

    place: Place | None
    start_s: float
    temperature_c: Callable[[float], float]
    heads: tuple[str, ...]
    faces: Callable[[Place], Mapping[str, str]]
    in_sight: Callable[[float, float], bool]
    extra: Mapping[str, float] = field(default_factory=dict)


def _after_recorded(runs: Sequence[RunObservables], limits: Limits) -> _Conditions:
    faces = {name: face for run in runs for name, face in run.faces.items()}
    ends = [run.start_s + run.duration_s for run in runs if np.isfinite(run.start_s)]
    # Without a rig file lasers are believed as far out as they have been seen to work.
    farthest_deg = degrees(max((abs(run.theta_rad) for run in runs if run.lasers_m), default=-1.0) + 1e-6)
    return _Conditions(
        place=last_of(runs).place,
        start_s=max(ends) + SOON_S if np.isfinite(runs[-1].start_s) else np.nan,
        temperature_c=_temperature_trend(runs),
        heads=heads_of(runs) or tuple(limits.heads),
        faces=lambda _: faces,
        in_sight=_spots_stay(limits.package) if limits.known else lambda theta_deg, _: theta_deg <= farthest_deg,
        extra=runs[-1].extra,
    )


def _before_any_run(limits: Limits) -> _Conditions:
    def faces(place: Place) -> dict[str, str]:
        axis, configuration, _ = place
        return {name: limits.package.face(axis, configuration, head.position) for name, head in limits.heads.items()}

    return _Conditions(None, SOON_S, lambda _: _NOMINAL_C, tuple(limits.heads), faces, _spots_stay(limits.package))


def _spots_stay(package: Package) -> Callable[[float, float], bool]:
    return lambda theta_deg, amplitude_mm: package.spot_margin_mm(theta_deg, amplitude_mm) >= 0.0


def _waits_s(proposals: Sequence[Proposal]) -> dict[float, float]:
    """Until the room is at each temperature [s], one after the other from the coldest."""
    rooms = sorted({float(each.settings["temperature_c"]) for each in proposals if "temperature_c" in each.settings})
    return {room: ROOM_S * place for place, room in enumerate(rooms, start=1)}


def _imagined(
    proposal: Proposal, run_id: str, common: _Conditions, noise: _Noise, wait_s: Mapping[float, float]
) -> RunObservables:
    given = proposal.settings
    place = common.place or (str(given["axis"]), str(given["configuration"]), int(given["mounting"]))
    theta_deg, amplitude_mm = float(given["theta_deg"]), float(given["amplitude_mm"])
    frequency_hz, dwell_s = float(given["frequency_hz"]), float(given["dwell_s"])
    start_s = float(given.get("start_s", common.start_s + wait_s.get(given.get("temperature_c", np.nan), 0.0)))
    motion = np.zeros(HARMONICS, dtype=np.complex128)
    # X_1 = -iA: x = A sin(w t).
    motion[0] = -1e-3j * amplitude_mm
    heads = common.heads if common.in_sight(abs(theta_deg), amplitude_mm) else ()
    return RunObservables(
        run_id=run_id,
        axis=place[0],
        configuration=place[1],
        mounting=place[2],
        theta_rad=radians(theta_deg),
        approach=float(given["approach"]),
        frequency_hz=frequency_hz,
        temperature_c=float(given.get("temperature_c", common.temperature_c(start_s + 0.5 * dwell_s))),
        start_s=start_s,
        duration_s=dwell_s,
        motion_m=motion,
        accel_v=noise.amplitudes("", place, frequency_hz, dwell_s),
        lasers_m={head: noise.amplitudes(head, place, frequency_hz, dwell_s) for head in heads},
        faces=dict(common.faces(place)),
        extra=common.extra,
    )


def _temperature_trend(runs: Sequence[RunObservables]) -> Callable[[float], float]:
    """The room's temperature in the middle of a run, by that time, if it goes on changing as it did.

    NaN where it was not recorded. No promise rests on it: a straight line in time tells nothing apart from a drift.
    """
    known = np.array([(run.start_s + 0.5 * run.duration_s, run.temperature_c) for run in runs])
    mean_s, mean_c = known.mean(axis=0)
    since_s = known[:, 0] - mean_s
    if len(runs) < 3 or not np.isfinite(known).all() or not since_s.any():
        return lambda _: float(known[-1, 1])
    slope = float(since_s @ known[:, 1] / (since_s @ since_s))
    return lambda middle_s: float(mean_c + slope * (middle_s - mean_s))


class _Noise:
    """Noise of runs to come, from that of runs made: of the nearest frequency, less for longer runs."""

    def __init__(self, runs: Sequence[RunObservables]) -> None:
        self._runs = runs
        self._densities = cache(self._from_runs)

    def amplitudes(self, head: str, place: Place, frequency_hz: float, duration_s: float) -> Amplitudes:
        """Zero, with the sigmas that a run of this length would have."""
        density, mean, dof = self._densities(head, place[:2], frequency_hz)
        clocks = (run.lasers_m[head].clock for run in self._runs if head in run.lasers_m)
        sigma = np.sqrt(density / duration_s)
        # What the mean scatters by from run to run is slower than any run.
        sigma[0] = mean
        # As recorded: of a head on a clock of its own nothing more will be known of the phase.
        clock = next((each for each in clocks if each is not None), None)
        return Amplitudes(np.zeros(HARMONICS + 1, dtype=np.complex128), sigma, dof, clock=clock)

    def _from_runs(
        self, head: str, place: tuple[str, str], frequency_hz: float
    ) -> tuple[FloatArray, float, FloatArray]:
        """Densities of the harmonics [unit^2/Hz], sigma of the mean [unit] and degrees of freedom."""
        alike = [run for run in self._runs if (run.axis, run.configuration) == place] or self._runs
        channels = [(run, run.lasers_m.get(head) if head else run.accel_v) for run in alike]
        known = [(run, channel) for run, channel in channels if channel is not None]
        if not known:
            level = _NOMINAL_M_RTHZ if head else _NOMINAL_V_RTHZ
            return np.full(HARMONICS + 1, level**2), _NOMINAL_DC_V, np.full(HARMONICS + 1, 40.0)
        # Fitted frequencies of one set-point differ in their last digits.
        nearest = min(abs(run.frequency_hz - frequency_hz) for run, _ in known) + 1e-4
        near = [(run, channel) for run, channel in known if abs(run.frequency_hz - frequency_hz) <= nearest]
        # S = sigma^2 T: longer runs know an amplitude better.
        density = np.median([channel.sigma**2 * run.duration_s for run, channel in near], axis=0)
        mean = float(np.median([channel.sigma[0] for _, channel in known]))
        return np.asarray(density), mean, np.median([channel.dof for _, channel in near], axis=0)


class RecordedRuns:
    """The valid runs of a recording, reduced once for each set of lines that are fitted in their samples."""

    def __init__(self, source: RunSource) -> None:
        self.package, self.heads, self.g_m_s2 = recorded_calibration(source.header)
        self.rig_is_known = source.header.rig_toml is not None
        self._source = source
        self.reduction = cache(lambda lines_hz: reduction(source, lines_hz).sorted_by(_contents))
        """The runs in order of time, with lines at these frequencies fitted, and what was left out."""
        self.line_scan = cache(partial(line_scan, source))
        """The spectrum of what the fitted harmonics and these lines leave of the samples."""

    @cached_property
    def origins(self) -> Origins:
        """Where temperature, time and extra columns count from."""
        return origins_of(self.reduction(()).runs)

    @property
    def limits(self) -> Limits:
        """Of the set-points that this bench can be given."""
        channel = self._source.header.channels.get(ACCEL)
        full_scale_v = channel.full_scale if channel else None
        return Limits(self.package, self.heads, full_scale_v, known=self.rig_is_known)


def _contents(run: RunObservables) -> list[float]:
    accel = run.accel_v.value
    return [run.start_s, run.theta_rad, run.frequency_hz, *accel.real, *accel.imag]


@dataclass(frozen=True)
class ScanData:
    """Recorded runs, and `imagined` ones after them."""

    recorded: RecordedRuns
    imagined: tuple[RunObservables, ...] = ()

    def runs(self, lines_hz: tuple[float, ...] = ()) -> tuple[RunObservables, ...]:
        """All runs, with these lines fitted in the samples of the recorded ones."""
        return (*self.recorded.reduction(lines_hz).runs, *self.imagined)

    @property
    def origins(self) -> Origins:
        """Those of the recorded runs: imagined ones must not move them."""
        return self.recorded.origins if self.recorded.reduction(()).runs else origins_of(self.imagined)

    def with_proposals(self, proposals: Sequence[Proposal]) -> ScanData:
        """The recorded runs and those proposed, in the mounting that was used last."""
        return ScanData(self.recorded, tuple(imagined(proposals, self.runs(), self.recorded.limits)))

    def placed_heads(self, runs: Sequence[RunObservables]) -> dict[str, HeadSettings]:
        """Heads of which it is known where they stand: without a rig file the face they look at tells it."""
        heads = self.recorded.heads
        if self.recorded.rig_is_known:
            return dict(heads)
        faceless = {head for run in runs for head in run.lasers_m if head not in run.faces}
        return {name: head for name, head in heads.items() if name not in faceless}
