"""One instrument of the rig that is held: asked again and again on a thread of its own, moved on another."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import numpy as np
from textual.message import Message

from rigctl.console.messages import Noted
from rigctl.console.readings import InstrumentView, Limits, Strip, Value
from rigctl.core.errors import LimitError, MotionStopped, RigError
from rigctl.core.interfaces import (
    DisplacementMeter,
    Instrument,
    LinearStage,
    Reading,
    RotationStage,
    Stage,
    Thermometer,
    Voltmeter,
)
from rigctl.files.rig_file import InstrumentTable

POLL_S = 0.1
AGAIN_S = 2.0
STRIP_LENGTH = 600
MOTIONS = {"moving", "homing"}


class Station:
    """What is known of one instrument; it ends when `closing` is set."""

    def __init__(
        self,
        name: str,
        table: InstrumentTable,
        instrument: Instrument,
        closing: threading.Event,
        post: Callable[[Message], object],
    ) -> None:
        self.name = name
        self.instrument = instrument
        self.limits = _limits_of(instrument)
        self.settled = threading.Event()
        """Set while no motion of ours is under way."""
        self.settled.set()
        self.stops = 0
        self._table = table
        self._closing = closing
        self._post = post
        self.state = "connecting"
        self._identity = ""
        self._error = ""
        self._busy_since_s = 0.0
        self._values: dict[str, deque[Value]] = {}
        self._wake = threading.Event()
        self.thread = threading.Thread(target=self._attend, name=f"poll {name}", daemon=True)

    def view(self) -> InstrumentView:
        """The instrument now, without asking it."""
        silent = self.state == "ready" and time.monotonic() - self._busy_since_s > AGAIN_S
        return InstrumentView(
            self.name,
            self._table.role,
            self._table.driver,
            self._table.address,
            "silent" if silent else self.state,
            self._identity,
            tuple(values[-1] for values in list(self._values.values())),
            self._error,
            self.limits,
        )

    def strips(self) -> dict[str, Strip]:
        """The last values of its quantities, by name."""
        now_s = time.monotonic()
        strips = {}
        for name, values in list(self._values.items()):
            kept = list(values)
            ago_s = np.array([each.taken_s - now_s for each in kept])
            strips[name] = Strip(name, ago_s, np.array([each.value for each in kept]))
        return strips

    def wake(self) -> None:
        """Ask it now, also when it was lost."""
        self._wake.set()

    # Motions

    def move(self, value: float) -> None:
        """Home the stage if needed and move it."""
        stage: Any = self.instrument
        # Homing does only what is still to be done.
        self._set_out("moving", stage.home, lambda: stage.move_to(value))

    def jog(self, step: float) -> None:
        """Move the stage by a step from where it says it is now: what is on the screen may be a moment old."""
        stage: Any = self.instrument
        # Read when the key is pressed: homing may come first, and a stop in it ends the jog as well.
        stops = self.stops

        def go() -> None:
            (_, at), *_ = _readings_of(stage)
            if self.limits is not None and (refusal := self.limits.refusal(at.value + step)):
                raise LimitError(f"{self.name}: {refusal}")
            self._raise_if_stopped(stops)
            stage.move_to(at.value + step)

        self._set_out("moving", stage.home, go)

    def home(self) -> None:
        """Home the stage."""
        stage: Any = self.instrument
        self._set_out("homing", stage.home)

    def _set_out(self, state: str, *steps: Callable[[], None]) -> None:
        """Carry out a motion on a thread of its own, unless it is stopped between two of its steps."""
        if self.state in MOTIONS:
            self._post(Noted(f"{self.name}: still {self.state}; stop it first", "warning"))
            return
        if self.state not in {"ready", "stopped"}:
            self._post(Noted(f"{self.name}: {self.state}; it cannot be moved now", "warning"))
            return
        stops = self.stops
        # A motion refused by the limits leaves the instrument as it was.
        before, self.state = self.state, state
        self.settled.clear()

        def carry_out() -> None:
            try:
                for step in steps:
                    self._raise_if_stopped(stops)
                    step()
            except LimitError as error:
                self.state = before
                self._post(Noted(str(error), "warning"))
            except RigError as error:
                self.state, self._error = "stopped", str(error)
                self._post(Noted(str(error), "warning"))
            else:
                self.state, self._error = "ready", ""
            finally:
                self.settled.set()

        threading.Thread(target=carry_out, name=f"{state} {self.name}", daemon=True).start()

    def _raise_if_stopped(self, stops: int) -> None:
        """`MotionStopped` when it was stopped since `stops` was read: between two motions no instrument knows."""
        if self.stops != stops:
            raise MotionStopped(f"{self.name}: stopped before it had set out", instrument=self.name)

    # The thread that asks

    def _attend(self) -> None:
        while not self._closing.is_set():
            self._busy_since_s = time.monotonic()
            try:
                if self.state in {"connecting", "lost"}:
                    self._connect()
                for label, reading in _readings_of(self.instrument):
                    value = Value(label, reading.value, reading.unit, time.monotonic())
                    self._values.setdefault(label, deque(maxlen=STRIP_LENGTH)).append(value)
                # Why it stopped stays to be read, until it is moved again.
                if self.state not in {*MOTIONS, "stopped"}:
                    self._error = ""
            except RigError as error:
                self._lose(str(error))
            except Exception as error:  # noqa: BLE001 - a thread that ends in silence shows an old value for ever
                self._lose(f"{self.name}: internal error: {type(error).__name__}: {error}")
            self._busy_since_s = time.monotonic()
            self._wake.wait(AGAIN_S if self.state == "lost" else POLL_S)
            self._wake.clear()

    def _connect(self) -> None:
        self.state = "connecting"
        self.instrument.open()
        # Before it is asked who it is: nothing moves here that nobody has asked to.
        self._bring_to_rest_first()
        identity = self.instrument.identify()
        self._identity = " ".join(part for part in (identity.model, identity.serial, identity.firmware) if part)
        self.state, self._error = "ready", ""

    def _bring_to_rest_first(self) -> None:
        """Whatever had it move, a crash or a lost connection among them: it moves when somebody here says so."""
        moved = isinstance(self.instrument, Stage) and self.instrument.is_moving()
        self.instrument.stop()
        if moved:
            self._post(Noted(f"{self.name}: moved already, was stopped", "warning"))

    def _lose(self, why: str) -> None:
        if self._closing.is_set():
            return
        if self._error != why:
            self._post(Noted(why, "error"))
        self._error = why
        # The thread that moves it tells its end; here it is only asked.
        if self.state not in MOTIONS:
            self.state = "lost"
            with suppress(Exception):  # it is lost already, and who is told of failures has been told
                self.instrument.close()


def _limits_of(instrument: Instrument) -> Limits | None:
    """Of a stage; None for what cannot be moved."""
    if isinstance(instrument, RotationStage):
        turn = instrument.limits
        return Limits(turn.angle_min_deg, turn.angle_max_deg, "deg", turn.speed_deg_s)
    if isinstance(instrument, LinearStage):
        travel = instrument.limits
        return Limits(travel.position_min_mm, travel.position_max_mm, "mm", travel.speed_mm_s)
    return None


def _readings_of(instrument: Instrument) -> Iterator[tuple[str, Reading]]:
    """What an instrument reads now, by label."""
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
