"""The serial line of a Newport ESP300 / ESP301 / ESP302.

Commands end with CR and are not acknowledged; only queries are answered, with CR LF. What went wrong is
queued in the controller until it is asked for. After a failed exchange the line is brought back into step
with a query whose answer cannot be mistaken, so that a late answer is never taken for the next one's.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from drivers.connect import serial_ways
from drivers.numbers import whole
from drivers.transport import Connect, Transport
from drivers.transport_serial import SerialSettings
from drivers.unacknowledged_line import UnacknowledgedLine
from rigctl.core.errors import BadReply, LinkTimeout, WrongInstrument

END = b"\r\n"
VERSION = "VE?"
MODEL = re.compile(r"ESP\s?30\d")
ERRORS_QUEUED_MAX = 64
NO_ERROR = "NO ERROR DETECTED"
EMERGENCY_STOP, LIMITS, AXIS_ERRORS = 4, range(4, 8), 100
"""Error codes: of an axis, its number is in the hundreds."""
UNREADABLE = -1
"""In place of the code of an error whose text is that of a safety device."""
SAFETY = re.compile(r"EMERGENCY STOP|(HARDWARE|SOFTWARE) LIMIT", re.IGNORECASE)
"""What the texts of those have in them."""
LINES = tuple(SerialSettings(baud=baud, rtscts=True) for baud in (921600, 19200))
"""How ESP301s are set: over its USB connector at 921 600 baud, and at 19 200 where drivers use its RS-232."""


@dataclass(frozen=True)
class QueuedError:
    """One entry of the controller's error queue; code 0 when it is empty."""

    code: int
    text: str

    @property
    def is_safety(self) -> bool:
        """The emergency stop, or a limit of an axis, by code or text: a turned bit must not erase one."""
        of_axis = self.code >= AXIS_ERRORS and self.code % AXIS_ERRORS in LIMITS
        return of_axis or self.code == EMERGENCY_STOP or bool(SAFETY.search(self.text))


def parse_error(answer: str) -> QueuedError:
    """Take an answer to `TB?` apart: code, timestamp, text; `ValueError` for all else, and where they disagree."""
    # The text may hold commas.
    code, timestamp, text = (field.strip() for field in answer.split(",", 2))
    if whole(timestamp) < 0 or whole(code) < 0:
        raise ValueError("expected 'code, timestamp, text'")
    if (whole(code) == 0) != (text.upper() == NO_ERROR):
        raise ValueError(f"only 0 is {NO_ERROR}")
    return QueuedError(whole(code), text)


class EspLine(UnacknowledgedLine):
    """Exchanges with the controller."""

    def __init__(self, name: str, connect: Connect, timeout_s: float) -> None:
        self.found = ""
        """Which of the line's settings the controller answered at; empty where there was nothing to choose."""
        self._timeout_s = timeout_s
        self._ways = serial_ways(connect, LINES)
        self._way = self._ways[0][1]
        self._version = ""
        super().__init__(name, lambda: self._way(), VERSION, lambda answer: bool(MODEL.search(answer)))

    @property
    def session(self) -> int:
        """Counts connections: what was true of the controller may not be after a new one."""
        return self._conversation.sessions

    def open(self) -> str:
        """Connect and return the controller's answer to `VE?`; `WrongInstrument` if it is no ESP30x.

        Where the address does not say how the line is set, what ESP301s are set to is tried.
        """
        with self.lock:
            self._version = self._found_version()
        if not MODEL.search(self._version):
            raise WrongInstrument(
                f"{self.name}: no ESP301 answers, 'VE?' gave {self._version[:80]!r}; check address and baud rate",
                instrument=self.name,
                text=self._version,
            )
        return self._version

    def _found_version(self) -> str:
        """What answers `VE?` at the first of the ways at which an ESP30x does, else at the last."""
        for words, way in self._ways:
            self._way, self.found = way, words if len(self._ways) > 1 else ""
            last = way is self._ways[-1][1]
            try:
                self._conversation.open()
                # At another rate it has heard noise, which this ends: an error in its queue, cleared later.
                if way is not self._ways[0][1]:
                    self.tell("")
                version = self.ask(VERSION)
            except LinkTimeout as error:
                if last:
                    raise self._silent(error) from error
            else:
                if last or MODEL.search(version):
                    return version
        raise LinkTimeout(f"{self.name}: no way to connect")

    def _silent(self, error: LinkTimeout) -> LinkTimeout:
        if len(self._ways) == 1:
            return error
        tried = " and ".join(words for words, _ in self._ways)
        return LinkTimeout(f"{error}; tried {tried} with RTS/CTS, as its address says neither")

    def ask_number(self, query: str) -> float:
        """The answer to a query as a finite number; `BadReply` otherwise."""
        return self._number(query, self.ask(query))

    def next_error(self) -> QueuedError:
        """Take the oldest error off the controller's queue."""
        answer = self.ask("TB?")
        try:
            return parse_error(answer)
        except ValueError:
            # It has been taken off the queue: who asks again would not hear of it.
            if SAFETY.search(answer):
                return QueuedError(UNREADABLE, answer)
            raise self._bad("TB?", answer, "'code, timestamp, text' that agree") from None

    def clear_errors(self) -> None:
        """Empty the controller's error queue."""
        for _ in range(ERRORS_QUEUED_MAX):
            if self.next_error().code == 0:
                return
        raise BadReply(
            f"{self.name}: 'TB?' gave {ERRORS_QUEUED_MAX} errors and no end; switch the controller off and on",
            instrument=self.name,
        )

    def _read(self, transport: Transport) -> str:
        return transport.read_until(END, self._timeout_s).decode("latin-1").removesuffix("\r\n")

    def _bytes(self, line: str) -> bytes:
        return line.encode("ascii") + b"\r"
