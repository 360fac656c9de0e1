"""The rig open in this process: every instrument is asked, moved and stopped on threads of its own.

So one that hangs keeps nobody waiting: not the screen, not the others, and not the STOP.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Container
from contextlib import ExitStack
from pathlib import Path

from textual.message import Message

from rigctl.campaign.session.holders import stopped_from_outside
from rigctl.charge import rig_of_ones_own
from rigctl.console.messages import Stopped
from rigctl.console.readings import InstrumentView, Strip
from rigctl.console.station import Station
from rigctl.core.making_safe import STOP_SIGNAL, Rest, bring_to_rest, let_go
from rigctl.files.rig_file import RigFile, parse_rig
from rigctl.rig import Rig

SETTLE_S = 0.2
"""A motion ends that soon after its instrument has stopped; one that does not was begun behind the stop."""
THREADS_END_S = 3.0


class LiveBench:
    """A rig held by this console; made by `open_bench`, given back by `close`."""

    def __init__(self, rig: Rig, held: ExitStack, post: Callable[[Message], object]) -> None:
        self._held = held
        self._post = post
        self._closing = threading.Event()
        self.addresses = frozenset(table.address for table in rig.file.instruments.values())
        """Of all that is held."""
        self.stations = {
            name: Station(name, table, rig.instruments[name], self._closing, post)
            for name, table in rig.file.instruments.items()
        }
        for station in self.stations.values():
            station.thread.start()

    def views(self) -> tuple[InstrumentView, ...]:
        """All instruments now; asks none of them."""
        return tuple(station.view() for station in self.stations.values())

    def strips(self) -> dict[str, Strip]:
        """What the strip charts show, by quantity."""
        return {name: strip for station in self.stations.values() for name, strip in station.strips().items()}

    def reconnect(self) -> None:
        """Try again now what does not answer."""
        for station in self.stations.values():
            station.wake()

    def stop(self) -> None:
        """Bring every instrument to rest, all at once; returns at once, what came of it is posted."""
        threading.Thread(target=lambda: self._post(Stopped(self.bring_to_rest())), name="stop", daemon=True).start()

    def bring_to_rest(self) -> tuple[Rest, ...]:
        """Stop every instrument, and once more where a motion was begun behind the stop."""
        stations = list(self.stations.values())
        for station in stations:
            # Before any stop is sent: a motion that is between two of its steps then does not set out.
            station.stops += 1
        first = bring_to_rest(station.instrument for station in stations)
        # A motion that goes on after its instrument has stopped was begun behind the stop.
        late = [station.instrument for station in stations if not station.settled.wait(SETTLE_S)]
        again = {rest.instrument: rest for rest in bring_to_rest(late)}
        return tuple(again.get(rest.instrument, rest) for rest in first)

    def close(self) -> tuple[Rest, ...]:
        """Bring everything to rest, disconnect, and give the instruments free for others; may be called twice."""
        # First, so that no thread asks or connects anew while all is brought to rest.
        self._closing.set()
        self.reconnect()
        rests = self.bring_to_rest()
        for station in self.stations.values():
            station.thread.join(THREADS_END_S)
        let_go([station.instrument for station in self.stations.values()])
        # Given free last: until here nobody else may connect.
        self._held.close()
        return rests


def open_bench(file: RigFile, post: Callable[[Message], object]) -> LiveBench:
    """Hold a rig and connect to all of it; `ConfigError`, or `RigError` when a campaign holds it.

    Moves nothing, and stops what moves.
    """
    held = ExitStack()
    # Held before anything is made of it: two consoles cannot both get this far.
    held.enter_context(rig_of_ones_own(file))
    try:
        rig = Rig(file)
        rig.wire_logs.prepare("")
        return LiveBench(rig, held, post)
    except BaseException:
        held.close()
        raise


def stop_from_outside(rig_toml: str, store: Path, held: Container[str], post: Callable[[Message], object]) -> None:
    """`rigctl stop` of the rig of a campaign's store, but for addresses `held` here, which the bench stops."""
    file = parse_rig(rig_toml, store)
    # Simulators that live in the campaign's process stop with it: it is asked to abort.
    outside = {name for name, table in file.instruments.items() if not (table.simulated or table.address in held)}
    instruments = {name: each for name, each in Rig(file).instruments.items() if name in outside}
    if instruments:
        post(Stopped(stopped_from_outside(file, instruments, STOP_SIGNAL)))
