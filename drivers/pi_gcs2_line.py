"""The line of a PI controller that speaks GCS 2.0: commands are not acknowledged, `ERR?` tells of the last one.

After the C-863.12 user manual (MS249E, chapter 8) and the maker's PIPython. Lines end with LF; an answer names its
axis (`1=0.1250`); a question that is not understood has no answer, only an error.
"""

from __future__ import annotations

import re
from contextlib import AbstractContextManager

from drivers.conversation import Check, Conversation
from drivers.numbers import decimal, whole
from drivers.transport import Connect, Transport
from rigctl.core.errors import BadReply, LinkTimeout, WrongInstrument

IDENTITY, ERROR, MOVING = "*IDN?", "ERR?", "\x05"
"""#5 is a single character, and has no line end."""
MAKER = "Physik Instrumente"
_MASK = re.compile(r"[0-9A-Fa-f]{1,8}", re.ASCII)


class GcsLine:
    """Exchanges with the controller; hold `lock` around those that belong together."""

    def __init__(self, name: str, connect: Connect, timeout_s: float) -> None:
        self.name = name
        self._timeout_s = timeout_s
        self._identity = ""
        # Serial lines are among its wires: a late answer outlives a connection.
        check = Check(_bytes(IDENTITY), lambda transport: self._read(transport) == self._identity)
        self._conversation = Conversation(name, connect, check, anew=False)
        self.lock = self._conversation.lock

    def open(self) -> None:
        """Connect; `WrongInstrument` when it is no controller of PI's."""
        self._conversation.open()
        self._identity = self.ask(IDENTITY)
        if MAKER not in self._identity:
            raise WrongInstrument(
                f"{self.name}: no controller of {MAKER} answers, {IDENTITY!r} gave {self._identity[:80]!r}; "
                "check the address",
                instrument=self.name,
                text=self._identity,
            )

    def close(self) -> None:
        """Disconnect for good; an exchange in another thread ends with `LinkLost`."""
        self._conversation.close()

    def reachable(self) -> AbstractContextManager[None]:
        """Connected even if it is not open."""
        return self._conversation.reachable()

    def confirm_in_step(self) -> None:
        """`OutOfStep` when the identity is not the answer to its question, or something else is unread."""
        self._conversation.confirm_in_step()

    def tell(self, command: str) -> None:
        """Send a command; nothing comes back."""
        self._conversation.tell(_bytes(command))

    def shout(self, command: str) -> None:
        """Send a command past whoever awaits an answer."""
        self._conversation.shout(_bytes(command))

    def ask(self, query: str) -> str:
        """The answer, without its end."""
        return self._conversation.ask(_bytes(query), self._read)

    def ask_number(self, query: str, axis: str) -> float:
        """The number that the answer gives this axis; `BadReply` when it gives none."""
        text = self.ask_text(query, axis)
        try:
            return decimal(text)
        except ValueError:
            raise self._bad(query, text, "a number") from None

    def ask_text(self, query: str, axis: str) -> str:
        """What the answer says of this axis."""
        answer = self.ask(f"{query} {axis}")
        named, equals, text = answer.partition("=")
        if named.strip() != axis or not equals:
            raise self._bad(query, answer, f"'{axis}=...'")
        return text.strip()

    def understood(self, query: str, axis: str) -> str | None:
        """As `ask_text`; None where the controller does not know the question, which shows by its silence."""
        try:
            return self.ask_text(query, axis)
        except LinkTimeout:
            if self.error():
                return None
            raise

    def error(self) -> int:
        """The code of the last error, which is forgotten."""
        answer = self.ask(ERROR)
        try:
            return whole(answer.strip())
        except ValueError:
            raise self._bad(ERROR, answer, "a code") from None

    def moving(self) -> bool:
        """True while an axis moves, by the bits of #5."""
        answer = self.ask(MOVING)
        if not _MASK.fullmatch(answer.strip()):
            raise self._bad("#5", answer, "bits as a hexadecimal number")
        return int(answer, 16) != 0

    def _read(self, transport: Transport) -> str:
        line = answer = transport.read_until(b"\n", self._timeout_s)
        # A space before its end: another line of the same answer comes.
        while line.endswith(b" \n"):
            line = transport.read_until(b"\n", self._timeout_s)
            answer += line
        return answer.decode("latin-1").removesuffix("\n")

    def _bad(self, query: str, answer: str, expected: str) -> BadReply:
        self._conversation.doubt()
        return BadReply(
            f"{self.name}: {query!r} gave {answer[:80]!r} instead of {expected}; check cable and baud rate",
            instrument=self.name,
            text=answer,
        )


def _bytes(command: str) -> bytes:
    return command.encode("ascii") + (b"" if len(command) == 1 else b"\n")
