"""Exchanges with one axis of a Zaber device: every question has a number, and its reply the same."""

from __future__ import annotations

from contextlib import AbstractContextManager

from drivers.conversation import Check, Conversation
from drivers.numbers import whole
from drivers.transport import Connect, Transport
from rigctl.core.errors import BadReply, InstrumentError
from zaber_stage.messages import END, Reply, command, parse_reply

CHECK = 99
"""The number that the check question alone has."""


class ZaberLine:
    """The serial line, for one device and axis."""

    def __init__(self, name: str, device: int, axis: int, connect: Connect, timeout_s: float) -> None:
        self._name = name
        self._device, self._axis = device, axis
        self._timeout_s = timeout_s
        self._number = 0
        self._summed = False
        check = Check(
            command(device, axis, CHECK, "get pos"), lambda transport: self._read(transport).number == CHECK
        )
        self._conversation = Conversation(name, connect, check, anew=False)
        self.lock = self._conversation.lock

    def open(self) -> None:
        """Connect, and have every reply end with its sum."""
        self._summed = False
        self._conversation.open()
        self.succeed("set comm.checksum 1")
        self._summed = True

    def close(self) -> None:
        """Disconnect; may be called twice."""
        self._conversation.close()

    def urgently(self) -> AbstractContextManager[None]:
        """Connected even if it is not open, and before all others."""
        return self._conversation.urgently()

    def confirm_in_step(self) -> None:
        """`OutOfStep` when replies may have been taken for others."""
        self._conversation.confirm_in_step()

    def ask(self, words: str) -> Reply:
        """The reply to a command, accepted or not."""
        with self.lock:
            self._number = (self._number + 1) % CHECK
            number = self._number
            return self._conversation.ask(
                command(self._device, self._axis, number, words),
                lambda transport: self._own(transport, number, words),
            )

    def succeed(self, words: str) -> Reply:
        """The reply to a command that must be accepted; `InstrumentError` with the reason otherwise."""
        reply = self.ask(words)
        if not reply.accepted:
            raise InstrumentError(
                f"{self._name}: {words!r} was refused with {reply.data} (flag {reply.flag}); see the manual's list",
                instrument=self._name,
                code=reply.data,
                text=reply.flag,
            )
        return reply

    def ask_whole(self, words: str) -> int:
        """A reply that is a whole number; `BadReply` otherwise."""
        data = self.succeed(words).data
        try:
            return whole(data)
        except ValueError:
            self._conversation.doubt()
            raise self._bad(f"{words!r} gave {data[:40]!r} instead of a whole number") from None

    def _own(self, transport: Transport, number: int, words: str) -> Reply:
        reply = self._read(transport)
        if reply.number != number:
            raise self._bad(f"{words!r} was answered by the reply to another question")
        return reply

    def _read(self, transport: Transport) -> Reply:
        line = transport.read_until(END, self._timeout_s)
        try:
            return parse_reply(line, self._device, self._axis, summed=self._summed)
        except ValueError as error:
            raise self._bad(f"{line[:60]!r} is {error}") from None

    def _bad(self, why: str) -> BadReply:
        return BadReply(f"{self._name}: {why}; check cable, address and baud rate", instrument=self._name)
