"""The text of a wire log: a header, then a line for everything that happened on the wire.

A line has seven fields, separated by tabs: number, rig time [s], connection, kind, bytes of the wire logged so far,
what went, and the number again. Bytes are written as Python writes them (`\\r`, `\\x00`), so neither a tab nor the
end of a line occurs in them; the number at the end tells a whole line from one that was cut off or written over.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Literal

MAGIC = "rigctl wire log 1 "

SENT = ">"
READ = "<"
UNASKED = "~"
"""Had come although nobody read; taken when the driver looked."""
PENDING = "?"
"""Had come when a read gave up; it is logged again by whichever read takes it."""
OPENED = "+"
NOT_READ = "!"
"""Reading failed, or connecting."""
NOT_SENT = "x"
ENDED = "|"
"""The connection's end, found when the driver looked for what had come."""
CLOSED = "-"
KINDS = frozenset((SENT, READ, UNASKED, PENDING, OPENED, NOT_READ, NOT_SENT, ENDED, CLOSED))
BYTES = frozenset((SENT, READ, UNASKED))
"""What counts as bytes of the wire."""
MASKED = "*"
"""Follows the kind of a line in which something secret was replaced."""


Opening = Literal["asked", "checked", "in charge", ""]
"""What a connection is made for; in charge the instrument is stopped first."""


@dataclass(frozen=True)
class Header:
    """Whose log it is. `opening` says what for: `checked` by `rigctl check`, `asked` who answers, or `in charge`."""

    instrument: str
    driver: str
    address: str
    opening: Opening
    rigctl: str
    started: str
    head_bytes: int
    ring_bytes: int

    def line(self) -> bytes:
        """The first line of the file."""
        return f"{MAGIC}{json.dumps(asdict(self))}\n".encode("ascii")


@dataclass(frozen=True)
class Record:
    """One line; `total` counts the wire's bytes up to and with this one."""

    number: int
    at_s: float
    connection: int
    kind: str
    total: int
    data: bytes
    masked: bool = False


def line_of(number: int, at_s: float, connection: int, kind: str, total: int, data: bytes) -> bytes:
    """A record as it stands in the file; `kind` may be followed by `MASKED`."""
    # Python's own notation: made in C, hence cheap.
    text = repr(data)[2:-1]
    return f"{number}\t{at_s:.6f}\t{connection}\t{kind}\t{total}\t{text}\t{number}\n".encode("ascii")


def parse_header(line: bytes) -> Header:
    """The first line taken apart; `ValueError` when it is no wire log's."""
    text = line.decode("ascii", errors="replace")
    if not text.startswith(MAGIC):
        raise ValueError("no wire log")
    try:
        return Header(**json.loads(text.removeprefix(MAGIC)))
    except TypeError as error:
        raise ValueError(str(error)) from error


def parse_line(line: bytes) -> Record | None:
    """A line without its end taken apart; None when it is not whole."""
    fields = line.split(b"\t")
    if len(fields) != 7 or fields[0] != fields[6]:
        return None
    try:
        number, at_s, connection, total = int(fields[0]), float(fields[1]), int(fields[2]), int(fields[4])
        kind, data = fields[3].decode("ascii"), _unescaped(fields[5])
    except ValueError:
        return None
    if kind.removesuffix(MASKED) not in KINDS:
        return None
    return Record(number, at_s, connection, kind.removesuffix(MASKED), total, data, kind.endswith(MASKED))


def _unescaped(text: bytes) -> bytes:
    return text.decode("unicode_escape").encode("latin-1") if b"\\" in text else text
