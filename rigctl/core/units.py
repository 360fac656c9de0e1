"""Units as text: what the name of a column promises, which texts are units, which are the same; possible values."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

from rigctl.core.numbers import MAGNITUDE_MAX

# Longer suffixes first: `accel_m_s2` ends in no shorter one, but `speed_m_s` ends in `_s` as well.
_BY_SUFFIX = {
    "v_per_m_s2": "V/(m/s2)",
    "rad_s2": "rad/s2",
    "deg_s": "deg/s",
    "rad_s": "rad/s",
    "mm_s": "mm/s",
    "m_s2": "m/s2",
    "m_s3": "m/s3",
    "m_s": "m/s",
    **{unit: unit for unit in ("arcsec", "mrad", "urad", "deg", "rad", "mbar", "ms", "us", "nm", "um", "mm", "cm")},
    "mhz": "mHz",
    "khz": "kHz",
    "hz": "Hz",
    "hpa": "hPa",
    "kpa": "kPa",
    "pa": "Pa",
    "mv": "mV",
    "uv": "uV",
    "v": "V",
    "m": "m",
    "s": "s",
    "c": "degC",
    "k": "K",
}

_BEFORE_A_SUFFIX = {
    *("per", "n", "mn", "kn", "v", "nv", "uv", "mv", "kv", "na", "ua", "ma", "ohm", "kohm", "t", "ut", "mt"),
    *("pa", "hpa", "kpa", "mpa", "bar", "mbar", "m", "nm", "um", "mm", "cm", "km", "in", "ft", "l", "ml"),
    *("s", "ns", "us", "ms", "h", "hz", "khz", "mhz", "ghz", "g", "mg", "kg", "lb", "lbf", "mol", "j", "kj"),
    *("w", "mw", "kw", "k", "rad", "urad", "mrad", "deg", "arcsec", "db", "ppm", "ppb"),
}
"""Pieces of names that are units as well: `out_mv_v` is in mV/V, `torque_n_m` in N m or n in m, `v_km_s` in km/s.

`a` is a chain of that name (`q_a_v`), `min` the least, far more often than an ampere or a minute.
"""

_BASE = {
    *("m", "g", "s", "A", "K", "mol", "cd", "rad", "sr", "Hz", "N", "Pa", "J", "W", "C", "V", "F", "ohm", "Ohm", "Ω"),
    *("S", "Wb", "T", "H", "lm", "lx", "Bq", "L", "l", "bar", "eV", "gal", "Gal"),
}
_PREFIXES = {"", *"fpnuµmckMGTdh"}
_OTHER = {
    *("1", "%", "ppm", "ppb", "deg", "arcsec", "arcmin", "degC", "°C", "degF", "min", "h", "d", "day", "in", "inch"),
    *("ft", "mil", "lb", "lbf", "klbf", "kip", "psi", "oz", "mmHg", "torr", "Torr", "atm", "rpm", "div", "count"),
    *("counts", "LSB", "dB", "g0", "kgf", "hPa", "°"),
}
_SPELLINGS = {
    **dict.fromkeys(("°c", "℃", "c", "celsius", "deg c"), "degc"),
    **dict.fromkeys(("°", "degree", "degrees"), "deg"),
    **dict.fromkeys(("volt", "volts"), "v"),
    **dict.fromkeys(("metre", "meter"), "m"),
    **dict.fromkeys(("second", "seconds"), "s"),
    "kelvin": "k",
    "hertz": "hz",
}

_PLAIN = str.maketrans({"²": "2", "³": "3", "µ": "u", "μ": "u"})
_PART = re.compile(
    r"(?P<between>[\s*·/]+)|\(|(?:(?P<symbol>1|%|°[Cc]|[°℃]|[^\W\d_]+0?)|\))\^?(?P<power>-?\d+)?(?=[\s*·/()]|$)"
)
_CHARACTERS_MAX = 100


def name_and_unit(column: str) -> tuple[str, str]:
    """A column's name without its suffix, and the unit that the suffix gives; "" where there is none.

    None is given where what stands before the suffix may be a part of the unit. `_c` and `_k` are units of
    temperatures only: a third sensor may well be `sensor_c`.
    """
    suffix = _suffix(column)
    if not suffix:
        return column, ""
    name = column.removesuffix(f"_{suffix}")
    is_unit = suffix not in {"c", "k"} or column.startswith(("temp", "t_"))
    return (name, _BY_SUFFIX[suffix]) if is_unit and not _ends_in_a_unit(name) else (column, "")


def _suffix(column: str) -> str:
    return next((suffix for suffix in _BY_SUFFIX if column.endswith(f"_{suffix}")), "")


def _ends_in_a_unit(name: str) -> bool:
    before, _, last = name.rpartition("_")
    symbol = last.lower().rstrip("23") or last
    # A letter that nothing stands before is the quantity itself: `t_s`, `g_m_s2`.
    return symbol in _BEFORE_A_SUFFIX and bool(before or len(symbol) > 1)


def unit_of_column(name: str) -> str:
    """The unit the suffix of `name` gives, "" without one."""
    return name_and_unit(name)[1]


def contradicts(unit: str, column: str) -> bool:
    """Whether a unit as it is stated cannot be that of a column of this name: V of `length_mm`.

    mV/V of `ratio_v` can: what is stated ends in what the name ends in.
    """
    promised = unit_of_column(column)
    if not promised or same_unit(unit, promised):
        return False
    stated = _pieces(unit)
    return not any(stated[-len(end) :] == end for end in (_pieces(_suffix(column)), _pieces(promised)))


def _pieces(unit: str) -> list[str]:
    return [piece for piece in re.findall(r"[^\W_]+", unit.translate(_PLAIN).lower()) if piece != "per"]


def known_unit(text: object) -> bool:
    """Whether a text is a unit: symbols with powers, a space or * between factors, / before divisors, brackets."""
    powers = factors(text) if isinstance(text, str) else None
    return bool(powers) and all(_is_symbol(symbol) for symbol in powers or ())


def same_unit(one: str, other: str) -> bool:
    """True for two spellings of the same unit; upper and lower case are the same."""
    return _canonical(one) == _canonical(other)


def power(unit: str, exponent: float) -> str:
    """A unit to a power: s, s2, (m/s)3, 1/s, s0.5."""
    if not unit or exponent == 1:
        return unit
    # Without brackets the power of m/s would be read as one of s.
    plain = unit if unit.isalpha() else f"({unit})"
    return f"1/{plain}" if exponent == -1 else f"{plain}{exponent:g}"


def ratio(above: str, below: str) -> str:
    """The unit of a quotient; "" where either is unknown."""
    if not above or not below:
        return ""
    if below.startswith("1/"):
        return f"{above} {below[2:]}"
    return f"{above}/({below})" if "/" in below and not below.startswith("(") else f"{above}/{below}"


def factors(text: str) -> dict[str, int] | None:
    """Of each symbol: m 1, s -2 for m/s2, m s-2 and m/s^2; None where a text is no product of symbols."""
    text = text.replace("**", "^").translate(_PLAIN)
    # What is left when all parts are taken out is no unit.
    if len(text) > _CHARACTERS_MAX or _PART.sub("", text) or text.count("(") != text.count(")"):
        return None
    return _product(_PART.finditer(text))[0]


def _is_symbol(word: str) -> bool:
    return word in _OTHER or any(word.startswith(p) and word[len(p) :] in _BASE for p in _PREFIXES)


def _canonical(unit: str) -> object:
    text = unit.strip().lower()
    powers = factors(_SPELLINGS.get(text, text))
    return text if powers is None else {_SPELLINGS.get(symbol, symbol): power for symbol, power in powers.items()}


def _product(parts: Iterator[re.Match[str]]) -> tuple[dict[str, int], int]:
    """The powers up to the bracket that closes, and the power that stands behind it."""
    powers: dict[str, int] = {}
    sign = 1
    for part in parts:
        if part["between"]:
            # A divisor is the next factor only: `m/s kg` is m kg/s.
            sign = -1 if "/" in part["between"] else 1
            continue
        exponent = int(part["power"] or 1)
        if part[0].startswith(")"):
            return powers, exponent
        factor = {part["symbol"]: 1}
        if part[0] == "(":
            factor, exponent = _product(parts)
        for symbol, each in factor.items():
            powers[symbol] = powers.get(symbol, 0) + sign * exponent * each
        sign = 1
    return powers, 1


ABSOLUTE_ZERO_C = -273.15
HOTTEST_C = 1e4
"""Nothing with a sensor on it is hotter."""

ANGLE_MAX_DEG = 36_000.0
"""A hundred turns: more than any cable, and than any stage's counter is trusted for."""

GRAVITY_MAX_M_S2 = 30.0
"""Above that of Jupiter."""

GRAVITY_ON_EARTH_M_S2 = (9.76, 9.84)
"""From Huascaran to the Arctic Ocean."""

ORBIT_MIN_S = 1000.0
"""No body of ordinary matter is so dense that it can be circled faster; in minutes an orbit looks like that."""

ECCENTRICITY_MAX = 1.0
TILT_MAX_DEG = 90.0
"""So far from the normal of its face a beam misses it."""


def flaw_of_constant(name: str, value: float) -> str | None:
    """Why a constant of this name cannot be `value`, and the mend; None when it can. Units are in names."""
    if not abs(value) <= MAGNITUDE_MAX:
        return f"is {value:g}, no quantity; write a number, or leave it out"
    if name == "g_m_s2" and not 0.0 < value <= GRAVITY_MAX_M_S2:
        return f"is {value:g}; write the local gravity, positive, in m/s2, about 9.8 on Earth"
    if name.startswith("gain") and value == 0.0:
        return "is 0, which measures nothing; write the scale factor, or leave it out"
    if name == "orbit_period_s" and value < ORBIT_MIN_S:
        return f"is {value:g}, shorter than any orbit; write it in seconds"
    if name == "eccentricity" and not 0.0 <= value < ECCENTRICITY_MAX:
        return f"is {value:g}, that of no orbit; write a number from 0 to below 1"
    lowest, _ = possible_range(unit_of_column(name))
    return f"is {value:g}, below absolute zero; mend it" if value < lowest else None


def doubt_of_constant(name: str, value: float) -> str | None:
    """What is strange about a constant that can be true; None for nothing."""
    low, high = GRAVITY_ON_EARTH_M_S2
    if name == "g_m_s2" and not low <= value <= high:
        return f"is {value:g}, which is found nowhere on Earth ({low:g} to {high:g}); check it"
    return None


def possible_range(unit: str) -> tuple[float, float]:
    """From the smallest to the largest value that a reading in `unit` can have."""
    ranges = {
        "degC": (ABSOLUTE_ZERO_C, HOTTEST_C),
        "K": (0.0, HOTTEST_C),
    }
    return ranges.get(unit, (-math.inf, math.inf))
