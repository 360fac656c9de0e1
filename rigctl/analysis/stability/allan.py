"""The Allan family: overlapping Allan, modified Allan, time and overlapping Hadamard deviation, with confidence.

W. J. Riley, *Handbook of Frequency Stability Analysis*, NIST Special Publication 1065 (2008). Its fractional
frequencies y are the samples here, of any quantity, and its phase x their integral. Own code: of the libraries there
are, allantools gives the same deviations, but its identification of noise walks through the samples in Python, its
degrees of freedom stop at f^-3, and it requires pytest and numpydoc of whoever runs it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import special

from rigctl.analysis.stability.degrees_of_freedom import Estimate, degrees_of_freedom
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError

SHORTEST = 16
"""Samples below which nothing is said."""

ONE_SIGMA = float(special.erf(np.sqrt(0.5)))

_IDENTIFIABLE = 30
"""Averages without which no noise is identified (NIST SP 1065, section 5.5.3)."""

_STEEPEST = {2: -2, 3: -4}
"""By the order of the difference: the steepest noise of which its variance exists."""

_BLOCK = 1 << 18
"""Differences at a time: what fits in a processor's cache is summed faster."""

TAUS = {"octave": (1, 2), "decade": (1, 2, 5, 10)}


@dataclass(frozen=True)
class Deviation:
    """A deviation at one averaging time: `low` to `high` covers the true one with the probability asked for.

    `alpha` is the exponent of the noise's density as identified at this averaging time, or, `carried`, at the longest
    one at which that could be done.
    """

    tau_s: float
    value: float
    low: float
    high: float
    edf: float
    alpha: int
    carried: bool
    terms: int


@dataclass(frozen=True)
class AllanFamily:
    """Each kind of deviation in the order of averaging times."""

    allan: tuple[Deviation, ...]
    modified: tuple[Deviation, ...]
    time: tuple[Deviation, ...]
    hadamard: tuple[Deviation, ...]


def allan_family(
    samples: FloatArray, rate_hz: float, *, confidence: float = ONE_SIGMA, taus: str = "octave"
) -> AllanFamily:
    """The deviations of evenly spaced samples without gaps, in the samples' unit; the time deviation in unit s.

    Averaging times go up to a quarter of the record. `DataError` for fewer than `SHORTEST` samples or missing ones.
    """
    if samples.size < SHORTEST:
        raise DataError(f"{samples.size} samples are too few for an Allan deviation: record at least {SHORTEST}")
    if not np.isfinite(samples).all():
        raise DataError("samples are missing in between: give a stretch without gaps")
    integral = integrated(samples)
    found: dict[str, list[Deviation]] = {"allan": [], "modified": [], "time": [], "hadamard": []}
    known = {2: 0, 3: 0}
    for factor in averaging_factors(samples.size, taus):
        identified = {order: identified_noise(integral, factor, order) for order in known}
        for order, alpha in identified.items():
            known[order] = known[order] if alpha is None else alpha
        estimates = {
            "allan": (allan_variance(integral, factor), Estimate(2, factor, integral.size)),
            "modified": (modified_variance(integral, factor), Estimate(2, factor, integral.size, modified=True)),
            "hadamard": (hadamard_variance(integral, factor), Estimate(3, factor, integral.size)),
        }
        for name, (variance, estimate) in estimates.items():
            order = estimate.order
            at = _deviation(variance, estimate, known[order], identified[order] is None, rate_hz, confidence)
            found[name].append(at)
        found["time"].append(_of_time(found["modified"][-1]))
    return AllanFamily(**{name: tuple(each) for name, each in found.items()})


def integrated(samples: FloatArray) -> FloatArray:
    """The running sum from 0 on, of one element more; without the mean, which no difference sees."""
    # In place: ten million samples are copied no more than needed.
    total = np.empty(samples.size + 1)
    total[0] = 0.0
    np.subtract(samples, samples.mean(), out=total[1:])
    np.cumsum(total[1:], out=total[1:])
    return total


def averaging_factors(samples: int, taus: str = "octave") -> Iterator[int]:
    """Numbers of samples to average, up to a quarter of them; `taus` is a key of `TAUS`."""
    steps = TAUS[taus]
    scale = 1
    while scale <= samples // 4:
        yield from (scale * step for step in steps[:-1] if scale * step <= samples // 4)
        scale *= steps[-1]


def allan_variance(integral: FloatArray, factor: int) -> float:
    """The overlapping Allan variance (NIST SP 1065, equation 11)."""
    return _mean_square(integral, factor, (1.0, -2.0, 1.0)) / (2.0 * factor**2)


def hadamard_variance(integral: FloatArray, factor: int) -> float:
    """The overlapping Hadamard variance (NIST SP 1065, equation 25), which no steady drift enters."""
    return _mean_square(integral, factor, (-1.0, 3.0, -3.0, 1.0)) / (6.0 * factor**2)


def modified_variance(integral: FloatArray, factor: int) -> float:
    """The modified Allan variance (NIST SP 1065, equation 15), averaged within as well."""
    difference = integral[2 * factor :] - 2.0 * integral[factor:-factor]
    difference += integral[: -2 * factor]
    # The sum over `factor` neighbours is a difference of running sums, whatever the factor.
    running = np.cumsum(difference, out=difference)
    moving = running[factor:] - running[:-factor]
    total = float(running[factor - 1]) ** 2 + float(moving @ moving)
    return total / ((moving.size + 1) * 2.0 * float(factor) ** 4)


def identified_noise(integral: FloatArray, factor: int, order: int) -> int | None:
    """The exponent of the density of noise that dominates at `factor`, from the lag-1 autocorrelation.

    W. J. Riley and C. A. Greenhall, "Power law noise identification using the lag 1 autocorrelation", Proc. 18th EFTF
    (2004); NIST SP 1065, section 5.5.3. None where there are too few averages, or they are all the same.
    """
    averages = np.diff(integral[::factor])
    if averages.size < _IDENTIFIABLE:
        return None
    place = np.linspace(-1.0, 1.0, averages.size)
    # A drift is no noise, and would pass for the steepest.
    averages = averages - averages.mean() - place * float(place @ averages) / float(place @ place)
    # Samples are the first difference of the phase that the paper differences up to `order` times.
    for differenced in range(order):
        centred = averages - averages.mean()
        power = float(centred @ centred)
        if power <= 0.0:
            return None
        lag_one = float(centred[1:] @ centred[:-1]) / power
        fractional = lag_one / (1.0 + lag_one)
        if fractional < 0.25 or differenced == order - 1:
            alpha = -round(2.0 * fractional) - 2 * differenced
            return max(_STEEPEST[order], min(2, alpha))
        averages = np.diff(averages)
    raise AssertionError(order)


def interval(value: float, edf: float, confidence: float) -> tuple[float, float]:
    """Where the true deviation lies, from the chi-squared distribution (NIST SP 1065, equation 45)."""
    tail = (1.0 - confidence) / 2.0
    low, high = edf / special.chdtri(edf, tail), edf / special.chdtri(edf, 1.0 - tail)
    return value * float(np.sqrt(low)), value * float(np.sqrt(high))


def _mean_square(integral: FloatArray, factor: int, weights: tuple[float, ...]) -> float:
    """Of the weighted difference of elements `factor` apart."""
    count = integral.size - (len(weights) - 1) * factor
    total = 0.0
    for start in range(0, count, _BLOCK):
        stop = min(start + _BLOCK, count)
        part = weights[0] * integral[start:stop]
        for k, weight in enumerate(weights[1:], 1):
            part += weight * integral[start + k * factor : stop + k * factor]
        total += float(part @ part)
    return total / count


def _deviation(
    variance: float, estimate: Estimate, alpha: int, carried: bool, rate_hz: float, confidence: float
) -> Deviation:
    value, edf = float(np.sqrt(variance)), degrees_of_freedom(alpha, estimate)
    low, high = interval(value, edf, confidence)
    return Deviation(estimate.factor / rate_hz, value, low, high, edf, alpha, carried, estimate.terms)


def _of_time(modified: Deviation) -> Deviation:
    """The time deviation: tau / sqrt(3) times the modified Allan deviation (NIST SP 1065, equation 16)."""
    scale = modified.tau_s / float(np.sqrt(3.0))
    low, value, high = (scale * each for each in (modified.low, modified.value, modified.high))
    m = modified
    return Deviation(m.tau_s, value, low, high, m.edf, m.alpha, m.carried, m.terms)
