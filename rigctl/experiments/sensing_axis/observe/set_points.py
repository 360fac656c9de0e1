"""Which runs could be made next in the mounting that is there."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import degrees, inf, pi, radians, sin

import numpy as np

from rigctl.experiments.sensing_axis.observe.observables import RunObservables
from rigctl.files.package import HeadSettings, Package
from rigctl.workbench.study import Proposal

ANGLES_DEG = (0.4, 0.8, 1.6, 5.0, 10.0, 20.0, 30.0, 45.0, 60.0, 90.0)
FREQUENCIES_HZ = (0.3, 0.4, 0.5, 0.6, 0.8, 1.0)
DWELLS_S = (10.0, 20.0, 60.0)
OVERHEAD_S = 15.0
"""Turning, settling, arming and read-out, where the recording does not tell."""

SOON_S = 300.0
"""Into the time when the next runs are made."""

ROOM_S = 3600.0
"""Until room and bench have followed the air conditioning."""

ROOM_K = 1.0
"""How far from its mean a room can be taken."""

_SAME_K = 1e-3


@dataclass(frozen=True)
class Limits:
    """What the bench allows beyond what a recording shows; None without a rig file."""

    package: Package
    heads: Mapping[str, HeadSettings]
    full_scale_v: float | None
    known: bool


def options(runs: Sequence[RunObservables], limits: Limits) -> list[Proposal]:
    """Set-points for the next runs: those used in the mounting that is there, and around them what the bench allows.

    Without a rig file nothing farther out than the recording shows to have been possible. In a room at another
    temperature only those used, so that nothing but the room differs.
    """
    here = [run for run in runs if run.place == last_of(runs).place]
    angles, frequencies = _used(degrees(run.theta_rad) for run in here), _used(run.frequency_hz for run in here)
    dwells = sorted({*DWELLS_S, *(float(round(run.duration_s)) for run in here)})
    overhead_s = overhead(runs)
    places = _places(runs, limits, _angles(runs, angles, limits), _frequencies(runs, limits))
    proposals = [_proposal(each, dwell_s, overhead_s) for each, dwell_s in itertools.product(places, dwells)]
    again = _places(runs, limits, angles, frequencies)
    for room in rooms(runs):
        proposals += [_proposal(each, dwells[-1], overhead_s, room) for each in again]
    return proposals


def overhead(runs: Sequence[RunObservables]) -> float:
    """Rig time between runs [s], as the recording shows it."""
    starts = np.array([run.start_s for run in runs])
    if len(runs) < 3 or not np.isfinite(starts).all():
        return OVERHEAD_S
    order = np.argsort(starts)
    # From the end of a run to the beginning of the next.
    gaps = np.diff(starts[order]) - np.array([runs[i].duration_s for i in order[:-1]])
    return float(np.median(np.maximum(gaps, 0.0)))


def last_of(runs: Sequence[RunObservables]) -> RunObservables:
    """The run made last; where times are not known one of the last mounting, since these are counted."""
    timed = all(np.isfinite(run.start_s) for run in runs)
    return max(runs, key=lambda run: run.start_s if timed else run.mounting)


@dataclass(frozen=True)
class _SetPoint:
    theta_deg: float
    frequency_hz: float
    amplitude_mm: float
    approach: int


def _places(
    runs: Sequence[RunObservables], limits: Limits, angles: Sequence[float], frequencies: Sequence[float]
) -> list[_SetPoint]:
    """Where the sensor's output stays in its range, reached from either side."""
    last = last_of(runs)
    amplitudes = _used(round(1e3 * run.amplitude_m, 2) for run in runs)
    grid = [
        (angle, frequency, _largest(last, limits, angle, frequency, amplitude))
        for angle, frequency, amplitude in itertools.product(angles, frequencies, amplitudes)
    ]
    # Halved amplitudes may meet others of the grid.
    return [_SetPoint(*each, approach) for each in dict.fromkeys(grid) if each[2] for approach in (1, -1)]


def _proposal(place: _SetPoint, dwell_s: float, overhead_s: float, room: float | None = None) -> Proposal:
    settings = {**vars(place), "dwell_s": dwell_s}
    if room is None:
        return Proposal(settings, dwell_s + overhead_s)
    return Proposal({**settings, "temperature_c": room}, dwell_s + overhead_s, f"room at {room:g} C", ROOM_S)


def _angles(runs: Sequence[RunObservables], used: Sequence[float], limits: Limits) -> list[float]:
    low, high = (f(degrees(run.theta_rad) for run in runs) for f in (min, max))
    grid = [sign * angle for angle in ANGLES_DEG for sign in (-1.0, 1.0)]
    return _used([*used, *(angle for angle in grid if limits.known or low <= angle <= high)])


def _frequencies(runs: Sequence[RunObservables], limits: Limits) -> list[float]:
    used = _used(run.frequency_hz for run in runs)
    return _used([*used, *(f for f in FREQUENCIES_HZ if limits.known or used[0] <= f <= used[-1])])


def peak_output_v(
    package: Package, axis: str, configuration: str, theta_deg: float, frequency_hz: float, amplitude_mm: float
) -> float:
    """What a sensor gives up to [V] at a set-point, as far as its gain and the level of a mounting are known."""
    sensor = package.axes[axis].sensor[configuration]
    w = 2.0 * pi * frequency_hz
    # |H| of eq. 1: near its resonance a sensor saturates at a fraction of the force.
    response = 1.0 / abs(complex(1.0 - w**2 * sensor.inv_w0_squared, w * sensor.damping))
    force_m_s2 = 1e-3 * amplitude_mm * w**2 * abs(sin(radians(theta_deg)))
    # Added without regard to sign: the swing has both.
    return sensor.gain_v_per_m_s2 * response * force_m_s2 + package.level_limit_v


def _largest(
    last: RunObservables, limits: Limits, theta_deg: float, frequency_hz: float, amplitude_mm: float
) -> float:
    """The amplitude, or half or a quarter of it where it would take the output out of its range; 0 for none."""
    range_v = inf if limits.full_scale_v is None else limits.full_scale_v
    for part in (amplitude_mm, 0.5 * amplitude_mm, 0.25 * amplitude_mm):
        if peak_output_v(limits.package, last.axis, last.configuration, theta_deg, frequency_hz, part) < range_v:
            return part
    return 0.0


def rooms(runs: Sequence[RunObservables]) -> list[float]:
    """Room temperatures an operator might bring about: none where the recording shows none that differ."""
    known = np.array([run.temperature_c for run in runs])
    if not np.isfinite(known).all() or np.ptp(known) <= _SAME_K:
        return []
    reach = max(float(np.ptp(known)) / 2.0, ROOM_K)
    # Both ways: a coefficient shows in the difference.
    return [round(float(known.mean()) - reach, 1), round(float(known.mean()) + reach, 1)]


def _used(values: Iterable[float]) -> list[float]:
    return sorted({round(float(value), 4) for value in values})
