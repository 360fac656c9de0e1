"""Digital and analogue inputs and outputs: nothing is connected to them."""

from __future__ import annotations

from simulators.aerotech_ensemble.grammar import Invalid, exactly, number, whole


def digital_input(words: tuple[str, ...]) -> str:
    """DIN; `words` without the axis."""
    for word in words:
        whole(word, 0, 31)
    return "0"


def digital_output(words: tuple[str, ...]) -> None:
    """DOUT."""
    (value,) = exactly(1, words)
    whole(value, 0, 0xFFFF)


def analog_input(words: tuple[str, ...]) -> str:
    """AIN."""
    for word in words:
        whole(word, 0, 3)
    return "0.000000"


def analog_output(words: tuple[str, ...]) -> None:
    """AOUT."""
    (value,) = exactly(1, words)
    if abs(number(value)) > 10.0:
        raise Invalid
