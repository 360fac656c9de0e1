"""Measured values of Keyence LK-G controllers, as they stand in a reply.

A value is 8 characters: a sign, then 7 characters that are digits and one decimal point ("+01.2345",
"-00001.2"). "XXXXXXXX" says that there is no valid value, "+FFFFFFF" and "-FFFFFFF" that it is out of range
(LK-G Series User's Manual, chapter 5).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigctl.core.arrays import BoolArray, FloatArray

VALUE_CHARACTERS = 8
# Seven characters, one of them the point: six digits.
_POWERS = 10.0 ** np.arange(5, -1, -1)

Characters = NDArray[np.uint8]


def parse_values(text: bytes) -> FloatArray:
    """The values of a comma-separated list, shape (n,), in the unit on display; NaN for the special ones.

    Works on the whole line at once: a storage read-out is megabytes long. Raises `ValueError` for anything
    that is not the manual's 8 characters, so that a character lost on the wire cannot pass as a value.
    """
    if not text:
        return np.empty(0)
    cells = _cells(text)
    values = np.full(len(cells), np.nan)
    numbers = ~_special(cells)
    points = (cells[:, 1:] == ord(".")).argmax(axis=1)
    # One pass per place of the point, of which a reply has one or two, instead of one per value.
    for point in np.unique(points[numbers]):
        rows = numbers & (points == point)
        values[rows] = _numbers(cells[rows], int(point))
    return values


def _cells(text: bytes) -> Characters:
    # With a comma after the last value all cells have nine characters.
    characters = np.frombuffer(text + b",", dtype=np.uint8)
    if characters.size % (VALUE_CHARACTERS + 1):
        raise ValueError(f"not {VALUE_CHARACTERS} characters per value")
    cells = characters.reshape(-1, VALUE_CHARACTERS + 1)
    if (cells[:, VALUE_CHARACTERS] != ord(",")).any():
        raise ValueError(f"not {VALUE_CHARACTERS} characters per value")
    return cells[:, :VALUE_CHARACTERS]


def _special(cells: Characters) -> BoolArray:
    invalid = (cells == ord("X")).all(axis=1)
    out_of_range = _signed(cells) & (cells[:, 1:] == ord("F")).all(axis=1)
    return np.asarray(invalid | out_of_range)


def _signed(cells: Characters) -> BoolArray:
    return np.asarray((cells[:, 0] == ord("+")) | (cells[:, 0] == ord("-")))


def _numbers(cells: Characters, point: int) -> FloatArray:
    # Unsigned: a character below "0" becomes a large number and fails the test for digits.
    digits = np.delete(cells[:, 1:], point, axis=1) - np.uint8(ord("0"))
    if (cells[:, 1 + point] != ord(".")).any() or (digits > 9).any() or not _signed(cells).all():
        raise ValueError("neither a number nor a special value")
    # Whole digits over a power of ten round once, so the result is the double nearest to the text.
    magnitudes = (digits @ _POWERS) / 10.0 ** (6 - point)
    return np.asarray(np.where(cells[:, 0] == ord("-"), -magnitudes, magnitudes))
