"""The line of a PI controller that speaks GCS 2.0: commands are not acknowledged, `ERR?` tells of the last one.

After the C-863.12 user manual (MS249E, chapter 8) and the maker's PIPython. Lines end with LF; an answer names its
axis (`1=0.1250`); a question that is not understood has no answer, only an error.
"""

from __future__ import annotations

import re

from drivers.numbers import whole
from drivers.transport import Connect, Transport
from drivers.unacknowledged_line import UnacknowledgedLine
from rigctl.core.errors import WrongInstrument

IDENTITY, ERROR, MOVING = "*IDN?", "ERR?", "\x05"
"""#5 is a single character, and has no line end."""
MAKER = "Physik Instrumente"
_MASK = re.compile(r"[0-9A-Fa-f]{1,8}", re.ASCII)


class GcsLine(UnacknowledgedLine):
    """Exchanges with the controller."""

    def __init__(self, name: str, connect: Connect, timeout_s: float) -> None:
        self._timeout_s = timeout_s
        self._identity = ""
        super().__init__(name, connect, IDENTITY, lambda answer: answer == self._identity)

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

    def ask_number(self, query: str, axis: str) -> float:
        """The number that the answer gives this axis; `BadReply` when it gives none."""
        return self._number(query, self.ask_text(query, axis))

    def ask_text(self, query: str, axis: str) -> str:
        """What the answer says of this axis."""
        answer = self.ask(f"{query} {axis}")
        named, equals, text = answer.partition("=")
        if named.strip() != axis or not equals:
            raise self._bad(query, answer, f"'{axis}=...'")
        return text.strip()

    def commands(self) -> frozenset[str]:
        """All that the controller says it understands, without parameters."""
        return frozenset(word for line in self.ask("HLP?").splitlines() for word in line.split()[:1])

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

    def _bytes(self, line: str) -> bytes:
        return line.encode("ascii") + (b"" if len(line) == 1 else b"\n")
