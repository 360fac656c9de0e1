"""The wire of Keyence LK-G controllers.

Commands and replies are ASCII lines that end with CR; a command is sent only after the reply to the one
before. A refusal is `ER,<command>,<code>`; which command stands in the middle differs between sources, so
only the code is read.
"""

from __future__ import annotations

import re
from contextlib import AbstractContextManager

from drivers.conversation import Check, Conversation
from drivers.keyence_settings import KeyenceSettings
from drivers.transport import Connect, Transport
from rigctl.core.clock import Clock
from rigctl.core.errors import BadReply, InstrumentError, LinkTimeout

PROGRAM, PROGRAM_REPLY = b"PR", re.compile(rb"PR,[0-7]|ER,PR,\d\d")
"""Which of the eight programs is in use: nothing else is answered like that."""

_MENDS = {
    "command error": "check `generation` in the rig file",
    "status error": "it is in the wrong mode: leave its settings menu and open it again",
    "head connection error": "check the heads' cables",
}


class KeyenceLine:
    """Asks one question at a time, from any thread; connects anew after a loss, since nothing moves here.

    `lock` may be held around several questions that belong together.
    """

    def __init__(self, name: str, settings: KeyenceSettings, connect: Connect, clock: Clock) -> None:
        self.name = name
        self._settings = settings
        self._clock = clock
        self._conversation = Conversation(
            # On a serial line late replies outlive the connection.
            name,
            connect,
            Check(PROGRAM + b"\r", self._is_program),
            anew=False,
            harmless=_automatic,
        )
        self.lock = self._conversation.lock

    @property
    def is_open(self) -> bool:
        """True between `open` and `close`."""
        return self._conversation.opened

    @property
    def guarded(self) -> bool:
        """No bit turns on the way without being noticed."""
        return self._conversation.guarded

    def open(self) -> None:
        """Connect."""
        self._conversation.open()

    def close(self) -> None:
        """Disconnect; may be called twice."""
        self._conversation.close()

    def urgently(self) -> AbstractContextManager[None]:
        """Connected even if it is not open, and before all others."""
        return self._conversation.urgently()

    def confirm_in_step(self) -> None:
        """`OutOfStep` when the program's number is not the answer to its question, or something else is unread."""
        self._conversation.confirm_in_step()

    def ask(self, command: str, timeout_s: float | None = None) -> bytes:
        """What stands in the reply after the command's name.

        Raises `InstrumentError` when the command is refused, `BadReply` when something else is answered.
        """
        # Zero is a time-out, None is not.
        reply = self._exchange(command, self._settings.link_timeout_s if timeout_s is None else timeout_s)
        name, _, rest = reply.partition(b",")
        if name == b"ER":
            raise self._refused(command, reply)
        if name != main_command(command).encode():
            # Another command's reply: from here on every reply may be one behind.
            self._conversation.doubt()
            raise self.bad(command, reply, f"a reply that begins with {main_command(command)}")
        return rest

    def ask_repeated(self, command: str) -> bytes:
        """What stands in the reply after the whole command, which it repeats; as `ask` otherwise."""
        reply = self.ask(command)
        # Of another output, or of another setting: a bit of the command or of the reply has turned.
        _, _, repeated = command.encode().partition(b",")
        if not repeated:
            return reply
        if not reply.startswith(repeated + b","):
            self._conversation.doubt()
            raise self.bad(command, reply, f"a reply that repeats {command}")
        return reply.removeprefix(repeated + b",")

    def bad(self, command: str, reply: bytes, wanted: str) -> BadReply:
        """The error for a reply that the manual does not allow."""
        return BadReply(
            f"{self.name}: {command} was answered by {reply[:60]!r}, not by {wanted}; "
            "check the line (baud rate, parity) and the address",
            instrument=self.name,
        )

    def _exchange(self, command: str, timeout_s: float) -> bytes:
        return self._conversation.ask(command.encode() + b"\r", lambda transport: self._reply(transport, timeout_s))

    def _reply(self, transport: Transport, timeout_s: float) -> bytes:
        left_s = timeout_s
        deadline_s = self._clock.now_s() + timeout_s
        while left_s >= 0.0:
            line = transport.read_until(b"\r", left_s)[:-1]
            # A controller set to automatic output sends values unasked.
            if not line.startswith(b"TG,"):
                return line
            # Automatic output comes all the time: without a deadline of its own the reply would be awaited for ever.
            left_s = deadline_s - self._clock.now_s()
        raise LinkTimeout(
            f"only automatic output came in {timeout_s:g} s, which is not used (LK-G series user's manual, page "
            "5-24); end it on the controller's panel"
        )

    def _is_program(self, transport: Transport) -> bool:
        # A storage read-out takes up to `readout_timeout_s` on the line, and nothing else is answered meanwhile.
        deadline_s = self._clock.now_s() + self._settings.readout_timeout_s
        while True:
            try:
                return bool(PROGRAM_REPLY.fullmatch(self._reply(transport, self._settings.link_timeout_s)))
            except LinkTimeout:
                # a long reply may still be on its way
                if not transport.unread() or self._clock.now_s() > deadline_s:
                    raise

    def _refused(self, command: str, reply: bytes) -> InstrumentError:
        code = reply.rpartition(b",")[2].decode("ascii", "replace").strip()
        text = self._settings.dialect.errors.get(code, "unknown code")
        mend = _MENDS.get(text, "see the controller's manual")
        return InstrumentError(
            f"{self.name}: {command} refused with error {code} ({text}); {mend}",
            instrument=self.name,
            code=code,
            text=text,
        )


def _automatic(unread: bytes) -> bool:
    """Automatic output, perhaps cut at the end."""
    # Cut off at the moment of looking, the last line may be only the beginning of one.
    return all(line.startswith(b"TG,"[: len(line)]) for line in unread.split(b"\r"))


def main_command(command: str) -> str:
    """The command's name, with which the reply begins."""
    return command.partition(",")[0]
