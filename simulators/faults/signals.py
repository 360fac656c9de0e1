"""What goes wrong before the instrument: a signal that is lost, stuck or too large; edges that do not arrive."""

from __future__ import annotations

import numpy as np

from simulators.faults.mishaps import InstrumentFaults, MissingEdges
from simulators.wiring import FloatArray, Signal, TriggerLine
from simulators.worlds.keyed_random import generator, uniform_of_integers


class FaultySignal:
    """A signal as a sensor gives it that suffers `plan`: NaN without a target, infinite when saturated."""

    def __init__(self, signal: Signal, plan: InstrumentFaults) -> None:
        self._signal = signal
        self._plan = plan
        self._stuck_at: dict[float, float] = {}

    def __call__(self, times_s: FloatArray) -> FloatArray:
        """The values at rig times, same shape."""
        plan = self._plan
        values = np.asarray(self._signal(times_s), dtype=np.float64)
        if plan.stuck is not None:
            values = self._held(plan.stuck.strikes_at(plan.seed, times_s), values)
        if plan.saturation is not None:
            struck = ~np.isnan(plan.saturation.strikes_at(plan.seed, times_s)) & ~np.isnan(values)
            values = np.where(struck, np.copysign(np.inf, values), values)
        if plan.target_lost is not None:
            values = np.where(np.isnan(plan.target_lost.strikes_at(plan.seed, times_s)), values, np.nan)
        return values

    def _held(self, since_s: FloatArray, values: FloatArray) -> FloatArray:
        """In each stretch the value it showed first."""
        held = values.copy()
        for begin_s in np.unique(since_s[~np.isnan(since_s)]):
            struck = since_s == begin_s
            held[struck] = self._stuck_at.setdefault(float(begin_s), float(values[struck][0]))
        return held


class LossyTrigger(TriggerLine):
    """A trigger line of which not every edge arrives."""

    def __init__(self, line: TriggerLine, missing: MissingEdges, seed: int) -> None:
        super().__init__()
        self._line = line
        self._missing = missing
        self._seed = seed
        self._salt = int(generator(seed, "missing edges").integers(1 << 62))

    def edges(self, after_s: float, until_s: float) -> FloatArray:
        """Those that arrive in (after_s, until_s]."""
        edges = self._line.edges(after_s, until_s)
        spell = ~np.isnan(self._missing.strikes_at(self._seed, edges))
        drawn = 0.5 + 0.5 * uniform_of_integers(self._salt, np.round(1e6 * edges).astype(np.int64))
        return edges[~(spell & (drawn < self._missing.share))]
