r"""Units as D-SI writes them: `m/s2` is `\metre\second\tothe{-2}` (names of the SI brochure, 9th edition).

A unit that the SI brochure does not have, or of which the text does not say enough, stands behind `|`, as it is.
The letter `g` is among these: in accelerometry it is gravity as often as the gram. Nothing is converted.
"""

from __future__ import annotations

from rigctl.core.units import factors

NOT_STATED = "|not_stated"

_SI = {
    "m": "metre",
    "s": "second",
    "A": "ampere",
    "K": "kelvin",
    "mol": "mole",
    "cd": "candela",
    "rad": "radian",
    "sr": "steradian",
    "Hz": "hertz",
    "N": "newton",
    "Pa": "pascal",
    "J": "joule",
    "W": "watt",
    "C": "coulomb",
    "V": "volt",
    "F": "farad",
    "ohm": "ohm",
    "Ohm": "ohm",
    "Ω": "ohm",
    "S": "siemens",
    "Wb": "weber",
    "T": "tesla",
    "H": "henry",
    "lm": "lumen",
    "lx": "lux",
    "Bq": "becquerel",
    "L": "litre",
    "l": "litre",
    "eV": "electronvolt",
}
_WHOLE = {
    "kg": "kilogram",
    "deg": "degree",
    "°": "degree",
    "arcmin": "arcminute",
    "arcsec": "arcsecond",
    "degC": "degreecelsius",
    "°C": "degreecelsius",
    "min": "minute",
    "h": "hour",
    "d": "day",
    "day": "day",
}
"""Those that take no prefix here."""

_ONE = r"\one"
_ALONE = {"%": r"\percent", "ppm": r"\ppm"}
"""Those that take neither prefix nor power."""

_PREFIXES = {
    "f": "femto",
    "p": "pico",
    "n": "nano",
    "u": "micro",
    "m": "milli",
    "c": "centi",
    "d": "deci",
    "h": "hecto",
    "k": "kilo",
    "M": "mega",
    "G": "giga",
    "T": "tera",
}


def dsi_unit(*units: str) -> str:
    """The product of units as texts, such as the unit of a covariance; one unit is a product as well."""
    if len(units) == 1 and units[0] in _ALONE:
        return _ALONE[units[0]]
    powers: dict[str, int] = {}
    for unit in units:
        for symbol, power in (factors(unit) or {unit: 1}).items():
            name = _name(symbol)
            if name is None:
                return _as_it_is(units)
            powers[name] = powers.get(name, 0) + power
    powers.pop(_ONE, None)
    written = (name if power == 1 else f"{name}\\tothe{{{power}}}" for name, power in powers.items() if power)
    return "".join(written) or _ONE


def in_dsi(unit: str) -> bool:
    """Whether a unit, as written here, is one of D-SI."""
    return not unit.startswith("|")


def _name(symbol: str) -> str | None:
    if symbol == "1":
        return _ONE
    if whole := _WHOLE.get(symbol) or _SI.get(symbol):
        return f"\\{whole}"
    prefix, rest = _PREFIXES.get(symbol[:1]), _SI.get(symbol[1:])
    return f"\\{prefix}\\{rest}" if prefix and rest else None


def _as_it_is(units: tuple[str, ...]) -> str:
    # Lists of units are divided by spaces.
    if not all(units):
        return NOT_STATED
    said = [each for each in units if each != "1"]
    return "|" + "*".join(f"({each})" if len(said) > 1 else each for each in said).replace(" ", "*")
