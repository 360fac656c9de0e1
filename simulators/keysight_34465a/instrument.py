"""A Keysight 34465A Truevolt multimeter on the wire (Truevolt Series Operating and Service Guide)."""

from __future__ import annotations

from collections.abc import Callable

from simulators.clock import SimulationClock
from simulators.faults.mishaps import ClockJump, MemoryOverflow, PowerCycle, WrongUnit
from simulators.faults.when import Event
from simulators.keysight_34465a.acquisition_commands import AcquisitionCommands
from simulators.keysight_34465a.measurement_commands import MeasurementCommands
from simulators.keysight_34465a.meter import Meter
from simulators.keysight_34465a.scaling_commands import scaling_commands
from simulators.keysight_34465a.settings import MeterSettings
from simulators.keysight_34465a.system_commands import system_commands
from simulators.measured import Tap, unheard
from simulators.scpi import ScpiShell
from simulators.wiring import Connection, Signal, TriggerLine


class Simulated34465A:
    """The meter with its LAN socket: any number of clients share the one state, each has its own output.

    Measures `volts` (DC voltage) and `celsius` (temperature probes). On its sample timer it gives the edges
    of `trigger_out` (VM COMP); with TRIG:SOUR EXT it takes a reading per edge of `trigger_in`. The signals are
    asked lazily, each instant once and in order. Not there: functions other than DC voltage and temperature,
    pre-trigger and level triggering, statistics and limits.
    """

    kind = "keysight-34465a"

    def __init__(
        self,
        clock: SimulationClock,
        volts: Signal,
        celsius: Signal,
        trigger_out: TriggerLine | None = None,
        trigger_in: TriggerLine | None = None,
        settings: MeterSettings | None = None,
        tap: Tap | None = None,
    ) -> None:
        settings = settings or MeterSettings()
        self._meter = Meter(clock, volts, celsius, trigger_out, trigger_in, settings, tap or unheard())
        measurement = MeasurementCommands(self._meter, settings)
        acquisition = AcquisitionCommands(self._meter, measurement)
        self._shell = ScpiShell(
            clock,
            (
                *system_commands(self._meter, settings),
                *measurement.table(),
                *scaling_commands(self._meter),
                *acquisition.table(),
            ),
            busy=lambda: not self._meter.idle,
            idle_s=self._meter.idle_s,
            questionable=self._meter.questionable,
            operation=self._meter.operation,
        )

    def connect(self, send: Callable[[bytes], None]) -> Connection:
        """Serve one more client, which is sent bytes through `send`."""
        return self._shell.connect(send)

    def befall(self, event: Event) -> None:
        """Something happens to the meter."""
        match event:
            case PowerCycle():
                self._meter.reset()
                self._shell.power_on()
            case WrongUnit():
                self._meter.configuration.temperature_unit = "F"
            case MemoryOverflow():
                self._meter.lose_readings()
            case ClockJump(jump_s=jump_s):
                self._meter.stand_still(jump_s)

    def relieve(self, event: Event) -> None:
        """It is over; what it has forgotten stays forgotten."""
        if isinstance(event, WrongUnit):
            self._meter.configuration.temperature_unit = "C"

    def key_noise(self, *key: int) -> None:
        """Draw the meter's noise from here on from (seed, *key): the same for a run that is taken again."""
        self._meter.key_noise(*key)
