"""What a procedure runs in: steps that are durable, are replayed after a restart, and can be interrupted.

A procedure is straight-line code. Everything it does to the world goes through `acquire` and `once`, each under a
key of the procedure's own. A key that the store already holds is not done again: its record is returned. So a resumed
campaign runs the same code from the start, and reaches the point of interruption without moving anything.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

from rigctl.campaign.recording import RunRecord
from rigctl.campaign.session.control import Control
from rigctl.campaign.session.operator import Operator
from rigctl.campaign.session.progress import Progress
from rigctl.campaign.session.recovery import Apparatus, Faults, Recovery
from rigctl.campaign.session.rig_time import Resumption
from rigctl.campaign.store.entries import RUN_REPEATED, STEP_REPEATED, Event
from rigctl.campaign.store.run_writer import RunWriter
from rigctl.campaign.store.store import Store
from rigctl.core.clock import Clock
from rigctl.core.errors import DataError

T = TypeVar("T")
Measure = Callable[[RunWriter], Mapping[str, Any]]


SERIALS = 1_000_000
"""Serial numbers set aside for each campaign of a store: what a world draws by them is drawn once."""


class Session:
    """One campaign in progress: the first of its store, or `part` 2, 3, ... that was run into it later.

    Keys of later parts are kept apart from earlier ones; a mounting they share is the same one, its noise is not.
    """

    def __init__(
        self, store: Store, clock: Clock, operator: Operator, control: Control, progress: Progress, part: int = 1
    ) -> None:
        self.store = store
        self.clock = clock
        self.operator = operator
        self._control = control
        self._progress = progress
        self._recovery = Recovery(self, control, progress)
        self._answers = {event.data["key"]: event.data["result"] for event in store.events("once")}
        self._resumption = Resumption(store, clock)
        self._steps: list[str] = []
        self._serial = (part - 1) * SERIALS
        self._prefix = f"part {part}: " if part > 1 else ""

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """A named part of the procedure; steps nest."""
        self._steps.append(name)
        self._progress.at(" / ".join(self._steps))
        try:
            yield
        finally:
            self._steps.pop()

    def tell(self, what: str = "") -> None:
        """How far a long step is, for whoever watches; nothing is told of it any more when left out."""
        self._progress.told(" / ".join([*self._steps, *([what] if what else [])]))

    def plan(self, runs: int, takes: Sequence[float] = (), mountings: int = 0) -> None:
        """Tell how many runs and mountings the procedure expects in all, for the progress and its ETA.

        `takes` is what each run takes, where they differ.
        """
        self._progress.plan(runs, takes, mountings)

    def mounted(self, *, replayed: bool) -> None:
        """Tell that something was mounted, now or, `replayed`, before a restart, for the progress and its ETA."""
        self._progress.mounted(replayed=replayed)

    def counted(self, runs: int, *, replayed: bool = False) -> None:
        """So many runs more are over whose samples nobody keeps, for the progress and its ETA."""
        if replayed:
            self._progress.replayed(valid=True, runs=runs)
        else:
            self._progress.ran(valid=True, runs=runs)

    def acquire(
        self, key: str, conditions: Mapping[str, Any], measure: Measure, apparatus: Apparatus | None = None
    ) -> RunRecord:
        """One run: measured and durable when this returns, or as recorded when the store already has `key`.

        `measure` appends samples to the writer and returns the conditions known only afterwards, with
        `valid` and `reason` among them when the run is not to be used. Where a fault of the `apparatus` touches it,
        what there is stays as an attempt with its reason, and the run is measured again under the same key and
        nature's same number. `DataError` when the store holds the key with other set-points: the campaign file and
        the record do not belong together. `NotRecovered` when faults do not end.
        """
        # Counted for recorded steps too: a resumed campaign gives every later run the same number, hence the same
        # noise.
        number, key = self._next(), self._prefix + key
        recorded = self.store.run_by_key(key)
        if recorded is not None:
            self._must_match(key, recorded, conditions)
            self._resumption.replayed(key)
            self._progress.replayed(valid=recorded.valid)
            return recorded

        def measured() -> RunRecord:
            # Pause and abort first: after the run is announced nature has begun it.
            self.checkpoint()
            self.take_up()
            # Before the first motion: a simulated run's nature begins when it is announced.
            self.operator.announce_run(number)
            with self.store.begin_run(key, " / ".join(self._steps), conditions) as writer:
                outcome = dict(measure(writer))
                if apparatus is not None:
                    # Before the run is ended, so that a doubt makes it an attempt and not a finished run.
                    apparatus.confirm()
                valid, reason = bool(outcome.pop("valid", True)), str(outcome.pop("reason", ""))
                # In the commit that ends the run: a resumed campaign needs both or neither.
                return writer.finish(outcome, valid=valid, reason=reason, rig_time_s=self.clock.now_s())

        self._progress.begins()
        record = self._repeated(RUN_REPEATED, key, apparatus, measured)
        self._progress.ran(valid=record.valid)
        return record

    def once(self, key: str, action: Callable[[], Any], apparatus: Apparatus | None = None) -> Any:
        """The JSON-able result of `action`, done once per campaign and durable when this returns.

        What reads instruments names them as its `apparatus`, and is done again after a fault.
        """
        number, key = self._next(), self._prefix + key
        if key in self._answers:
            self._resumption.replayed(key)
            return self._answers[key]

        def done() -> Any:
            self.checkpoint()
            self.take_up()
            # A step that reads instruments draws noise too, under a number of its own.
            self.operator.announce_run(number)
            result = action()
            if apparatus is not None:
                apparatus.confirm()
            return result

        result = self.guarded(key, apparatus, done)
        # Only when done: killed in between it is done again, and never taken for done.
        self.store.add_event("once", {"key": key, "result": result}, self.clock.now_s())
        self._answers[key] = result
        return result

    def guarded(self, what: str, apparatus: Apparatus | None, action: Callable[[], T]) -> T:
        """The result of `action`, which is done again as a whole after a fault of the `apparatus`.

        `NotRecovered` when faults do not end; without an apparatus the fault itself.
        """
        return self._repeated(STEP_REPEATED, what, apparatus, action)

    def _repeated(self, kind: str, what: str, apparatus: Apparatus | None, action: Callable[[], T]) -> T:
        attempt = 0
        while True:
            attempt += 1
            try:
                return action()
            except Faults as fault:
                # Without one nothing says which instruments to bring back.
                if apparatus is None:
                    raise
                self._recovery.after(fault, what, attempt, apparatus)
                self.event(kind, key=what, attempt=attempt, error=type(fault).__name__, reason=str(fault))

    def key(self, key: str) -> str:
        """The name in the store of a key of this campaign."""
        return self._prefix + key

    def done(self, key: str) -> bool:
        """True when `once(key)` has been done, now or before a restart."""
        return self._prefix + key in self._answers

    def recorded(self, key: str) -> bool:
        """True when the store holds the run `key`."""
        return self.store.run_by_key(self._prefix + key) is not None

    def of_recorded_runs(self, kind: str) -> list[Event]:
        """Events of a kind that name a run of this campaign by its `key`, where that run is recorded."""
        runs = {run.key for run in self.store.runs()}
        return [
            event
            for event in self.store.events(kind)
            if event.data["key"] in runs and event.data["key"].startswith(self._prefix)
        ]

    def event(self, kind: str, **data: Any) -> None:
        """Note something that happened."""
        self.store.add_event(kind, data, self.clock.now_s())

    def wait_s(self, duration_s: float) -> None:
        """Let rig time pass; `Aborted` promptly when the operator asks."""
        end_s = self.clock.now_s() + duration_s
        # A tenth of a second of wall-clock between two looks for an abort; a virtual clock jumps at once.
        slice_s = max(0.1 * self.clock.speed, 0.1)
        # What rounding of the clock may leave.
        while (left_s := end_s - self.clock.now_s()) > 1e-9:
            self._control.raise_if_aborted()
            self.clock.sleep_s(min(left_s, slice_s))

    def checkpoint(self) -> None:
        """Between two actions: stay here while paused, leave with `Aborted` when asked to."""
        self._control.raise_if_aborted()
        if self._control.paused:
            self._progress.state("paused")
            # Bringing to rest in a pause may meet a fault; no run is being measured, so none is given up.
            self._recovery.borne("pause", self._control.rest)
            self._control.while_paused(lambda: time.sleep(0.05))
            self._progress.state("running")

    def when_taken_up(self, restore: Callable[[], None]) -> None:
        """Have `restore` called after a restart on a virtual clock, before the first step that is not recorded."""
        self._resumption.restore = restore

    def take_up(self) -> None:
        """Before the first thing done anew after a restart on a virtual clock: all as it was left, and when it was.

        `acquire` and `once` do it by themselves; what an operator does between them comes after it.
        """
        self._resumption.take_up()

    def _next(self) -> int:
        self._serial += 1
        return self._serial

    @staticmethod
    def _must_match(key: str, recorded: RunRecord, conditions: Mapping[str, Any]) -> None:
        for name, value in conditions.items():
            held = recorded.conditions.get(name)
            near = isinstance(held, int | float) and isinstance(value, int | float) and abs(held - value) < 1e-9
            if held != value and not near:
                raise DataError(
                    f"run '{key}' is recorded with {name} = {held}, the procedure now asks for {value}: "
                    "the store belongs to another campaign file or version; start a new store"
                )
