"""What the noise of an inertial sensor is called: the coefficients of IEEE Std 952 and IEEE Std 1293, from a fit.

The standards write two-sided densities: N^2 white, B^2 / (2 pi f) flicker, (K / 2 pi)^2 / f^2 random walk, of
which the Allan variance is N^2 / tau, (2 ln 2 / pi) B^2 and K^2 tau / 3. The one-sided
density that is fitted is twice that.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, log, pi, sqrt

from rigctl.analysis.stability.allan import Deviation
from rigctl.analysis.stability.density import PowerLaw
from rigctl.core.units import same_unit

FLICKER_FLOOR = sqrt(2.0 * log(2.0) / pi)
"""The Allan deviation of flicker noise over its bias instability B: 0.664."""

_SQUARE = {0: 0.5, -1: pi, -2: 2.0 * pi**2}
"""By exponent: the square of the coefficient over the term h of the one-sided density."""

_SYMBOLS = {0: ("N", "{}/sqrt(Hz)"), -1: ("B", "{}"), -2: ("K", "{} sqrt(Hz)")}
_NAMES = {
    "accelerometer": {0: "velocity random walk", -1: "bias instability", -2: "acceleration random walk"},
    "rate": {0: "angle random walk", -1: "bias instability", -2: "rate random walk"},
    "": {0: "white noise", -1: "flicker", -2: "random walk"},
}
_UNITS = {
    "accelerometer": ("m/s2", "mm/s2", "um/s2", "g0", "g", "mg", "ug", "Gal", "mGal"),
    "rate": ("rad/s", "deg/s", "deg/h"),
}


@dataclass(frozen=True)
class Coefficient:
    """One coefficient with its standard uncertainty; of a term that is not `resolved` only `upper` is known.

    The true one is beyond `upper` with a probability of 5 %.
    """

    symbol: str
    name: str
    value: float
    sigma: float
    upper: float
    unit: str
    resolved: bool


@dataclass(frozen=True)
class Floor:
    """The lowest Allan deviation; `bias_instability` is it over 0.664.

    `where` is `between`, or `last`: an upper bound, for the record ends there, or `first`: no floor at all.
    """

    at: Deviation
    bias_instability: float
    where: str


def coefficients(terms: tuple[PowerLaw, ...], kind: str, unit: str) -> tuple[Coefficient, ...]:
    """N, B and K of a fitted density, named by the sensor's kind (`accelerometer`) or its unit."""
    names = _NAMES[_sensor(kind, unit)]
    return tuple(_coefficient(term, names[term.exponent], unit or "1") for term in terms)


def floor(allan: tuple[Deviation, ...]) -> Floor:
    """Read off the Allan deviation where it is lowest."""
    lowest = min(allan, key=lambda each: each.value)
    where = {allan[0].tau_s: "first", allan[-1].tau_s: "last"}.get(lowest.tau_s, "between")
    return Floor(lowest, lowest.value / FLICKER_FLOOR, where)


def _coefficient(term: PowerLaw, name: str, unit: str) -> Coefficient:
    symbol, form = _SYMBOLS[term.exponent]
    square = _SQUARE[term.exponent]
    value = sqrt(square * term.value)
    sigma = value * term.sigma / (2.0 * term.value) if term.value else inf
    return Coefficient(symbol, name, value, sigma, sqrt(square * term.upper), form.format(unit), term.resolved)


def _sensor(kind: str, unit: str) -> str:
    if kind in _NAMES and kind:
        return kind
    for sensor, units in _UNITS.items():
        if any(same_unit(unit, each) for each in units):
            return sensor
    return ""
