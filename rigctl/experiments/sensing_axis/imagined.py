"""Runs that could be made next in the mounting that is there, and what they would be like as observables."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import radians

import numpy as np

from rigctl.experiments.sensing_axis.observables import HARMONICS, Amplitudes, RunObservables, heads_of
from rigctl.experiments.sensing_axis.package import HeadSettings, Package
from rigctl.workbench.study import Proposal

ANGLES_DEG = (0.4, 0.8, 1.6, 5.0, 10.0, 20.0, 30.0, 45.0, 60.0, 90.0)
FREQUENCIES_HZ = (0.3, 0.4, 0.5, 0.6, 0.8, 1.0)
DWELLS_S = (10.0, 20.0, 60.0)
OVERHEAD_S = 15.0
"""Turning, settling, arming and read-out, where the recording does not tell."""

ROOM_S = 1800.0
"""Until room and bench have followed the air conditioning."""

SOON_S = 300.0
"""Into the time when the next runs are made."""

ROOM_K = 1.0
"""How far from its mean a room can be taken."""

_SAME_K = 1e-3
_NOMINAL_V_RTHZ, _NOMINAL_M_RTHZ, _NOMINAL_DC_V = 3e-4, 1e-8, 1e-3
"""Of noise, before anything has been measured."""


@dataclass(frozen=True)
class Limits:
    """What the bench allows beyond what a recording shows; None without a rig file."""

    package: Package
    heads: Mapping[str, HeadSettings]
    full_scale_v: float | None
    known: bool


def options(runs: Sequence[RunObservables], limits: Limits) -> list[Proposal]:
    """Set-points for the next runs: those used, and around them what the bench allows.

    Without a rig file nothing farther out than the recording shows to have been possible.
    """
    last = _last(runs)
    angles = _used(float(np.degrees(run.theta_rad)) for run in runs)
    frequencies = _used(run.frequency_hz for run in runs)
    amplitudes = _used(round(1e3 * run.amplitude_m, 2) for run in runs)
    dwells = sorted({*DWELLS_S, *(float(round(run.duration_s)) for run in runs)})
    more = [sign * angle for angle in ANGLES_DEG for sign in (-1.0, 1.0)]
    if limits.known:
        angles, frequencies = _used([*angles, *more]), _used([*frequencies, *FREQUENCIES_HZ])
    else:
        angles = _used([*angles, *(each for each in more if angles[0] <= each <= angles[-1])])
        frequencies = _used([*frequencies, *(f for f in FREQUENCIES_HZ if frequencies[0] <= f <= frequencies[-1])])
    overhead_s = overhead(runs)
    rooms = _rooms(runs)
    places = [
        (angle_deg, frequency_hz, _largest(last, limits, angle_deg, frequency_hz, amplitude_mm))
        for angle_deg, frequency_hz, amplitude_mm in itertools.product(angles, frequencies, amplitudes)
    ]
    grid = itertools.product(dict.fromkeys(places), (1, -1), dwells, rooms)
    return [
        Proposal(
            {
                "angle_deg": angle_deg,
                "frequency_hz": frequency_hz,
                "amplitude_mm": amplitude_mm,
                "approach": approach,
                "dwell_s": dwell_s,
                **({} if room is None else {"temperature_c": room}),
            },
            dwell_s + overhead_s + (0.0 if room is None else ROOM_S),
        )
        for (angle_deg, frequency_hz, amplitude_mm), approach, dwell_s, room in grid
        if amplitude_mm and (room is None or dwell_s == dwells[-1])
    ]


def imagined(proposals: Sequence[Proposal], runs: Sequence[RunObservables], limits: Limits) -> list[RunObservables]:
    """Proposals as runs soon after `runs`, in the mounting used last; amplitudes are zero, sigmas as they will be.

    Settings may say also `start_s`; before there are any runs also `axis`, `configuration` and `mounting`.
    """
    noise = _NoiseOf(runs)
    end_s = max((run.start_s + run.duration_s for run in runs if np.isfinite(run.start_s)), default=0.0)
    return [_imagined(each, number, noise, runs, limits, end_s + SOON_S) for number, each in enumerate(proposals)]


def overhead(runs: Sequence[RunObservables]) -> float:
    """Rig time between runs [s], as the recording shows it."""
    starts = np.array([run.start_s for run in runs])
    if len(runs) < 3 or not np.isfinite(starts).all():
        return OVERHEAD_S
    order = np.argsort(starts)
    gaps = np.diff(starts[order]) - np.array([runs[i].duration_s for i in order[:-1]])
    return float(np.median(np.maximum(gaps, 0.0)))


def _imagined(
    proposal: Proposal,
    number: int,
    noise: _NoiseOf,
    runs: Sequence[RunObservables],
    limits: Limits,
    start_s: float,
) -> RunObservables:
    given = proposal.settings
    place = _place(runs) if runs else (str(given["axis"]), str(given["configuration"]), int(given["mounting"]))
    axis, configuration, mounting = place
    start_s = float(given.get("start_s", start_s))
    amplitude_m = 1e-3 * float(given["amplitude_mm"])
    motion = np.zeros(HARMONICS, dtype=np.complex128)
    motion[0] = -1j * amplitude_m
    frequency_hz, dwell_s = float(given["frequency_hz"]), float(given["dwell_s"])
    heads = noise.heads or tuple(limits.heads)
    seen = heads if _lasers_see(runs, limits, float(given["angle_deg"]), float(given["amplitude_mm"])) else ()
    last = runs[-1] if runs else None
    return RunObservables(
        run_id=f"imagined {number}",
        axis=axis,
        configuration=configuration,
        mounting=mounting,
        theta_rad=radians(float(given["angle_deg"])),
        approach=float(given["approach"]),
        frequency_hz=frequency_hz,
        temperature_c=float(given.get("temperature_c", _going_on(runs, start_s))),
        start_s=start_s if last is None or np.isfinite(last.start_s) else np.nan,
        duration_s=dwell_s,
        motion_m=motion,
        accel_v=noise.amplitudes("", place, frequency_hz, dwell_s),
        lasers_m={head: noise.amplitudes(head, place, frequency_hz, dwell_s) for head in seen},
        faces={name: face for run in runs for name, face in run.faces.items()}
        if last
        else {n: limits.package.face(axis, configuration, h.position) for n, h in limits.heads.items()},
        extra=last.extra if last else {},
    )


def _going_on(runs: Sequence[RunObservables], start_s: float) -> float:
    """The room's temperature if it goes on changing as it did; NaN where it was not recorded."""
    if not runs:
        return 20.0
    known = np.array([(run.start_s, run.temperature_c) for run in runs])
    if len(runs) < 3 or not np.isfinite(known).all() or np.ptp(known[:, 0]) <= 0.0:
        return float(known[-1, 1])
    since = known[:, 0] - known[:, 0].mean()
    slope = float(since @ known[:, 1] / (since @ since))
    return float(known[:, 1].mean() + slope * (start_s - known[:, 0].mean()))


class _NoiseOf:
    """Noise of runs to come, from that of runs made: of the nearest frequency, less for longer runs."""

    def __init__(self, runs: Sequence[RunObservables]) -> None:
        self._runs = runs
        self.heads = heads_of(runs)
        self._kept: dict[tuple[str, str, str, float], tuple[np.ndarray, float, np.ndarray]] = {}

    def amplitudes(
        self, head: str, place: tuple[str, str, int], frequency_hz: float, duration_s: float
    ) -> Amplitudes:
        """Zero, with the sigmas that a run of this length would have."""
        density, mean, dof = self._density(head, place, frequency_hz)
        sigma = np.sqrt(density / duration_s)
        # What the mean scatters by from run to run is slower than any run.
        sigma[0] = mean
        return Amplitudes(np.zeros(HARMONICS + 1, dtype=np.complex128), sigma, dof)

    def _density(
        self, head: str, place: tuple[str, str, int], frequency_hz: float
    ) -> tuple[np.ndarray, float, np.ndarray]:
        key = (head, place[0], place[1], frequency_hz)
        if key not in self._kept:
            self._kept[key] = self._found(head, place, frequency_hz)
        return self._kept[key]

    def _found(
        self, head: str, place: tuple[str, str, int], frequency_hz: float
    ) -> tuple[np.ndarray, float, np.ndarray]:
        alike = [run for run in self._runs if (run.axis, run.configuration) == place[:2]] or self._runs
        own = [(run, run.lasers_m.get(head) if head else run.accel_v) for run in alike]
        known = [(run, channel) for run, channel in own if channel is not None]
        if not known:
            level = _NOMINAL_M_RTHZ if head else _NOMINAL_V_RTHZ
            return np.full(HARMONICS + 1, level**2), _NOMINAL_DC_V, np.full(HARMONICS + 1, 40.0)
        nearest = min(abs(run.frequency_hz - frequency_hz) for run, _ in known) + 1e-4
        near = [(run, channel) for run, channel in known if abs(run.frequency_hz - frequency_hz) <= nearest]
        density = np.median([channel.sigma**2 * run.duration_s for run, channel in near], axis=0)
        mean = float(np.median([channel.sigma[0] for _, channel in known]))
        return density, mean, np.median([channel.dof for _, channel in near], axis=0)


def _last(runs: Sequence[RunObservables]) -> RunObservables:
    return max(runs, key=lambda run: run.start_s) if all(np.isfinite(run.start_s) for run in runs) else runs[-1]


def _place(runs: Sequence[RunObservables]) -> tuple[str, str, int]:
    last = _last(runs)
    return last.axis, last.configuration, last.mounting


def _lasers_see(runs: Sequence[RunObservables], limits: Limits, angle_deg: float, amplitude_mm: float) -> bool:
    if limits.known or not runs:
        return limits.package.spot_margin_mm(angle_deg, amplitude_mm) >= 0.0
    seen = [abs(run.theta_rad) for run in runs if run.lasers_m]
    return radians(abs(angle_deg)) <= max(seen, default=-1.0) + 1e-6


def _within(last: RunObservables, limits: Limits, angle_deg: float, frequency_hz: float, amplitude_mm: float) -> bool:
    """The sensor's output within its range, as far as that is known."""
    if limits.full_scale_v is None:
        return True
    sensor = limits.package.axes[last.axis].sensor[last.configuration]
    w = 2.0 * np.pi * frequency_hz
    response = 1.0 / abs(complex(1.0 - w**2 * sensor.inv_w0_squared, w * sensor.damping))
    force_m_s2 = 1e-3 * amplitude_mm * w**2 * abs(np.sin(radians(angle_deg)))
    return bool(sensor.gain_v_per_m_s2 * response * force_m_s2 + limits.package.level_limit_v < limits.full_scale_v)


def _largest(
    last: RunObservables, limits: Limits, angle_deg: float, frequency_hz: float, amplitude_mm: float
) -> float:
    """The amplitude, or half or a quarter of it where it would take the output out of its range; 0 for none."""
    parts = (amplitude_mm, 0.5 * amplitude_mm, 0.25 * amplitude_mm)
    return next((part for part in parts if _within(last, limits, angle_deg, frequency_hz, part)), 0.0)


def _rooms(runs: Sequence[RunObservables]) -> list[float | None]:
    """Room temperatures an operator might bring about: none where the recording shows none that differ."""
    known = np.array([run.temperature_c for run in runs])
    if not np.isfinite(known).all() or np.ptp(known) <= _SAME_K:
        return [None]
    reach = max(float(np.ptp(known)) / 2.0, ROOM_K)
    return [None, round(float(known.mean()) - reach, 1), round(float(known.mean()) + reach, 1)]


def _used(values: Iterable[float]) -> list[float]:
    return sorted({round(float(value), 4) for value in values})
