"""A conversation with a SCPI instrument: queries, its error queue, IEEE 488.2 blocks."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress

from drivers.conversation import Check, Conversation
from drivers.numbers import decimal, whole
from drivers.transport import Connect, Transport
from rigctl.core.errors import BadReply, InstrumentError, LinkError, LinkTimeout, WrongInstrument
from rigctl.core.interfaces import Identity

_ERROR = re.compile(r'([+-]?\d{1,5}),"(.*)"', re.ASCII)
IDENTITY, ERROR_QUESTION = b"*IDN?\n", "SYST:ERR?"
BLOCK_BYTES_MAX = 1 << 24
_UNDEFINED_HEADER = -113
_ERRORS_KEPT = 40
"""Read from one queue at most: twice what the deepest holds."""


class NotUnderstood(LinkTimeout):
    """No reply to a question that the instrument does not know, of which its error queue tells (-113 of SCPI)."""


class ScpiLink:
    """One connection; every exchange holds a lock, so any thread may ask at any time.

    All methods raise `LinkLost` when the connection is gone or was never opened.
    """

    def __init__(self, name: str, connect: Connect, timeout_s: float) -> None:
        self.name = name
        self.timeout_s = timeout_s
        self._conversation = Conversation(name, connect, Check(IDENTITY, self._is_identity), anew=True)
        self._lock = self._conversation.lock
        self._identity = ""

    def open(self, makers: tuple[str, ...], models: tuple[str, ...]) -> Identity:
        """Connect and make sure who answers, any of these; `WrongInstrument` names what did otherwise."""
        with self._lock:
            self._conversation.open()
            try:
                return self.identify(makers, models)
            except BaseException:
                self.close()
                raise

    def close(self) -> None:
        """Disconnect; may be called twice."""
        self._conversation.close()

    def urgently(self) -> AbstractContextManager[None]:
        """Connected even if it is not open, and before all others."""
        return self._conversation.urgently()

    def identify(self, makers: tuple[str, ...], models: tuple[str, ...]) -> Identity:
        """The four fields of *IDN?."""
        with self._lock:
            text = _text(self._conversation.ask(IDENTITY, self._read_line))
            address = self._conversation.address
        fields = [field.strip() for field in text.split(",")]
        known = len(fields) == 4 and fields[0].lower().startswith(tuple(maker.lower() for maker in makers))
        if not known or fields[1] not in models:
            expected = f"{' or '.join(makers)} {' or '.join(models)}"
            raise WrongInstrument(
                f"{self.name} at {address}: expected a {expected}, but {text[:80]!r} answers; "
                "check the address in the rig file",
                instrument=self.name,
                text=text,
            )
        self._identity = text
        return Identity(model=fields[1], serial=fields[2], firmware=fields[3], text=text)

    def confirm_in_step(self) -> None:
        """`OutOfStep` when the identity is not the answer to its question, or something else is unread."""
        self._conversation.confirm_in_step()

    def _is_identity(self, transport: Transport) -> bool:
        return _text(self._read_line(transport)) == self._identity

    def send(self, *commands: str) -> None:
        """Send commands and do not look at the error queue."""
        with self._lock:
            for command in commands:
                self._conversation.tell(command.encode("ascii") + b"\n")

    def configure(self, *commands: str) -> None:
        """Send commands, then raise `InstrumentError` with what the error queue says of them."""
        with self._lock:
            self.send(*commands)
            self.check(f"after {'; '.join(commands)}")

    def check(self, context: str) -> None:
        """Empty the error queue; `InstrumentError` with the first entry unless there was none."""
        errors = self.errors()
        if errors:
            # The first is the cause; later ones are often its consequences.
            code, text = errors[0]
            more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
            raise InstrumentError(
                f'{self.name}: {code},"{text}"{more} {context}', instrument=self.name, code=code, text=text
            )

    def errors(self) -> list[tuple[str, str]]:
        """Codes and texts from the error queue, oldest first; it is empty afterwards."""
        errors: list[tuple[str, str]] = []
        with self._lock:
            # An instrument that never says that its queue is empty must not be asked for ever.
            while len(errors) < _ERRORS_KEPT:
                code, text = self._error(self.query(ERROR_QUESTION))
                if int(code) == 0:
                    break
                errors.append((code, text))
        return errors

    def query(self, query: str, extra_s: float = 0.0) -> str:
        """The reply to a query, which may take `extra_s` beyond the link's time-out; `LinkTimeout` if none comes."""
        return _text(self._ask(query, lambda t: t.read_until(b"\n", self.timeout_s + extra_s)))

    def query_number(self, query: str, extra_s: float = 0.0) -> float:
        """A reply that is one number; `BadReply` when it is not."""
        reply = self.query(query, extra_s)
        try:
            return decimal(reply)
        except ValueError:
            raise self.bad_reply(query, reply, "a number") from None

    def query_whole(self, query: str) -> int:
        """A reply that is one whole number; `BadReply` when it is not."""
        reply = self.query(query)
        try:
            return whole(reply)
        except ValueError:
            raise self.bad_reply(query, reply, "a whole number") from None

    def query_block(self, query: str, longest: int = BLOCK_BYTES_MAX) -> bytes:
        """The payload, at most `longest` bytes, of a reply that is a definite-length block (IEEE 488.2, 8.7.9)."""
        return self._ask(query, lambda transport: self._read_block(transport, query, longest))

    def bad_reply(self, query: str, reply: str, expected: str) -> BadReply:
        """The one wording for a reply that the manual does not allow."""
        shown = reply if len(reply) <= 60 else reply[:57] + "..."
        return BadReply(
            f"{self.name}: {query} was answered {shown!r}, expected {expected}; "
            "is another program talking to the instrument?",
            instrument=self.name,
            text=reply,
        )

    def _ask(self, query: str, read: Callable[[Transport], bytes]) -> bytes:
        with self._lock:
            try:
                return self._conversation.ask(query.encode("ascii") + b"\n", read)
            except LinkTimeout as silence:
                # The question for the error has itself timed out: asking it again explains nothing.
                if query == ERROR_QUESTION:
                    raise
                raise self._explained(query, silence) from silence

    def _explained(self, query: str, silence: LinkTimeout) -> LinkTimeout:
        """The time-out with the instrument's own error: a query it does not understand gets no reply."""
        explanation, kind = "", LinkTimeout
        with suppress(LinkError, BadReply):
            # Over a connection made anew, as after any time-out; the queue of errors outlives it.
            code, text = self._error(self.query(ERROR_QUESTION))
            explanation = f'; the instrument says {code},"{text}"'
            kind = NotUnderstood if int(code) == _UNDEFINED_HEADER else LinkTimeout
        waited = str(silence).removeprefix(f"{self.name}: {query}: ")
        return kind(f"{self.name}: no reply to {query}{explanation} ({waited})")

    def _read_line(self, transport: Transport) -> bytes:
        return transport.read_until(b"\n", self.timeout_s)

    def _error(self, reply: str) -> tuple[str, str]:
        match = _ERROR.fullmatch(reply)
        if match is None:
            raise self.bad_reply(ERROR_QUESTION, reply, 'a code and a text, like +0,"No error"')
        return match[1], match[2]

    def _read_block(self, transport: Transport, query: str, longest: int) -> bytes:
        start = transport.read_exactly(2, self.timeout_s)
        if not re.fullmatch(rb"#[1-9]", start):
            raise self.bad_reply(query, _text(start), "a block that begins with # and a digit")
        # IEEE 488.2: #, the number of digits, the number of bytes, the bytes.
        digits = transport.read_exactly(int(start[1:]), self.timeout_s)
        if not digits.isdigit():
            raise self.bad_reply(query, _text(start + digits), "the length of the block in digits")
        # Refused by its announced length, before it is waited for.
        if int(digits) > longest:
            raise self.bad_reply(query, _text(start + digits), f"at most {longest} bytes")
        # With the line feed that ends the message, before which a gateway may put a carriage return, as in a line.
        length = int(digits)
        payload = transport.read_exactly(length + 1, self.timeout_s)
        if payload[length:] == b"\r":
            payload += transport.read_exactly(1, self.timeout_s)
        if payload[length:] not in (b"\n", b"\r\n"):
            raise self.bad_reply(query, shown(payload[-20:]), "a line feed after the block")
        return payload[:length]


def _text(line: bytes) -> str:
    return line.decode("ascii", "replace").strip("\r\n")


def shown(data: bytes) -> str:
    """A piece of a reply as a message has it: as text where it is text, otherwise in hex."""
    text = _text(data)
    return text if data.isascii() and text.isprintable() else f"{data[:16].hex(' ')} (hex)"
