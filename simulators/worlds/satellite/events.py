"""What happens at random to single draws: glitches, and steps of a charge."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.keyed_random import generator
from simulators.worlds.satellite.forcing import Command
from simulators.worlds.satellite.settings import SatelliteSettings

RISE_S, FALL_S = 1.0, 3.0
LASTS_S = 40.0 * FALL_S
"""After which nothing is left of a glitch."""
MEASURED = 6
"""Accelerations: x, y, z of mass 1, then of mass 2."""


@dataclass(frozen=True, eq=False)
class _Glitches:
    """Of one draw: when they begin, (n,), and their amplitude in each channel, (n, MEASURED)."""

    at_s: FloatArray
    amplitude_m_s2: FloatArray


class Events:
    """All that happens to the lanes of a run."""

    def __init__(self, settings: SatelliteSettings, draws: Sequence[int], run: int, command: Command) -> None:
        self._lanes = len(draws)
        span_s = command.samples * settings.sample_period_s
        self._glitches = [_glitches(settings, draw, run, span_s) for draw in draws]
        self._steps = [[_steps(settings, draw, run, mass, span_s) for mass in ("1", "2")] for draw in draws]
        self._any = any(len(g.at_s) for g in self._glitches) or any(len(s[0]) for two in self._steps for s in two)

    def at(self, time_s: FloatArray) -> FloatArray:
        """What they add to what is measured, (times, MEASURED * lanes); no row when there are none."""
        if not self._any or not len(time_s):
            return np.empty((0, MEASURED * self._lanes))
        made = np.zeros((len(time_s), MEASURED, self._lanes))
        for lane, (glitches, steps) in enumerate(zip(self._glitches, self._steps, strict=True)):
            nearby = (glitches.at_s < time_s[-1]) & (glitches.at_s > time_s[0] - LASTS_S)
            for at_s, amplitude in zip(glitches.at_s[nearby], glitches.amplitude_m_s2[nearby], strict=True):
                since_s = np.maximum(time_s - at_s, 0.0)
                shape = np.exp(-since_s / FALL_S) - np.exp(-since_s / RISE_S)
                made[:, :, lane] += np.multiply.outer(shape, amplitude)
            for mass, (at_s, sizes) in enumerate(steps):
                totals = np.concatenate([[0.0], np.cumsum(sizes)])
                made[:, 3 * mass, lane] += totals[np.searchsorted(at_s, time_s, side="right")]
        return made.reshape(len(time_s), -1)


def _glitches(settings: SatelliteSettings, draw: int, run: int, span_s: float) -> _Glitches:
    """As many per orbit as the settings say, a part of them at the same places of every orbit."""
    size = settings.size
    amplitude, per_orbit = size("glitches", "amplitude"), size("glitches", "per_orbit")
    if amplitude == 0.0 or per_orbit == 0.0:
        return _Glitches(np.empty(0), np.empty((0, MEASURED)))
    rng = generator(settings.seed, draw, run, "glitches")
    orbits = span_s / settings.orbit_period_s
    phased = round(size("glitches", "phased") * per_orbit)
    free = rng.poisson(max(per_orbit - phased, 0.0) * orbits)
    places = rng.uniform(0.0, settings.orbit_period_s, phased)
    repeated = (places + settings.orbit_period_s * np.arange(math.ceil(orbits))[:, np.newaxis]).ravel()
    at_s = np.sort(np.concatenate([rng.uniform(0.0, span_s, free), repeated[repeated < span_s]]))
    # Log-uniform over two decades, either sign; every axis in a proportion of its own, mass 2 nearly as mass 1.
    sizes = amplitude * 10.0 ** rng.uniform(-2.0, 0.0, len(at_s)) * rng.choice([-1.0, 1.0], len(at_s))
    axes = np.stack([np.ones(len(at_s)), *rng.uniform(-1.0, 1.0, (2, len(at_s)))], axis=1)
    first = sizes[:, np.newaxis] * axes
    return _Glitches(at_s, np.concatenate([first, first * (1.0 - size("glitches", "ratio"))], axis=1))


def _steps(
    settings: SatelliteSettings, draw: int, run: int, mass: str, span_s: float
) -> tuple[FloatArray, FloatArray]:
    """Times and sizes of the steps of a mass' charge, as accelerations."""
    step, often = settings.size("charge", "step", mass), settings.size("charge", "steps_per_orbit", mass)
    if step == 0.0 or often == 0.0:
        return np.empty(0), np.empty(0)
    rng = generator(settings.seed, draw, run, "charge", mass)
    number = rng.poisson(often * span_s / settings.orbit_period_s)
    return np.sort(rng.uniform(0.0, span_s, number)), step * rng.choice([-1.0, 1.0], number)
