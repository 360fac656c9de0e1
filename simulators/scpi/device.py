"""The shell around a simulated SCPI device: clients, error queue, status registers, common commands."""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Callable, Iterable

from simulators.clock import SimulationClock
from simulators.scpi.commands import Command, Immediate, Pending, Register, Reply, register_commands, setting
from simulators.scpi.grammar import (
    Integer,
    ScpiError,
    Unit,
    header_regex,
    parse,
    split_message,
)

HEADERS_KEPT = 256
"""Spellings of commands whose meaning is remembered."""
QUEUE_LENGTH = 20
SHORTEST_WAIT_S = 1e-6
POWER_ON = 1 << 7
"""The bit of the standard event register."""


class ScpiShell:
    """Reads messages of any number of clients and lets the device's commands answer them.

    `busy` tells whether an overlapped operation is pending and `idle_s` when it may end (inf: unknown); both
    are what *OPC, *OPC? and *WAI wait for.
    """

    def __init__(
        self,
        clock: SimulationClock,
        commands: Iterable[Command],
        busy: Callable[[], bool],
        idle_s: Callable[[], float],
        questionable: Register,
        operation: Register,
    ) -> None:
        self.clock = clock
        self.standard = Register(event=POWER_ON)
        self.questionable = questionable
        self.operation = operation
        self._service_enable = 0
        self._busy, self._idle_s = busy, idle_s
        self._completion_asked = False
        self._errors: deque[ScpiError] = deque()
        self._sessions: list[Session] = []
        self._wake_s = -math.inf
        self._commands: list[tuple[re.Pattern[str], Command]] = [
            (header_regex(c.pattern), c) for c in (*self._common(), *commands)
        ]
        self._known: dict[str, tuple[Command, tuple[int, ...]]] = {}

    def connect(self, send: Callable[[bytes], None]) -> Session:
        """Serve one more client."""
        session = Session(self, send)
        self._sessions.append(session)
        return session

    def disconnect(self, session: Session) -> None:
        """Forget a client."""
        if session in self._sessions:
            self._sessions.remove(session)

    def power_on(self) -> None:
        """Status and errors as after switching on."""
        self._clear()
        self.standard.event = POWER_ON

    def error(self, error: ScpiError) -> None:
        """Queue an error; when full the last one becomes -350."""
        # Command, execution, device and query errors: bits 5 to 2 of the event register (IEEE 488.2).
        bit = {1: 32, 2: 16, 3: 8, 4: 4}[-error.code // 100]
        self.standard.event |= bit
        if len(self._errors) < QUEUE_LENGTH:
            self._errors.append(error)
        else:
            self._errors[-1] = ScpiError(-350)

    def execute(self, unit: Unit) -> Reply:
        """What one unit answers; `ScpiError` when it is refused."""
        command, suffixes = self._command(unit.header)
        if len(unit.parameters) < command.required:
            raise ScpiError(-109)
        if len(unit.parameters) > command.required + command.optional:
            raise ScpiError(-108)
        return command.handler(*suffixes, *unit.parameters)

    def _command(self, header: str) -> tuple[Command, tuple[int, ...]]:
        """A header's command and numeric suffixes; -113 when there is none."""
        known = self._known.get(header)
        if known is not None:
            return known
        for regex, command in self._commands:
            if match := regex.fullmatch(header):
                resolved = command, tuple(int(digits or 1) for digits in match.groups())
                if len(self._known) < HEADERS_KEPT:
                    self._known[header] = resolved
                return resolved
        raise ScpiError(-113)

    def resume(self) -> None:
        """Let clients go on whose reply is ready, and wake again when the next one may be."""
        for session in tuple(self._sessions):
            session.resume()
        now_s = self.clock.now_s()
        wake_s = min((s.wake_s() for s in self._sessions), default=math.inf)
        # One wake-up that is due before this one is enough: it looks again.
        if math.isfinite(wake_s) and not now_s < self._wake_s <= wake_s:
            self._wake_s = wake_s = max(wake_s, now_s + SHORTEST_WAIT_S)
            self.clock.call_at(wake_s, self.resume)

    def _common(self) -> tuple[Command, ...]:
        """IEEE 488.2 commands that need nothing of the device, and the SYSTem and STATus ones beside them."""
        byte = Integer(0, 255, 0)
        return (
            Command("*CLS", self._clear),
            Command("*ESR?", lambda: f"{self._completed().read():+d}"),
            *setting("*ESE", byte, lambda: self.standard.enable, self.standard.set_enable),
            *setting("*SRE", byte, lambda: self._service_enable, self._set_service_enable),
            Command("*STB?", lambda: f"{self._status_byte():+d}"),
            Command("*OPC", self._ask_completion),
            Command("*OPC?", lambda: self._when_idle("1", is_query=True)),
            Command("*WAI", lambda: self._when_idle(None, is_query=False)),
            Command("SYSTem:ERRor[:NEXT]?", self._next_error),
            Command("SYSTem:VERSion?", lambda: "1994.0"),
            Command("STATus:PRESet", self._preset_status),
            *register_commands("QUEStionable", self.questionable),
            *register_commands("OPERation", self.operation),
        )

    def _when_idle(self, reply: Immediate, *, is_query: bool) -> Pending:
        return Pending(lambda: not self._busy(), lambda: reply, self._idle_s, is_query)

    def _ask_completion(self) -> None:
        self._completion_asked = True

    def _completed(self) -> Register:
        # Looked at when somebody asks: no message tells that an operation has ended.
        if self._completion_asked and not self._busy():
            self._completion_asked = False
            self.standard.event |= 1
        return self.standard

    def _status_byte(self) -> int:
        # Bit 2 errors, 3 questionable, 5 standard events, 7 operation; 6 sums up those that are enabled (SCPI-99).
        status = 4 * bool(self._errors) + 8 * self.questionable.summary
        status += 32 * self._completed().summary + 128 * self.operation.summary
        return status + 64 * bool(status & self._service_enable)

    def _set_service_enable(self, value: float) -> None:
        # Bit 6 is the summary itself and cannot be enabled.
        self._service_enable = int(value) & ~64

    def _clear(self) -> None:
        self._errors.clear()
        self._completion_asked = False
        for register in (self.standard, self.questionable, self.operation):
            register.event = 0

    def _preset_status(self) -> None:
        self.questionable.enable = self.operation.enable = 0

    def _next_error(self) -> str:
        error = self._errors.popleft() if self._errors else ScpiError(0)
        return f'{error.code:+d},"{error.text}"'


class Session:
    """One client: its input, its output, and the query it waits for."""

    def __init__(self, shell: ScpiShell, send: Callable[[bytes], None]) -> None:
        self._shell = shell
        self._send = send
        self._input = bytearray()
        self._messages: deque[bytes] = deque()
        self._units: deque[str] = deque()
        self._replies: list[bytes] = []
        self._pending: Pending | None = None
        self._path = ""

    def receive(self, data: bytes) -> None:
        """Take bytes; every LF ends a message."""
        with self._shell.clock.lock:
            self._input += data
            *messages, rest = bytes(self._input).split(b"\n")
            self._input[:] = rest
            for message in messages:
                self._interrupt()
                self._messages.append(message)
                self._run()
            self._shell.resume()

    def close(self) -> None:
        """The client has gone."""
        with self._shell.clock.lock:
            self._pending = None
            self._shell.disconnect(self)

    def resume(self) -> None:
        """Answer if what was waited for has come, and go on."""
        if self._answer():
            self._run()

    def wake_s(self) -> float:
        """When it is worth looking again."""
        return self._pending.wake_s() if self._pending else math.inf

    def _interrupt(self) -> None:
        """A new message while a query waits: its reply is lost (IEEE 488.2, 6.3.2.3)."""
        if self._pending is not None and self._pending.is_query:
            self._pending = None
            self._units.clear()
            self._replies.clear()
            self._shell.error(ScpiError(-410))

    def _run(self) -> None:
        while self._pending is None:
            if self._units:
                self._execute(self._units.popleft())
                continue
            if self._replies:
                # One message for all queries of a message: a client reads up to its LF.
                self._send(b";".join(self._replies) + b"\n")
                self._replies.clear()
            if not self._messages:
                return
            self._begin(self._messages.popleft())

    def _execute(self, text: str) -> None:
        self._take(lambda: self._shell.execute(self._resolve(parse(text))))

    def _begin(self, message: bytes) -> None:
        self._path = ""
        try:
            # Any byte can be decoded; strange ones are for the grammar to refuse.
            self._units.extend(split_message(message.decode("latin-1")))
        except ScpiError as error:
            self._shell.error(error)

    def _take(self, answer: Callable[[], Reply]) -> None:
        try:
            reply = answer()
        except ScpiError as error:
            self._shell.error(error)
            if error.is_command_error:
                self._units.clear()
            return
        if isinstance(reply, Pending):
            self._pending = reply
            self._answer()
        elif reply is not None:
            self._replies.append(reply.encode("ascii", "replace") if isinstance(reply, str) else reply)

    def _answer(self) -> bool:
        pending = self._pending
        if pending is None or not pending.ready():
            return False
        self._pending = None
        self._take(pending.reply)
        return True

    def _resolve(self, unit: Unit) -> Unit:
        """The header from the root; after a semicolon it goes on where the last one was (SCPI-99, 6.2.4)."""
        # Common commands leave the path as it is.
        if unit.header.startswith("*"):
            return unit
        header = unit.header[1:] if unit.header.startswith(":") else self._path + unit.header
        node, colon, _ = header.rpartition(":")
        self._path = node + colon
        return Unit(header, unit.parameters)
