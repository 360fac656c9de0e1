"""The meter on the bus: lines in, replies out, one line at a time."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

from simulators.clock import SimulationClock
from simulators.faults.mishaps import PowerCycle
from simulators.faults.when import Event
from simulators.keysight_3458a.commands import Commands
from simulators.keysight_3458a.language import parse
from simulators.keysight_3458a.meter import Meter
from simulators.keysight_3458a.settings import Meter3458ASimulatorSettings
from simulators.measured import Tap, unheard
from simulators.wiring import Connection, Signal, TriggerLine

BUFFER_LINES = 64
"""The input buffer is finite; a client that floods it loses what comes last."""


class Simulated3458A:
    """A 3458A that measures `volts`; it gives `trigger_out` or hears `trigger_in`.

    Not there: functions other than DC voltage, level and line triggering, subprograms, and the readings that a meter
    takes without end (TARM AUTO with TRIG AUTO) or whenever it is read (TRIG SYN).
    """

    kind = "keysight-3458a"

    def __init__(
        self,
        clock: SimulationClock,
        volts: Signal,
        trigger_out: TriggerLine | None = None,
        trigger_in: TriggerLine | None = None,
        settings: Meter3458ASimulatorSettings | None = None,
        tap: Tap | None = None,
    ) -> None:
        self.clock = clock
        self._settings = settings or Meter3458ASimulatorSettings()
        self._meter = Meter(clock, volts, trigger_out, trigger_in, self._settings, tap or unheard())
        self._commands = Commands(self._meter, self._settings)
        self._meter.send_reading = lambda value: self._reply(self._commands.reading(value))
        self._lines: deque[tuple[str, Client]] = deque()
        self._speaker: Client | None = None
        self._off = False

    def connect(self, send: Callable[[bytes], None]) -> Connection:
        """Serve one more client."""
        return Client(self, send)

    def key_noise(self, *key: int) -> None:
        """Draw the meter's noise from here on from (seed, *key)."""
        self._meter.key_noise(*key)

    def befall(self, event: Event) -> None:
        """Something happens to the meter."""
        if isinstance(event, PowerCycle):
            self._off = True
            self._lines.clear()
            self._meter.reset()

    def relieve(self, event: Event) -> None:
        """It is over: as after switching on."""
        if isinstance(event, PowerCycle):
            self._off = False

    def received(self, line: str, client: Client) -> None:
        """Put a line in the input buffer, and take up what can be."""
        if not self._off and len(self._lines) < BUFFER_LINES:
            self._lines.append((line, client))
        self._go_on()

    def cleared(self) -> None:
        """A device clear: the input buffer is emptied, and what is under way ends, if the meter heeds it."""
        self._lines.clear()
        if self._settings.dialect.heeds_device_clear:
            self._meter.hold()

    def gone(self, client: Client) -> None:
        """Forget what a client has asked."""
        self._lines = deque(entry for entry in self._lines if entry[1] is not client)
        if self._speaker is client:
            self._speaker = None

    def _go_on(self) -> None:
        while self._lines and not self._busy():
            line, self._speaker = self._lines.popleft()
            for command in parse(line):
                if (reply := self._commands.execute(command)) is not None:
                    self._reply(reply)
            self._wake_at_the_end()

    def _busy(self) -> bool:
        done_s = self._meter.done_s
        return done_s > self.clock.now_s() and not self._settings.dialect.hears_while_sampling

    def _wake_at_the_end(self) -> None:
        # Of the readings under way: their values may have to be sent, and lines may wait. Whether the end has come
        # meanwhile is left to the clock, which may go on by itself.
        if math.isfinite(done_s := self._meter.done_s):
            self.clock.call_at(done_s, self._go_on_after)

    def _go_on_after(self) -> None:
        self._meter.advance()
        self._go_on()

    def _reply(self, text: str) -> None:
        if self._speaker is not None:
            self._speaker.send(text.encode("ascii") + b"\r\n")


class Client:
    """The meter's end of one connection."""

    def __init__(self, meter: Simulated3458A, send: Callable[[bytes], None]) -> None:
        self.send = send
        self._meter = meter
        self._received = b""

    def receive(self, data: bytes) -> None:
        """Take bytes; a line ends with LF, with CR, or with both."""
        with self._meter.clock.lock:
            *lines, self._received = (self._received + data).replace(b"\r", b"\n").split(b"\n")
            for line in filter(None, lines):
                self._meter.received(line.decode("ascii", "replace"), self)

    def device_clear(self) -> None:
        """The bus says so, past the input buffer."""
        with self._meter.clock.lock:
            self._received = b""
            self._meter.cleared()

    def close(self) -> None:
        """The client has gone."""
        with self._meter.clock.lock:
            self.send = lambda _: None
            self._meter.gone(self)
