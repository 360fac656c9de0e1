"""The rows in a SQLite file and its write-ahead log, page by page, whatever of both is left.

Nothing is taken from what leads to a page: neither the first page, nor trees, nor the log's checksums. Whether a row
is what was written is for its own checksum to say. Format: https://www.sqlite.org/fileformat2.html.
"""

from __future__ import annotations

import mmap
import struct
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

DEFAULT_PAGE_BYTES = 4096
_MAGIC = b"SQLite format 3\0"
_WAL_HEADER_BYTES, _FRAME_HEADER_BYTES = 32, 24
_LEAF = 0x0D
# Size of an integer by its serial type 0 to 6.
_INTEGER_BYTES = (0, 1, 2, 3, 4, 6, 8)
_NULL, _FLOAT, _ZERO, _ONE, _FIRST_BLOB = 0, 7, 8, 9, 12

Buffer = bytes | mmap.mmap
Values = tuple[Any, ...]


class _NoRow(Exception):
    """These bytes are no row."""


@dataclass(frozen=True)
class Cell:
    """Where a row is: `at` in the page at `start` of `file`; `age` 0 is the newest page of the log."""

    rowid: int
    age: int
    file: Buffer
    start: int
    at: int


class Pages:
    """What is left of a file and its log."""

    def __init__(self, path: Path) -> None:
        self._main = _contents(path)
        self._wal = _contents(path.with_name(path.name + "-wal"))
        self.page_bytes = _page_bytes(self._main, self._wal)
        self._frames = list(_frames(self._wal, self.page_bytes))
        self._newest = dict(self._frames)

    def cells(self) -> Iterator[Cell]:
        """Every row of every table, in every copy there is, the newest copies first."""
        # The log is written forwards: its last frames are the newest.
        for age, (_, at) in enumerate(reversed(self._frames)):
            yield from self._cells(self._wal, at, age)
        for at in range(0, len(self._main), self.page_bytes):
            yield from self._cells(self._main, at, len(self._frames))

    def values(self, cell: Cell) -> list[Values]:
        """The row of a cell, as the log and as the file alone complete it; none when it is no row."""
        rows: list[Values] = []
        # A row's end may be on a page that is in the log and in the file; the checksum tells which belongs to it.
        for overflow in (self._latest, self._in_main):
            with suppress(_NoRow):
                values = _values(self._payload(cell, overflow))
                if values not in rows:
                    rows.append(values)
        return rows

    def _cells(self, file: Buffer, at_page: int, age: int) -> Iterator[Cell]:
        page = file[at_page : at_page + self.page_bytes]
        # The file's header takes the first 100 bytes of page 1.
        start = 100 if page.startswith(_MAGIC) else 0
        if len(page) < start + 8 or page[start] != _LEAF:
            return
        # Leaf: 8 bytes of header, the number of cells in bytes 3 and 4, then their offsets.
        (count,) = struct.unpack_from(">H", page, start + 3)
        for place in range(start + 8, min(start + 8 + 2 * count, len(page) - 1), 2):
            (at,) = struct.unpack_from(">H", page, place)
            with suppress(_NoRow):
                _, after = _varint(page, at)
                rowid, _ = _varint(page, after)
                yield Cell(rowid, age, file, at_page, at)

    def _payload(self, cell: Cell, overflow: Callable[[int], bytes]) -> bytes:
        page = cell.file[cell.start : cell.start + self.page_bytes]
        size, at = _varint(page, cell.at)
        _, at = _varint(page, at)
        # A damaged length would have the loop below follow pages without end.
        if size > len(self._main) + len(self._wal):
            raise _NoRow
        local = _local_bytes(size, self.page_bytes)
        parts, left = [page[at : at + local]], size - local
        after = page[at + local : at + local + 4]
        while left > 0:
            page = overflow(int.from_bytes(after, "big"))
            parts.append(page[4 : 4 + left])
            # Every overflow page begins with the number of the next.
            left -= self.page_bytes - 4
            after = page[:4]
        payload = b"".join(parts)
        if len(payload) != size:
            raise _NoRow
        return payload

    def _latest(self, number: int) -> bytes:
        at = self._newest.get(number)
        return self._in_main(number) if at is None else self._wal[at : at + self.page_bytes]

    def _in_main(self, number: int) -> bytes:
        at = (number - 1) * self.page_bytes
        if not 0 <= at < len(self._main):
            raise _NoRow
        return self._main[at : at + self.page_bytes]


def _contents(path: Path) -> Buffer:
    try:
        with path.open("rb") as file:
            return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except (OSError, ValueError):  # not there, or empty
        return b""


def _page_bytes(main: Buffer, wal: Buffer) -> int:
    # 65536 does not fit into two bytes and is written as 1.
    sizes = [1 if main[16:18] == b"\0\1" else int.from_bytes(main[16:18], "big")] if main[:16] == _MAGIC else []
    sizes.append(int.from_bytes(wal[8:12], "big"))
    return next((size for size in sizes if 512 <= size <= 65536 and size & (size - 1) == 0), DEFAULT_PAGE_BYTES)


def _frames(wal: Buffer, page_bytes: int) -> Iterator[tuple[int, int]]:
    """Page number and place of each committed page in the log, those of its last round only."""
    frames: list[tuple[bytes, int, int, int]] = []
    for at in range(_WAL_HEADER_BYTES, len(wal) - _FRAME_HEADER_BYTES - page_bytes + 1, page_bytes + 24):
        number, committed = struct.unpack_from(">II", wal, at)
        frames.append((wal[at + 8 : at + 16], number, committed, at + _FRAME_HEADER_BYTES))
    salts = Counter(salt for salt, *_ in frames)
    if not salts:
        return
    # SQLite begins the log anew with other salts: frames of an earlier round lie behind and must not count.
    salt = wal[16:24] if wal[16:24] in salts else salts.most_common(1)[0][0]
    # Only up to the last frame that ends a transaction: what follows was never committed.
    last = max((place for place, frame in enumerate(frames) if frame[0] == salt and frame[2]), default=-1)
    yield from ((number, at) for each, number, _, at in frames[: last + 1] if each == salt)


def _local_bytes(size: int, page_bytes: int) -> int:
    """How much of a row lies on its leaf; the rest is on overflow pages."""
    # Formula of the file format, section 1.6: a table leaf with a page of U usable bytes.
    most = page_bytes - 35
    if size <= most:
        return size
    least = (page_bytes - 12) * 32 // 255 - 23
    some = least + (size - least) % (page_bytes - 4)
    return some if some <= most else least


def _varint(data: bytes, at: int) -> tuple[int, int]:
    """A number and where it ends."""
    value = 0
    for place in range(at, at + 9):
        if place >= len(data):
            raise _NoRow
        byte = data[place]
        # The ninth byte has all eight bits.
        if place == at + 8:
            return _signed((value << 8) | byte), place + 1
        value = (value << 7) | (byte & 0x7F)
        if byte < 0x80:
            return value, place + 1
    raise _NoRow


def _signed(value: int) -> int:
    return value - (1 << 64) if value >> 63 else value


def _values(payload: bytes) -> Values:
    end, at = _varint(payload, 0)
    if end > len(payload):
        raise _NoRow
    values, place = [], end
    # First the types of all values, up to `end`, then the values: both are walked at once.
    while at < end:
        kind, at = _varint(payload, at)
        value, place = _value(kind, payload, place)
        values.append(value)
    if place != len(payload):
        raise _NoRow
    return tuple(values)


def _value(kind: int, payload: bytes, at: int) -> tuple[Any, int]:
    if kind in (_NULL, _ZERO, _ONE):
        return {_NULL: None, _ZERO: 0, _ONE: 1}[kind], at
    size = _value_bytes(kind)
    data = payload[at : at + size]
    if len(data) != size:
        raise _NoRow
    return _decoded(kind, data), at + size


def _value_bytes(kind: int) -> int:
    if kind < _FLOAT:
        return _INTEGER_BYTES[kind]
    if kind == _FLOAT:
        return 8
    if kind < _FIRST_BLOB:
        raise _NoRow
    # Even kinds are blobs, odd ones text, both with their length in the kind.
    return (kind - _FIRST_BLOB) // 2


def _decoded(kind: int, data: bytes) -> Any:
    if kind < _FLOAT:
        return int.from_bytes(data, "big", signed=True)
    if kind == _FLOAT:
        return struct.unpack(">d", data)[0]
    if kind % 2 == 0:
        return data
    try:
        return data.decode()
    except UnicodeDecodeError:
        raise _NoRow from None
