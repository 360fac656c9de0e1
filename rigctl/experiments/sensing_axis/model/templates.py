"""What goes in proportion to the sensor's signal, and its curve of third order, as all its harmonics see them.

A gain that follows a condition changes every run by what that run reads, whatever its angle, frequency, amplitude and
configuration. Shapes of a series, which know one power of the frequency and one harmonic of the angle, each show a
part of it; and what bends the response is seen at the drive's frequency and at its multiples.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rigctl.core.arrays import BoolArray, ComplexArray, FloatArray
from rigctl.experiments.sensing_axis.model.chain import GRID_POINTS, amplitudes
from rigctl.experiments.sensing_axis.observe.observables import HARMONICS, RunObservables
from rigctl.workbench.study import OF_SIGNAL, SIGNAL

POWERS = (1, 2)
"""Of a condition that a gain follows."""

_NO_CONDITIONS = ("theta_deg", "mounting")
# Of so few different values a square says nothing that a straight line does not.
_BENT_FROM = 4
_NU_IN_PHASE = 1


def templates(
    runs: Sequence[RunObservables], covariates: Mapping[str, FloatArray], present: BoolArray
) -> dict[tuple[int, str], FloatArray]:
    """`Observations.templates` at the data `present` (runs, series), whose first series are the sensor's.

    `covariates` are columns over the runs.
    """
    signal_v = _signal_v(runs)
    usual_v = float(np.sqrt(np.mean(signal_v**2)))
    if not usual_v > 0.0:  # runs to come have no readings
        return {}
    # Of a signal of usual size.
    share = np.zeros((len(runs), HARMONICS), dtype=np.complex128)
    share[:, 0] = signal_v / usual_v
    found = {}
    for name, away in _followed(covariates):
        found[_NU_IN_PHASE, OF_SIGNAL + name] = _at(present, np.asarray(share * away[:, None], dtype=np.complex128))
    found[_NU_IN_PHASE, f"{SIGNAL}^3"] = _at(present, _cubed(share, _force(runs)))
    return {key: column for key, column in found.items() if column.any()}


def _signal_v(runs: Sequence[RunObservables]) -> FloatArray:
    """In phase with the drive, what each mounting's readings are by the sine and cosine of its angles [V], (runs,).

    Not the readings themselves: their noise is that of what a fit leaves, and a shape made of it would find itself.
    """
    read_v = np.array([run.accel_v.value[1].real for run in runs])
    force = np.array([run.peak_acceleration_m_s2 * np.exp(1j * run.theta_rad) for run in runs])
    signal_v = np.zeros(len(runs))
    for place in dict.fromkeys(run.place for run in runs):
        rows = np.flatnonzero([run.place == place for run in runs])
        columns = np.stack([force[rows].imag, force[rows].real], axis=1)
        signal_v[rows] = columns @ np.linalg.lstsq(columns, read_v[rows], rcond=None)[0]
    return signal_v


def _followed(covariates: Mapping[str, FloatArray]) -> list[tuple[str, FloatArray]]:
    """Powers of the conditions of runs in standard deviations from their mean."""
    found = []
    for name, values in covariates.items():
        if name in _NO_CONDITIONS or not np.isfinite(values).all() or not np.ptp(values) > 0.0:
            continue
        away = (values - values.mean()) / values.std()
        for power in POWERS if len(np.unique(values)) >= _BENT_FROM else POWERS[:1]:
            found.append((name if power == 1 else f"{name}^{power}", away**power))
    return found


def _force(runs: Sequence[RunObservables]) -> FloatArray:
    """The varying force along the sensing axis, of usual size 1: where gains differ, a curve is one of the force."""
    force = np.array([run.peak_acceleration_m_s2 * np.sin(run.theta_rad) for run in runs])
    size = float(np.sqrt(np.mean(force**2)))
    return force / size if size > 0.0 else force


def _cubed(signal: ComplexArray, force: FloatArray) -> ComplexArray:
    """Harmonics of the cube of a sine of unit amplitude, times the signal and the square of the force."""
    phase = 2.0 * np.pi * np.arange(GRID_POINTS) / GRID_POINTS
    cube = amplitudes(np.sin(phase)[None, :] ** 3, HARMONICS)[:, 1:]
    return np.asarray(signal[:, :1].real * force[:, None] ** 2 * cube)


def _at(present: BoolArray, lines: ComplexArray) -> FloatArray:
    """Harmonics of the sensor, (runs, HARMONICS), at the data there are."""
    column = np.zeros(present.shape)
    column[:, 1 : 1 + 2 * HARMONICS] = np.stack([lines.real, lines.imag], axis=-1).reshape(len(lines), -1)
    return column[present]
