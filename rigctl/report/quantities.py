"""Numbers as people read them: no more digits than the uncertainty allows."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rigctl.effects.catalogue import Effect  # what prints numbers needs no catalogue

_FIXED = range(-3, 6)
"""Powers of ten that are written out."""


def quantity(value: float | None, sigma: float | None, unit: str = "") -> str:
    """A value with its standard uncertainty to two digits: (9.71 ± 0.12)e-05 rad/m."""
    if value is None or not math.isfinite(value) or (sigma is not None and not math.isfinite(sigma)):
        return "not determined"
    # Held, or known exactly: no sigma says how many digits there are.
    if not sigma:
        return with_unit(number(value, 6), unit)
    # By the larger of the two, so that both stand under one power of ten.
    exponent = _exponent(max(abs(value), sigma))
    scale = 0 if exponent in _FIXED else exponent
    # Two digits of the sigma.
    decimals = max(0, 1 + scale - _exponent(sigma))
    pair = f"{value / 10.0**scale:.{decimals}f} ± {sigma / 10.0**scale:.{decimals}f}"
    return with_unit(f"({pair})e{scale:+03d}" if scale else pair, unit)


def estimate(entry: Mapping[str, Any], unit: str = "") -> str:
    """A fitted parameter by its `value` and `sigma`, which is NaN, in JSON null, where the fit held it at that value:
    for others imitate it, or at a limit beyond which chi-square would fall on."""
    value, sigma = entry["value"], entry["sigma"]
    if value is not None and math.isfinite(value) and (sigma is None or not math.isfinite(sigma)):
        return f"not determined, held at {with_unit(number(value, 6), unit)}"
    return quantity(value, sigma, unit)


def number(value: float | None, digits: int = 3) -> str:
    """A number to so many digits; "-" where there is none."""
    return "-" if value is None or not math.isfinite(value) else f"{value:.{digits}g}"


def with_unit(text: str, unit: str) -> str:
    """A number and its unit; 1 is the unit of ratios, which nobody writes."""
    return f"{text} {unit}" if unit and unit != "1" else text


def probability(p: float | None) -> str:
    """A p value: what is too small to matter by its power of ten."""
    if p is None or not math.isfinite(p):
        return "-"
    # A double underflows there; the p-value itself is not zero.
    if p <= 0.0:
        return "<1e-300"
    return f"{p:.1e}" if p < 1e-3 else f"{p:.2g}"


def p_value(p: float | None) -> str:
    """The same as a statement: p = 0.012, p < 1e-300."""
    text = probability(p)
    return f"p < {text[1:]}" if text.startswith("<") else f"p = {text}"


def share(p: float) -> str:
    """A level as people say it: 1 %."""
    return f"{100.0 * p:g} %"


def counted(count: int, noun: str, many: str = "") -> str:
    """3 effects, 1 effect; `many` where that is not the noun with an s."""
    return f"{count} {noun if count == 1 else many or noun + 's'}"


def typically(effect: Effect) -> str:
    """An effect with the typical sizes of its parameters."""
    units = effect.parameters
    sizes = (f"{name} = {with_unit(number(value), units[name])}" for name, value in effect.typical.items())
    return f"{effect.id} ({', '.join(sizes)})"


def duration(seconds: float | None) -> str:
    """Seconds as a person says them."""
    if seconds is None:
        return "?"
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


def age(seconds: float | None) -> str:
    """How old something is, in six characters or so: "< 1 s", "12 s", "5 min", "3.2 h", "4 d"; "?" where unknown."""
    if seconds is None or math.isnan(seconds):
        return "?"
    if seconds < 1.0:
        return "< 1 s"
    if seconds < 99.5:
        return f"{seconds:.0f} s"
    if seconds < 99.5 * 60:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h" if seconds < 48 * 3600 else f"{seconds / 86400:.0f} d"


def _exponent(value: float) -> int:
    return math.floor(math.log10(abs(value))) if value else 0
