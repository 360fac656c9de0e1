"""Keysight 34465A multimeter: sample-timer master, triggered slave, thermometer.

Commands after the Truevolt Series Operating and Service Guide; `SAMP:SOUR TIM` with a short aperture is what
the front panel calls digitising. VM COMP on the rear gives one pulse per reading: the edges of the rig.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from drivers.keysight_34465a_examined import as_voltmeter, reads
from drivers.keysight_memory import ReadingMemory
from drivers.keysight_meter import ALTERING, Keysight34465A
from drivers.keysight_settings import ThermometerSettings, VoltmeterSettings, require_period
from drivers.keysight_thermometer import MeterThermometer
from drivers.transport import Connect
from rigctl.core.arrays import FloatArray
from rigctl.core.clock import Clock
from rigctl.core.declarations import DriverDeclaration, Use
from rigctl.core.errors import EdgesMissing, InstrumentError, LimitError, RigError
from rigctl.core.findings import Finding
from rigctl.core.interfaces import Channel, Identity, Reading

SAMPLES_MAXIMUM = 1_000_000
PERIOD_MAXIMUM_S = 3600.0
TIMER_STEP_S = 1e-6
TIMING_VIOLATION, MEMORY_OVERFLOW = 1 << 2, 1 << 14
"""Bits of the questionable register."""


class _Voltmeter(Keysight34465A):
    """DC volts on a fixed range with a short aperture."""

    _middle = -0.5
    """From the edge to the middle of the aperture, in apertures: confirm that the edge a meter gives ends it."""

    def __init__(self, name: str, settings: VoltmeterSettings, connect: Connect, clock: Clock) -> None:
        super().__init__(name, connect, clock, settings.link_timeout_s)
        self.settings = settings
        self._memory = ReadingMemory(self._link, settings.transfer)
        self._recording = False
        self._remaining = 0
        self._overdue_s = math.inf
        """When the last reading of a record that paces itself must long be there."""

    def open(self) -> None:
        """Connect, make sure it is a 34465A, end what it is doing and clear its errors."""
        super().open()
        self._recording, self._remaining = False, 0

    def _examine(self, identity: Identity) -> Iterator[Finding]:
        yield from as_voltmeter(identity, self.settings, self._link, self._fastest_s)
        yield reads(self.settings.channel, self.voltage)

    def _fastest_s(self) -> float:
        self._configure("ABOR", *self._measurement(), "SAMP:SOUR TIM")
        return self._link.query_number("SAMP:TIM? MIN")

    def channels(self) -> tuple[Channel, ...]:
        """One column of volts."""
        s = self.settings
        late_s = self._middle * s.aperture_s if s.latency_s is None else s.latency_s
        return (Channel(s.channel, "V", "voltage", late_s, s.range_v),)

    def stop(self) -> None:
        """End the record; readings taken so far can still be fetched."""
        self._recording = False
        super().stop()

    def voltage(self) -> Reading:
        """One reading, triggered at once [V]; NaN when overloaded; refused while a record is running."""
        if self._recording:
            raise InstrumentError(
                f"{self.name}: a record is running and a single reading would end it; fetch the rest or stop it",
                instrument=self.name,
            )
        # Configuring erases the memory, readings of an older record included.
        self._remaining = 0
        self._configure(*self._measurement(), "FORM:DATA ASC")
        return self._read_one("V", 2 * self.settings.aperture_s)

    @property
    def first_sample_after_s(self) -> float:
        """From the trigger to the first reading, which is when its integration is over."""
        return self.settings.aperture_s

    def _measurement(self) -> tuple[str, ...]:
        """CONF also sets triggers and samples back to one reading at once."""
        s = self.settings
        return (
            f"CONF:VOLT:DC {s.range_v:g}",
            # 10 Mohm, as after *RST: with more, as another client may want it, less is lost in the sensor.
            "SENS:VOLT:DC:IMP:AUTO OFF",
            # Autozero measures zero between readings and doubles their time.
            "SENS:VOLT:DC:ZERO:AUTO OFF",
            f"SENS:VOLT:DC:APER {s.aperture_s:.6E}",
            # The automatic delay depends on range and function, and would shift every sample.
            "TRIG:DEL 0",
        )

    def longest_record(self, period_s: float) -> int:
        """Most samples of one record; `LimitError` for a period below the aperture or beyond the timer's longest."""
        s = self.settings
        require_period(self.name, period_s, s.aperture_s, PERIOD_MAXIMUM_S)
        return SAMPLES_MAXIMUM

    def _check_limits(self, samples: int, period_s: float) -> None:
        longest = self.longest_record(period_s)
        if not 1 <= samples <= longest:
            raise LimitError(f"{self.name}: {samples} samples asked for; 1 to {longest} are possible")

    def _check_interval(self, period_s: float) -> None:
        """Ask for the shortest interval, which depends on all that was configured before."""
        # The meter itself knows what aperture, range and functions take together.
        minimum_s = self._link.query_number("SAMP:TIM? MIN")
        if period_s < minimum_s * (1 - 1e-9):
            raise InstrumentError(
                f"{self.name}: a sample every {period_s:g} s is too fast, the meter needs {minimum_s:g} s with "
                f"aperture_s = {self.settings.aperture_s:g}; shorten the aperture or sample slower",
                instrument=self.name,
            )

    def _initiate(self, samples: int, *commands: str) -> None:
        """Send what starts the record; it counts as running from the first byte, so that `stop` may come at once."""
        self._recording, self._remaining = True, samples
        try:
            self._link.configure(*commands)
        except RigError:
            self._recording = False
            raise

    def _finish(self) -> None:
        self._check_record()
        if altered := self._altered():
            switched = " and ".join(f"{name} was switched on ({ALTERING[name]})" for name in altered)
            self._fail(f"{switched} while it measured; leave its panel alone, and keep others off it")
        self._link.check("at the end of the record")
        self._recording = False

    def _drain(self) -> FloatArray:
        """What is in memory now, one column."""
        rows = self._memory.drain(self._remaining)[:, np.newaxis]
        self._remaining -= len(rows)
        return rows

    def fetch(self) -> FloatArray:
        """The readings since the last call [V], shape (n, 1), n may be 0; NaN where overloaded.

        `InstrumentError` when readings were lost because the memory overflowed, came late, or no longer come.
        """
        # Asked before draining: readings that come meanwhile are no reason to call the rest lost.
        overdue = self._clock.now_s() > self._overdue_s
        rows = self._drain()
        if self._recording and self._remaining:
            self._check_record()
            if overdue:
                self._fail(f"{self._remaining} readings never came; was it stopped from elsewhere?")
        elif self._recording:
            self._finish()
        return rows

    def _check_record(self) -> None:
        """`InstrumentError` when readings were lost or came late, which the error queue does not tell."""
        events = self._link.query_whole("STAT:QUES:EVEN?")
        if events & MEMORY_OVERFLOW:
            self._fail("its memory overflowed and the oldest readings are lost; fetch more often")
        if events & TIMING_VIOLATION:
            self._fail("sample timing violation, readings came late; sample slower or shorten aperture_s")

    def _fail(self, what: str) -> None:
        self.stop()
        raise InstrumentError(f"{self.name}: {what}", instrument=self.name)


class PacingVoltmeter(_Voltmeter):
    """Samples on its own timer; its VM COMP output paces the other instruments (`PacingRecorder`)."""

    def longest_record(self, period_s: float) -> int:
        """Most samples of one record; `LimitError` also for a period that is no whole number of the timer's steps."""
        # A thousandth of a step: what is left of rounding, no drift over a million samples.
        if abs(period_s - round(period_s / TIMER_STEP_S) * TIMER_STEP_S) > 1e-3 * TIMER_STEP_S:
            raise LimitError(
                f"{self.name}: the sample timer has steps of 1 us, {period_s!r} s would drift; "
                f"use {round(period_s, 6):g} s"
            )
        return super().longest_record(period_s)

    def start(self, samples: int, period_s: float, at_s: float | None = None) -> float:
        """Start `samples` readings, `period_s` apart; returns the rig time of the trigger, not before `at_s`.

        Records longer than the memory need `fetch` in time. `LimitError` for more than 1 000 000 samples, a
        period below the aperture, or one that is no whole number of the timer's 1 us steps.
        """
        self._check_limits(samples, period_s)
        self._configure("ABOR", "*CLS", *self._measurement(), "SAMP:SOUR TIM")
        self._check_interval(period_s)
        self._link.configure(
            f"SAMP:TIM {period_s:.6f}", f"SAMP:COUN {samples}", *self._memory.format, "TRIG:SOUR BUS", "INIT"
        )
        if at_s is not None:
            self._clock.sleep_s(max(at_s - self._clock.now_s(), 0.0))
        started_s = self._clock.now_s()
        self._overdue_s = started_s + samples * period_s + self.settings.aperture_s + self.settings.link_timeout_s
        self._initiate(samples, "*TRG")
        return started_s


class PacedVoltmeter(_Voltmeter):
    """Takes one reading per edge at its Ext Trig input (`StreamedRecorder`)."""

    _grace_s = 0.0
    """How long after the last edge its reading may take."""
    _middle = 0.5

    def longest_record(self, period_s: float) -> int:
        """They are fetched after the last edge: all have to fit in memory."""
        return min(self.settings.memory_readings, super().longest_record(period_s))

    def arm(self, samples: int, period_s: float) -> None:
        """Clear and wait for `samples` edges, `period_s` apart; `LimitError` if the memory cannot hold them."""
        self._check_limits(samples, period_s)
        self._follow(samples, period_s)

    def follow(self, samples: int, period_s: float) -> None:
        """As `arm`, for readings that are fetched while they come: up to 1 000 000, whatever the memory."""
        self.longest_record(period_s)
        if not 1 <= samples <= SAMPLES_MAXIMUM:
            raise LimitError(f"{self.name}: {samples} samples asked for; 1 to {SAMPLES_MAXIMUM} are possible")
        self._follow(samples, period_s)

    def _follow(self, samples: int, period_s: float) -> None:
        self._configure("ABOR", "*CLS", *self._measurement())
        self._check_interval(period_s)
        # Integration, latency, and one period, at most 0.5 s, for the last edge itself.
        self._grace_s = 2 * self.settings.aperture_s + abs(self.settings.latency_s or 0.0) + min(period_s, 0.5)
        self._initiate(
            samples,
            *self._memory.format,
            "TRIG:SOUR EXT",
            # VM COMP is a low-true pulse: its first edge falls.
            "TRIG:SLOP NEG",
            f"TRIG:COUN {samples}",
            "SAMP:COUN 1",
            "INIT",
        )

    def collect(self) -> FloatArray:
        """The readings [V], shape (samples, 1), after the last edge; NaN where overloaded.

        Waits for the last reading; `InstrumentError` when fewer edges than armed for have come by then.
        """
        samples = self._remaining
        if not samples:
            raise InstrumentError(f"{self.name}: nothing to collect, it was not armed", instrument=self.name)
        came = self._wait_for(samples)
        if came < samples:
            self.stop()
            raise EdgesMissing(
                f"{self.name}: {came} of {samples} trigger edges came; check the cable from VM COMP to Ext Trig",
                instrument=self.name,
                came=came,
                armed=samples,
            )
        rows = self._drain()
        self._finish()
        return rows

    def edges_seen(self) -> int:
        """How many readings there are."""
        return self._link.query_whole("DATA:POIN?")

    def _wait_for(self, samples: int) -> int:
        """How many readings are there, once all are or the last one can no longer be on its way."""
        deadline_s = self._clock.now_s() + self._grace_s
        while True:
            # Looked at before the count, so that the last look counts whatever has come until then.
            late = not self._recording or self._clock.now_s() > deadline_s
            came = self._link.query_whole("DATA:POIN?")
            if came >= samples or late:
                return came
            self._clock.sleep_s(self._grace_s / 10)


_PACED = Use(VoltmeterSettings, PacedVoltmeter)

DRIVER = DriverDeclaration(
    "keysight-34465a",
    contract=1,
    roles={
        "readout": Use(VoltmeterSettings, PacingVoltmeter),
        "voltmeter": _PACED,
        "thermometer": Use(ThermometerSettings, MeterThermometer),
        "spare": _PACED,
    },
    simulator="simulators.keysight_34465a.declaration:SIMULATOR",
    port=5025,
)
