"""Coloured noise as a stream: white noise, keyed by a counter, through a filter that was running since ever.

A density white + red / f^exponent is fitted by a constant and Lorentzians, three to a decade of frequency, to some
parts in ten thousand from ten times the knee up to the Nyquist frequency, where it is meant as sampled: nothing is
folded in. Such a sum is |H|^2 of one filter with real poles, and real zeros between them, so that one stream of white
noise, a dozen sections and two dozen numbers of state are all there is to days of it. Below the knee it levels off.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq, nnls
from scipy.signal import sosfilt

from rigctl.core.arrays import FloatArray
from simulators.keyed_random import generator

BLOCK = 16384
"""Samples made at a time, whatever is asked for: what comes does not depend on how it is taken."""

POLES_PER_DECADE = 3.0
NEGLIGIBLE = 1e-9
"""A Lorentzian that never comes to so much of the white part has no pole."""
HIGHEST_POLE_HZ = 3.0
"""Above, the white part is what counts in any chain worth simulating; and never above the Nyquist frequency."""


@dataclass(frozen=True)
class PowerLaw:
    """A two-sided density: white + red / f^exponent, unit^2 per Hz; level below `knee_hz`, right from 10 knees."""

    white: float
    red: float
    exponent: float
    knee_hz: float = 1e-7

    def density(self, frequency_hz: FloatArray) -> FloatArray:
        """What it is meant to be [unit^2/Hz]."""
        return self.white + self.red * np.abs(frequency_hz) ** -self.exponent


@dataclass(frozen=True)
class RisingNoise:
    """A two-sided density: flat to `corner_hz`, rising as f^4 above it, level at `cap`^2 times the floor."""

    floor: float
    corner_hz: float
    cap: float


@dataclass(frozen=True, eq=False)
class Shape:
    """A filter that makes white noise of standard deviation `rms` into noise of some density."""

    sections: FloatArray
    rms: float
    state_factor: FloatArray
    """Independent normal numbers times this are the state of the filter after a long time, per unit of `rms`."""

    @property
    def state_count(self) -> int:
        """How many numbers of state there are."""
        return 2 * len(self.sections)


@lru_cache(maxsize=32)
def shape(density: PowerLaw | RisingNoise, rate_hz: float) -> Shape:
    """The filter of a density at a sampling rate."""
    poles, zeros, gain = (
        power_law_filter(density, rate_hz) if isinstance(density, PowerLaw) else _rising(density, rate_hz)
    )
    # Slow with fast: 1 - p1 - p2 + p1 p2 of two slow ones would drown in rounding.
    pairs = [(i, len(poles) - 1 - i) for i in range(len(poles) // 2)]
    sections = np.array(
        [
            [1.0, -zeros[i] - zeros[j], zeros[i] * zeros[j], 1.0, -poles[i] - poles[j], poles[i] * poles[j]]
            for i, j in pairs
        ]
    )
    return Shape(sections, math.sqrt(gain * rate_hz), _square_root(_stationary_covariance(sections)))


class NoiseStream:
    """Noise of a density at a sampling rate: stationary, never repeating, and a function of `key` and place alone.

    With `from_zero` the level at the beginning is taken off: whatever is slower than the stream sets out from 0.
    """

    def __init__(
        self, density: PowerLaw | RisingNoise, rate_hz: float, *key: int | str, from_zero: bool = False
    ) -> None:
        self._shape = shape(density, rate_hz)
        self._key = int.from_bytes(hashlib.blake2b(repr(key).encode(), digest_size=16).digest(), "little")
        drawn = generator(*key, "state").standard_normal(self._shape.state_count)
        self._state = (self._shape.rms * (self._shape.state_factor @ drawn)).reshape(-1, 1, 2)[:, 0, :]
        self._level = float(_zero_input(self._shape.sections, self._state)) if from_zero else 0.0
        self._blocks = 0
        self._ready = np.empty(0)

    def take(self, count: int) -> FloatArray:
        """The next `count` samples."""
        parts, missing = [self._ready[:count]], count - len(self._ready)
        self._ready = self._ready[count:]
        while missing > 0:
            block = self._block()
            parts.append(block[:missing])
            self._ready = block[missing:]
            missing -= len(block)
        return np.concatenate(parts) if len(parts) > 1 else parts[0]

    def _block(self) -> FloatArray:
        # The counter's upper words number the block, its lower ones the draws in it.
        white = np.random.Generator(np.random.Philox(key=self._key, counter=self._blocks << 128))
        self._blocks += 1
        drive = white.standard_normal(BLOCK)
        drive *= self._shape.rms
        noise, self._state = sosfilt(self._shape.sections, drive, zi=self._state)
        noise -= self._level
        return np.asarray(noise, dtype=np.float64)


def power_law_filter(
    density: PowerLaw, rate_hz: float, per_decade: float = POLES_PER_DECADE, highest_hz: float = HIGHEST_POLE_HZ
) -> tuple[list[float], list[float], float]:
    """Poles and zeros in z, slowest first, and the gain of the power.

    In y = sin^2(pi f / rate) a first-order section is |1 - p/z|^2 = 4 p (y + c) with c = (1 - p)^2 / 4 p.
    """
    highest_hz = min(highest_hz, 0.5 * rate_hz)
    count = math.ceil(per_decade * math.log10(highest_hz / density.knee_hz)) + 1
    corners = np.sin(math.pi * np.geomspace(density.knee_hz, highest_hz, count) / rate_hz) ** 2
    # Not down to the knee itself, where the density is to level off.
    frequency_hz = np.geomspace(3.0 * density.knee_hz, 0.5 * rate_hz, 4000)
    y = np.sin(math.pi * frequency_hz / rate_hz) ** 2
    wanted = density.density(frequency_hz)
    # Over the density that is wanted: the fit is to be as good relatively at all frequencies.
    terms = 1.0 / ((y[:, np.newaxis] + corners) * wanted[:, np.newaxis])
    # The columns differ by many decades.
    scale = terms.max(axis=0)
    heights = nnls(terms / scale, 1.0 - density.white / wanted)[0] / scale
    kept = heights > NEGLIGIBLE * density.white * corners
    corners, heights = corners[kept], heights[kept]
    poles = [_pole(c) for c in corners.tolist()]
    zeros = [_pole(z) for z in _zeros(density.white, heights, corners)]
    gain = density.white * math.prod(p / q for p, q in zip(poles, zeros, strict=True))
    # A section takes two of each: an even number, and at least two.
    idle = [0.0] * (len(poles) % 2 or 2 * (not poles))
    return [*poles, *idle], [*zeros, *idle], gain


def _zeros(white: float, heights: FloatArray, corners: FloatArray) -> list[float]:
    """Where white + sum heights / (corners - z) is zero: once between any two corners, and once beyond the last."""

    def value(z: float) -> float:
        return white + float(np.sum(heights / (corners - z)))

    # No zero is further than H / white behind the last corner, H the sum of the heights; twice that is safe.
    beyond = float(np.max(corners, initial=0.0) + 2.0 * np.sum(heights) / white)
    ends = [*corners.tolist(), beyond][1:]
    zeros = []
    for low, high in zip(corners.tolist(), ends, strict=True):
        # Off the corners, where the sum is infinite.
        inside = max(1e-12 * (high - low), 1e-14 * low)
        # Zeros lie many decades apart: only relative accuracy means anything.
        zeros.append(float(brentq(value, low + inside, high - inside, xtol=1e-300, rtol=1e-14)))
    return zeros


def _rising(density: RisingNoise, rate_hz: float) -> tuple[list[float], list[float], float]:
    """Two zeros at the corner, two poles where the cap is reached."""
    corner, top = (
        math.sin(min(math.pi * f / rate_hz, 0.5 * math.pi)) ** 2
        for f in (density.corner_hz, density.corner_hz * math.sqrt(density.cap))
    )
    pole, zero = _pole(top), _pole(corner)
    return [pole, pole], [zero, zero], density.floor * (top * pole / (corner * zero)) ** 2


def _pole(c: float) -> float:
    """The stable p with c = (1 - p)^2 / 4 p."""
    return 1.0 + 2.0 * c - 2.0 * math.sqrt(c * (1.0 + c))


def _zero_input(sections: FloatArray, state: FloatArray) -> float:
    """What comes out next when nothing goes in."""
    return float(sosfilt(sections, np.zeros(1), zi=state)[0][0])


def _stationary_covariance(sections: FloatArray) -> FloatArray:
    """Of the filter's state, driven by unit white noise since ever: the sum over k of A^k b b' A'^k, by doubling."""
    count = 2 * len(sections)
    transition = np.empty((count, count))
    for index, unit in enumerate(np.eye(count)):
        transition[:, index] = sosfilt(sections, np.zeros(1), zi=unit.reshape(-1, 2))[1].ravel()
    entry = sosfilt(sections, np.ones(1), zi=np.zeros((len(sections), 2)))[1].ravel()
    covariance = np.outer(entry, entry)
    while np.abs(transition).max() > 1e-9:
        covariance = covariance + transition @ covariance @ transition.T
        transition = transition @ transition
    return covariance


def _square_root(covariance: FloatArray) -> FloatArray:
    scale = np.sqrt(np.diag(covariance))
    # An idle section has no state.
    scale[scale == 0.0] = 1.0
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(scale[:, np.newaxis] * vectors * np.sqrt(np.maximum(values, 0.0)), dtype=np.float64)
