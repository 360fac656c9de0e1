"""What a pattern can and cannot tell apart, in numbers and in words, before a run and beside its result.

A pattern tells acceleration from bias as far as the moments of c over the kept samples vanish (Lenoir, Christophe,
Reynaud, Measurement 46 (2013) 1411): the zeroth for levels, the first for drifts, the second for slopes. No pattern
sees a bias that is locked to the angle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ConfigError
from rigctl.experiments.rotating_platform.observe.estimators import Estimator, weights
from rigctl.experiments.rotating_platform.observe.patterns import SampledPattern

DRIFT = ("constant", "linear", "quadratic", "cubic")
"""Names of the polynomial orders of a drift."""

_ROUNDING = 1e-12


@dataclass(frozen=True)
class Conditions:
    """Moments of c over the kept samples, t from their mean time: how the projection mixes what it should tell apart.

    `m0` = sum c / n, the part of the bias in the mean acceleration; `m1` = tau sum c t / sum t^2; `m2` = sum c t^2 /
    sum t^2, the part of the bias's slope in that of the acceleration. The same with the two exchanged.
    """

    m0: float
    m1: float
    m2: float


@dataclass(frozen=True)
class Separation:
    """What an estimator makes of a pattern on its samples.

    `mean_leaks` [s^j] and `slope_leaks` [s^(j-1)] are the parts of a bias t^j, j = 0 .. 3, in mean and slope of the
    acceleration (and of an acceleration t^j in those of the bias). `order` is the highest order of drift up to which
    the mean is free of the bias but for the rounding of the dwells to samples; -1: not even of its level.
    """

    estimator: Estimator
    conditions: Conditions
    mean_leaks: tuple[float, ...]
    slope_leaks: tuple[float, ...]
    order: int
    slopes_separate: bool

    @property
    def says(self) -> tuple[str, ...]:
        """The same in sentences."""
        return (self._mean_says(), self._slope_says(), "angle: " + _NO_PATTERN)

    def _mean_says(self) -> str:
        if self.order < 0:
            return f"mean acceleration: {self.mean_leaks[0]:.3g} of the bias is in it"
        free = f"mean acceleration: free of a {_drifting(self.order)}"
        if self.order + 1 == len(self.mean_leaks):
            return free
        leak = _leak(self.mean_leaks, self.order + 1)
        return f"{free}, not of a {_drifting(self.order + 1)}: {leak} times the drift's coefficient are in it"

    def _slope_says(self) -> str:
        if self.slopes_separate:
            return "slope of the acceleration: free of the bias's level and slope"
        return (
            f"slope of the acceleration: {self.slope_leaks[0]:.3g} /s of the bias's level and "
            f"{self.slope_leaks[1]:.3g} of its slope are in it"
        )


_NO_PATTERN = "what turns with the platform (a bias that depends on theta) counts as acceleration, in every pattern"


def conditions(sampled: SampledPattern) -> Conditions:
    """The moments of c on the samples; raises `ConfigError` for a pattern without extent."""
    sums = _about_their_mean(sampled.power_sums(2))
    total, signed = sums[0] + sums[1], sums[0] - sums[1]
    if not total[2] > 0.0:
        raise ConfigError(f"{sampled.pattern.label} keeps a single sample: sample faster or dwell longer")
    period_s = sampled.pattern.period_s
    return Conditions(
        float(signed[0] / total[0]), float(period_s * signed[1] / total[2]), float(signed[2] / total[2])
    )


def separation(sampled: SampledPattern, estimator: Estimator = "projection") -> Separation:
    """What `estimator` makes of the pattern; raises `ConfigError` where it has nothing to work with."""
    balance = conditions(sampled)
    kept, t = np.abs(sampled.sign).astype(np.float64), sampled.time_s
    # The leak of a drift t^j is the output's response to that very drift.
    powers = kept * t ** np.arange(len(DRIFT))[:, None]
    leaks = weights(sampled, estimator)[:2] @ powers.T
    allowed = _rounding_of_edges(sampled, powers)
    free = np.abs(leaks) <= allowed
    # The first order that leaks, less one; the False ends the list where none does.
    order = int(np.argmin([*free[0], False])) - 1
    mean, slope = (tuple(float(each) for each in row) for row in leaks)
    return Separation(estimator, balance, mean, slope, order, bool(free[1, :2].all()))


def require(sampled: SampledPattern, drift_order: int, estimator: Estimator = "projection") -> Separation:
    """The separation, if it keeps a bias that drifts as a polynomial of `drift_order` out of the mean acceleration.

    Raises `ConfigError`, saying what would do, when it does not.
    """
    if not 0 <= drift_order < len(DRIFT):
        raise ConfigError(f"drift of order {drift_order}: patterns are known to reject orders 0 to {len(DRIFT) - 1}")
    separated = separation(sampled, estimator)
    if separated.order < drift_order:
        order = separated.order + 1
        raise ConfigError(
            f"{sampled.pattern.label} at {sampled.sample_rate_hz:g} Hz with {estimator} cannot reject a "
            f"{_drifting(drift_order)}: {_leak(separated.mean_leaks, order)} of its {DRIFT[order]} part stay in the "
            f"mean acceleration; {_mend(order)}"
        )
    return separated


def _mend(order: int) -> str:
    """What rejects a drift of `order`."""
    if order == 0:
        return "rest as many samples at 0 as at half a turn, or take joint-ls"
    return "take " + ("pattern b, c or c_tm, or joint-ls", "pattern c or c_tm", "pattern c")[order - 1]


def _leak(leaks: tuple[float, ...], order: int) -> str:
    unit = ("", " s", " s2", " s3")[order]
    return f"{abs(leaks[order]):.3g}{unit}"


def _drifting(order: int) -> str:
    return "constant bias" if order == 0 else f"{DRIFT[order]} drift of the bias"


def _about_their_mean(sums: FloatArray) -> FloatArray:
    """Power sums up to the second, about the mean time of all."""
    count, first, _ = sums.sum(axis=0)
    mean = first / count
    level, ramp, square = sums.T
    return np.stack([level, ramp - mean * level, square - 2.0 * mean * ramp + mean**2 * level], axis=1)


def _rounding_of_edges(sampled: SampledPattern, powers: FloatArray) -> FloatArray:
    """What leaks of t^j at most because dwells end on samples: half of one at each edge; shape (2, orders)."""
    at = sampled.time_s
    edges = np.array([at[k] for _, start, stop in sampled.segments for k in (start, stop - 1)])
    moved = 0.5 * np.abs(edges) ** np.arange(len(DRIFT) + 1)[:, None]
    magnitude = np.abs(powers)
    spread = float(powers[2].sum())
    mean = _ROUNDING * magnitude.sum(axis=1) / sampled.kept + moved[:-1].sum(axis=1) / sampled.kept
    slope = _ROUNDING * (magnitude * np.abs(at)).sum(axis=1) / spread + moved[1:].sum(axis=1) / spread
    # Levels cancel exactly or not at all: the pattern as designed has as many samples of either sign.
    mean[0] = _ROUNDING
    return np.stack([mean, slope])
