"""A Keysight 33500B waveform generator on the wire (docs/protocol-33500b.md)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from simulators.clock import SimulationClock
from simulators.faults.mishaps import PowerCycle
from simulators.faults.when import Event
from simulators.keysight_33500b.commands import Commands
from simulators.keysight_33500b.output import Output
from simulators.keysight_33500b.settings import GeneratorSettings
from simulators.measured import Tap, unheard
from simulators.scpi import Register, ScpiShell
from simulators.wiring import Connection, VoltageLine

OUTPUTS = (1, 2)


class Simulated33500B:
    """The generator with its LAN socket; it drives the line of each output, one of its own where none is given.

    The connectors see high impedances. Not there: functions other than DC, sine and ramp, modulation, sweep, bursts
    but those that the bus triggers, units other than V peak to peak and degrees, and the steps of the converter.
    """

    kind = "keysight-33500b"

    def __init__(
        self,
        clock: SimulationClock,
        lines: Mapping[int, VoltageLine] | None = None,
        settings: GeneratorSettings | None = None,
        tap: Tap | None = None,
    ) -> None:
        settings, wired = settings or GeneratorSettings(), lines or {}
        tap = tap or unheard()
        outputs = {n: Output(clock, wired.get(n) or VoltageLine(), settings, tap, str(n)) for n in OUTPUTS}
        self._outputs = outputs
        self._shell = ScpiShell(
            clock,
            Commands(outputs, settings).table(),
            busy=lambda: False,
            idle_s=lambda: -math.inf,
            questionable=Register(),
            operation=Register(),
        )

    def befall(self, event: Event) -> None:
        """It loses its power: no output drives anything, before and after."""
        if isinstance(event, PowerCycle):
            for output in self._outputs.values():
                output.reset()
            self._shell.power_on()

    def relieve(self, event: Event) -> None:
        """Nothing comes back by itself."""

    def connect(self, send: Callable[[bytes], None]) -> Connection:
        """Serve one more client, which is sent bytes through `send`."""
        return self._shell.connect(send)
