"""Position capture (DATAACQ): the encoder latched at every edge of the trigger line."""

from __future__ import annotations

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.aerotech_ensemble.settings import StageSimulatorSettings
from simulators.keyed_random import generator
from simulators.measured import Tap
from simulators.motion import MotionAxis
from simulators.wiring import TriggerLine


class PositionCapture:
    """Latches nothing while time passes: what was recorded follows from the edges and the axis' past.

    `run_key` goes with the seed into the encoder's noise; whoever wants every run to have its own noise,
    whenever it is made, changes it from run to run.
    """

    def __init__(self, axis: MotionAxis, trigger: TriggerLine, settings: StageSimulatorSettings, tap: Tap) -> None:
        self.run_key: tuple[int, ...] = ()
        self._tap = tap
        self._axis = axis
        self._line = trigger
        self._settings = settings
        self.reset()

    def reset(self) -> None:
        """As after switching on."""
        self.trigger = 0
        self.input = 0
        self._armed_s = 0.0
        self._zero_mm = 0.0
        self._points = 0
        self._ended_s = 0.0
        self._complete: FloatArray | None = None
        self._edges_s = np.empty(0)
        self._read = 0

    def arm(self, now_s: float, points: int, zero_mm: float) -> None:
        """Forget the last record and wait for `points` edges; positions are relative to `zero_mm`."""
        self._armed_s, self._points, self._zero_mm = now_s, points, zero_mm
        self._ended_s, self._complete, self._read = np.inf, None, 0
        self._tap.begin()

    def off(self, now_s: float) -> None:
        """Latch no more and forget what was set up, as the maker says of OFF; the points can still be read."""
        # Recorded before the trigger is forgotten: they came by it.
        self._complete = self._recorded(now_s)
        self._ended_s = min(self._ended_s, now_s)
        self.trigger = self.input = 0

    def active(self, now_s: float) -> bool:
        """True while edges are awaited."""
        return self._ended_s > now_s and len(self._recorded(now_s)) < self._points

    def take(self, now_s: float, count: int) -> FloatArray:
        """The next up to `count` points, in counts."""
        recorded = self._recorded(now_s)
        taken = recorded[self._read : self._read + count]
        self._note(self._read, taken)
        if self._settings.dialect.capture_read == "continues":
            # Which of the two controllers do is not known for sure, so it is a setting.
            self._read += len(taken)
        return taken

    def left(self, now_s: float) -> int:
        """How many points can still be read."""
        return len(self._recorded(now_s)) - self._read

    def _note(self, first: int, taken: FloatArray) -> None:
        if not self._tap.heard or not len(taken):
            return
        edges_s = self._edges_s[first : first + len(taken)]
        # The tap hears where the stage truly was, before the encoder's noise and rounding.
        true_mm = self._axis.sample(edges_s + self._settings.capture_latency_s)[0] - self._settings.home_position_mm
        self._tap.note("position", edges_s, taken / self._settings.counts_per_mm)
        self._tap.note("true position", edges_s, true_mm)

    def _recorded(self, now_s: float) -> FloatArray:
        # Kept once it is full: the world remembers only its recent past.
        if self._complete is not None:
            return self._complete
        # Another trigger number is wired to nothing.
        if self._points == 0 or self.trigger != self._settings.capture_trigger:
            return np.empty(0)
        latency_s = self._settings.capture_latency_s
        # An edge is recorded when its position is latched, not when it comes.
        until_s = min(now_s - latency_s, self._ended_s)
        edges_s = self._line.edges(self._armed_s, until_s)[: self._points]
        self._edges_s = edges_s
        values = self._latched(edges_s + latency_s)
        if len(values) == self._points:
            self._complete = values
        return values

    def _latched(self, times_s: FloatArray) -> FloatArray:
        s = self._settings
        if self.input != s.capture_input:
            # Another input has no encoder: it records zeros, as does a controller that was set up wrong.
            return np.zeros(len(times_s))
        position_mm = self._axis.sample(times_s)[0] - self._zero_mm
        if s.encoder_noise_mm:
            # By seed and run, not in sequence: a resumed campaign meets the same noise.
            random = generator(s.seed, "captured encoder", *self.run_key)
            position_mm = position_mm + random.normal(0.0, s.encoder_noise_mm, len(times_s))
        # The encoder counts; what is read is a whole number of counts.
        return np.round(position_mm * s.counts_per_mm)
