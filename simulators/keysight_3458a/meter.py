"""The meter itself: how it is set, when it takes readings, and its memory."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.aperture import mean_over_aperture
from simulators.clock import SimulationClock
from simulators.keysight_3458a.settings import Meter3458ASimulatorSettings
from simulators.keysight_34465a.acquisition import BOUNDLESS, PacedReadings, Readings, TimedReadings
from simulators.measured import Tap
from simulators.wiring import Signal, TriggerLine

OVERLOAD_V = 1e38
RANGES_V = (0.1, 1.0, 10.0, 100.0, 1000.0)
OVER_RANGE = 1.2
BYTES = {"SREAL": 4, "DREAL": 8, "DINT": 4, "SINT": 2, "ASCII": 16}
"""Of one reading in memory."""
OVERHEAD_S = 1e-5
"""Between two readings at least: 100 000 a second (the maker's data sheet)."""


@dataclass(frozen=True)
class Setup:
    """What it is set to; the defaults are those of PRESET NORM (User's Guide, table 10)."""

    range_v: float = 10.0
    autorange: bool = True
    aperture_s: float = 0.02
    autozero: bool = True
    delay_s: float = 0.0
    timer_s: float = 1.0
    readings: int = 1
    sample_event: str = "AUTO"
    trigger: str = "SYN"
    arm: str = "AUTO"
    memory: str = "OFF"
    memory_format: str = "SREAL"
    output: str = "OFF"

    @property
    def reading_s(self) -> float:
        """One reading, and what autozero measures beside it."""
        return (self.aperture_s + OVERHEAD_S) * (2 if self.autozero else 1)

    @property
    def period_s(self) -> float:
        """From one reading to the next."""
        return max(self.timer_s, self.reading_s) if self.sample_event == "TIMER" else self.reading_s


POWERED = Setup(aperture_s=0.2, trigger="AUTO")
"""After switching on, and RESET (User's Guide, table 5): NPLC 10 and TRIG AUTO, whose readings nobody hears here."""


class Meter:
    """`send_reading` is given each reading that goes to no memory."""

    def __init__(
        self,
        clock: SimulationClock,
        volts: Signal,
        trigger_out: TriggerLine | None,
        trigger_in: TriggerLine | None,
        settings: Meter3458ASimulatorSettings,
        tap: Tap,
    ) -> None:
        self.setup = POWERED
        self.too_fast = False
        self.send_reading: Callable[[float], None] = lambda _: None
        self._clock = clock
        self._volts = volts
        self._trigger_out, self._trigger_in = trigger_out, trigger_in
        self._settings = settings
        self._tap = tap
        self._readings: Readings | None = None
        self._stored = np.empty(0)
        self._random = np.random.default_rng(settings.seed)

    def key_noise(self, *key: int) -> None:
        """Draw the noise from here on from (seed, *key), whatever was drawn before."""
        self._random = np.random.default_rng([self._settings.seed, *key])

    def reset(self) -> None:
        """As after switching on: the memory is empty."""
        self.hold()
        self.setup = POWERED
        self._stored = np.empty(0)
        self.too_fast = False

    def change(self, **settings: object) -> None:
        """Another setting; what it was doing goes on with the old one until it is armed anew."""
        self.setup = replace(self.setup, **settings)  # type: ignore[arg-type]

    def store_anew(self) -> None:
        """MEM FIFO: an empty memory."""
        self.advance()
        self._stored = np.empty(0)
        self.change(memory="FIFO")

    def hold(self) -> None:
        """TARM HOLD: no further reading."""
        self.advance()
        if isinstance(self._readings, TimedReadings) and self._trigger_out is not None:
            self._trigger_out.end(self._clock.now_s())
        self._readings = None
        self.change(arm="HOLD")

    def arm(self, event: str) -> None:
        """TARM SGL or AUTO."""
        self.hold()
        self.change(arm=event)
        setup = self.setup
        self._tap.begin()
        if setup.trigger == "EXT":
            triggers = 1 if event == "SGL" else BOUNDLESS
            self._readings = PacedReadings(
                self._trigger_in, self._clock.now_s(), triggers, setup.readings, setup.delay_s, setup.reading_s,
                setup.aperture_s,
            )  # fmt: skip
        elif setup.trigger == "AUTO" and event == "SGL":
            self._sample()

    def trigger_once(self) -> None:
        """TRIG SGL: the readings of one trigger if it is armed, and none after that."""
        self.advance()
        self.change(trigger="HOLD")
        if self.setup.arm == "AUTO" and self._readings is None:
            self._tap.begin()
            self._sample()

    def _sample(self) -> None:
        setup = self.setup
        self.too_fast |= setup.sample_event == "TIMER" and setup.timer_s < setup.reading_s
        first_s = self._clock.now_s() + setup.delay_s + setup.aperture_s
        period_s = setup.period_s / (1.0 + 1e-6 * self._settings.clock_ppm)
        self._readings = TimedReadings(first_s, period_s, setup.readings, 0.0)
        if self._trigger_out is not None and setup.output == "ICOMP":
            self._trigger_out.begin(first_s, period_s, setup.readings)

    @property
    def done_s(self) -> float:
        """When the readings of a TARM SGL are all taken; now when nothing is under way."""
        self.advance()
        if not isinstance(self._readings, TimedReadings):
            return -math.inf
        return self._readings.reached_s(self._readings.remaining)

    def count(self) -> int:
        """MCOUNT?."""
        self.advance()
        return len(self._stored)

    def recalled(self, first: int, count: int) -> FloatArray:
        """These readings by their numbers, the newest first."""
        self.advance()
        return self._stored[::-1][first - 1 : first - 1 + count]

    def advance(self) -> None:
        """Take the readings that are due by now."""
        if self._readings is None:
            return
        times_s = self._readings.due(self._clock.now_s())
        if len(times_s):
            self._keep(self._measured(times_s))
        if not self._readings.remaining:
            self._readings = None
            if self.setup.arm == "SGL":
                self.change(arm="HOLD")

    def _keep(self, volts: FloatArray) -> None:
        if self.setup.memory == "OFF":
            for value in volts:
                self.send_reading(float(value))
            return
        # First in, first out: a full memory takes no more.
        capacity = self._settings.memory_bytes // BYTES[self.setup.memory_format]
        self._stored = np.concatenate([self._stored, volts])[:capacity]

    def _measured(self, edges_s: FloatArray) -> FloatArray:
        setup = self.setup
        middle_s = edges_s + (0.5 if isinstance(self._readings, PacedReadings) else -0.5) * setup.aperture_s
        volts = mean_over_aperture(self._volts, middle_s, setup.aperture_s)
        volts = volts + self._settings.noise_v_rms * self._random.standard_normal(len(edges_s))
        if setup.autorange:
            held = (r for r in RANGES_V if abs(volts[-1]) <= OVER_RANGE * r)
            self.change(range_v=next(held, RANGES_V[-1]))
        over = ~(np.abs(volts) <= OVER_RANGE * (RANGES_V[-1] if setup.autorange else setup.range_v))
        # A single real has 24 bits.
        kept = volts.astype(np.float32).astype(np.float64) if setup.memory_format == "SREAL" else volts
        self._tap.note("VOLT", edges_s, np.where(over, np.nan, kept))
        return np.where(over, np.copysign(OVERLOAD_V, volts), kept)
