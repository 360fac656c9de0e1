"""What a simulator says of itself: how it is built from a bench, and what can befall it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
from pydantic import BaseModel

from rigctl.core.arrays import FloatArray
from simulators.benches import Bench
from simulators.clock import SimulationClock
from simulators.faults import FaultPlan, faults_of
from simulators.faults.signals import FaultySensor, LossyTrigger
from simulators.measured import Tap
from simulators.motion import MotionAxis
from simulators.wiring import Signal, TriggerLine

STAGE_FAULTS = frozenset({"power_cycle", "following_error", "limit_hit", "emergency_stop"})
"""What every simulated stage can suffer."""


@dataclass(frozen=True)
class Wiring:
    """What hears an instrument, what may go wrong with it, and the trigger line as it reaches it."""

    tap: Tap
    plan: FaultPlan
    pace: TriggerLine

    @property
    def trigger(self) -> TriggerLine:
        """The line with the pulses of the pacing instrument."""
        # In front of one instrument: the others still get their edges.
        missing = self.plan.missing_edges
        return self.pace if missing is None else LossyTrigger(self.pace, missing, self.plan.seed, self.tap)

    def signal(self, signal: Signal) -> Signal:
        """A quantity of the world as its sensor gives it."""
        plan = self.plan
        # What nothing befalls is handed on as it is, and costs nothing.
        spoilt = plan.stuck or plan.saturation or plan.target_lost
        return FaultySensor(plan, self.tap).of(signal) if spoilt else signal


@dataclass(frozen=True)
class Site(Wiring):
    """Where an instrument stands: its time and its world as well."""

    clock: SimulationClock
    bench: Bench

    def axis(self, role: str) -> MotionAxis:
        """The world's axis of this role; an instrument that has no part in the experiment moves its own."""
        return self.bench.axes.get(role) or MotionAxis()


@dataclass(frozen=True)
class SimulatorDeclaration:
    """How one kind of instrument is simulated.

    `build` takes what the rig file says of the instrument, where it stands, and its `settings`, checked; it gives a
    `simulators.wiring.SimulatedInstrument`, or, when it is not `wired`, the object its driver talks with. Of the
    `simulators.faults.InstrumentFaults` it suffers `faults`. `columns` gives the column of a run by the name that the
    instrument has for a quantity.
    """

    settings: type[BaseModel]
    build: Callable[[Spec, Site, Any], Any]
    faults: frozenset[str]
    columns: Callable[[Spec], dict[str, str]] = lambda _: {}
    wired: bool = True

    def possible_faults(self, *, serial: bool) -> list[str]:
        """The faults it can have at the end of such a line, by their keys in a rig file."""
        return faults_of(self.faults, wired=self.wired, serial=serial)


@dataclass(frozen=True)
class Spec:
    """One instrument as the rig file has it: `settings` are the driver's keys, `simulator` the simulator's own."""

    kind: str
    role: str
    declaration: SimulatorDeclaration
    settings: Mapping[str, Any] = field(default_factory=dict)
    simulator: Mapping[str, Any] = field(default_factory=dict)
    faults: Mapping[str, Any] = field(default_factory=dict)
    serial: bool = False
    """At the end of a serial line, or of a network."""

    def numbered(self, key: str, default: Mapping[str, int] | None = None) -> dict[str, int]:
        """A table of the driver's keys that gives names to numbers."""
        return {name: int(number) for name, number in dict(self.settings.get(key, default or {})).items()}


@runtime_checkable
class DrawsNoise(Protocol):
    """An instrument with noise of its own, which every run draws anew."""

    def key_noise(self, *key: int) -> None:
        """Draw the noise from here on from (its seed, *key), whatever was drawn before."""
        ...


def position_columns(column: str) -> dict[str, str]:
    """Of a stage that says where it is, and knows where it truly is."""
    return {"position": column, "true position": f"true {column}"}


def nothing(times_s: FloatArray) -> FloatArray:
    """What an input hears that nothing is connected to."""
    return np.full_like(times_s, np.nan)
