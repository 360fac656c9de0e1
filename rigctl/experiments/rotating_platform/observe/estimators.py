"""What is estimated from one modulation period, as weights of its samples.

`projection` is the paper's (Lenoir, Christophe, Reynaud, Measurement 46 (2013) 1411, eq. 11 and 15) with the
samples of the rotations left out and t from the mean time of the others, which makes its columns orthogonal.
`joint-ls` fits c (a0 + a1 t) + b0 + b1 t to the kept samples, that is one straight line to those of either sign:
exact for acceleration and bias that drift linearly, whatever the pattern and whatever is missing of it.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ConfigError
from rigctl.experiments.rotating_platform.observe.patterns import SampledPattern

Estimator = Literal["projection", "joint-ls"]
ESTIMATORS: tuple[Estimator, ...] = get_args(Estimator)

OUTPUTS = ("accel_mean", "accel_slope", "bias_mean", "bias_slope")
"""What a period gives; means in the unit of the samples, slopes in it per second, at the kept samples' mean time."""


def weights(sampled: SampledPattern, estimator: Estimator = "projection") -> FloatArray:
    """The weights of a period's samples in each of `OUTPUTS`, shape (4, samples).

    Raises `ConfigError` where the joint fit has fewer than two samples of either sign.
    """
    return _projection(sampled) if estimator == "projection" else _joint(sampled)


def coarser(rows: FloatArray, sample_rate_hz: float, most: int) -> tuple[FloatArray, float]:
    """Weights, shape (outputs, samples), on a time base of at most so many samples a period, and its rate."""
    samples = rows.shape[1]
    # A divisor: a period must stay a whole number of samples.
    step = next(d for d in range(1, samples + 1) if samples % d == 0 and samples // d <= most)
    return rows.reshape(len(rows), samples // step, step).sum(axis=2), sample_rate_hz / step


def _projection(sampled: SampledPattern) -> FloatArray:
    sign, t = sampled.sign.astype(np.float64), sampled.time_s
    kept = np.abs(sign)
    ramp = kept * t
    spread = float(ramp @ t)
    return np.stack([sign / sampled.kept, sign * t / spread, kept / sampled.kept, ramp / spread])


def _joint(sampled: SampledPattern) -> FloatArray:
    plus, minus = (_line(sampled, sign) for sign in (1, -1))
    return 0.5 * np.concatenate([plus - minus, plus + minus])


def _line(sampled: SampledPattern, sign: int) -> FloatArray:
    """Weights of level at the centre and slope of a straight line through the samples of one sign, (2, samples)."""
    use = (sampled.sign == sign).astype(np.float64)
    count = use.sum()
    if count < 2.0:
        raise ConfigError(
            f"{sampled.pattern.label} has fewer than two samples with cos(theta) = {sign:+d}: "
            "nothing tells acceleration from bias; dwell at 0 and at half a turn"
        )
    mean = use @ sampled.time_s / count
    off = use * (sampled.time_s - mean)
    slope = off / (off @ off)
    return np.stack([use / count - mean * slope, slope])
