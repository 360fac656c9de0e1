"""Noise that other laboratories have: coloured over the whole recording, it correlates one run with the next."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.blind_sampler import SampledRun
from rigctl.core.arrays import FloatArray
from simulators.keyed_random import generator


def _power_law(exponent: float) -> Callable[[FloatArray, float], FloatArray]:
    return lambda frequency, knee_hz: 1.0 + (knee_hz / frequency) ** exponent


def _one_time_scale(frequency: FloatArray, knee_hz: float) -> FloatArray:
    """White, and a first-order process that is as strong at the knee."""
    corner_hz = knee_hz / 30.0
    return 1.0 + (1.0 + (knee_hz / corner_hz) ** 2) / (1.0 + (frequency / corner_hz) ** 2)


def _two_time_scales(frequency: FloatArray, knee_hz: float) -> FloatArray:
    slow = (1.0 + (knee_hz / 3e-4) ** 2) / (1.0 + (frequency / 3e-4) ** 2)
    return 0.5 * (_one_time_scale(frequency, knee_hz) + 1.0 + slow)


SHAPES: dict[str, Callable[[FloatArray, float], FloatArray]] = {
    "white": lambda frequency, _: np.ones_like(frequency),
    "ar1": _one_time_scale,
    "flicker": _power_law(1.0),
    "f^-1.64": _power_law(1.64),
    "two-time-scale": _two_time_scales,
    "student-t": lambda frequency, _: np.ones_like(frequency),
}
"""Power density relative to the white level, by frequency and by the knee where the colour equals the white."""

T_DOF = 4.0


def with_noise(
    runs: Sequence[SampledRun], colour: str, *, asd_v_rthz: float, knee_hz: float, seed: int
) -> list[SampledRun]:
    """The runs' outputs with one stretch of coloured noise that goes through all of them.

    `student-t`: every run has a level of its own, so that amplitudes scatter as Student's t with four degrees of
    freedom. `asd_v_rthz` is the one-sided white level.
    """
    rng = generator(seed, "noise", colour)
    start_s = min(float(run.conditions["start_s"]) for run in runs)
    steps = [float(run.columns["t_s"][1] - run.columns["t_s"][0]) for run in runs]
    step_s = min(steps)
    end_s = max(float(run.conditions["start_s"]) + float(run.columns["t_s"][-1]) for run in runs)
    noise = coloured(colour, 1 + round((end_s - start_s) / step_s) + 1, step_s, asd_v_rthz, knee_hz, rng)
    found = []
    for run in runs:
        times_s = float(run.conditions["start_s"]) - start_s + run.columns["t_s"]
        scale = np.sqrt(T_DOF / rng.chisquare(T_DOF)) if colour == "student-t" else 1.0
        volts = run.columns["accel_v"] + scale * noise[np.rint(times_s / step_s).astype(np.intp)]
        found.append(replace(run, columns={**run.columns, "accel_v": volts}))
    return found


def coloured(
    colour: str, count: int, step_s: float, asd_v_rthz: float, knee_hz: float, rng: np.random.Generator
) -> FloatArray:
    """Noise of a colour, shape (count,); its random walk does not close on itself."""
    length = 2 ** int(np.ceil(np.log2(2 * count)))
    frequency = np.asarray(np.fft.rfftfreq(length, step_s), dtype=np.float64)
    frequency[0] = frequency[1]
    white = rng.standard_normal(length) * asd_v_rthz / np.sqrt(2.0 * step_s)
    shaped = np.fft.irfft(np.fft.rfft(white) * np.sqrt(SHAPES[colour](frequency, knee_hz)), length)
    return np.asarray(shaped[:count], dtype=np.float64)
