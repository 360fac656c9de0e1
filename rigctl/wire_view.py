"""A wire log as a person reads it: a line for everything that happened, what repeats folded, what is missing said."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from drivers.wire import lines
from drivers.wire.lines import Record
from drivers.wire.reading import Gap, WireLog

LONGEST_CYCLE = 8
"""Lines of a poll that repeats: up to four questions and their answers."""
SHOWN_BYTES = 160
SHOWN_HEX = 48
BINARY = 0.2
"""From this share of bytes that are no text on, bytes are shown as numbers."""
TEXT = frozenset((9, 10, 13, *range(32, 127)))
WORDS = {
    lines.OPENED: "connected",
    lines.CLOSED: "disconnected",
    lines.NOT_READ: "failed:",
    lines.NOT_SENT: "not sent:",
    lines.ENDED: "ended:",
}

Item = Record | Gap


def text_lines(log: WireLog, *, full: bool = False) -> Iterator[str]:
    """Header, records and gaps; `full` shows all bytes and folds nothing."""
    header = log.header
    yield f"{header.instrument}: {header.driver} at {header.address}, {header.started}, rigctl {header.rigctl}"
    if log.masked:
        yield f"masked when it was written: secrets in {len(log.masked)} lines, shown as ***"
    items = list(_joined(_items(log)))
    place = 0
    while place < len(items):
        length, times = (1, 1) if full else repeats(items, place)
        for item in items[place : place + length]:
            yield _line(item, full=full)
        place += length * times
        if times > 1:
            what = "line" if length == 1 else f"{length} lines"
            last = items[place - 1]
            yield f"{'':>14}    ... the last {what} {times - 1} times more, until {_at_s(last):.6f} s"
    if not log.records:
        yield "nothing was logged"


def documents(log: WireLog) -> list[dict[str, Any]]:
    """All records and gaps for other programs; bytes as in the file."""
    return [_document(item) for item in _items(log)]


def repeats(items: Sequence[Item], place: int) -> tuple[int, int]:
    """The length of the cycle that begins at `place`, and how often it comes; one line once where nothing repeats."""
    best = (1, 1)
    for length in range(1, LONGEST_CYCLE + 1):
        cycle = [_same(item) for item in items[place : place + length]]
        times = 1
        while [_same(item) for item in items[place + times * length : place + (times + 1) * length]] == cycle:
            times += 1
        # Twice is shorter to read than to be told of; of two cycles the one that covers more.
        if times > 2 and length * times > best[0] * best[1]:
            best = (length, times)
    return best


def _items(log: WireLog) -> Iterator[Item]:
    gaps = log.gaps()
    for record in log.records:
        if record.number in gaps:
            yield gaps[record.number]
        yield record


def _joined(items: Iterable[Item]) -> Iterator[Item]:
    """What was read in pieces, an answer's first byte and its rest for example, as one."""
    before: Item | None = None
    for item in items:
        if isinstance(item, Record) and isinstance(before, Record) and _goes_on(before, item):
            before = replace(before, data=before.data + item.data, masked=before.masked or item.masked)
            continue
        if before is not None:
            yield before
        before = item
    if before is not None:
        yield before


def _goes_on(before: Record, item: Record) -> bool:
    return item.kind == before.kind == lines.READ and item.connection == before.connection


def _same(item: Item) -> object:
    return (item.connection, item.kind, item.data) if isinstance(item, Record) else item


def _at_s(item: Item) -> float:
    return item.at_s if isinstance(item, Record) else item.to_s


def _line(item: Item, *, full: bool) -> str:
    if isinstance(item, Gap):
        return f"{'':>14}    [{item}]"
    start = f"{item.at_s:14.6f} {item.connection:2} {item.kind} "
    if item.kind in WORDS:
        return start + f"{WORDS[item.kind]} {item.data.decode('utf-8', 'replace')}".rstrip()
    return start + shown(item.data, full=full)


def shown(data: bytes, *, full: bool = False) -> str:
    """Bytes as text with escapes, or as hexadecimal numbers where they are none."""
    strange = sum(byte not in TEXT for byte in data)
    binary = strange > BINARY * len(data)
    limit = len(data) if full else SHOWN_HEX if binary else SHOWN_BYTES
    head = data[:limit]
    text = f"hex {head.hex(' ')}" if binary else repr(head)[2:-1]
    return f"{text} ... ({len(data)} bytes)" if len(data) > limit else text


def _document(item: Item) -> dict[str, Any]:
    if isinstance(item, Gap):
        return {"missing": {"lines": item.lines, "bytes": item.wire_bytes, "from_s": item.from_s, "to_s": item.to_s}}
    return {
        "number": item.number,
        "at_s": item.at_s,
        "connection": item.connection,
        "kind": item.kind,
        "text": repr(item.data)[2:-1],
        "masked": item.masked,
    }
