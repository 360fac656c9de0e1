"""The 3458A's own language: commands on one line, replies that end with CR LF, errors kept until they are asked for.

After the Keysight 3458A User's Guide (03458-90014): ERRSTR? (p. 48), reading numbers and MCOUNT? (p. 96), commas
between the readings that RMEM recalls in ASCII (p. 149 of edition 6).
"""

from __future__ import annotations

import re
from contextlib import AbstractContextManager

from drivers.conversation import Check, Conversation
from drivers.numbers import decimal, whole
from drivers.transport import Connect, Transport
from rigctl.core.errors import BadReply, InstrumentError, WrongInstrument

END = b"\r\n"
IDENTITY = "ID?"
MODEL = "HP3458A"
"""What every 3458A calls itself, whoever's name is on its front."""
ERROR_QUESTION = "ERRSTR?"
ERRORS_KEPT = 40
"""Asked for at most: each bit of two registers once."""
_ERROR = re.compile(r'([+-]?\d{1,6})\s*,\s*"(.*)"', re.ASCII)


class MeterLine:
    """One connection; every exchange holds a lock, so any thread may ask at any time."""

    def __init__(self, name: str, connect: Connect, timeout_s: float) -> None:
        self.name = name
        self._timeout_s = timeout_s
        check = Check(_bytes(IDENTITY), lambda transport: self._reply(transport, timeout_s) == MODEL)
        self._conversation = Conversation(name, connect, check, anew=True)
        self.lock = self._conversation.lock

    def open(self, *commands: str) -> None:
        """Connect, clear the device, send these, and make sure who answers; `WrongInstrument` for another."""
        with self.lock:
            self._conversation.open()
            try:
                # It may be at a long record, or have a reading ready: after switching on it reads without end.
                self.device_clear()
                self.tell(*commands)
                self.identify()
            except BaseException:
                self.close()
                raise

    def close(self) -> None:
        """Disconnect; may be called twice."""
        self._conversation.close()

    def urgently(self) -> AbstractContextManager[None]:
        """Connected even if it is not open, and before all others."""
        return self._conversation.urgently()

    def device_clear(self) -> None:
        """GPIB's device clear, where the wire has it: ends what the meter is at, whether or not it listens."""
        self._conversation.device_clear()

    def confirm_in_step(self) -> None:
        """`OutOfStep` when the identity is not the answer to its question, or something else is unread."""
        self._conversation.confirm_in_step()

    def identify(self) -> str:
        """What it calls itself."""
        text = self.ask(IDENTITY)
        if text != MODEL:
            raise WrongInstrument(
                f"{self.name} at {self._conversation.address}: expected a 3458A, but {text[:80]!r} answers; "
                "check the address in the rig file",
                instrument=self.name,
                text=text,
            )
        return text

    def tell(self, *commands: str) -> None:
        """Send commands and do not ask for errors."""
        with self.lock:
            for command in commands:
                self._conversation.tell(_bytes(command))

    def configure(self, *commands: str) -> None:
        """Send commands, then raise `InstrumentError` with what the error registers say of them."""
        with self.lock:
            self.tell(*commands)
            self.check(f"after {'; '.join(commands)}")

    def check(self, context: str) -> None:
        """Empty the error registers; `InstrumentError` with the first unless there was none."""
        if errors := self.errors():
            code, text = errors[0]
            raise InstrumentError(
                f'{self.name}: {code},"{text}" {context}', instrument=self.name, code=code, text=text
            )

    def errors(self) -> list[tuple[str, str]]:
        """Numbers and texts of all errors since they were last asked for."""
        errors: list[tuple[str, str]] = []
        with self.lock:
            while len(errors) < ERRORS_KEPT:
                reply = self.ask(ERROR_QUESTION)
                match = _ERROR.fullmatch(reply)
                if match is None:
                    raise self.bad_reply(ERROR_QUESTION, reply, 'a number and a text, like 0,"NO ERROR"')
                if int(match[1]) == 0:
                    break
                errors.append((match[1], match[2]))
        return errors

    def ask(self, query: str, extra_s: float = 0.0) -> str:
        """The reply, which may take `extra_s` beyond the link's time-out; without the spaces around it."""
        return self._conversation.ask(_bytes(query), lambda t: self._reply(t, self._timeout_s + extra_s))

    def ask_whole(self, query: str, extra_s: float = 0.0) -> int:
        """A reply that is one whole number; `BadReply` when it is not."""
        reply = self.ask(query, extra_s)
        try:
            return whole(reply)
        except ValueError:
            raise self.bad_reply(query, reply, "a whole number") from None

    def ask_numbers(self, query: str, count: int, extra_s: float = 0.0) -> list[float]:
        """A reply of so many numbers with commas between; `BadReply` when it is not."""
        reply = self.ask(query, extra_s)
        try:
            numbers = [decimal(number.strip()) for number in reply.split(",")]
        except ValueError as error:
            raise self.bad_reply(query, reply, f"{count} numbers: {error}") from None
        if len(numbers) != count:
            raise self.bad_reply(query, f"{len(numbers)} numbers", f"{count}")
        return numbers

    def bad_reply(self, query: str, reply: str, expected: str) -> BadReply:
        """The one wording for a reply that the manual does not allow."""
        return BadReply(
            f"{self.name}: {query} was answered {reply[:60]!r}, expected {expected}; "
            "is another program talking to the meter?",
            instrument=self.name,
            text=reply,
        )

    def _reply(self, transport: Transport, timeout_s: float) -> str:
        return transport.read_until(END, timeout_s).decode("ascii", "replace").strip()


def _bytes(line: str) -> bytes:
    return line.encode("ascii") + b"\n"
