"""A campaign may be cut off at any instant, by anything, and goes on to the same result."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from procedures.sensing_axis import sensing_axes
from procedures.sensing_axis.campaign import plan as plan_of
from procedures.sensing_axis.wiring import bench_of
from rigctl import results, runner
from rigctl.campaign.origin import truth_path
from rigctl.campaign.session.control import Control
from rigctl.campaign.session.operator import Levelled, Operator
from rigctl.campaign.session.progress import Progress
from rigctl.campaign.session.session import Session
from rigctl.campaign.status import status_of
from rigctl.campaign.store.run_writer import RunWriter
from rigctl.campaign.store.store import Store
from rigctl.core.errors import Aborted, ProcedureError
from rigctl.files.campaign_file import read_campaign
from rigctl.files.rig_file import read_rig
from rigctl.rig import Rig

SLOW = (
    ('"virtual"', '"real"'),
    ("clock_speed = 1.0", "clock_speed = 100.0"),
    ("seed = 2022", "seed = 2022\nremount_s = 20.0\nlevel_s = 5.0"),
    # A millisecond of this computer is 100 of them on the rig: when lasers start is known less well.
    *((f"heads = {{ laser_{number}_mm", f"start_u_s = 0.1\nheads = {{ laser_{number}_mm") for number in (1, 3)),
)
"""A rig on the wall clock: somebody has time to do something to a campaign on it."""


# kill -9


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory, campaigns: Path, small: str) -> dict[str, Any]:
    """The result of the small campaign that nobody disturbs."""
    path = tmp_path_factory.mktemp("undisturbed")
    (path / "campaign.toml").write_text(small)
    campaign = read_campaign(path / "campaign.toml")
    runner.start(campaign, read_rig(campaigns / "isa-rig.toml"), path / "x", runner.Options(unattended=True))
    found: dict[str, Any] = json.loads(json.dumps(results.of(path / "x")))
    return found


def killed(desk: Any, owner: type, method: str, nth: int, *, after: bool) -> None:
    """`rigctl run` in a process that is killed just before or after the nth call of a method."""
    child = os.fork()
    if child:
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
        return
    original = getattr(owner, method)
    calls = []

    def counted(*arguments: Any, **options: Any) -> Any:
        calls.append(1)
        if len(calls) == nth and not after:
            os.kill(os.getpid(), signal.SIGKILL)
        found = original(*arguments, **options)
        if len(calls) == nth:
            os.kill(os.getpid(), signal.SIGKILL)
        return found

    try:
        setattr(owner, method, counted)
        desk.run()
    finally:
        os._exit(1)


@pytest.mark.parametrize(
    ("owner", "method", "nth", "after", "finished"),
    [
        (Store, "set_identity", 2, True, 0),
        (Store, "add_event", 1, False, 0),
        (Store, "add_event", 1, True, 0),
        (Store, "add_event", 2, True, 0),
        (RunWriter, "stream", 2, True, 0),
        (RunWriter, "finish", 2, False, 1),
        (RunWriter, "finish", 2, True, 2),
        (RunWriter, "stream", 15, False, 2),
        (RunWriter, "finish", 4, True, 4),
        (RunWriter, "finish", 6, True, 6),
    ],
)
def test_killed_at_any_instant_a_campaign_goes_on_to_the_same_result(
    desk: Any, undisturbed: dict[str, Any], owner: type, method: str, nth: int, after: bool, finished: int
) -> None:
    killed(desk, owner, method, nth, after=after)
    assert status_of(desk.store)["state"] == "interrupted"
    with Store.open(desk.store, readonly=True) as store:
        before = {run.run_id: store.samples(run.run_id)["accel_v"].tobytes() for run in store.runs()}
    assert len(before) == finished
    with Store.open(desk.store) as store:
        store.add_request("abort")  # asked too late: the campaign it was meant for is gone

    found = desk.rigctl("resume", desk.store, "--json")
    assert found.status == 0, found.err
    assert found.json["status"]["state"] == "done"
    assert found.json["status"]["runs_done"] == 6
    with Store.open(desk.store, readonly=True) as store:
        kept = {run.run_id: store.samples(run.run_id)["accel_v"].tobytes() for run in store.runs()}
        assert len({run.key for run in store.runs()}) == len(kept)
    assert kept.items() >= before.items()
    assert found.json["result"] == undisturbed


def test_killed_from_outside_a_campaign_says_interrupted_until_it_is_resumed(desk: Any) -> None:
    desk.rig(*SLOW)
    process = desk.process("run", "campaign.toml", "--store", desk.store, "--yes", "--json")
    desk.until(lambda: desk.runs() >= 1, process)
    assert desk.rigctl("status", desk.store, "--json").json["state"] == "running"
    process.kill()
    process.wait()
    assert desk.rigctl("status", desk.store, "--json").json["state"] == "interrupted"
    desk.rigctl("abort", desk.store).refused(1, "no campaign is running")


def test_without_its_world_a_simulated_campaign_is_not_resumed(desk: Any) -> None:
    killed(desk, RunWriter, "finish", 1, after=True)
    truth = truth_path(desk.store)
    text = truth.read_text()
    truth.write_text(text.replace("seed = 2022", "seed = 2023"))
    desk.rigctl("resume", desk.store).refused(2, truth.name, "is not the world", "restore the original")
    truth.unlink()
    desk.rigctl("resume", desk.store).refused(2, truth.name, "is missing")
    assert status_of(desk.store)["state"] == "interrupted"
    truth.write_text(text)
    assert desk.rigctl("resume", desk.store).status == 0


# Asked to stop


def signal_when_running(desk: Any, number: int) -> threading.Thread:
    """Sends this process a signal once its campaign has a run."""

    def send() -> None:
        never = threading.Event()
        while desk.runs() < 1:
            never.wait(0.005)
        os.kill(os.getpid(), number)

    thread = threading.Thread(target=send)
    thread.start()
    return thread


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_motion_and_leaves_a_campaign_that_can_be_resumed(
    desk: Any, wire: Any, number: signal.Signals
) -> None:
    desk.rig(*SLOW)
    handler = signal.getsignal(number)
    stop = Rig.stop

    def impatient(rig: Rig) -> None:
        if desk.runs():  # not when it begins at rest
            os.kill(os.getpid(), number)
        stop(rig)

    desk.patch.setattr(Rig, "stop", impatient)
    thread = signal_when_running(desk, number)
    found = desk.run()
    thread.join()
    desk.patch.setattr(Rig, "stop", stop)
    assert found.status == 130
    assert found.out == ""
    assert found.err.splitlines()[-1] == f"aborted: interrupted by {number.name}"
    assert signal.getsignal(number) == handler
    assert desk.rigctl("status", desk.store, "--json").json["state"] == "aborted"
    last_motion = max(i for i, data in enumerate(wire.sent) if b"OSCILLATE" in data or b"MOVEABS" in data)
    assert any(data.startswith(b"ABORT") for data in wire.sent[last_motion:])
    assert desk.rigctl("resume", desk.store, "--json").json["status"]["state"] == "done"


def test_an_abort_from_another_process(desk: Any) -> None:
    desk.rig(*SLOW)
    process = desk.process("run", "campaign.toml", "--store", desk.store, "--yes", "--json")
    desk.until(lambda: desk.runs() >= 1, process)
    assert desk.rigctl("abort", desk.store, "--json").json == {"requested": "abort"}
    ended = desk.end(process, 20.0)
    assert ended.status == 130
    assert "aborted: the operator asked for it (rigctl abort)" in ended.err
    assert "Traceback" not in ended.err
    assert desk.rigctl("status", desk.store, "--json").json["state"] == "aborted"


def test_a_pause_and_a_lost_terminal_from_outside(desk: Any) -> None:
    desk.rig(*SLOW)
    process = desk.process("run", "campaign.toml", "--store", desk.store, "--yes", "--json")
    desk.until(lambda: desk.runs() >= 1, process)
    assert desk.rigctl("pause", desk.store, "--json").json == {"requested": "pause"}
    desk.until(lambda: status_of(desk.store)["state"] == "paused", process)
    runs = desk.runs()
    desk.run().refused(2, "exists already")
    process.send_signal(signal.SIGHUP)
    assert desk.rigctl("status", desk.store, "--json").json["state"] == "paused"
    assert desk.runs() == runs
    assert desk.rigctl("resume", desk.store, "--json").json == {"requested": "resume"}
    ended = desk.end(process)
    assert (ended.status, ended.json["status"]["state"]) == (0, "done")


def test_a_lost_terminal_stops_a_campaign_whose_file_says_so(desk: Any) -> None:
    desk.rig(*SLOW)
    desk.campaign(('rig = "rig.toml"', 'rig = "rig.toml"\non_terminal_lost = "stop"'))
    thread = signal_when_running(desk, signal.SIGHUP)
    found = desk.run()
    thread.join()
    assert found.status == 130
    assert "aborted: the terminal was lost" in found.err
    assert status_of(desk.store)["state"] == "aborted"


def test_ctrl_c_at_a_question_is_heard(desk: Any) -> None:
    process = desk.process("run", "campaign.toml", "--store", desk.store, stdin=subprocess.PIPE)
    said = ""
    while "Type 'done'" not in said:
        letter = process.stderr.read(1)
        assert letter, said
        said += letter
    process.send_signal(signal.SIGINT)
    ended = desk.end(process, 20.0)
    assert ended.status == 130
    assert "aborted: interrupted by SIGINT" in ended.err
    assert status_of(desk.store)["state"] == "aborted"


def test_an_attended_campaign_asks_again_when_it_is_resumed(desk: Any) -> None:
    killed(desk, RunWriter, "finish", 1, after=True)
    with Store.open(desk.store) as store:
        assert store.header.extra["unattended"] is True
    desk.patch.setattr("sys.stdin", None)
    attended = desk.directory / "y.rig.sqlite"
    found = desk.rigctl("run", "campaign.toml", "--store", attended)
    assert found.status == 1
    assert "nobody at the terminal to answer: Mount the package" in found.err
    assert status_of(attended)["state"] == "interrupted"
    found = desk.rigctl("resume", attended)
    assert found.status == 1
    assert "nobody at the terminal" in found.err
    assert desk.rigctl("resume", attended, "--yes", "--json").json["status"]["state"] == "done"


# What the operator says after a restart


@dataclass
class Hand(Operator):
    """An operator with a will of their own."""

    untouched: bool = True
    idle_levellings: int = 0
    accepts: bool = False
    done: list[str] = field(default_factory=list)
    leave_at_run: int = 10**6

    def remount(self, axis: str, configuration: str, mounting: int) -> None:
        self.done.append(f"remount {axis} {configuration} {mounting}")
        super().remount(axis, configuration, mounting)

    def level(self, reading_v: float) -> None:
        self.done.append("level")
        if self.idle_levellings:
            self.idle_levellings -= 1
        else:
            super().level(reading_v)

    def still_mounted(self, axis: str, configuration: str, mounting: int, levelled: Levelled | None = None) -> bool:
        self.done.append(f"still {axis} {configuration} {mounting}?")
        return self.untouched and super().still_mounted(axis, configuration, mounting, levelled)

    def accept(self, question: str) -> bool:
        self.done.append(question)
        return self.accepts

    def announce_run(self, number: int) -> None:
        if number == self.leave_at_run:
            raise Aborted("went home")
        super().announce_run(number)


@pytest.fixture
def session_with(desk: Any) -> Callable[..., tuple[Store, Hand]]:
    """Runs the small campaign in a session with this operator, on a store that is made when it is not there."""

    def run(**will: Any) -> tuple[Store, Hand]:
        campaign = read_campaign(desk.directory / "campaign.toml")
        plan = plan_of(campaign)
        with Rig(read_rig(desk.directory / "rig.toml")) as rig:
            if not desk.store.exists():
                Store.create(desk.store, runner.header_of(campaign, rig, runner.Options(), {})).close()
            store = Store.open(desk.store)
            bench = bench_of(rig)
            hand = Hand(rig.operator_link, **will)
            session = Session(store, rig.clock, hand, Control(rig.stop, bench.rest), Progress(store))
            with suppress(Aborted):
                sensing_axes.run(session, bench, plan)
            return store, hand

    return run


def test_a_mounting_that_was_disturbed_is_made_anew_and_its_runs_are_not_used(
    session_with: Callable[..., tuple[Store, Hand]],
) -> None:
    # 1 mounted, 2 level, 3 noise check, 4 5 6 the runs of the first mounting.
    store, hand = session_with(leave_at_run=6)
    assert [run.conditions["mounting"] for run in store.runs()] == [1, 1]
    store.close()

    store, hand = session_with(untouched=False)
    assert hand.done[0] == "still X pendulum 1?"
    assert "remount X pendulum 3" in hand.done
    assert "remount X pendulum 1" not in hand.done
    fate = [(run.conditions["mounting"], run.valid, run.reason) for run in store.runs()]
    assert fate[:2] == [(1, False, "X pendulum 1 was disturbed")] * 2
    assert fate[2:] == [(3, True, "")] * 3 + [(2, True, "")] * 3
    assert [event.data["mounting"] for event in store.events("mounting-lost")] == ["X pendulum 1"]
    store.close()
    found = results.of(store.path)
    assert sorted(null["mounting"] for null in found["nulls"]) == [2, 3]

    store, hand = session_with()
    assert hand.done == [], "all of it is settled"
    assert len(store.runs()) == 8
    store.close()


def test_a_mounting_that_is_still_in_place_is_gone_on_with(session_with: Callable[..., tuple[Store, Hand]]) -> None:
    store, _ = session_with(leave_at_run=6)
    store.close()
    store, hand = session_with()
    assert hand.done[:2] == ["still X pendulum 1?", "remount X flag 2"]
    assert all(run.valid for run in store.runs())
    assert len(store.runs()) == 6
    store.close()


def test_the_package_is_levelled_until_it_is_level(session_with: Callable[..., tuple[Store, Hand]]) -> None:
    store, hand = session_with(idle_levellings=2)
    assert hand.done[:4] == ["remount X pendulum 1", "level", "level", "level"]
    readings = [event.data["result"] for event in store.events("once") if "X pendulum 1 level" in event.data["key"]]
    assert len(readings) == 3
    assert abs(readings[0]) > 1.0
    assert abs(readings[2]) < 1.0
    store.close()


def test_a_package_that_cannot_be_levelled_is_given_up_before_it_is_measured(
    session_with: Callable[..., tuple[Store, Hand]], desk: Any
) -> None:
    with pytest.raises(ProcedureError, match=r"X pendulum 1: static output .* after 5 levellings, limit 1 V; check"):
        session_with(idle_levellings=99)
    assert desk.runs() == 0


LOUD = ("seed = 2022", "seed = 2022\nground = { asd_m_s2_rthz = 1e-4 }")


def test_a_loud_room_is_refused_when_nobody_is_there_to_accept_it(desk: Any) -> None:
    desk.rig(LOUD)
    found = desk.run()
    assert found.status == 1
    assert (
        "noise check: 0.0001 m/s2/rtHz" in found.err.splitlines()[-1] or "noise check:" in found.err.splitlines()[-1]
    )
    assert "wait for a quieter room or raise targets.noise_m_s2_rthz" in found.err
    assert "Traceback" not in found.err
    assert status_of(desk.store)["state"] == "interrupted"
    assert desk.runs() == 0


def test_a_loud_room_may_be_accepted_once(session_with: Callable[..., tuple[Store, Hand]], desk: Any) -> None:
    desk.rig(LOUD)
    desk.campaign(("theta0_sigma_arcsec = 15.0", "theta0_sigma_arcsec = 200.0"))
    store, hand = session_with(accepts=True)
    questions = [said for said in hand.done if "Start anyway?" in said]
    assert len(questions) == 1
    assert "allowed 1e-05" in questions[0]
    assert len(store.runs()) >= 6
    store.close()
