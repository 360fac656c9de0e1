"""When a fault strikes: by number, by rig time, or at random by seed, drawn by name and never in sequence."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Self

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from rigctl.core.arrays import FloatArray
from simulators.keyed_random import generator

SLOT_S = 3600.0
"""Random faults are drawn hour by hour of rig time."""
HORIZON_SLOTS = 24 * 400
"""Beyond so many hours without one nobody looks for the next."""

Number = Annotated[int, Field(ge=1)]
TimeS = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


def _one_or_many(value: Any) -> Any:
    return [value] if isinstance(value, int | float) else value


Times = Annotated[tuple[TimeS, ...], BeforeValidator(_one_or_many)]


class Table(BaseModel):
    """A table of a rig file."""

    model_config = ConfigDict(frozen=True, extra="forbid")


@dataclass(frozen=True)
class Occasion:
    """One reply (or attempt to connect): its number, and when it and the one before it were."""

    number: int
    at_s: float = 0.0
    before_s: float = -math.inf


class Fault(Table):
    """Which replies it strikes: these, all after that one, the first at or after a time, each with a probability.

    `between_s` alone strikes all within, and confines the other ways to it.
    """

    nth: tuple[Number, ...] = ()
    after: Annotated[int, Field(ge=0)] | None = None
    probability: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    at_s: Times = ()
    between_s: tuple[TimeS, TimeS] | None = None

    @model_validator(mode="after")
    def _says_when(self) -> Self:
        if not self.model_fields_set & set(Fault.model_fields):
            raise ValueError(
                "say when: nth = [3], after = 10, probability = 0.01, at_s = 60.0 or between_s = [60, 90]"
            )
        if self.between_s is not None and not self.between_s[0] < self.between_s[1]:
            raise ValueError("between_s is the begin and the end of a stretch of rig time")
        return self

    def strikes(self, seed: int, occasion: Occasion) -> bool:
        """True when it befalls this one."""
        if self.between_s is not None:
            if not self.between_s[0] <= occasion.at_s < self.between_s[1]:
                return False
            if not self.model_fields_set & {"nth", "after", "probability", "at_s"}:
                return True
        return (
            occasion.number in self.nth
            or (self.after is not None and occasion.number > self.after)
            # The first reply at or after the time: a fault between two replies strikes the next one.
            or any(occasion.before_s < at_s <= occasion.at_s for at_s in self.at_s)
            or (
                self.probability > 0.0
                # By name and number: what else was drawn, or how often, does not matter.
                and generator(seed, type(self).__name__, occasion.number).random() < self.probability
            )
        )


@dataclass(frozen=True)
class Stretch:
    """From `begin_s` up to `end_s` of rig time."""

    begin_s: float
    end_s: float


class Event(Table):
    """When something befalls an instrument: at these rig times, or so many times an hour at random."""

    at_s: Times = ()
    per_hour: Annotated[float, Field(ge=0.0, le=3600.0)] = 0.0

    @model_validator(mode="after")
    def _says_when(self) -> Self:
        if not self.at_s and not self.per_hour:
            raise ValueError("say when: at_s = 300.0, at_s = [300.0, 900.0] or per_hour = 0.5")
        return self

    @property
    def length_s(self) -> float:
        """How long it lasts; 0 for what is over at once."""
        return 0.0

    def next(self, seed: int, after_s: float) -> Stretch | None:
        """The first that begins later than `after_s`; None when there is none any more."""
        first = max(math.floor(after_s / SLOT_S), 0)
        coming = [at_s for at_s in self.at_s if at_s > after_s]
        if self.per_hour:
            # Without an end to the search a rate near zero would be drawn for ever.
            drawn = (at_s for slot in range(first, first + HORIZON_SLOTS) for at_s in self._drawn(seed, slot))
            coming += next(([at_s] for at_s in drawn if at_s > after_s), [])
        return Stretch(min(coming), min(coming) + self.length_s) if coming else None

    def within(self, seed: int, from_s: float, until_s: float) -> list[Stretch]:
        """All that touch this stretch of time, in order of their begin."""
        return sorted(self._touching(seed, from_s, until_s), key=lambda stretch: stretch.begin_s)

    def strikes_at(self, seed: int, times_s: FloatArray) -> FloatArray:
        """The begin of the stretch that each time lies in, NaN where in none; same shape."""
        begins = np.full_like(times_s, np.nan)
        if times_s.size:
            for stretch in self.within(seed, float(times_s.min()), float(times_s.max())):
                begins[(times_s >= stretch.begin_s) & (times_s < stretch.end_s)] = stretch.begin_s
        return begins

    def _touching(self, seed: int, from_s: float, until_s: float) -> Iterator[Stretch]:
        begins = list(self.at_s)
        if self.per_hour:
            # Also spells that began in an earlier slot and still last.
            slots = range(max(math.floor((from_s - self.length_s) / SLOT_S), 0), math.floor(until_s / SLOT_S) + 1)
            begins += [at_s for slot in slots for at_s in self._drawn(seed, slot)]
        for begin_s in begins:
            if begin_s <= until_s and begin_s + self.length_s >= from_s:
                yield Stretch(begin_s, begin_s + self.length_s)

    def _drawn(self, seed: int, slot: int) -> list[float]:
        random = generator(seed, type(self).__name__, slot)
        # A Poisson process: the number of an hour first, then each anywhere within it.
        count = int(random.poisson(self.per_hour))
        return sorted((SLOT_S * (slot + random.random(count))).tolist())


class Spell(Event):
    """An event that lasts."""

    lasting_s: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] = 20.0

    @property
    def length_s(self) -> float:
        """How long it lasts."""
        return self.lasting_s
