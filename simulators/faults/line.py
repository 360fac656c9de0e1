"""An instrument behind a faulty wire, with a plan of what befalls it."""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Callable
from typing import cast

from simulators.clock import SimulationClock
from simulators.faults.mishaps import Faultable, PowerCycle, schedule
from simulators.faults.plan import FaultPlan
from simulators.faults.when import Event, Occasion
from simulators.faults.wire import Exchange
from simulators.measured import Tap, unheard
from simulators.wiring import Connection, SimulatedInstrument


class FaultyInstrument:
    """An instrument that suffers `plan`, at the end of a serial line or of a network.

    A serial line has no connection that could end: an instrument without power is silent on it.
    """

    def __init__(
        self,
        inner: SimulatedInstrument,
        plan: FaultPlan,
        clock: SimulationClock,
        *,
        serial: bool = False,
        tap: Tap | None = None,
    ) -> None:
        self.kind = inner.kind
        self.sends_whole_replies = True
        """What is sent in one call is one message, where the wire knows messages, even if its end is missing."""
        self.plan = plan
        self._inner = inner
        self._clock = clock
        self._serial = serial
        self._tap = tap or unheard()
        self._powered = True
        self._connections: set[FaultyConnection] = set()
        self._replies, self._commands, self._attempts = (Occasions(clock) for _ in range(3))
        schedule(plan, clock, self._befall, self._relieve)
        if plan.refused is not None:
            for at_s in plan.refused.between_s or ():
                clock.call_at(at_s, lambda: None)  # so that whoever serves it looks at `listening` then

    @property
    def listening(self) -> bool:
        """False while an attempt to connect finds nobody."""
        return self._serial or (self._powered and self.plan.listens(self._clock.now_s()))

    def connect(self, send: Callable[[bytes], None]) -> FaultyConnection:
        """Serve one more client; one that is refused is hung up on at once."""
        attempt = self._attempts.next()
        refused = self.plan.refuses(attempt)
        if refused:
            self.tell("refused", attempt)
        connection = FaultyConnection(self, send)
        if refused or not self.listening:
            connection.cut()
        elif self._powered:
            connection.reach(self._inner)
        self._connections.add(connection)
        return connection

    def forget(self, connection: FaultyConnection) -> None:
        """A client has gone."""
        self._connections.discard(connection)

    def next_reply(self) -> Occasion:
        """One more reply sets out."""
        return self._replies.next()

    def next_command(self) -> Occasion:
        """One more command comes."""
        return self._commands.next()

    def tell(self, fault: str, occasion: Occasion) -> None:
        """Let those who listen know that a fault strikes: its rig time, and the number of the reply or command."""
        self._tap.note(f"fault {fault}", occasion.at_s, occasion.number)

    def call_at(self, at_s: float, callback: Callable[[], None]) -> None:
        """At a rig time."""
        self._clock.call_at(at_s, callback)

    def _befall(self, event: Event) -> None:
        if isinstance(event, PowerCycle):
            self._powered = False
            for connection in self._connections:
                # On a serial line nothing ends: it is only silent.
                connection.lose_power(ends=not self._serial)
        cast(Faultable, self._inner).befall(event)
        self.tell(self.plan.name_of(event), Occasion(0, self._clock.now_s()))

    def _relieve(self, event: Event) -> None:
        cast(Faultable, self._inner).relieve(event)
        if isinstance(event, PowerCycle):
            self._powered = True
            for connection in self._connections:
                # Lines that outlived the power cut lead to a living instrument again.
                connection.reach(self._inner)


class Occasions:
    """Numbers what happens on all connections of an instrument."""

    def __init__(self, clock: SimulationClock) -> None:
        self._clock = clock
        self._numbers = itertools.count(1)
        # So that a fault at the very beginning strikes the first reply.
        self._last_s = math.nextafter(clock.now_s(), -math.inf)

    def next(self) -> Occasion:
        """It happens again."""
        now_s = self._clock.now_s()
        occasion = Occasion(next(self._numbers), now_s, self._last_s)
        self._last_s = now_s
        return occasion


class FaultyConnection:
    """The instrument's end of one bad connection."""

    def __init__(self, instrument: FaultyInstrument, send: Callable[[bytes], None]) -> None:
        self._instrument = instrument
        self._plan = instrument.plan
        self._send = send
        self._waiting: deque[tuple[frozenset[str], Exchange]] = deque()
        self._release_s = 0.0
        self._cut = False
        self._command = self._previous = b""
        self._inner: Connection | None = None

    def reach(self, instrument: SimulatedInstrument) -> None:
        """The wire leads to a living instrument; nothing happens on a connection that has ended."""
        if not self._cut and self._inner is None:
            self._inner = instrument.connect(self._reply)

    def device_clear(self) -> None:
        """On a line of its own, past its bytes and their faults."""
        if (heard := getattr(self._inner, "device_clear", None)) is not None:
            heard()

    @property
    def hung_up(self) -> bool:
        """True once the fault or the instrument has ended the connection."""
        # Not before what is still under way has come.
        return self._cut or (not self._waiting and bool(getattr(self._inner, "hung_up", False)))

    def receive(self, data: bytes) -> None:
        """Take bytes from the client; after the end, or without power, nothing arrives."""
        if self._cut or self._inner is None:
            return
        occasion = self._instrument.next_command()
        struck = self._plan.struck_command(occasion)
        for fault in sorted(struck):
            self._instrument.tell(fault, occasion)
        self._command = data
        if heard := self._plan.heard(struck, occasion.number, data):
            self._inner.receive(heard)

    def close(self) -> None:
        """The client has gone."""
        self.cut()
        self._instrument.forget(self)

    def cut(self) -> None:
        """End the connection; the instrument takes its client for gone."""
        self._cut = True
        self._leave()

    def lose_power(self, *, ends: bool) -> None:
        """What was on its way is lost, and the connection unless it is a line."""
        self._waiting.clear()
        self._leave()
        self._cut = self._cut or ends

    def _leave(self) -> None:
        inner, self._inner = self._inner, None
        if inner is not None:
            inner.close()

    def _reply(self, data: bytes) -> None:
        occasion = self._instrument.next_reply()
        struck = self._plan.struck(occasion)
        # In one order, whatever the set's is.
        for fault in sorted(struck):
            self._instrument.tell(fault, occasion)
        exchange = Exchange(occasion.number, data, self._command, self._previous)
        # The reply as the instrument gave it, not as it was spoilt.
        self._previous = data
        delay_s = self._plan.delay_s(struck)
        if not delay_s and not self._waiting:
            self._deliver(struck, exchange)
            return
        self._waiting.append((struck, exchange))
        # A late reply holds back those behind it: a wire keeps their order.
        self._release_s = max(self._release_s, occasion.at_s + delay_s)
        self._instrument.call_at(self._release_s, self._deliver_waiting)

    def _deliver_waiting(self) -> None:
        if self._waiting:
            self._deliver(*self._waiting.popleft())

    def _deliver(self, struck: frozenset[str], exchange: Exchange) -> None:
        if self._cut:
            return
        if self._plan.ends_before(struck):
            self._cut = True
            return
        for copy in self._plan.copies(struck, exchange):
            self._send(copy)
        if self._plan.ends_after(struck):
            self._cut = True
