"""A run that a fault touches is kept, told of, and measured again; what is lost is waited for."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl.campaign.recording import Header
from rigctl.campaign.session.control import Control
from rigctl.campaign.session.progress import Progress
from rigctl.campaign.session.recovery import ATTEMPTS, GIVE_UP_S, Apparatus
from rigctl.campaign.session.session import Session
from rigctl.campaign.status import status_in
from rigctl.campaign.store.run_writer import RunWriter
from rigctl.campaign.store.store import Store
from rigctl.core.errors import (
    InstrumentError,
    LimitError,
    LinkLost,
    LinkTimeout,
    MotionStopped,
    NotRecovered,
    OutOfStep,
    RigError,
    SafetyStop,
)
from rigctl.report.status_lines import status_lines
from simulators.clock import VirtualClock


@dataclass
class Device:
    """An instrument that notes what is asked of it, and is away until a rig time."""

    name: str
    clock: VirtualClock
    away_until_s: float = 0.0
    out_of_step: list[RigError] = field(default_factory=list)
    did: list[str] = field(default_factory=list)

    safety: list[str] = field(default_factory=list)
    homed: bool = True

    def is_homed(self) -> bool:
        return self.homed

    def home(self) -> None:
        self.did.append("home")
        self.homed = True

    def safety_stop(self) -> str:
        return self.safety.pop() if self.safety else ""

    def open(self) -> None:
        if self.clock.now_s() < self.away_until_s:
            raise LinkLost(f"{self.name}: no connection; check power and cable, then reconnect")
        self.did.append("open")

    def close(self) -> None:
        self.did.append("close")

    def stop(self) -> None:
        self.did.append("stop")

    def confirm_in_step(self) -> None:
        if self.out_of_step:
            raise self.out_of_step.pop()
        self.did.append("confirm")


@dataclass
class Person:
    """Answers as told; without an answer left, no."""

    answers: list[bool] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)
    announced: list[int] = field(default_factory=list)

    def announce_run(self, number: int) -> None:
        self.announced.append(number)

    def accept(self, question: str) -> bool:
        self.asked.append(question)
        return self.answers.pop(0) if self.answers else False


class Scene:
    """A session with one instrument, and a measurement that fails as told, each time after two samples."""

    def __init__(self, store: Store) -> None:
        self.store, self.clock, self.person = store, VirtualClock(), Person()
        self.device = Device("stage", self.clock)
        self.rested = 0
        self.control = Control(self._rest)
        self.progress = Progress(store)
        self.session = Session(store, self.clock, self.person, self.control, self.progress)  # type: ignore[arg-type]
        self.faults: list[RigError] = []

    def _rest(self) -> None:
        self.rested += 1

    @property
    def apparatus(self) -> Apparatus:
        return Apparatus((self.device,), forget=lambda: self.device.did.append("forget"))  # type: ignore[arg-type]

    def measure(self, writer: RunWriter) -> dict[str, Any]:
        writer.append({"t_s": np.arange(2.0)})
        if self.faults:
            raise self.faults.pop(0)
        writer.append({"t_s": np.array([2.0])})
        return {"theta_deg": 0.5}

    def acquire(self, key: str = "a") -> Any:
        return self.session.acquire(key, {"axis": "X"}, self.measure, self.apparatus)

    def events(self, kind: str) -> list[dict[str, Any]]:
        return [event.data for event in self.store.events(kind)]


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[Scene]:
    with Store.create(tmp_path / "x.rig.sqlite", Header("sensing-axis")) as store:
        yield Scene(store)


@pytest.mark.parametrize(
    "fault",
    [
        LinkTimeout("stage: waited 2 s"),
        LinkLost("stage: gone"),
        OutOfStep("stage: out of step"),
        InstrumentError("stage: fewer positions captured", instrument="stage"),
    ],
)
def test_a_run_that_a_fault_touches_is_measured_again_as_the_same_run(scene: Scene, fault: RigError) -> None:
    scene.faults = [fault]
    record = scene.acquire()
    (kept,) = scene.store.runs()
    assert kept == record
    assert scene.store.samples(kept.run_id)["t_s"].tolist() == [0.0, 1.0, 2.0]
    (attempt,) = scene.store.interrupted_runs()
    assert (attempt.key, attempt.valid, attempt.reason) == ("a", False, f"{type(fault).__name__}: {fault}")
    assert scene.store.samples(attempt.run_id)["t_s"].tolist() == [0.0, 1.0], "what there is of it is kept"
    assert scene.person.announced == [1, 1], "the same run of nature"
    (told,) = scene.events("fault")
    assert told == {"during": "a", "instrument": "stage", "error": type(fault).__name__, "text": str(fault)}
    (repeated,) = scene.events("run-repeated")
    assert repeated == {"key": "a", "attempt": 1, "error": type(fault).__name__, "reason": str(fault)}


def test_everything_rests_and_is_in_step_before_anything_is_made_ready_again(scene: Scene) -> None:
    scene.faults = [LinkTimeout("stage: waited")]
    scene.acquire()
    assert scene.rested == 1
    assert scene.device.did == ["close", "open", "stop", "confirm", "forget", "confirm"]


def test_what_has_lost_its_reference_is_homed_once_it_rests(scene: Scene) -> None:
    scene.faults = [LinkLost("stage: power cycle")]
    scene.device.homed = False
    scene.acquire()
    assert scene.device.did == ["close", "open", "stop", "confirm", "forget", "home", "confirm"]


def test_a_doubt_at_the_end_of_a_run_is_a_fault_of_that_run(scene: Scene) -> None:
    scene.device.out_of_step = [OutOfStep("stage: a reply too many")]
    scene.acquire()
    (attempt,) = scene.store.interrupted_runs()
    assert attempt.reason == "OutOfStep: stage: a reply too many"
    assert len(scene.store.runs()) == 1


def test_what_is_done_once_is_done_again_after_a_fault(scene: Scene) -> None:
    scene.faults = [LinkTimeout("meter: waited")]

    def read() -> float:
        if scene.faults:
            raise scene.faults.pop()
        return 0.25

    assert scene.session.once("level", read, scene.apparatus) == 0.25
    assert scene.person.announced == [1, 1]
    assert len(scene.events("step-repeated")) == 1


def test_a_lost_instrument_pauses_the_campaign_until_it_answers(scene: Scene) -> None:
    scene.faults = [LinkLost("stage: gone")]
    scene.device.away_until_s = 1000.0
    states = []
    set_status = scene.store.set_status

    def note(status: dict[str, Any], **options: Any) -> None:
        states.append((status["state"], status["step"]))
        set_status(status, **options)

    scene.store.set_status = note  # type: ignore[method-assign,assignment]
    with scene.session.step("scan"):
        scene.acquire()
    waiting = [step for state, step in states if state == "paused"]
    assert waiting
    assert all("stage: no connection; check power and cable" in step for step in waiting)
    assert states[-1] == ("running", "scan"), "nothing is waited for any more"
    assert 1000.0 <= scene.clock.now_s() < 1600.0, "it looks again every few minutes"
    (back,) = scene.events("instruments-back")
    assert back["during"] == "a"
    assert scene.person.asked == []
    assert len(scene.store.runs()) == 1


def test_an_instrument_that_stays_away_ends_the_campaign_when_nobody_is_there(scene: Scene) -> None:
    scene.faults = [LinkLost("stage: gone")]
    scene.device.away_until_s = math.inf
    with pytest.raises(NotRecovered, match=r"stage: no connection.*`rigctl resume`"):
        scene.acquire()
    assert GIVE_UP_S - 300.0 <= scene.clock.now_s() <= GIVE_UP_S
    assert len(scene.person.asked) == 1


def test_who_is_there_can_have_it_tried_longer(scene: Scene) -> None:
    scene.faults = [LinkLost("stage: gone")]
    scene.device.away_until_s = 1.5 * GIVE_UP_S
    scene.person.answers = [True]
    scene.acquire()
    assert len(scene.person.asked) == 1


@pytest.mark.parametrize("there", [True, False])
def test_a_run_that_keeps_failing_is_not_repeated_for_ever(scene: Scene, there: bool) -> None:
    scene.faults = [InstrumentError("stage: edges missing")] * ATTEMPTS
    scene.person.answers = [there]
    if there:
        scene.acquire()
    else:
        with pytest.raises(NotRecovered, match="edges missing"):
            scene.acquire()
    assert len(scene.person.asked) == 1
    assert f"a failed {ATTEMPTS} times" in scene.person.asked[0]
    assert len(scene.store.interrupted_runs()) == ATTEMPTS


@pytest.mark.parametrize("fault", [SafetyStop("stage: emergency stop"), MotionStopped("stage: by hand")])
def test_nothing_moves_again_after_a_safety_stop_before_a_person_agrees(scene: Scene, fault: RigError) -> None:
    scene.faults = [fault, fault]
    scene.person.answers = [True]
    with pytest.raises(NotRecovered):
        scene.acquire()
    assert scene.device.did.count("open") == 1


def test_a_safety_stop_that_shows_only_afterwards_is_asked_about_before_it_is_homed(scene: Scene) -> None:
    scene.faults = [LinkTimeout("stage: waited")]
    scene.device.safety, scene.device.homed = ["emergency stop"], False
    with pytest.raises(NotRecovered, match="emergency stop"):
        scene.acquire()
    assert "May the instruments be moved again?" in scene.person.asked[0]
    assert "home" not in scene.device.did


def test_who_is_there_lets_it_be_homed_after_an_emergency_stop(scene: Scene) -> None:
    scene.faults = [LinkTimeout("stage: waited")]
    scene.device.safety, scene.device.homed = ["emergency stop"] * 9, False
    scene.person.answers = [True]
    scene.acquire()
    assert scene.device.did.count("home") == 1


def test_what_is_no_fault_ends_the_campaign_as_before(scene: Scene) -> None:
    scene.faults = [LimitError("stage: 80 mm is outside the travel")]
    with pytest.raises(LimitError):
        scene.acquire()
    assert scene.device.did == []


def test_the_echo_of_an_abort_is_no_fault(scene: Scene) -> None:
    def stopped() -> None:
        scene.control.abort("fire")
        raise MotionStopped("stage: stopped")

    with pytest.raises(MotionStopped):
        scene.session.guarded("move", scene.apparatus, stopped)
    assert scene.device.did == scene.person.asked == scene.events("fault") == []


def test_the_status_says_how_many_runs_were_repeated_and_why(scene: Scene) -> None:
    scene.faults = [LinkTimeout("stage: waited"), LinkTimeout("stage: waited"), InstrumentError("laser: few")]
    scene.acquire()
    status = status_in(scene.store)
    assert status["runs_repeated"] == {"LinkTimeout": 2, "InstrumentError": 1}
    assert status["last_repeat"]["reason"] == "laser: few"
    assert f"last repeated: {status['last_repeat']['key']}, because of: laser: few" in status_lines(status)


@pytest.mark.parametrize(("safety", "error"), [([], "InstrumentError"), (["emergency stop"] * 2, "SafetyStop")])
def test_a_run_whose_stage_lost_its_reference_is_not_valid(scene: Scene, safety: list[str], error: str) -> None:
    def measure(writer: RunWriter) -> dict[str, Any]:
        writer.append({"t_s": np.arange(2.0)})
        scene.device.homed = "home" in scene.device.did
        scene.device.safety = [] if scene.device.homed else safety
        return {"theta_deg": 0.0}

    scene.person.answers = [True]
    record = scene.session.acquire("a", {}, measure, scene.apparatus)
    assert record.valid
    (attempt,) = scene.store.interrupted_runs()
    assert attempt.reason.startswith(f"{error}: stage: ")
    assert scene.device.did.count("home") == 1
