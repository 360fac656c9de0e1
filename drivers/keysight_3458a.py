"""Keysight (Agilent, HP) 3458A multimeter over GPIB: paces a rig by its timer, or follows trigger edges.

After the Keysight 3458A User's Guide (03458-90014) and programs that run on real meters. What matters here:

- `TARM SGL` takes all readings of a record, and the meter hears nothing until it has them (p. 91; `INBUF ON` frees
  the bus meanwhile, or GPIB adapters give up within a minute or two). So nothing is asked while it paces: `fetch`
  waits for the end of the record. A stop sends GPIB's device clear, where the wire has one; a meter that does not
  heed it confirms the stop at the record's end only.
- A reading is done `TIMER` after the one before, the first at once (p. 207). `EXTOUT ICOMP` gives an edge when the
  converter has integrated, which ends the aperture.
- The newest reading in memory has number 1 (p. 96); in which order RMEM sends them is found out from one of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from drivers.keysight_3458a_line import MODEL, MeterLine
from drivers.keysight_settings import known_range, require_period
from drivers.transport import Connect
from rigctl.core.arrays import FloatArray
from rigctl.core.clock import Clock
from rigctl.core.declarations import DriverDeclaration, Use
from rigctl.core.errors import EdgesMissing, InstrumentError, LimitError
from rigctl.core.findings import Finding, differs, ok
from rigctl.core.interfaces import Channel, Identity, Reading

OVERLOAD = 1e38
PERIOD_MAXIMUM_S = 6000.0
TIMER_STEP_S = 1e-7
RECALL_S = 5e-3
"""What one reading takes on the bus at most."""
SLOW = 2e-4
"""By how much its clock may be slow (the maker says 1e-4): nobody asks before it is surely done."""
LOOK_S = 0.2
"""How often somebody who waits looks whether he was stopped."""


class Meter3458ASettings(BaseModel):
    """What an operator may set; `latency_s` as for a 34465A: left out it is the middle of the aperture."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    channel: str = Field(default="accel_v", min_length=1)
    range_v: Annotated[float, AfterValidator(known_range)] = 10.0
    aperture_s: float = Field(default=1e-3, ge=500e-9, le=1.0)
    latency_s: float | None = None
    memory_readings: int = Field(default=5000, ge=1)
    """As single reals of 4 bytes in 20 kB; option 001 has more."""
    link_timeout_s: float = Field(default=2.0, gt=0.0)


class Keysight3458A:
    """What both uses of the meter share."""

    _middle = -0.5
    """From the edge to the middle of the aperture, in apertures."""

    def __init__(self, name: str, settings: Meter3458ASettings, connect: Connect, clock: Clock) -> None:
        self.name = name
        self.settings = settings
        self._clock = clock
        self._line = MeterLine(name, connect, settings.link_timeout_s)
        self._recording = False
        self._samples = 0

    def open(self) -> None:
        """Connect, make sure it is a 3458A, end what it is doing and forget its errors."""
        # END ALWAYS: every reply says where it ends, also to adapters that look for nothing else.
        self._line.open("TARM HOLD", "END ALWAYS")
        self._line.errors()
        self._recording, self._samples = False, 0

    def close(self) -> None:
        """Disconnect; may be called twice."""
        self._line.close()

    def identify(self) -> Identity:
        """The model; the meter tells neither serial number nor, in one line with it, its firmware."""
        return Identity(MODEL, "", "", self._line.identify())

    def confirm_in_step(self) -> None:
        """`OutOfStep` when replies may have been taken for others."""
        self._line.confirm_in_step()

    def examine(self) -> Iterator[Finding]:
        """Connect, end what it is doing, and look at errors, settings and one reading."""
        self._line.open("TARM HOLD", "END ALWAYS")
        old = "; ".join(f'{code},"{text}"' for code, text in self._line.errors())
        yield ok("capability", "errors", f"emptied of old ones: {old}" if old else "none")
        self._line.configure(*self._measurement())
        yield ok("capability", "settings", "range, aperture and formats are understood")
        reading = self.voltage()
        if math.isnan(reading.value):
            yield differs("capability", self.settings.channel, "overloaded", "look at cable and terminals")
        else:
            yield ok("capability", self.settings.channel, f"{reading.value:.6g} V now")

    def stop(self) -> None:
        """End the record, by a device clear where the wire has one, and return when the meter answers.

        Without it, or not heeding it, a meter that paces answers at the record's end only.
        """
        self._recording = False
        with self._line.urgently():
            self._line.device_clear()
            self._line.tell("TARM HOLD")
            # Taken up one after the other: who answers has heard the one before.
            self._line.identify()

    def channels(self) -> tuple[Channel, ...]:
        """One column of volts."""
        s = self.settings
        late_s = self._middle * s.aperture_s if s.latency_s is None else s.latency_s
        return (Channel(s.channel, "V", "voltage", late_s, s.range_v),)

    def longest_record(self, period_s: float) -> int:
        """Most samples of one record, which have to fit in memory; `LimitError` for a period that it cannot keep."""
        s = self.settings
        require_period(self.name, period_s, s.aperture_s, PERIOD_MAXIMUM_S)
        return s.memory_readings

    def voltage(self) -> Reading:
        """One reading, triggered at once [V]; NaN when overloaded; refused while a record is running."""
        if self._recording:
            raise InstrumentError(
                f"{self.name}: a record is running and a single reading would end it; collect it or stop it",
                instrument=self.name,
            )
        self._line.configure(*self._measurement(), "MEM OFF", "NRDGS 1,AUTO", "TRIG AUTO")
        (value,) = self._line.ask_numbers("TARM SGL", 1, 2 * self.settings.aperture_s)
        return Reading(math.nan if abs(value) >= OVERLOAD else value, "V", self._clock.now_s())

    def _measurement(self) -> tuple[str, ...]:
        """Everything about a reading, whatever another client has set; the meter holds still."""
        s = self.settings
        # PRESET NORM arms it by itself, and switches mathematics off; nothing triggers before it is held again.
        preset = ("PRESET NORM", "TARM HOLD", "INBUF ON")
        volts = (f"DCV {s.range_v:g}", f"APER {s.aperture_s:.7f}", "AZERO OFF", "DELAY 0")
        return (*preset, *volts, "MFORMAT SREAL", "OFORMAT ASCII")

    def _check_limits(self, samples: int, period_s: float) -> None:
        longest = self.longest_record(period_s)
        if not 1 <= samples <= longest:
            raise LimitError(
                f"{self.name}: {samples} samples asked for; 1 to {longest} are possible (memory_readings)"
            )

    def _prepare(self, samples: int, *commands: str) -> None:
        """Set up a record in an empty memory."""
        self._line.configure(*self._measurement(), "MEM FIFO", *commands)
        if there := self._line.ask_whole("MCOUNT?"):
            raise InstrumentError(f"{self.name}: {there} readings in a memory just emptied", instrument=self.name)
        self._samples = samples

    def _recall(self, came: int, samples: int) -> FloatArray:
        """The oldest `samples` of `came` readings, oldest first, one column; NaN where overloaded."""
        # Numbers count back from the newest, which is 1.
        first = came - samples + 1
        values = self._line.ask_numbers(f"RMEM {first},{samples}", samples, RECALL_S * samples)
        ordered = np.array(values if self._oldest_first(values, first) else values[::-1])
        return np.where(np.abs(ordered) >= OVERLOAD, np.nan, ordered)[:, np.newaxis]

    def _oldest_first(self, values: list[float], first: int) -> bool:
        """In which order they came: asked of one that is another in the other order."""
        differing = (place for place, pair in enumerate(zip(values, values[::-1], strict=True)) if pair[0] != pair[1])
        place = next(differing, None)
        if place is None:
            return True
        query = f"RMEM {first + place},1"
        (value,) = self._line.ask_numbers(query, 1)
        if value not in (values[place], values[-1 - place]):
            raise self._line.bad_reply(query, f"{value!r}", "a reading that was recalled just before")
        return value != values[place]


class PacingMeter(Keysight3458A):
    """Samples on its own timer; its Ext Out paces the other instruments (`PacingRecorder`)."""

    _end_s = 0.0
    """When the last reading is done."""

    @property
    def first_sample_after_s(self) -> float:
        """From the start to the first edge, which is when its integration is over."""
        return self.settings.aperture_s

    def longest_record(self, period_s: float) -> int:
        """As of any record; `LimitError` also for a period that is no whole number of the timer's steps."""
        if abs(period_s - round(period_s / TIMER_STEP_S) * TIMER_STEP_S) > 1e-3 * TIMER_STEP_S:
            raise LimitError(f"{self.name}: the timer has steps of 100 ns, {period_s!r} s would drift")
        return super().longest_record(period_s)

    def start(self, samples: int, period_s: float, at_s: float | None = None) -> float:
        """Start `samples` readings, `period_s` apart; returns the rig time of the start, not before `at_s`."""
        self._check_limits(samples, period_s)
        paced = (f"TIMER {period_s:.7f}", f"NRDGS {samples},TIMER", "TRIG AUTO", "EXTOUT ICOMP,NEG")
        self._prepare(samples, *paced)
        if at_s is not None:
            self._clock.sleep_s(max(at_s - self._clock.now_s(), 0.0))
        started_s = self._clock.now_s()
        lasts_s = self.settings.aperture_s + (samples - 1) * period_s
        self._end_s = started_s + lasts_s * (1.0 + SLOW)
        self._recording = True
        self._line.tell("TARM SGL")
        return started_s

    def fetch(self) -> FloatArray:
        """The whole record [V], shape (samples, 1), once it is over: waits for that. Empty when there is none.

        `InstrumentError` when readings are missing or came late.
        """
        while self._recording and (left_s := self._end_s - self._clock.now_s()) > 0.0:
            self._clock.sleep_s(min(left_s, LOOK_S))
        if not self._recording:
            return np.empty((0, 1))
        self._recording = False
        came = self._line.ask_whole("MCOUNT?", self.settings.aperture_s)
        # First: it may say why readings are missing.
        self._line.check("at the end of the record")
        if came != self._samples:
            raise InstrumentError(
                f"{self.name}: {came} of {self._samples} readings are there; was it stopped from its panel?",
                instrument=self.name,
            )
        return self._recall(came, came)


class PacedMeter(Keysight3458A):
    """Takes one reading per negative edge at its Ext Trig input (`PacedRecorder`)."""

    _middle = 0.5
    _grace_s = 0.0

    def arm(self, samples: int, period_s: float) -> None:
        """Clear and wait for `samples` edges, `period_s` apart; `LimitError` if the memory cannot hold them."""
        self._check_limits(samples, period_s)
        self._grace_s = 2 * self.settings.aperture_s + min(period_s, 0.5)
        self._prepare(samples, "NRDGS 1,AUTO", "TRIG EXT")
        self._recording = True
        self._line.tell("TARM AUTO")

    def collect(self) -> FloatArray:
        """The readings [V], shape (samples, 1), after the last edge; NaN where overloaded.

        `EdgesMissing` when fewer have been taken; those beyond are left out.
        """
        if not self._recording:
            raise InstrumentError(f"{self.name}: nothing to collect, it was not armed", instrument=self.name)
        self._clock.sleep_s(self._grace_s)
        self._recording = False
        self._line.configure("TARM HOLD")
        came = self._line.ask_whole("MCOUNT?")
        if came < self._samples:
            raise EdgesMissing(
                f"{self.name}: {came} of {self._samples} trigger edges came; check the cable to Ext Trig",
                instrument=self.name,
                came=came,
                armed=self._samples,
            )
        return self._recall(came, self._samples)

    def edges_seen(self) -> int:
        """How many readings there are."""
        return self._line.ask_whole("MCOUNT?")


_PACED = Use(Meter3458ASettings, PacedMeter)

DRIVER = DriverDeclaration(
    "keysight-3458a",
    contract=1,
    roles={"readout": Use(Meter3458ASettings, PacingMeter), "voltmeter": _PACED, "spare": _PACED},
    simulator="simulators.keysight_3458a.declaration:SIMULATOR",
)
