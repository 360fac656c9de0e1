"""All runs on one period of the drive, as effects see them: a row for each run, SI."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigctl.core.arrays import ComplexArray, FloatArray
from rigctl.core.errors import DataError
from rigctl.effects.trial import AnyColumns
from rigctl.experiments.frequency_response.observables import Sensitivity

POINTS = 32
"""Of a period: a cube of the signal has its third harmonic."""


@dataclass(frozen=True)
class ShakenRuns:
    """Runs by points of a period. `x`, `v`, `a` are the motion along the stage's positive travel.

    `direction` is that of the sensing axis, `acceleration` the amplitude of `a`, `start` the middle of a run;
    `start_0` and `temperature_0` are means. Times begin at the displacement's positive maximum.
    """

    t: FloatArray
    x: FloatArray
    v: FloatArray
    a: FloatArray
    omega: FloatArray
    direction: FloatArray
    acceleration: FloatArray
    temperature: FloatArray
    start: FloatArray
    temperature_0: float
    start_0: float
    g: float
    columns: Mapping[str, FloatArray]
    signal: FloatArray

    def column(self, name: str) -> FloatArray:
        """A laboratory's own column of runs.csv; `DataError` when there is none of this name."""
        if name not in self.columns:
            raise DataError(f"the recording has no column '{name}'; it has {', '.join(self.columns) or 'none'}")
        return self.columns[name]

    def through(self, response: Callable[[ComplexArray], ComplexArray]) -> FloatArray:
        """The signal behind something linear of this response, a function of s = i w."""
        lines = np.asarray(np.fft.rfft(self.signal, axis=1), dtype=np.complex128)
        s = np.asarray(1j * self.omega * np.arange(lines.shape[1]), dtype=np.complex128)
        passed = lines * response(s)
        # Half the sampling rate has no phase; nothing of the drive is there.
        passed[:, -1] = 0.0
        return np.asarray(np.fft.irfft(passed, POINTS, axis=1))


def shaken(runs: Sequence[Sensitivity], g_m_s2: float) -> ShakenRuns:
    """The runs of a recording, their displacement taken as the pure sine of its amplitude."""

    def column(values: Sequence[float]) -> FloatArray:
        return np.array(values, dtype=np.float64)[:, None]

    names = dict.fromkeys(name for run in runs for name in run.conditions)
    return periodic(
        column([run.omega for run in runs]),
        column([run.acceleration_m_s2 for run in runs]),
        column([float(run.direction) for run in runs]),
        column([run.number("temperature_c") for run in runs]),
        column([run.number("start_s") + 0.5 * run.duration_s for run in runs]),
        g_m_s2,
        {name: column([run.number(name) for run in runs]) for name in names},
    )


def periodic(
    omega: FloatArray,
    acceleration: FloatArray,
    direction: FloatArray,
    temperature: FloatArray,
    start: FloatArray,
    g_m_s2: float,
    columns: Mapping[str, FloatArray],
) -> ShakenRuns:
    """Sines of these frequencies and amplitudes, a row each; the signal is the force along the sensing axis."""
    phase = 2.0 * np.pi * np.arange(POINTS) / POINTS
    amplitude = acceleration / omega**2
    a = -acceleration * np.cos(phase)
    return ShakenRuns(
        t=phase / omega,
        x=amplitude * np.cos(phase),
        v=-amplitude * omega * np.sin(phase),
        a=a,
        omega=omega,
        direction=direction,
        acceleration=acceleration,
        temperature=temperature,
        start=start,
        temperature_0=_mean(temperature),
        start_0=_mean(start),
        g=g_m_s2,
        columns=columns,
        signal=direction * a,
    )


def _mean(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else float("nan")


def fundamental(runs: ShakenRuns, signal: FloatArray) -> ComplexArray:
    """The complex amplitude of a signal over that of the acceleration along the sensing axis, shape (runs,)."""
    # Time is counted from the positive maximum of the displacement: the acceleration's amplitude is -acceleration.
    amplitude = 2.0 * np.fft.rfft(signal, axis=1)[:, 1] / POINTS
    return np.asarray(amplitude / (-runs.direction * runs.acceleration)[:, 0])


def trial_run(point: str) -> ShakenRuns:
    """Runs that differ in every condition, with the signal at a point of the chain."""
    rng, count = np.random.default_rng(1), 24
    columns = AnyColumns((count, 1))
    drawn = [rng.uniform(low, high, (count, 1)) for low, high in ((3.0, 120.0), (0.1, 2.0), (15.0, 30.0))]
    omega, acceleration, temperature = drawn
    direction = np.where(np.arange(count) % 2, 1.0, -1.0)[:, None]
    start = 60.0 * np.arange(count, dtype=np.float64)[:, None]
    runs = periodic(omega, acceleration, direction, temperature, start, 9.8, columns)
    return replace(runs, signal=5.0 * runs.signal) if point == "shaken_output_v" else runs
