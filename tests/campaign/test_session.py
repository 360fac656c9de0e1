"""A session replays what is recorded, measures the rest, and can be interrupted between and within steps."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl.campaign.recording import Header, RunRecord
from rigctl.campaign.session.control import Control
from rigctl.campaign.session.progress import Progress
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.run_writer import RunWriter
from rigctl.campaign.store.store import Store
from rigctl.core.errors import Aborted, DataError, LinkLost


@dataclass
class Clock:
    """Time passes when somebody sleeps."""

    speed: float = math.inf
    now: float = 100.0
    at_sleep: Callable[[float], None] = lambda _: None

    def now_s(self) -> float:
        return self.now

    def sleep_s(self, duration_s: float) -> None:
        self.now += duration_s
        self.at_sleep(duration_s)


@dataclass
class Person:
    """An operator who notes what is announced."""

    name: str = "person"
    announced: list[int] = field(default_factory=list)

    def announce_run(self, number: int) -> None:
        self.announced.append(number)


@dataclass
class Scene:
    """One campaign file, and as many sessions on it as a test wants."""

    store: Store
    clock: Clock = field(default_factory=Clock)
    paused_at: list[str] = field(default_factory=list)
    made_safe: int = 0

    def session(self, display: Any = None) -> Session:
        self.person = Person()
        self.control = Control(self._make_safe, lambda: self.paused_at.append("rest"))
        return Session(self.store, self.clock, self.person, self.control, Progress(self.store, display))  # type: ignore[arg-type]

    def _make_safe(self) -> None:
        self.made_safe += 1


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[Scene]:
    with Store.create(tmp_path / "x.rig.sqlite", Header("sensing-axis")) as store:
        yield Scene(store)


def three_samples(writer: RunWriter) -> dict[str, Any]:
    writer.append({"t_s": np.arange(3.0)})
    return {"theta_deg": 0.5}


def never(_: Any = None) -> Any:
    raise AssertionError("what is recorded is not done again")


def test_a_run_is_durable_with_its_conditions_and_step_when_acquire_returns(scene: Scene) -> None:
    session = scene.session()
    with session.step("axis X"), session.step("mounting 1"):
        record = session.acquire("X 1 run 1", {"axis": "X", "theta_asked_deg": 0.4}, three_samples)
    with Store.open(scene.store.path, readonly=True) as other:
        (kept,) = other.runs()
        assert other.samples(kept.run_id)["t_s"].tolist() == [0.0, 1.0, 2.0]
    assert kept == record
    assert kept.step == "axis X / mounting 1"
    assert kept.conditions == {"axis": "X", "theta_asked_deg": 0.4, "theta_deg": 0.5}
    assert kept.valid


def test_a_run_may_declare_itself_invalid(scene: Scene) -> None:
    record = scene.session().acquire(
        "a", {}, lambda writer: {**three_samples(writer), "valid": False, "reason": "saturated"}
    )
    assert (record.valid, record.reason) == (False, "saturated")
    assert "valid" not in record.conditions
    assert "reason" not in record.conditions


def test_a_recorded_run_is_returned_without_measuring(scene: Scene) -> None:
    first = scene.session().acquire("a", {"theta_asked_deg": 0.1 + 0.2, "axis": "X"}, three_samples)
    resumed = scene.session()
    again = resumed.acquire("a", {"theta_asked_deg": 0.3, "axis": "X"}, never)
    assert again == first
    assert scene.person.announced == []
    assert len(scene.store.runs()) == 1


@pytest.mark.parametrize(
    "asked", [{"theta_asked_deg": 0.4}, {"axis": "Y"}, {"theta_asked_deg": "0.3"}, {"laser": 1}, {"mounting": True}]
)
def test_a_record_with_other_set_points_is_another_campaigns(scene: Scene, asked: dict[str, Any]) -> None:
    scene.session().acquire("a", {"theta_asked_deg": 0.3, "axis": "X", "mounting": "first"}, three_samples)
    with pytest.raises(DataError, match=r"run 'a' is recorded with .*another campaign file or version; start a new"):
        scene.session().acquire("a", asked, never)


def test_a_run_that_was_cut_off_is_measured_again(scene: Scene) -> None:
    def cut_off(writer: RunWriter) -> dict[str, Any]:
        writer.append({"t_s": np.arange(2.0)})
        raise ValueError("power cut")

    with pytest.raises(ValueError, match="power cut"):
        scene.session().acquire("a", {}, cut_off)
    assert scene.store.runs() == []
    record = scene.session().acquire("a", {}, three_samples)
    assert scene.store.runs() == [record]
    assert [run.reason for run in scene.store.interrupted_runs()] == ["ValueError: power cut"]


def test_once_is_done_once_per_campaign(scene: Scene) -> None:
    session = scene.session()
    done = []
    assert session.once("level", lambda: done.append(1) or {"reading_v": 0.25}) == {"reading_v": 0.25}
    assert session.once("level", never) == {"reading_v": 0.25}
    assert session.once("nothing", lambda: None) is None
    assert session.done("level")
    resumed = scene.session()
    assert resumed.once("level", never) == {"reading_v": 0.25}
    assert resumed.once("nothing", never) is None
    assert not resumed.done("other")
    assert done == [1]
    assert scene.store.events("once")[0].rig_time_s == 100.0


def test_what_once_failed_to_do_is_not_kept(scene: Scene) -> None:
    with pytest.raises(ZeroDivisionError):
        scene.session().once("a", lambda: 1 / 0)
    assert not scene.session().done("a")


def procedure(session: Session, stop_at: int = 10**6) -> list[RunRecord]:
    """Six actions, each of which may be where the power goes."""
    records = []
    for number in range(1, 4):
        if 2 * number - 1 == stop_at:
            raise ValueError("power cut")
        session.once(f"mount {number}", lambda: True)
        if 2 * number == stop_at:
            raise ValueError("power cut")
        records.append(session.acquire(f"run {number}", {"number": number}, three_samples))
    return records


@pytest.mark.parametrize("stop_at", range(1, 7))
def test_an_action_has_the_same_number_before_and_after_a_restart(scene: Scene, stop_at: int) -> None:
    first = scene.session()
    with pytest.raises(ValueError, match="power cut"):
        procedure(first, stop_at)
    before = scene.person.announced
    procedure(scene.session())
    assert before + scene.person.announced == [1, 2, 3, 4, 5, 6]
    assert [run.key for run in scene.store.runs()] == ["run 1", "run 2", "run 3"]


def test_waiting_lasts_as_long_as_asked_on_any_clock(scene: Scene) -> None:
    for speed in (math.inf, 1.0, 200.0):
        scene.clock.speed = speed
        start_s = scene.clock.now
        scene.session().wait_s(12.5)
        assert scene.clock.now - start_s == pytest.approx(12.5, abs=1e-6)


def test_an_abort_ends_a_wait_within_a_tenth_of_a_second_of_wall_time(scene: Scene) -> None:
    session = scene.session()
    scene.clock.speed = 50.0
    scene.clock.at_sleep = lambda _: scene.control.abort("fire") if scene.clock.now > 130.0 else None
    with pytest.raises(Aborted, match="fire"):
        session.wait_s(3600.0)
    assert 130.0 < scene.clock.now <= 135.0 + 1e-6
    assert scene.made_safe == 1


def test_nothing_is_begun_after_an_abort(scene: Scene) -> None:
    session = scene.session()
    scene.control.abort("fire")
    for begin in (lambda: session.acquire("a", {}, never), lambda: session.once("b", never), session.checkpoint):
        with pytest.raises(Aborted, match="fire"):
            begin()
    assert scene.store.runs() == scene.store.interrupted_runs() == []


class Screen:
    """Shows progress; at `paused` it lets the campaign go on."""

    def __init__(self, at_pause: Callable[[], None]) -> None:
        self.states: list[object] = []
        self._at_pause = at_pause

    def show(self, status: dict[str, object]) -> None:
        self.states.append(status["state"])
        if status["state"] == "paused":
            self._at_pause()


def test_a_pause_brings_the_rig_to_rest_before_the_next_action_and_says_so(scene: Scene) -> None:
    def go_on() -> None:
        told.append(scene.store.status()["state"])
        scene.control.go_on()

    told: list[object] = []
    screen = Screen(go_on)
    session = scene.session(screen)
    session.acquire("a", {}, three_samples)
    scene.control.pause()
    session.acquire("b", {}, three_samples)
    assert told == ["paused"]
    assert scene.paused_at == ["rest"]
    assert screen.states[-1] in {"running", "paused"}
    assert "running" in screen.states[screen.states.index("paused") :]
    assert [run.key for run in scene.store.runs()] == ["a", "b"]


def test_a_fault_while_a_pause_brings_the_rig_to_rest_is_told_and_ends_nothing(scene: Scene) -> None:
    def lost() -> None:
        error = LinkLost("tcp://192.168.0.10:8000: no reply")
        error.instrument = "stage"
        raise error

    session = scene.session(Screen(lambda: scene.control.go_on()))
    session._control._at_pause = lost
    scene.control.pause()
    session.acquire("a", {}, three_samples)
    (fault,) = (event.data for event in scene.store.events("fault"))
    assert (fault["during"], fault["instrument"]) == ("pause", "stage")
    assert scene.made_safe == 1, "whatever can be reached is brought to rest another way"
    assert [run.key for run in scene.store.runs()] == ["a"]


def test_an_abort_ends_a_pause(scene: Scene) -> None:
    session = scene.session(Screen(lambda: scene.control.abort("fire")))
    scene.control.pause()
    with pytest.raises(Aborted, match="fire"):
        session.acquire("a", {}, never)


def test_progress_counts_what_is_measured_and_what_is_replayed(scene: Scene) -> None:
    session = scene.session()
    session.plan(3)
    session.acquire("a", {}, three_samples)
    session.acquire("b", {}, lambda writer: {**three_samples(writer), "valid": False})
    resumed = scene.session()
    progress: Any = resumed._progress
    resumed.plan(3)
    assert progress.status() == {
        "state": "running", "step": "", "runs_done": 2, "runs_planned": 3, "runs_invalid": 1, "eta_s": None
    }  # fmt: skip
    for key in "ab":
        resumed.acquire(key, {}, never)
    assert progress.status()["eta_s"] is None, "a replay tells nothing of how long a run takes"
    assert progress.status()["runs_invalid"] == 1
    resumed.acquire("c", {}, three_samples)
    status = progress.status()
    assert (status["runs_done"], status["runs_planned"], status["eta_s"]) == (3, 3, 0.0)
