"""What goes wrong before the instrument: a signal that is lost, stuck or too large; edges that do not arrive."""

from __future__ import annotations

import math

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.faults.mishaps import InstrumentFaults, MissingEdges
from simulators.keyed_random import generator, uniform_of_integers
from simulators.measured import Tap
from simulators.wiring import Signal, TriggerLine


class FaultySensor:
    """A sensor that suffers `plan`: it gives NaN without a target, `saturated` with its sign beyond its range."""

    def __init__(self, plan: InstrumentFaults, tap: Tap, saturated: float = math.inf) -> None:
        self._plan = plan
        self._tap = tap
        self._saturated = saturated
        self._stuck_at: dict[float, float] = {}
        self._told: set[tuple[str, float]] = set()

    def gives(self, times_s: FloatArray, values: FloatArray) -> FloatArray:
        """What it makes of true values at rig times, same shape."""
        values = values.copy()
        for begin_s, struck in self._stretches("stuck", times_s):
            # Stuck at the value it had when it began, also where this stretch is asked for in pieces.
            values[struck] = self._stuck_at.setdefault(begin_s, float(values[struck].flat[0]))
        for _, struck in self._stretches("saturation", times_s):
            # NaN stays NaN: a lost target does not saturate.
            values[struck] = np.copysign(self._saturated, values[struck]) + 0.0 * values[struck]
        for _, struck in self._stretches("target_lost", times_s):
            values[struck] = np.nan
        return values

    def of(self, signal: Signal) -> Signal:
        """A signal as it gives it."""
        return lambda times_s: self.gives(times_s, np.asarray(signal(times_s), dtype=np.float64))

    def _stretches(self, fault: str, times_s: FloatArray) -> list[tuple[float, np.ndarray]]:
        event = getattr(self._plan, fault)
        if event is None:
            return []
        begins_s = event.strikes_at(self._plan.seed, times_s)
        stretches = [(float(each), begins_s == each) for each in np.unique(begins_s[~np.isnan(begins_s)])]
        for begin_s, struck in stretches:
            if (fault, begin_s) not in self._told:
                self._told.add((fault, begin_s))
                self._tap.note(f"fault {fault}", float(times_s[struck].min()), 0.0)
        return stretches


class LossyTrigger(TriggerLine):
    """A trigger line of which not every edge arrives."""

    def __init__(self, line: TriggerLine, missing: MissingEdges, seed: int, tap: Tap) -> None:
        super().__init__(line.pulse_s)
        self._line = line
        self._missing = missing
        self._seed = seed
        self._tap = tap
        self._told_until_s = -math.inf
        self._salt = int(generator(seed, "missing edges").integers(1 << 62))

    def edges(self, after_s: float, until_s: float) -> FloatArray:
        """Those that arrive in (after_s, until_s]."""
        edges = self._line.edges(after_s, until_s)
        spell = ~np.isnan(self._missing.strikes_at(self._seed, edges))
        # By the edge's time, in microseconds: the same edge is lost however often it is asked for.
        drawn = 0.5 + 0.5 * uniform_of_integers(self._salt, np.round(1e6 * edges).astype(np.int64))
        lost = spell & (drawn < self._missing.share)
        self._tell(edges[lost])
        return edges[~lost]

    def _tell(self, lost_s: FloatArray) -> None:
        # Edges are asked for again and again; each is told once.
        new_s = lost_s[lost_s > self._told_until_s]
        if new_s.size:
            self._told_until_s = float(new_s[-1])
            self._tap.note("fault missing_edges", new_s, np.zeros_like(new_s))
