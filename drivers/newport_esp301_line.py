"""The serial line of a Newport ESP300 / ESP301 / ESP302.

Commands end with CR and are not acknowledged; only queries are answered, with CR LF. What went wrong is
queued in the controller until it is asked for. After a failed exchange the line is brought back into step
with a query whose answer cannot be mistaken, so that a late answer is never taken for the next one's.
"""

from __future__ import annotations

import re
import threading
from dataclasses import dataclass

from drivers.transport import Connect, Transport
from rigctl.errors import BadReply, LinkLost, WrongInstrument

END = b"\r\n"
MODEL = re.compile(r"ESP\s?30\d")
ANSWERS_BEHIND_MAX = 16
ERRORS_QUEUED_MAX = 64


@dataclass(frozen=True)
class QueuedError:
    """One entry of the controller's error queue; code 0 when it is empty."""

    code: int
    text: str


def parse_error(answer: str) -> QueuedError:
    """Take an answer to `TB?` apart: code, timestamp, text; `ValueError` when it is something else."""
    code, timestamp, text = (field.strip() for field in answer.split(",", 2))
    if not (code.isdecimal() and timestamp.isdecimal()):
        raise ValueError("expected 'code, timestamp, text'")
    return QueuedError(int(code), text)


class EspLine:
    """Exchanges with the controller; hold `lock` around those that belong together."""

    def __init__(self, name: str, connect: Connect, timeout_s: float) -> None:
        self.name = name
        self.lock = threading.RLock()
        self.session = 0
        """Counts connections: what was true of the controller may not be after a new one."""
        self._connect = connect
        self._timeout_s = timeout_s
        self._transport: Transport | None = None
        self._wanted = False
        self._in_step = False

    def open(self) -> str:
        """Connect and return the controller's answer to `VE?`; `WrongInstrument` if it is no ESP30x."""
        self.close()
        self._wanted = True
        with self.lock:
            self._connected().discard_input()
            self._in_step = True
            version = self.ask("VE?")
        if not MODEL.search(version):
            raise WrongInstrument(
                f"{self.name}: no ESP301 answers, 'VE?' gave {version[:80]!r}; check address and baud rate",
                instrument=self.name,
                text=version,
            )
        return version

    def close(self) -> None:
        """Disconnect for good; an exchange in another thread ends with `LinkLost`."""
        self._wanted = False
        self._drop()

    def tell(self, command: str) -> None:
        """Send a command; nothing comes back."""
        with self.lock:
            try:
                self._connected().write(f"{command}\r".encode("ascii"))
            except LinkLost:
                self._drop()
                raise

    def ask(self, query: str) -> str:
        """The answer to a query, without its end; raises `LinkTimeout` or `LinkLost`."""
        with self.lock:
            self._connected()
            if not self._in_step:
                self._fall_into_step()
            self._in_step = False
            self.tell(query)
            answer = self._read_line()
            self._in_step = True
            return answer

    def ask_number(self, query: str) -> float:
        """The answer to a query as a finite number; `BadReply` otherwise."""
        answer = self.ask(query)
        if not re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,2})?", answer):
            raise self._bad(query, answer, "a number")
        return float(answer)

    def next_error(self) -> QueuedError:
        """Take the oldest error off the controller's queue."""
        answer = self.ask("TB?")
        try:
            return parse_error(answer)
        except ValueError:
            raise self._bad("TB?", answer, "'code, timestamp, text'") from None

    def clear_errors(self) -> None:
        """Empty the controller's error queue."""
        for _ in range(ERRORS_QUEUED_MAX):
            if self.next_error().code == 0:
                return
        raise BadReply(
            f"{self.name}: 'TB?' gave {ERRORS_QUEUED_MAX} errors and no end; switch the controller off and on",
            instrument=self.name,
        )

    def _fall_into_step(self) -> None:
        self._connected().discard_input()
        self.tell("VE?")
        for _ in range(ANSWERS_BEHIND_MAX):
            if MODEL.search(self._read_line()):
                return
        raise BadReply(
            f"{self.name}: no answer to 'VE?' among {ANSWERS_BEHIND_MAX} lines; check that nobody else uses the line",
            instrument=self.name,
        )

    def _read_line(self) -> str:
        try:
            return self._connected().read_until(END, self._timeout_s).decode("latin-1").strip()
        except LinkLost:
            self._drop()
            raise

    def _connected(self) -> Transport:
        if not self._wanted:
            raise LinkLost(f"{self.name}: not connected; open it first")
        if self._transport is None:
            self._transport = self._connect()
            self._in_step = False
            self.session += 1
        return self._transport

    def _drop(self) -> None:
        transport, self._transport = self._transport, None
        if transport is not None:
            transport.close()

    def _bad(self, query: str, answer: str, expected: str) -> BadReply:
        self._in_step = False
        return BadReply(
            f"{self.name}: {query!r} gave {answer[:80]!r} instead of {expected}; check cable and baud rate",
            instrument=self.name,
            text=answer,
        )
