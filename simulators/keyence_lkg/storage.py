"""The data storage: one value per output and edge of the TIMING input, or per so many sampling cycles.

Sampling cycles are those of the controller's own clock.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.clock import SimulationClock
from simulators.keyence_lkg.heads import Output
from simulators.keyence_lkg.model import LkgSettings
from simulators.keyence_lkg.values import shown_mm
from simulators.measured import Tap
from simulators.wiring import TriggerLine

# Well within what the world remembers.
_LOOK_EVERY_S = 30.0


@dataclass(frozen=True)
class Plan:
    """What to store: `count` values of each output; `cycle_s` apart, or by the TIMING input when None.

    It begins `delay_s` after it was started.
    """

    count: int
    cycle_s: float | None
    outputs: tuple[int, ...]
    delay_s: float = 0.0


class DataStorage:
    """Stores by itself while it runs and ends by itself when full.

    Edges are looked up and heads sampled when somebody asks, and every so often meanwhile, since the world
    remembers only its recent past.
    """

    def __init__(
        self, clock: SimulationClock, trigger: TriggerLine, outputs: list[Output], settings: LkgSettings, tap: Tap
    ) -> None:
        self._clock = clock
        self._tap = tap
        self._decimals = settings.decimals
        self._trigger = trigger
        self._outputs = outputs
        self._latency_s = settings.latency_s
        self._shortest_pulse_s = settings.timing_pulse_min_s
        self._rate = 1.0 + 1e-6 * settings.clock_ppm
        self._plan = Plan(0, None, ())
        self._start_s = math.inf
        self._seen_s = -math.inf
        self._running = False
        self._run = 0
        self.clear()

    @property
    def running(self) -> bool:
        """True until stopped or full."""
        self._look()
        return self._running

    def count(self, output: int) -> int:
        """Values stored of an output when last looked at."""
        return self._count if output in self._plan.outputs else 0

    def values(self, output: int) -> FloatArray:
        """The stored values of an output."""
        self.take()
        return self._values.get(output, np.empty(0))

    def clear(self) -> None:
        """Forget all values; a storage that runs goes on from here."""
        self._look()
        self._count = 0
        self._tap.begin()
        self._pending: list[FloatArray] = []
        self._values = {output: np.empty(0) for output in self._plan.outputs}

    def start(self, plan: Plan) -> None:
        """Go on storing, or begin anew when the plan has changed."""
        if self.running:
            return
        # Started again with the same plan it goes on.
        if plan != self._plan:
            self._plan = plan
            self.clear()
        self._start_s = self._clock.now_s() + plan.delay_s
        # An edge at the very instant of the start counts, once.
        self._seen_s = max(self._seen_s, math.nextafter(self._start_s, -math.inf))
        self._running = bool(plan.outputs) and self._count < plan.count
        # By number, so that the looks of an earlier start end.
        self._run += 1
        self._look_again(self._run)

    def stop(self) -> None:
        """End storing; the values stay."""
        self._look()
        self._running = False

    def take(self) -> None:
        """Sample the heads at the instants stored so far, as their outputs are set now."""
        self._look()
        if self._pending:
            times_s = np.concatenate(self._pending) + self._latency_s
            self._pending = []
            for output, before in self._values.items():
                values = self._outputs[output].at(times_s)
                self._values[output] = np.concatenate([before, values])
                self._note(output, times_s, values)

    def _note(self, output: int, times_s: FloatArray, values_mm: FloatArray) -> None:
        if self._tap.heard:
            shown = shown_mm(values_mm.tolist(), self._decimals)
            self._tap.note(str(output + 1), times_s - self._latency_s, shown)

    def _look(self) -> None:
        if not self._running:
            return
        # A value counts as stored when it is measured, `latency_s` after its edge.
        until_s = self._clock.now_s() - self._latency_s
        instants = self._instants(until_s)[: self._plan.count - self._count]
        if len(instants):
            # Not `until_s`: a train may yet begin at this very instant.
            self._seen_s = float(instants[-1])
            self._pending.append(instants)
            self._count += len(instants)
        self._running = self._count < self._plan.count

    def _instants(self, until_s: float) -> FloatArray:
        if self._plan.cycle_s is None:
            # A contact input: it does not see what is too short for it.
            seen = self._trigger.pulse_s >= self._shortest_pulse_s
            return self._trigger.edges(self._seen_s, until_s) if seen else np.empty(0)
        cycle_s = self._plan.cycle_s / self._rate
        # Rounding must not lose the cycle that ends right now.
        first, last = (math.floor((t - self._start_s) / cycle_s + 1e-6) for t in (self._seen_s, until_s))
        return np.asarray(self._start_s + cycle_s * np.arange(max(first, 0) + 1, last + 1), dtype=np.float64)

    def _look_again(self, run: int) -> None:
        if self._running and run == self._run:
            self.take()
            self._clock.call_at(self._clock.now_s() + _LOOK_EVERY_S, lambda: self._look_again(run))
