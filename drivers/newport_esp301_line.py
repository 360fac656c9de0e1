"""The serial line of a Newport ESP300 / ESP301 / ESP302.

Commands end with CR and are not acknowledged; only queries are answered, with CR LF. What went wrong is
queued in the controller until it is asked for. After a failed exchange the line is brought back into step
with a query whose answer cannot be mistaken, so that a late answer is never taken for the next one's.
"""

from __future__ import annotations

import re
from contextlib import AbstractContextManager
from dataclasses import dataclass

from drivers.conversation import Check, Conversation
from drivers.numbers import decimal, whole
from drivers.transport import Connect, Transport
from rigctl.core.errors import BadReply, WrongInstrument

END = b"\r\n"
VERSION = "VE?"
MODEL = re.compile(r"ESP\s?30\d")
ERRORS_QUEUED_MAX = 64


@dataclass(frozen=True)
class QueuedError:
    """One entry of the controller's error queue; code 0 when it is empty."""

    code: int
    text: str


def parse_error(answer: str) -> QueuedError:
    """Take an answer to `TB?` apart: code, timestamp, text; `ValueError` when it is something else."""
    # The text may hold commas.
    code, timestamp, text = (field.strip() for field in answer.split(",", 2))
    if whole(timestamp) < 0 or whole(code) < 0:
        raise ValueError("expected 'code, timestamp, text'")
    return QueuedError(whole(code), text)


class EspLine:
    """Exchanges with the controller; hold `lock` around those that belong together."""

    def __init__(self, name: str, connect: Connect, timeout_s: float) -> None:
        self.name = name
        self._timeout_s = timeout_s
        # A serial line: late answers outlive the connection.
        self._conversation = Conversation(name, connect, Check(_bytes(VERSION), self._is_version), anew=False)
        self._version = ""
        self.lock = self._conversation.lock

    @property
    def guarded(self) -> bool:
        """No bit turns on the way without being noticed."""
        return self._conversation.guarded

    @property
    def session(self) -> int:
        """Counts connections: what was true of the controller may not be after a new one."""
        return self._conversation.sessions

    def open(self) -> str:
        """Connect and return the controller's answer to `VE?`; `WrongInstrument` if it is no ESP30x."""
        with self.lock:
            self._conversation.open()
            self._version = self.ask(VERSION)
        if not MODEL.search(self._version):
            raise WrongInstrument(
                f"{self.name}: no ESP301 answers, 'VE?' gave {self._version[:80]!r}; check address and baud rate",
                instrument=self.name,
                text=self._version,
            )
        return self._version

    def close(self) -> None:
        """Disconnect for good; an exchange in another thread ends with `LinkLost`."""
        self._conversation.close()

    def reachable(self) -> AbstractContextManager[None]:
        """Connected even if it is not open."""
        return self._conversation.reachable()

    def confirm_in_step(self) -> None:
        """`OutOfStep` when the version is not the answer to its question, or something else is unread."""
        self._conversation.confirm_in_step()

    def tell(self, command: str) -> None:
        """Send a command; nothing comes back."""
        self._conversation.tell(_bytes(command))

    def shout(self, command: str) -> None:
        """Send a command past whoever awaits an answer."""
        self._conversation.shout(_bytes(command))

    def ask(self, query: str) -> str:
        """The answer to a query, without its end; raises `LinkTimeout` or `LinkLost`."""
        return self._conversation.ask(_bytes(query), self._read_line)

    def ask_number(self, query: str) -> float:
        """The answer to a query as a finite number; `BadReply` otherwise."""
        answer = self.ask(query)
        try:
            return decimal(answer)
        except ValueError:
            raise self._bad(query, answer, "a number") from None

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

    def _is_version(self, transport: Transport) -> bool:
        return bool(MODEL.search(self._read_line(transport)))

    def _read_line(self, transport: Transport) -> str:
        return transport.read_until(END, self._timeout_s).decode("latin-1").removesuffix("\r\n")

    def _bad(self, query: str, answer: str, expected: str) -> BadReply:
        self._conversation.doubt()
        return BadReply(
            f"{self.name}: {query!r} gave {answer[:80]!r} instead of {expected}; check cable and baud rate",
            instrument=self.name,
            text=answer,
        )


def _bytes(line: str) -> bytes:
    return line.encode("ascii") + b"\r"
