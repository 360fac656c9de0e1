"""One output: what it is set to, what follows from that on the wire, and how it bends what cannot be."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.clock import SimulationClock
from simulators.keysight_33500b.settings import GeneratorSettings
from simulators.measured import Tap
from simulators.scpi import ScpiError
from simulators.wiring import VoltageLine

SOURCE_OHM = 50.0
PEAK_V = 10.0
"""Into an open circuit, offset included."""
AMPLITUDE_MINIMUM_VPP = 2e-3
FREQUENCY_MINIMUM_HZ = 1e-6
RAMP_MAXIMUM_HZ = 200e3


@dataclass(frozen=True)
class Course:
    """A waveform as it runs; voltages are those of an open circuit, amplitudes peak to peak."""

    function: str = "SIN"
    frequency_hz: float = 1e3
    amplitude_vpp: float = 0.2
    offset_v: float = 0.0
    phase_deg: float = 0.0
    symmetry: float = 1.0
    inverted: bool = False
    on: bool = False
    began_s: float = 0.0
    began_turns: float = 0.0
    clock_rate: float = 1.0
    burst: bool = False
    burst_cycles: float = 1.0
    burst_phase_deg: float = 0.0
    trigger: str = "IMM"
    triggered: bool = False

    def turns(self, times_s: FloatArray) -> FloatArray:
        """Periods passed since the last synchronisation, phase not counted in."""
        turns = self.began_turns + self.clock_rate * self.frequency_hz * (times_s - self.began_s)
        if not self.burst:
            return turns
        # Before its trigger and after its last cycle a burst rests at the level it begins with.
        return np.clip(turns, 0.0, self.burst_cycles) if self.triggered else np.zeros_like(turns)

    def volts(self, times_s: FloatArray) -> FloatArray:
        """The voltage at the connector, with a high impedance on it."""
        if not self.on:
            return np.zeros_like(times_s)
        if self.function == "DC":
            return np.full_like(times_s, self.offset_v)
        phase_deg = self.burst_phase_deg if self.burst else self.phase_deg
        turns = self.turns(times_s) + phase_deg / 360.0
        shape = np.sin(2.0 * math.pi * turns) if self.function == "SIN" else _ramp(turns, self.symmetry)
        # Not the offset: the guide's rule for the maker's 33220A.
        sign = -1.0 if self.inverted else 1.0
        return self.offset_v + sign * 0.5 * self.amplitude_vpp * shape

    @property
    def levels_v(self) -> tuple[float, float]:
        """The lowest and the highest voltage, into an open circuit."""
        return self.offset_v - 0.5 * self.amplitude_vpp, self.offset_v + 0.5 * self.amplitude_vpp


class Output:
    """Takes settings one by one; `ScpiError` for what it has changed or clipped, after the fact."""

    def __init__(
        self, clock: SimulationClock, line: VoltageLine, settings: GeneratorSettings, tap: Tap, name: str
    ) -> None:
        self._clock = clock
        self._tap = tap
        self._name = name
        self._line = line
        self._settings = settings
        self.reset()

    def reset(self) -> None:
        """*RST."""
        self.load_ohm = SOURCE_OHM
        self._run(Course(began_s=self._clock.now_s(), clock_rate=1.0 + 1e-6 * self._settings.clock_ppm))

    @property
    def course(self) -> Course:
        """What runs now."""
        return self._course

    @property
    def scale(self) -> float:
        """What arrives at the load that voltages are reckoned for, of an open circuit's."""
        # Into a finite load part of the voltage is lost over the generator's own 50 ohm.
        return 1.0 if math.isinf(self.load_ohm) else self.load_ohm / (self.load_ohm + SOURCE_OHM)

    def change(self, **fields: object) -> None:
        """Settings that touch no other: symmetry, phase, the relay."""
        self._run(replace(self._course, **fields))  # type: ignore[arg-type]

    def set_burst(self, on: bool) -> None:
        """Wait for a trigger, or go on without end; a constant has no periods to count."""
        if on and self._course.function == "DC":
            raise ScpiError(-221, "burst turned off by selection of other mode or modulation")
        if on and self._course.trigger != "BUS":
            raise ScpiError(-221, "not simulated")
        self.change(burst=on, triggered=False)

    def fire(self) -> None:
        """The bus's trigger."""
        if self._course.burst and self._course.trigger == "BUS":
            self.change(triggered=True, began_s=self._clock.now_s(), began_turns=0.0)

    def synchronise(self) -> None:
        """Begin a period now."""
        self.change(began_s=self._clock.now_s(), began_turns=0.0)

    def frequency_maximum_hz(self) -> float:
        """Of the present function."""
        return RAMP_MAXIMUM_HZ if self._course.function == "RAMP" else self._settings.sine_maximum_hz

    def set_frequency(self, frequency_hz: float) -> None:
        """The nearest step; the waveform goes on from the phase it has."""
        now_s = self._clock.now_s()
        # The phase it has now is kept: a change of frequency makes no jump.
        turns = float(self._course.turns(np.array([now_s]))[0])
        step_hz = self._settings.frequency_step_hz
        nearest_hz = max(round(frequency_hz / step_hz) * step_hz, FREQUENCY_MINIMUM_HZ)
        self.change(frequency_hz=nearest_hz, began_s=now_s, began_turns=turns)

    def set_function(self, function: str) -> None:
        """SIN, RAMP, TRI or DC; frequency and offset give way."""
        symmetry = 0.5 if function == "TRI" else self._course.symmetry
        changed = ""
        if function == "DC" and self._course.burst:
            self.change(burst=False)
            changed = "burst turned off by selection of other mode or modulation"
        self.change(function="RAMP" if function == "TRI" else function, symmetry=symmetry)
        if self._course.frequency_hz > self.frequency_maximum_hz():
            self.set_frequency(self.frequency_maximum_hz())
            changed = "frequency reduced for ramp function"
        if abs(self._course.offset_v) > self.offset_maximum_v():
            self.change(offset_v=math.copysign(self.offset_maximum_v(), self._course.offset_v))
            changed = "offset changed on exit from dc function"
        if changed:
            raise ScpiError(-221, changed)

    def offset_maximum_v(self) -> float:
        """Into an open circuit."""
        return PEAK_V - (0.0 if self._course.function == "DC" else 0.5 * self._course.amplitude_vpp)

    def set_levels(self, low_v: float, high_v: float) -> None:
        """By its lowest and highest voltage into an open circuit."""
        self.change(amplitude_vpp=high_v - low_v, offset_v=0.5 * (low_v + high_v))

    def set_amplitude(self, amplitude_vpp: float) -> None:
        """Into an open circuit; the offset gives way."""
        self.change(amplitude_vpp=amplitude_vpp)
        if abs(self._course.offset_v) > self.offset_maximum_v():
            self.change(offset_v=math.copysign(self.offset_maximum_v(), self._course.offset_v))
            raise ScpiError(-221, "offset changed due to amplitude")

    def _run(self, course: Course) -> None:
        self._course = course
        now_s = self._clock.now_s()
        self._line.drive(now_s, course.volts)
        if self._tap.heard:
            self._tap.note(self._name, now_s, course.volts(np.array([now_s])))


def _ramp(turns: FloatArray, symmetry: float) -> FloatArray:
    """From -1 to 1 in `symmetry` of a period and back in the rest; upwards through zero where turns are whole."""
    place = (turns + 0.5 * symmetry) % 1.0
    rising = place / symmetry if symmetry > 0.0 else np.zeros_like(place)
    falling = (1.0 - place) / (1.0 - symmetry) if symmetry < 1.0 else np.zeros_like(place)
    return 2.0 * np.where(place < symmetry, rising, falling) - 1.0
