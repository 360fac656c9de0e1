"""How much room text takes, and numbers as axes write them."""

from __future__ import annotations

FONT = "Helvetica, Arial, 'Liberation Sans', 'DejaVu Sans', sans-serif"

_NARROW = set("iljtfrI.,:;|'![]()/ ·″′")
_WIDE = set("mwMWGOQ@%—…→")
_EM_NARROW, _EM, _EM_CAPITAL, _EM_WIDE = 0.36, 0.6, 0.72, 0.9
"""Of the letters' size, as DejaVu Sans has them, the widest of the fonts: in another one text is shorter."""

_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def width(text: str, size: float) -> float:
    """How wide the longest line of a text is at most."""
    return max((sum(map(_em, line)) for line in text.split("\n")), default=0.0) * size


def _em(letter: str) -> float:
    if letter in _NARROW:
        return _EM_NARROW
    if letter in _WIDE:
        return _EM_WIDE
    return _EM_CAPITAL if letter.isupper() else _EM


def signed(text: str) -> str:
    """With a minus sign for a hyphen."""
    return text.replace("-", "−")


def power_of_ten(exponent: int) -> str:
    """10 with its exponent raised."""
    return f"10{str(exponent).translate(_RAISED)}"
