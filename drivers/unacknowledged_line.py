"""A line whose commands are not acknowledged; only questions are answered, and errors are asked for."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager

from drivers.conversation import Check, Conversation
from drivers.numbers import decimal
from drivers.transport import Connect, Transport
from rigctl.core.errors import BadReply


class UnacknowledgedLine:
    """Exchanges with a controller; hold `lock` around those that belong together.

    `check` is a question with what its answer has to be. A serial line, perhaps: late answers outlive a connection.
    """

    def __init__(self, name: str, connect: Connect, check: str, is_answer: Callable[[str], bool]) -> None:
        self.name = name
        question = Check(self._bytes(check), lambda transport: is_answer(self._read(transport)))
        self._conversation = Conversation(name, connect, question, anew=False)
        self.lock = self._conversation.lock

    @property
    def guarded(self) -> bool:
        """No bit turns on the way without being noticed."""
        return self._conversation.guarded

    def close(self) -> None:
        """Disconnect for good; an exchange in another thread ends with `LinkLost`."""
        self._conversation.close()

    def reachable(self) -> AbstractContextManager[None]:
        """Connected even if it is not open."""
        return self._conversation.reachable()

    def confirm_in_step(self) -> None:
        """`OutOfStep` when the check's question is not answered by its answer, or something else is unread."""
        self._conversation.confirm_in_step()

    def tell(self, command: str) -> None:
        """Send a command; nothing comes back."""
        self._conversation.tell(self._bytes(command))

    def shout(self, command: str) -> None:
        """Send a command past whoever awaits an answer."""
        self._conversation.shout(self._bytes(command))

    def ask(self, query: str) -> str:
        """The answer to a query, without its end; raises `LinkTimeout` or `LinkLost`."""
        return self._conversation.ask(self._bytes(query), self._read)

    def _bytes(self, line: str) -> bytes:
        """A command with its end."""
        raise NotImplementedError

    def _read(self, transport: Transport) -> str:
        """An answer without its end."""
        raise NotImplementedError

    def _number(self, query: str, text: str) -> float:
        """A finite number; `BadReply` for anything else."""
        try:
            return decimal(text)
        except ValueError:
            raise self._bad(query, text, "a number") from None

    def _bad(self, query: str, answer: str, expected: str) -> BadReply:
        self._conversation.doubt()
        return BadReply(
            f"{self.name}: {query!r} gave {answer[:80]!r} instead of {expected}; check cable and baud rate",
            instrument=self.name,
            text=answer,
        )
