"""Esc as a key of its own, however fast the next key comes.

A terminal sends Esc as the byte that every function key begins with. Textual takes Esc and a key right behind it for
one key (Alt with it, or a character of another keyboard), so that typed ahead one of the two is lost. No key of this
console has Alt: Esc before anything that begins no sequence of a terminal is Esc.
"""

from __future__ import annotations

from collections.abc import Iterable
from time import monotonic

from textual import constants, events
from textual._xterm_parser import XTermParser
from textual.message import Message

ESC = "\x1b"
BEGINS_SEQUENCE = frozenset("[O]P_^NX")
"""What may follow Esc in what a terminal sends: CSI, SS3, OSC, DCS, APC, PM, SS2, SOS."""


class EscapeFirst(XTermParser):
    """Keys as textual reads them, and Esc as the key it is."""

    def __init__(self, debug: bool = False) -> None:
        super().__init__(debug)
        self._since_s: float | None = None

    def feed(self, data: str) -> Iterable[Message]:
        """What some characters mean; Esc at their end waits for the next ones, or for `tick`."""
        if self._since_s is not None and data:
            data, self._since_s = ESC + data, None
        while (place := _lone_escape(data)) >= 0:
            if place:
                yield from super().feed(data[:place])
            data = data[place + 1 :]
            yield _escape()
        if data.endswith(ESC):
            data, self._since_s = data[:-1], monotonic()
            if not data:
                return
        yield from super().feed(data)

    def tick(self) -> Iterable[Message]:
        """An Esc that nothing has followed."""
        if self._since_s is not None and monotonic() - self._since_s > constants.ESCAPE_DELAY:
            self._since_s = None
            yield _escape()
        yield from super().tick()


def _lone_escape(data: str) -> int:
    """Where the first Esc stands that begins nothing; -1 when there is none, or what follows is not there yet."""
    place = data.find(ESC)
    while 0 <= place < len(data) - 1 and data[place + 1] in BEGINS_SEQUENCE:
        place = data.find(ESC, place + 2)
    return place if 0 <= place < len(data) - 1 else -1


def _escape() -> events.Key:
    return events.Key("escape", ESC)
