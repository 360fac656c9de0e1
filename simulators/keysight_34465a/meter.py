"""The meter itself: triggers, readings, memory. Knows nothing of SCPI but the error numbers it refuses with."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.aperture import mean_over_aperture
from simulators.clock import SimulationClock
from simulators.keysight_34465a.acquisition import Memory, PacedReadings, Readings, TimedReadings
from simulators.keysight_34465a.configuration import OVERLOAD_V, RANGES_V, Configuration, Integration
from simulators.keysight_34465a.settings import MeterSettings
from simulators.measured import Tap
from simulators.scpi import Register, ScpiError
from simulators.wiring import Signal, TriggerLine

OVERLOAD = 9.9e37
NOT_A_NUMBER = 9.91e37
TIMING_VIOLATION, MEMORY_OVERFLOW, VOLTAGE_OVERLOAD = 1 << 2, 1 << 14, 1
"""Bits of the questionable register."""
MEASURING, WAITING = 1 << 4, 1 << 5
"""Bits of the operation register."""
SMOOTHED = {"SLOW": 100, "MED": 50, "FAST": 10}
"""How many readings smoothing takes the mean of."""
EXPECTED_S = 0.01
"""How soon to look again for edges that nobody has announced."""
LISTENERS_LIMIT = 1_000_000
"""A train on the VM COMP output is announced up to this many edges."""


class Meter:
    """Takes readings of two signals; all times are rig time."""

    def __init__(
        self,
        clock: SimulationClock,
        volts: Signal,
        celsius: Signal,
        trigger_out: TriggerLine | None,
        trigger_in: TriggerLine | None,
        settings: MeterSettings,
        tap: Tap,
    ) -> None:
        self.configuration = Configuration(settings)
        self.memory = Memory(settings.memory)
        self.questionable = Register(self._no_condition)
        self.operation = Register(self._operation)
        self._settings = settings
        self._clock = clock
        self._tap = tap
        self._signals = {"VOLT": volts, "TEMP": celsius}
        self._trigger_out, self._trigger_in = trigger_out, trigger_in
        self._readings: Readings | None = None
        self._triggers_awaited = 0.0
        self._smoothed_last: deque[float] = deque()
        self._random = np.random.default_rng(settings.seed)

    def key_noise(self, *key: int) -> None:
        """Draw the noise from here on from (seed, *key), whatever was drawn before."""
        self._random = np.random.default_rng([self._settings.seed, *key])

    @property
    def idle(self) -> bool:
        """True when no acquisition is initiated."""
        self.advance()
        return self._readings is None and not self._triggers_awaited

    def idle_s(self) -> float:
        """When the acquisition will end; inf when that depends on a trigger that nobody has announced."""
        if self._triggers_awaited or self._readings is None:
            return math.inf
        return self.stored_s(self._readings.remaining)

    def stored_s(self, count: int) -> float:
        """When `count` more readings will be in memory."""
        if self._readings is None:
            return math.inf
        at_s = self._readings.reached_s(count)
        if math.isinf(at_s) and isinstance(self._readings, PacedReadings):
            return self._clock.now_s() + EXPECTED_S
        return at_s

    def initiate(self) -> None:
        """INIT: forget the readings and wait for the trigger, which IMM does not need."""
        if not self.idle:
            raise ScpiError(-213)
        self.memory.clear()
        self._smoothed_last.clear()
        self._tap.begin()
        setup = self.configuration
        # A too short interval is not refused: only the questionable register tells.
        if setup.sample_source == "TIM" and setup.timer_s < setup.timer_minimum_s * (1 - 1e-9):
            self.questionable.event |= TIMING_VIOLATION
        if setup.trigger_source == "IMM":
            self._begin(setup.sample_count * setup.trigger_count)
        elif setup.trigger_source == "BUS":
            self._triggers_awaited = setup.trigger_count
        else:
            self._readings = PacedReadings(
                self._trigger_in,
                self._clock.now_s(),
                setup.trigger_count,
                setup.sample_count,
                setup.trigger_delay_s or 0.0,
                # One reading per trigger has no sample timer to wait for.
                setup.period_s if setup.sample_count > 1 else setup.interval_s,
                # A reading cannot be there before the instant it stands for, or before its integration is over.
                setup.integration_s if self._settings.latency_s is None else max(self._settings.latency_s, 0.0),
            )

    def trigger(self) -> None:
        """*TRG: -211 unless the meter waits for it."""
        self.advance()
        if self._readings is not None or not self._triggers_awaited:
            raise ScpiError(-211)
        self._triggers_awaited -= 1
        self._begin(self.configuration.sample_count)

    def abort(self) -> None:
        """Back to idle; the readings so far stay, the train of edges ends."""
        self.advance()
        if isinstance(self._readings, TimedReadings) and self._trigger_out is not None:
            self._trigger_out.end(self._clock.now_s())
        self._readings = None
        self._triggers_awaited = 0.0

    def stand_still(self, jump_s: float) -> None:
        """The sample timer goes on only after `jump_s`."""
        self.advance()
        readings = self._readings
        if isinstance(readings, TimedReadings) and readings.remaining:
            # All later samples are late by the jump, and so are their edges.
            readings.first_s += jump_s
            if self._trigger_out is not None:
                self._trigger_out.end(self._clock.now_s())
                self._trigger_out.begin(readings.next_s, readings.period_s, min(readings.remaining, LISTENERS_LIMIT))

    def lose_readings(self) -> None:
        """The memory overflows: the older half of the readings is lost."""
        self.advance()
        if len(self.memory):
            self.memory.take((len(self.memory) + 1) // 2)
            self.questionable.event |= MEMORY_OVERFLOW

    def change(self) -> None:
        """A setting of the measurement changes: it ends, and the memory is cleared."""
        self.abort()
        self.memory.clear()

    def reset(self) -> None:
        """*RST."""
        self.change()
        self.configuration = Configuration(self._settings)

    def select(self, function: str) -> None:
        """What is measured; scaling stays on only for what was measured before."""
        setup = self.configuration
        setup.scaling = setup.scaling and setup.function == function
        setup.function = function

    def configure(self, function: str) -> None:
        """CONFigure: the function with everything about its measurement at the default."""
        self.change()
        setup = self.configuration
        self.select(function)
        setup.preset_triggering()
        setup.integrations[function] = Integration()
        setup.autorange, setup.asked_resolution_v = True, None

    def advance(self) -> None:
        """Take the readings that are due by now."""
        if self._readings is None:
            return
        times = self._readings.due(self._clock.now_s())
        if len(times):
            self._take(times)
        if not self._readings.remaining:
            self._readings = None

    def _take(self, times_s: FloatArray) -> None:
        readings = self._measure(times_s)
        valid = np.where(np.abs(readings) >= OVERLOAD, np.nan, readings)
        # The tap hears what was measured, before smoothing and scaling make other numbers of it.
        self._tap.note(self.configuration.function, times_s, valid)
        if self.memory.append(self._scaled(self._smoothed(readings))):
            self.questionable.event |= MEMORY_OVERFLOW

    def _smoothed(self, readings: FloatArray) -> FloatArray:
        """The mean of the last readings while smoothing is on; it begins anew after an overload, as too far off."""
        setup = self.configuration
        if not setup.smoothing:
            return readings
        last = self._smoothed_last = deque(self._smoothed_last, SMOOTHED[setup.smoothing_response])
        smoothed = readings.copy()
        for place, reading in enumerate(readings):
            if abs(reading) >= OVERLOAD:
                last.clear()
                continue
            last.append(float(reading))
            smoothed[place] = np.mean(last)
        return smoothed

    def _scaled(self, readings: FloatArray) -> FloatArray:
        """M x - B of what was measured while scaling is on; no number stays none."""
        setup = self.configuration
        if not setup.scaling:
            return readings
        scaled = setup.scaling_gain * readings - setup.scaling_offset
        return np.where(np.abs(readings) >= OVERLOAD, readings, scaled)

    def _no_condition(self) -> int:
        self.advance()
        return 0

    def _operation(self) -> int:
        if self.idle:
            return 0
        return MEASURING if isinstance(self._readings, TimedReadings) else WAITING

    def _begin(self, count: float) -> None:
        """Readings on the own timer, the first complete after one integration; each gives a VM COMP edge."""
        setup = self.configuration
        first_s = self._clock.now_s() + (setup.trigger_delay_s or 0.0) + setup.integration_s
        # A clock that goes fast makes periods short.
        period_s = setup.period_s / (1.0 + 1e-6 * self._settings.clock_ppm)
        readings = TimedReadings(first_s, period_s, count, max(self._settings.latency_s or 0.0, 0.0))
        self._readings = readings
        if self._trigger_out is not None:
            self._trigger_out.begin(first_s, period_s, min(readings.count, LISTENERS_LIMIT))

    def _measure(self, edges_s: FloatArray) -> FloatArray:
        values = self._read(self._signals[self.configuration.function], edges_s)
        noise = self._random.standard_normal(len(edges_s))
        if self.configuration.function == "TEMP":
            return self._as_temperature(values + self._settings.noise_c_rms * noise)
        return self._as_voltage(values + self._settings.noise_v_rms * noise)

    def _read(self, signal: Signal, edges_s: FloatArray) -> FloatArray:
        """The mean of a signal over the aperture of each edge, or its value `latency_s` after it."""
        if self._settings.latency_s is not None:
            return np.asarray(signal(edges_s + self._settings.latency_s), dtype=np.float64)
        lasts_s = self.configuration.integration_s
        middle_s = edges_s + (0.5 if isinstance(self._readings, PacedReadings) else -0.5) * lasts_s
        return mean_over_aperture(signal, middle_s, lasts_s)

    def _as_voltage(self, volts: FloatArray) -> FloatArray:
        setup = self.configuration
        if setup.autorange:
            # Each reading on the smallest range that holds it.
            index = np.minimum(np.searchsorted(OVERLOAD_V, np.abs(volts)), len(RANGES_V) - 1)
        else:
            index = np.full(len(volts), RANGES_V.index(setup.range_v))
        steps = [self._settings.resolution_v or setup.resolution_v(r) for r in RANGES_V]
        step = np.take(steps, index)
        readings = np.round(volts / step) * step
        overload = np.abs(volts) > np.take(OVERLOAD_V, index)
        if np.any(overload):
            self.questionable.event |= VOLTAGE_OVERLOAD
        readings = np.where(overload, np.copysign(OVERLOAD, volts), readings)
        return np.where(np.isnan(volts), NOT_A_NUMBER, readings)

    def _as_temperature(self, celsius: FloatArray) -> FloatArray:
        step = self._settings.resolution_c
        rounded = np.round(celsius / step) * step
        unit = self.configuration.temperature_unit
        scale, offset = {"C": (1.0, 0.0), "F": (1.8, 32.0), "K": (1.0, 273.15)}[unit]
        # Infinite is a saturated sensor, NaN an input that nothing is connected to.
        readings = np.where(np.isinf(celsius), np.copysign(OVERLOAD, celsius), rounded * scale + offset)
        return np.where(np.isnan(celsius), NOT_A_NUMBER, readings)
