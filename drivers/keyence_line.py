"""The wire of Keyence LK-G controllers.

Commands and replies are ASCII lines that end with CR; a command is sent only after the reply to the one
before. A refusal is `ER,<command>,<code>`; which command stands in the middle differs between sources, so
only the code is read.
"""

from __future__ import annotations

import threading

from drivers.keyence_settings import KeyenceSettings
from drivers.transport import Connect, Transport
from rigctl.clock import Clock
from rigctl.errors import BadReply, InstrumentError, LinkLost, LinkTimeout

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
        self.lock = threading.RLock()
        self.opened = False
        self._settings = settings
        self._connect = connect
        self._clock = clock
        self._transport: Transport | None = None
        self._late_reply = False

    def open(self) -> None:
        """Connect."""
        with self.lock:
            self.opened = True
            self._link()

    def close(self) -> None:
        """Disconnect; may be called twice."""
        with self.lock:
            self.opened = False
            self._disconnect()

    def ask(self, command: str, timeout_s: float | None = None) -> bytes:
        """What stands in the reply after the command's name.

        Raises `InstrumentError` when the command is refused, `BadReply` when something else is answered.
        """
        reply = self._exchange(command, self._settings.link_timeout_s if timeout_s is None else timeout_s)
        name, _, rest = reply.partition(b",")
        if name == b"ER":
            raise self._refused(command, reply)
        if name != main_command(command).encode():
            raise self.bad(command, reply, f"a reply that begins with {main_command(command)}")
        return rest

    def bad(self, command: str, reply: bytes, wanted: str) -> BadReply:
        """The error for a reply that the manual does not allow."""
        return BadReply(
            f"{self.name}: {command} was answered by {reply[:60]!r}, not by {wanted}; "
            "check the line (baud rate, parity) and the address",
            instrument=self.name,
        )

    def _exchange(self, command: str, timeout_s: float) -> bytes:
        with self.lock:
            transport = self._link()
            try:
                if self._late_reply:
                    self._await_silence(transport)
                transport.discard_input()
                transport.write(command.encode() + b"\r")
                return self._reply(transport, timeout_s)
            except LinkTimeout as error:
                self._late_reply = True
                raise LinkTimeout(f"{self.name}: {command}: {error}") from error
            except LinkLost as error:
                self._disconnect()
                raise LinkLost(f"{self.name}: {command}: {error}") from error

    def _reply(self, transport: Transport, timeout_s: float) -> bytes:
        left_s = timeout_s
        deadline_s = self._clock.now_s() + timeout_s
        while left_s >= 0.0:
            line = transport.read_until(b"\r", left_s)[:-1]
            # A controller set to automatic output sends values unasked.
            if not line.startswith(b"TG,"):
                return line
            left_s = deadline_s - self._clock.now_s()
        raise LinkTimeout(f"only automatic output came in {timeout_s:g} s; end it on the controller's panel")

    def _await_silence(self, transport: Transport) -> None:
        """Let a reply that did not come in time pass, or it would be taken for the next one."""
        deadline_s = self._clock.now_s() + self._settings.readout_timeout_s
        while self._clock.now_s() < deadline_s:
            transport.discard_input()
            try:
                transport.read_exactly(1, self._settings.link_timeout_s)
            except LinkTimeout:
                break
        self._late_reply = False

    def _link(self) -> Transport:
        if not self.opened:
            raise LinkLost(f"{self.name}: not open; call open first")
        if self._transport is None:
            self._transport = self._connect()
        return self._transport

    def _disconnect(self) -> None:
        transport, self._transport = self._transport, None
        self._late_reply = False
        if transport is not None:
            transport.close()

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


def main_command(command: str) -> str:
    """The command's name, with which the reply begins."""
    return command.partition(",")[0]
