"""The reading memory of a Keysight 34465A, as `R?` empties it: what is read is erased there."""

from __future__ import annotations

from typing import Literal

import numpy as np

from drivers.numbers import CHARACTERS_MAX, decimal
from drivers.scpi import ScpiLink, shown
from rigctl.core.arrays import FloatArray

OVERLOAD = 9.9e37
"""Overloads are +-9.9E37 and not-a-number is 9.91E37."""
CHUNK = 5000
"""Readings per R?: 80 kB as doubles, 0.1 s of the fastest record."""


class ReadingMemory:
    """Blocks of readings over one connection, as doubles or as text."""

    def __init__(self, link: ScpiLink, transfer: Literal["real64", "ascii"]) -> None:
        self._link = link
        self._decode = _from_ascii if transfer == "ascii" else _from_doubles
        self.format: tuple[str, ...] = ("FORM:DATA REAL,64", "FORM:BORD NORM")
        """The commands that have readings sent so."""
        if transfer == "ascii":
            self.format = ("FORM:DATA ASC",)

    def drain(self, most: int) -> FloatArray:
        """What is in memory now, at most `most` readings, in as many exchanges as it takes; NaN where overloaded.

        Reading erases: how many there are is asked first, and exactly as many have to come.
        """
        parts = [np.empty(0)]
        # Anything above a chunk, so that the loop asks at least once.
        in_memory = CHUNK + 1
        # When less than a chunk was there the memory is empty now; asking again would never end at a fast record.
        while most and in_memory > CHUNK and (in_memory := self._link.query_whole("DATA:POIN?")) > 0:
            # Never more than the record still has: what lies behind it belongs to nobody.
            parts.append(self._take(min(in_memory, most, CHUNK)))
            most -= len(parts[-1])
        return np.concatenate(parts)

    def _take(self, count: int) -> FloatArray:
        """The oldest `count` readings in memory; they are erased there."""
        query = f"R? {count}"
        # The longest number a reply may have, and its comma.
        payload = self._link.query_block(query, count * (CHARACTERS_MAX + 1))
        try:
            values = self._decode(payload)
        except ValueError as error:
            raise self._link.bad_reply(query, shown(payload[:60]), str(error)) from None
        if len(values) != count:
            raise self._link.bad_reply(query, f"{len(values)} readings", f"{count}")
        return np.where(np.abs(values) >= OVERLOAD, np.nan, values)


def _from_ascii(payload: bytes) -> FloatArray:
    if not payload:
        return np.empty(0)
    try:
        return np.array([decimal(number) for number in payload.decode("latin-1").split(",")])
    except ValueError:
        raise ValueError("numbers with commas between") from None


def _from_doubles(payload: bytes) -> FloatArray:
    if len(payload) % 8:
        raise ValueError("a whole number of 8-byte doubles")
    # FORM:BORD NORM is big-endian.
    values = np.frombuffer(payload, dtype=">f8").astype(np.float64)
    finite = np.isfinite(values)
    if not finite.all():
        place = int(finite.argmin())
        raise ValueError(f"finite numbers, but number {place + 1} of {values.size} is {values[place]:g}")
    return values
