"""A conversation with a SCPI instrument: queries, its error queue, IEEE 488.2 blocks."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable

from drivers.transport import Connect, Transport
from rigctl.errors import BadReply, InstrumentError, LinkLost, LinkTimeout, WrongInstrument
from rigctl.interfaces import Identity

_ERROR = re.compile(r'([+-]?\d+),"(.*)"')
_ERRORS_KEPT = 40
"""Read from one queue at most: twice what the deepest holds."""


class ScpiLink:
    """One connection; every exchange holds a lock, so any thread may ask at any time.

    All methods raise `LinkLost` when the connection is gone or was never opened.
    """

    def __init__(self, name: str, connect: Connect, timeout_s: float) -> None:
        self.name = name
        self.timeout_s = timeout_s
        self._connect = connect
        self._transport: Transport | None = None
        self._lock = threading.RLock()

    @property
    def is_open(self) -> bool:
        """True between `open` and `close`."""
        return self._transport is not None

    def open(self, makers: tuple[str, ...], models: tuple[str, ...]) -> Identity:
        """Connect and make sure who answers, any of these; `WrongInstrument` names what did otherwise."""
        with self._lock:
            self.close()
            self._transport = self._connect()
            try:
                return self.identify(makers, models)
            except BaseException:
                self.close()
                raise

    def close(self) -> None:
        """Disconnect; may be called twice."""
        with self._lock:
            if self._transport is not None:
                transport, self._transport = self._transport, None
                transport.close()

    def identify(self, makers: tuple[str, ...], models: tuple[str, ...]) -> Identity:
        """The four fields of *IDN?."""
        with self._lock:
            transport = self._opened()
            transport.discard_input()
            transport.write(b"*IDN?\n")
            text = _text(transport.read_until(b"\n", self.timeout_s))
        fields = [field.strip() for field in text.split(",")]
        known = len(fields) == 4 and fields[0].lower().startswith(tuple(maker.lower() for maker in makers))
        if not known or fields[1] not in models:
            expected = f"{' or '.join(makers)} {' or '.join(models)}"
            raise WrongInstrument(
                f"{self.name} at {transport.address}: expected a {expected}, but {text[:80]!r} answers; "
                "check the address in the rig file",
                instrument=self.name,
                text=text,
            )
        return Identity(model=fields[1], serial=fields[2], firmware=fields[3], text=text)

    def send(self, *commands: str) -> None:
        """Send commands and do not look at the error queue."""
        with self._lock:
            transport = self._opened()
            for command in commands:
                transport.write(command.encode("ascii") + b"\n")

    def configure(self, *commands: str) -> None:
        """Send commands, then raise `InstrumentError` with what the error queue says of them."""
        with self._lock:
            self.send(*commands)
            self.check(f"after {'; '.join(commands)}")

    def check(self, context: str) -> None:
        """Empty the error queue; `InstrumentError` with the first entry unless there was none."""
        errors = self.errors()
        if errors:
            code, text = errors[0]
            more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
            raise InstrumentError(
                f'{self.name}: {code},"{text}"{more} {context}', instrument=self.name, code=code, text=text
            )

    def errors(self) -> list[tuple[str, str]]:
        """Codes and texts from the error queue, oldest first; it is empty afterwards."""
        errors: list[tuple[str, str]] = []
        with self._lock:
            while len(errors) < _ERRORS_KEPT:
                code, text = self._error(self.query("SYST:ERR?"))
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
            return float(reply)
        except ValueError:
            raise self.bad_reply(query, reply, "a number") from None

    def query_block(self, query: str) -> bytes:
        """The payload of a reply that is a definite-length block (IEEE 488.2, 8.7.9)."""
        return self._ask(query, lambda transport: self._read_block(transport, query))

    def bad_reply(self, query: str, reply: str, expected: str) -> BadReply:
        """The one wording for a reply that the manual does not allow."""
        shown = reply if len(reply) <= 60 else reply[:57] + "..."
        return BadReply(
            f"{self.name}: {query} was answered {shown!r}, expected {expected}; "
            "is another program talking to the instrument?",
            instrument=self.name,
            text=reply,
        )

    def _opened(self) -> Transport:
        if self._transport is None:
            raise LinkLost(f"{self.name}: not connected; open it first")
        return self._transport

    def _ask(self, query: str, read: Callable[[Transport], bytes]) -> bytes:
        with self._lock:
            transport = self._opened()
            transport.discard_input()
            transport.write(query.encode("ascii") + b"\n")
            try:
                return read(transport)
            except LinkTimeout as silence:
                if query == "SYST:ERR?":
                    raise
                raise self._explained(query, transport, silence) from silence

    def _explained(self, query: str, transport: Transport, silence: LinkTimeout) -> LinkTimeout:
        """The time-out with the instrument's own error: a query it does not understand gets no reply."""
        try:
            transport.discard_input()
            transport.write(b"SYST:ERR?\n")
            for _ in range(_ERRORS_KEPT):  # the late reply may come first
                match = _ERROR.fullmatch(_text(transport.read_until(b"\n", self.timeout_s)))
                if match:
                    break
        except (LinkTimeout, LinkLost):
            match = None
        said = f"; the instrument says {match[0]}" if match else ""
        return LinkTimeout(f"{self.name}: no reply to {query}{said} ({silence})")

    def _error(self, reply: str) -> tuple[str, str]:
        match = _ERROR.fullmatch(reply)
        if match is None:
            raise self.bad_reply("SYST:ERR?", reply, 'a code and a text, like +0,"No error"')
        return match[1], match[2]

    def _read_block(self, transport: Transport, query: str) -> bytes:
        start = transport.read_exactly(2, self.timeout_s)
        if not re.fullmatch(rb"#[1-9]", start):
            raise self.bad_reply(query, _text(start), "a block that begins with # and a digit")
        digits = transport.read_exactly(int(start[1:]), self.timeout_s)
        if not digits.isdigit():
            raise self.bad_reply(query, _text(start + digits), "the length of the block in digits")
        payload = transport.read_exactly(int(digits) + 1, self.timeout_s)
        if payload[-1:] != b"\n":
            raise self.bad_reply(query, _text(payload[-20:]), "a line feed after the block")
        return payload[:-1]


def _text(line: bytes) -> str:
    return line.decode("ascii", "replace").strip()
