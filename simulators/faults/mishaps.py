"""What befalls an instrument itself. It shows on the wire as the instrument's own states and error codes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Annotated, Protocol, runtime_checkable

from pydantic import Field

from simulators.clock import SimulationClock
from simulators.faults.when import Event, Spell, Stretch, Table


class PowerCycle(Spell):
    """The power fails: what moves stops, connections end, all that is not kept is forgotten."""


class FollowingError(Event):
    """An axis meets an obstacle."""


class LimitHit(Event):
    """A moving axis runs into the limit switch ahead of it."""


class EmergencyStop(Spell):
    """The emergency stop is pressed, and released."""


class AirLost(Spell):
    """An air bearing has no pressure."""


class WrongUnit(Spell):
    """Somebody sets other units at the front panel: inches, encoder counts, degrees Fahrenheit."""


class MemoryOverflow(Event):
    """Half of the readings that wait in memory are lost, the oldest."""


class TargetLost(Spell):
    """Laser heads see no target."""


class Saturation(Spell):
    """What is measured is out of range."""


class Stuck(Spell):
    """What is measured stays as it was."""


class MissingEdges(Spell):
    """Trigger edges do not arrive: each is lost with the probability `share`."""

    share: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0


class ClockJump(Event):
    """The sample timer stands still for `jump_s`."""

    jump_s: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] = 1.0


class ClockDrift(Table):
    """The instrument's clock is so much faster than rig time."""

    ppm: Annotated[float, Field(gt=-1e6, lt=1e6)]


TOLD = (PowerCycle, FollowingError, LimitHit, EmergencyStop, AirLost, WrongUnit, MemoryOverflow, ClockJump)
"""What an instrument is told of; the rest happens in front of it, or in what it is made with."""


class InstrumentFaults(Table):
    """What befalls an instrument, and when."""

    seed: int = 0
    power_cycle: PowerCycle | None = None
    following_error: FollowingError | None = None
    limit_hit: LimitHit | None = None
    emergency_stop: EmergencyStop | None = None
    air_lost: AirLost | None = None
    wrong_unit: WrongUnit | None = None
    memory_overflow: MemoryOverflow | None = None
    target_lost: TargetLost | None = None
    saturation: Saturation | None = None
    stuck: Stuck | None = None
    missing_edges: MissingEdges | None = None
    clock_jump: ClockJump | None = None
    clock_drift: ClockDrift | None = None

    def name_of(self, event: Event) -> str:
        """The key of an event of this plan."""
        return next(name for name in INSTRUMENT_FAULTS if getattr(self, name) is event)

    def told(self) -> Iterator[Event]:
        """What the instrument is told of."""
        for name in INSTRUMENT_FAULTS:
            event = getattr(self, name)
            if isinstance(event, TOLD):
                yield event


INSTRUMENT_FAULTS = tuple(name for name in InstrumentFaults.model_fields if name != "seed")


@runtime_checkable
class Faultable(Protocol):
    """An instrument that can be told what befalls it; called under the clock's lock."""

    def befall(self, event: Event) -> None:
        """It begins."""
        ...

    def relieve(self, event: Event) -> None:
        """It is over; not called for what is over at once."""
        ...


def schedule(
    plan: InstrumentFaults, clock: SimulationClock, befall: Callable[[Event], None], relieve: Callable[[Event], None]
) -> None:
    """Have every mishap of a plan begin and end at its time; what began before now and lasts begins now."""
    now_s = clock.now_s()
    for event in plan.told():
        _Recurring(plan.seed, clock, event, befall, relieve).begin_with(now_s)


class _Recurring:
    """One mishap, time after time."""

    def __init__(
        self,
        seed: int,
        clock: SimulationClock,
        event: Event,
        befall: Callable[[Event], None],
        relieve: Callable[[Event], None],
    ) -> None:
        self._seed, self._clock = seed, clock
        self._event = event
        self._befall, self._relieve = befall, relieve

    def begin_with(self, now_s: float) -> None:
        """Whatever is on now, else the next."""
        # A resumed campaign begins in the middle of what lasts.
        running = self._event.within(self._seed, now_s, now_s)
        if running:
            self._begin(running[-1])
        else:
            self._await(now_s)

    def _await(self, after_s: float) -> None:
        coming = self._event.next(self._seed, after_s)
        if coming is not None:
            self._clock.call_at(coming.begin_s, lambda: self._begin(coming))

    def _begin(self, stretch: Stretch) -> None:
        self._befall(self._event)
        # What is over at once has no end to tell of.
        if stretch.end_s > stretch.begin_s:
            self._clock.call_at(stretch.end_s, lambda: self._end(stretch))
        else:
            self._await(stretch.begin_s)

    def _end(self, stretch: Stretch) -> None:
        self._relieve(self._event)
        self._await(stretch.end_s)
