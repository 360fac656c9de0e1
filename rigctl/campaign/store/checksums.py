"""Checksums of what a store keeps: one in every row, over the row and its place, and one per column of samples.

A row's sum is the first eight bytes of BLAKE2b over the row's table, key and values as JSON, so that a row that
stands in another's place is seen too. Columns are long and get CRC-32, which sees every change of up to 32 bits in a
row and misses one in 4e9 of any other; see docs/decisions/027.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator
from typing import Any

from zlib_ng import zlib_ng

_BYTES = 8
# Damage can change the type of a value; that must not keep the sum from being made.
_encode = json.JSONEncoder(separators=(",", ":"), default=repr).encode


def row_sum(table: str, *values: Any) -> int:
    """The checksum of a row of `table`: its key first, bytes last if there are any; a signed 64-bit number."""
    # Bytes are fed to the hash as they are; as text in JSON they would be several times as long.
    blob = values[-1] if isinstance(values[-1], bytes) else b""
    text = _encode((table, *values[:-1]) if blob else (table, *values))
    digest = hashlib.blake2b(text.encode(), digest_size=_BYTES)
    if blob:
        digest.update(blob)
    # SQLite's integers are signed.
    return int.from_bytes(digest.digest(), "big", signed=True)


class ColumnSums:
    """Length in bytes and CRC-32 of each column of a run, taken up chunk by chunk."""

    def __init__(self) -> None:
        self._sums: dict[str, tuple[int, int]] = {}

    def add(self, name: str, data: bytes) -> None:
        """Take up the next chunk of a column."""
        length, crc = self._sums.get(name, (0, 0))
        self._sums[name] = (length + len(data), zlib_ng.crc32(data, crc))

    def taking(self, chunks: Iterable[tuple[str, bytes]]) -> Iterator[tuple[str, bytes]]:
        """The same chunks, each with the name of its column, taken up as they pass."""
        for name, data in chunks:
            self.add(name, data)
            yield name, data

    def to_text(self) -> str:
        """As a run's row keeps them: JSON, in the order in which the columns first came."""
        return _encode(self._sums)

    def differing(self, kept: str) -> list[str]:
        """The columns that are not as `to_text` once said; empty when all are, and in that order."""
        then = {name: (length, crc) for name, (length, crc) in json.loads(kept).items()}
        names = [name for name in {**then, **self._sums} if then.get(name) != self._sums.get(name)]
        # The order of columns is data too: that of the file which another laboratory gave us.
        return names or ([] if list(then) == list(self._sums) else list(then))
