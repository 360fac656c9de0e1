"""Faults of the wire and of the instrument's output: seeded, repeatable, around any simulated instrument.

In a rig file, for the instrument NAME:

    [instruments.NAME.faults]
    seed = 3
    late = { probability = 0.01, delay_s = 2.5 }
    garbled = { nth = [12, 40] }
    silent = { after = 100 }

What an instrument sends in one call counts as one reply; replies are counted from 1 over all connections,
so that a driver that reconnects does not meet the same fault again.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from simulators.clock import SimulationClock
from simulators.wiring import Connection, SimulatedInstrument
from simulators.worlds.keyed_random import generator

ReplyNumber = Annotated[int, Field(ge=1)]


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Fault(_Table):
    """Which replies it strikes: these, all after that one, or each with a probability."""

    nth: tuple[ReplyNumber, ...] = ()
    after: Annotated[int, Field(ge=0)] | None = None
    probability: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0

    @model_validator(mode="after")
    def _says_when(self) -> Self:
        if not self.model_fields_set & set(Fault.model_fields):
            raise ValueError("say when: nth = [3], after = 10 or probability = 0.01")
        return self

    def strikes(self, seed: int, number: int) -> bool:
        """True when it befalls reply `number`."""
        return (
            number in self.nth
            or (self.after is not None and number > self.after)
            or generator(seed, type(self).__name__, number).random() < self.probability
        )


class Late(Fault):
    """The reply comes `delay_s` of rig time later; those behind it wait."""

    delay_s: Annotated[float, Field(gt=0.0, allow_inf_nan=False)]


class Garbled(Fault):
    """Some bytes of the reply have other bits."""

    flipped_bytes: Annotated[int, Field(ge=1)] = 1


class Truncated(Fault):
    """Only the first bytes of the reply come."""

    keep_bytes: Annotated[int, Field(ge=0)]


class Silent(Fault):
    """The reply does not come."""


class Duplicated(Fault):
    """The reply comes twice."""


class Disconnect(Fault):
    """The connection ends after the reply."""


class WrongIdentity(_Table):
    """Wherever `text` stands in a reply, `instead` is sent: another model answers."""

    text: Annotated[str, Field(min_length=1)]
    instead: str


class FaultPlan(_Table):
    """What goes wrong, and when; one plan and one seed always give the same faults."""

    seed: int = 0
    late: Late | None = None
    garbled: Garbled | None = None
    truncated: Truncated | None = None
    silent: Silent | None = None
    duplicated: Duplicated | None = None
    disconnect: Disconnect | None = None
    wrong_identity: WrongIdentity | None = None

    def delay_s(self, number: int) -> float:
        """How much later reply `number` comes [rig s]."""
        return self.late.delay_s if self.late and self.late.strikes(self.seed, number) else 0.0

    def ends(self, number: int) -> bool:
        """True when the connection ends after reply `number`."""
        return self.disconnect is not None and self.disconnect.strikes(self.seed, number)

    def copies(self, number: int, reply: bytes) -> tuple[bytes, ...]:
        """What is sent in place of reply `number`: nothing, the reply as it is or spoilt, or that twice."""
        if self.silent and self.silent.strikes(self.seed, number):
            return ()
        if self.wrong_identity:
            named = self.wrong_identity
            reply = reply.replace(named.text.encode(), named.instead.encode())
        if self.garbled and self.garbled.strikes(self.seed, number):
            reply = self._garble(number, reply, self.garbled.flipped_bytes)
        if self.truncated and self.truncated.strikes(self.seed, number):
            reply = reply[: self.truncated.keep_bytes]
        twice = self.duplicated is not None and self.duplicated.strikes(self.seed, number)
        return (reply, reply) if twice else (reply,)

    def _garble(self, number: int, reply: bytes, count: int) -> bytes:
        random = generator(self.seed, "garble", number)
        garbled = bytearray(reply)
        for place in random.choice(len(reply), size=min(count, len(reply)), replace=False):
            garbled[place] ^= int(random.integers(1, 256))
        return bytes(garbled)


class FaultyInstrument:
    """An instrument whose replies suffer `plan`."""

    def __init__(self, inner: SimulatedInstrument, plan: FaultPlan, clock: SimulationClock) -> None:
        self.kind = inner.kind
        self._inner = inner
        self._plan = plan
        self._clock = clock
        self._numbers = itertools.count(1)

    def connect(self, send: Callable[[bytes], None]) -> FaultyConnection:
        """Serve one more client."""
        return FaultyConnection(self._inner, self._plan, self._clock, self._numbers, send)


class FaultyConnection:
    """The instrument's end of one bad connection."""

    def __init__(
        self,
        instrument: SimulatedInstrument,
        plan: FaultPlan,
        clock: SimulationClock,
        numbers: itertools.count[int],
        send: Callable[[bytes], None],
    ) -> None:
        self._plan = plan
        self._clock = clock
        self._numbers = numbers
        self._send = send
        self._waiting: deque[tuple[int, bytes]] = deque()
        self._release_s = 0.0
        self._cut = False
        self._inner: Connection = instrument.connect(self._reply)

    @property
    def hung_up(self) -> bool:
        """True once the fault or the instrument has ended the connection."""
        return self._cut or (not self._waiting and bool(getattr(self._inner, "hung_up", False)))

    def receive(self, data: bytes) -> None:
        """Take bytes from the client; after a disconnect nothing arrives."""
        if not self._cut:
            self._inner.receive(data)

    def close(self) -> None:
        """The client has gone."""
        self._cut = True
        self._inner.close()

    def _reply(self, data: bytes) -> None:
        number = next(self._numbers)
        delay_s = self._plan.delay_s(number)
        if not delay_s and not self._waiting:
            self._deliver(number, data)
            return
        self._waiting.append((number, data))
        self._release_s = max(self._release_s, self._clock.now_s() + delay_s)
        self._clock.call_at(self._release_s, self._deliver_waiting)

    def _deliver_waiting(self) -> None:
        if self._waiting:
            self._deliver(*self._waiting.popleft())

    def _deliver(self, number: int, data: bytes) -> None:
        if self._cut:
            return
        for copy in self._plan.copies(number, data):
            self._send(copy)
        if self._plan.ends(number):
            self._cut = True
