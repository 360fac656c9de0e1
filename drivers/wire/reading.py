"""Wire logs read back, also those of a process that was killed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from drivers.wire.lines import BYTES, Header, Record, parse_header, parse_line
from drivers.wire.ring import lines_in
from rigctl.core.errors import DataError, one_line


@dataclass(frozen=True)
class Gap:
    """What the ring has written over, or what was damaged: lines and bytes of the wire, and between which times."""

    lines: int
    wire_bytes: int
    from_s: float
    to_s: float

    def __str__(self) -> str:
        span = f"{self.from_s:.6f} to {self.to_s:.6f} s"
        return f"{self.lines} lines with {self.wire_bytes} bytes are missing here, {span}"


@dataclass(frozen=True)
class WireLog:
    """A log as far as it is there, in the order of its numbers."""

    path: Path
    header: Header
    records: Sequence[Record]

    def gaps(self) -> dict[int, Gap]:
        """What is missing, by the number of the record behind it."""
        return {after.number: gap for before, after in pairwise(self.records) if (gap := _gap(before, after))}

    @property
    def contiguous(self) -> Sequence[Record]:
        """Up to the first gap."""
        for place, record in enumerate(self.records):
            if record.number != place + 1:
                return self.records[:place]
        return self.records

    @property
    def masked(self) -> Sequence[Record]:
        """Those in which something secret was replaced when they were written."""
        return [record for record in self.records if record.masked]


def read_wire_log(path: Path) -> WireLog:
    """A wire log; `DataError` where it cannot be read or is none. A line that was cut off is left out."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror}); name a wire log") from error
    first, _, _ = data.partition(b"\n")
    try:
        header = parse_header(first)
    except ValueError as error:
        raise DataError(one_line(f"{path}: line 1: {error}; name a file that rigctl wrote as a wire log")) from error
    parsed = map(parse_line, lines_in(data, header.head_bytes))
    by_number = {record.number: record for record in parsed if record is not None}
    return WireLog(path, header, [by_number[number] for number in sorted(by_number)])


def _gap(before: Record, after: Record) -> Gap | None:
    if after.number == before.number + 1:
        return None
    own = len(after.data) if after.kind in BYTES else 0
    missing = after.total - own - before.total
    return Gap(after.number - before.number - 1, missing, before.at_s, after.at_s)
