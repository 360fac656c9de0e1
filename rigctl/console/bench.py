"""The rig open in this process: every instrument is asked, moved and stopped on threads of its own.

So one that hangs keeps nobody waiting: not the screen, not the others, and not the STOP.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigctl.console.messages import Noted, Stopped

if TYPE_CHECKING:
    from textual.message import Message

    from rigctl.core.interfaces import Instrument, Reading
    from rigctl.core.making_safe import Rest
    from rigctl.files.rig_file import RigFile
    from rigctl.rig import Rig

POLL_S = 0.1
AGAIN_S = 2.0
STRIP_LENGTH = 600
SETTLE_S = 0.2
"""A motion ends that soon after its instrument has stopped; one that does not was begun behind the stop."""
THREADS_END_S = 3.0


@dataclass(frozen=True)
class Value:
    """A reading as shown: `taken_s` on this computer's monotonic clock."""

    label: str
    value: float
    unit: str
    taken_s: float


@dataclass(frozen=True)
class Limits:
    """Where a stage may go."""

    low: float
    high: float
    unit: str
    speed: float

    def refusal(self, value: float) -> str:
        """Why a stage is not sent to `value`; empty when it may go there."""
        if self.low <= value <= self.high:
            return ""
        return f"{value:g} {self.unit} is outside {self.low:g} .. {self.high:g} {self.unit}"

    def __str__(self) -> str:
        return f"{self.low:g} .. {self.high:g} {self.unit}, up to {self.speed:g} {self.unit}/s"


@dataclass(frozen=True)
class InstrumentView:
    """An instrument at one moment; `state` is connecting, ready, moving, homing, stopped, silent or lost."""

    name: str
    role: str
    driver: str
    address: str
    state: str
    identity: str
    values: tuple[Value, ...]
    error: str
    limits: Limits | None = None


@dataclass(frozen=True)
class Strip:
    """The last values of one quantity; times are seconds before now, so at most 0."""

    name: str
    unit: str
    ago_s: Any
    values: Any


@dataclass
class _Station:
    """What the threads know of one instrument."""

    name: str
    role: str
    driver: str
    address: str
    instrument: Instrument
    state: str = "connecting"
    identity: str = ""
    error: str = ""
    busy_since_s: float = 0.0
    values: dict[str, Value] = field(default_factory=dict)
    limits: Limits | None = None
    stops: int = 0
    wake: threading.Event = field(default_factory=threading.Event)
    settled: threading.Event = field(default_factory=threading.Event)

    def __post_init__(self) -> None:
        self.settled.set()

    def raise_if_stopped(self, stops: int) -> None:
        """`MotionStopped` when it was stopped since `stops` was read: between two motions no instrument knows."""
        from rigctl.core.errors import MotionStopped

        if self.stops != stops:
            raise MotionStopped(f"{self.name}: stopped before it had set out", instrument=self.name)


class LiveBench:
    """A rig held by this console; made by `open_bench`, given back by `close`."""

    def __init__(self, file: RigFile, rig: Rig, held: ExitStack, post: Callable[[Message], object]) -> None:
        self.file = file
        self._rig = rig
        self._held = held
        self._post = post
        self._closing = threading.Event()
        self._strips: dict[str, deque[Value]] = {}
        self._stations = {
            name: _Station(name, table.role, table.driver, table.address, rig.instruments[name])
            for name, table in file.instruments.items()
        }
        self._threads = [
            threading.Thread(target=self._attend, args=(station,), name=f"poll {name}", daemon=True)
            for name, station in self._stations.items()
        ]
        for station in self._stations.values():
            station.limits = _limits(station.instrument)
        for thread in self._threads:
            thread.start()

    @property
    def stages(self) -> list[str]:
        """Names of what can be moved."""
        return [name for name, station in self._stations.items() if station.limits is not None]

    def views(self) -> tuple[InstrumentView, ...]:
        """All instruments now; asks none of them."""
        now_s = time.monotonic()
        return tuple(
            InstrumentView(
                s.name,
                s.role,
                s.driver,
                s.address,
                "silent" if s.state == "ready" and now_s - s.busy_since_s > AGAIN_S else s.state,
                s.identity,
                tuple(s.values.values()),
                s.error,
                s.limits,
            )
            for s in self._stations.values()
        )

    def strips(self) -> dict[str, Strip]:
        """What the strip charts show, by quantity."""
        import numpy as np

        now_s = time.monotonic()
        found = {}
        for name, values in list(self._strips.items()):
            kept = list(values)
            found[name] = Strip(
                name,
                kept[-1].unit,
                np.array([each.taken_s - now_s for each in kept]),
                np.array([each.value for each in kept]),
            )
        return found

    def move(self, name: str, value: float) -> None:
        """`rigctl move`: home the stage if needed and move it, on a thread of its own."""
        station = self._stations[name]
        stage: Any = station.instrument
        stops = station.stops

        def act() -> None:
            stage.home()
            station.raise_if_stopped(stops)
            stage.move_to(value)

        self._set_out(name, "moving", act)

    def jog(self, name: str, step: float) -> None:
        """Move the stage by a step from where it says it is now: what is on the screen may be a moment old."""
        from rigctl.core.errors import LimitError

        station = self._stations[name]
        stage: Any = station.instrument
        stops = station.stops

        def act() -> None:
            stage.home()
            (_, at), *_ = _readings(stage)
            if station.limits is not None and (refusal := station.limits.refusal(at.value + step)):
                raise LimitError(f"{name}: {refusal}")
            station.raise_if_stopped(stops)
            stage.move_to(at.value + step)

        self._set_out(name, "moving", act)

    def home(self, name: str) -> None:
        """`rigctl home`, on a thread of its own."""
        stage: Any = self._stations[name].instrument
        self._set_out(name, "homing", stage.home)

    def reconnect(self) -> None:
        """Try again now what does not answer."""
        for station in self._stations.values():
            station.wake.set()

    def stop(self) -> None:
        """Bring every instrument to rest, all at once; returns at once, what came of it is posted."""
        threading.Thread(target=self._stop, name="stop", daemon=True).start()

    def bring_to_rest(self) -> tuple[Rest, ...]:
        """Stop every instrument, and once more where a motion was begun behind the stop."""
        from rigctl.core.making_safe import bring_to_rest

        stations = list(self._stations.values())
        for station in stations:
            station.stops += 1
        first = bring_to_rest(station.instrument for station in stations)
        late = [station.instrument for station in stations if not station.settled.wait(SETTLE_S)]
        again = {rest.instrument: rest for rest in bring_to_rest(late)}
        return tuple(again.get(rest.instrument, rest) for rest in first)

    def close(self) -> tuple[Rest, ...]:
        """Bring everything to rest, disconnect, and give the instruments free for others; may be called twice."""
        from rigctl.core.making_safe import let_go

        self._closing.set()
        self.reconnect()
        rests = self.bring_to_rest()
        for thread in self._threads:
            thread.join(THREADS_END_S)
        let_go([s.instrument for s in self._stations.values()])
        self._held.close()
        return rests

    def _stop(self) -> None:
        self._post(Stopped(self.bring_to_rest()))

    def _set_out(self, name: str, state: str, act: Callable[[], None]) -> None:
        from rigctl.core.errors import LimitError, RigError

        station = self._stations[name]
        if station.state in {"moving", "homing"}:
            self._post(Noted(f"{name}: still {station.state}; stop it first", "warning"))
            return
        if station.state not in {"ready", "stopped"}:
            self._post(Noted(f"{name}: {station.state}; it cannot be moved now", "warning"))
            return
        before, station.state = station.state, state
        station.settled.clear()

        def carry_out() -> None:
            try:
                act()
            except LimitError as error:
                station.state = before
                self._post(Noted(str(error), "warning"))
            except RigError as error:
                station.state, station.error = "stopped", str(error)
                self._post(Noted(str(error), "warning"))
            else:
                station.state, station.error = "ready", ""
            finally:
                station.settled.set()

        threading.Thread(target=carry_out, name=f"{state} {name}", daemon=True).start()

    def _attend(self, station: _Station) -> None:
        from rigctl.core.errors import RigError

        while not self._closing.is_set():
            station.busy_since_s = time.monotonic()
            try:
                if station.state in {"connecting", "lost"}:
                    self._connect(station)
                for reading in _readings(station.instrument):
                    self._keep(station, *reading)
                if station.state not in {"moving", "homing", "stopped"}:
                    station.error = ""
            except RigError as error:
                self._lose(station, str(error))
            except Exception as error:  # noqa: BLE001 - a thread that ends in silence shows an old value for ever
                self._lose(station, f"{station.name}: internal error: {type(error).__name__}: {error}")
            station.busy_since_s = time.monotonic()
            station.wake.wait(AGAIN_S if station.state == "lost" else POLL_S)
            station.wake.clear()

    def _connect(self, station: _Station) -> None:
        station.state = "connecting"
        station.instrument.open()
        self._bring_to_rest_first(station)
        identity = station.instrument.identify()
        station.identity = " ".join(part for part in (identity.model, identity.serial, identity.firmware) if part)
        station.state, station.error = "ready", ""

    def _bring_to_rest_first(self, station: _Station) -> None:
        """Whatever had it move, a crash or a lost connection among them: it moves when somebody here says so."""
        from rigctl.core.interfaces import Stage

        moved = isinstance(station.instrument, Stage) and station.instrument.is_moving()
        station.instrument.stop()
        if moved:
            self._post(Noted(f"{station.name}: moved already, was stopped", "warning"))

    def _lose(self, station: _Station, why: str) -> None:
        if self._closing.is_set():
            return
        if station.error != why:
            self._post(Noted(why, "error"))
        station.error = why
        if station.state not in {"moving", "homing"}:
            station.state = "lost"
            _quietly(station.instrument.close)

    def _keep(self, station: _Station, label: str, reading: Reading) -> None:
        value = Value(label, reading.value, reading.unit, time.monotonic())
        station.values[label] = value
        self._strips.setdefault(label, deque(maxlen=STRIP_LENGTH)).append(value)


def open_bench(path: Path, post: Callable[[Message], object]) -> LiveBench:
    """Hold a rig and connect to all of it; `ConfigError`, or `RigError` when a campaign holds it.

    Moves nothing, and stops what moves.
    """
    from rigctl.charge import rig_of_ones_own
    from rigctl.files.rig_file import read_rig
    from rigctl.rig import Rig

    file = read_rig(path)
    held = ExitStack()
    held.enter_context(rig_of_ones_own(file))
    try:
        return LiveBench(file, Rig(file), held, post)
    except BaseException:
        held.close()
        raise


def stop_from_outside(rig_toml: str, store: Path, post: Callable[[Message], object]) -> None:
    """`rigctl stop` of the rig of a campaign's store: second connections, every instrument on its own thread."""
    from rigctl.core.making_safe import bring_to_rest, let_go
    from rigctl.files.rig_file import parse_rig
    from rigctl.rig import Rig

    file = parse_rig(rig_toml, store)
    if all(table.simulated for table in file.instruments.values()):
        return  # they live in the campaign's process, which is asked to abort
    instruments = Rig(file).instruments.values()
    post(Stopped(bring_to_rest(instruments)))
    let_go(instruments)


def _limits(instrument: Instrument) -> Limits | None:
    from rigctl.core.interfaces import LinearStage, RotationStage

    if isinstance(instrument, RotationStage):
        turn = instrument.limits
        return Limits(turn.angle_min_deg, turn.angle_max_deg, "deg", turn.speed_deg_s)
    if isinstance(instrument, LinearStage):
        travel = instrument.limits
        return Limits(travel.position_min_mm, travel.position_max_mm, "mm", travel.speed_mm_s)
    return None


def _readings(instrument: Instrument) -> Iterator[tuple[str, Reading]]:
    from rigctl.core.interfaces import DisplacementMeter, LinearStage, RotationStage, Thermometer, Voltmeter

    if isinstance(instrument, RotationStage):
        yield "angle", instrument.angle()
    elif isinstance(instrument, LinearStage):
        yield "position", instrument.position()
    elif isinstance(instrument, DisplacementMeter):
        names = [channel.name for channel in instrument.channels()]
        yield from zip(names, instrument.displacements(), strict=True)
    elif isinstance(instrument, Thermometer):
        yield "temperature", instrument.temperature()
    elif isinstance(instrument, Voltmeter):
        yield "voltage", instrument.voltage()


def _quietly(action: Callable[[], None]) -> None:
    try:
        action()
    except Exception:  # noqa: BLE001 - tried on the way out; whoever is told of failures has been told
        return
