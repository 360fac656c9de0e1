"""Making safe: every instrument is asked, none is waited for too long, and a signal does not wait either."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest

from rigctl.core import making_safe
from rigctl.core.errors import Aborted, BadReply, InstrumentError, LinkLost, LinkTimeout, OutOfStep, RigError
from rigctl.core.making_safe import Rest, bring_to_rest, ended_by_signals, require_rest

PATIENCE_S = 10.0


@dataclass
class Axis:
    """Something that can be stopped; `stopping` is what happens then."""

    name: str
    stopping: Callable[[], None] = lambda: None
    stopped: threading.Event = field(default_factory=threading.Event)

    def stop(self) -> None:
        self.stopping()
        self.stopped.set()


def lost() -> None:
    raise LinkLost("rotation: no connection;\ncheck power")


def test_each_instrument_is_told_of_by_itself_and_none_keeps_another_moving() -> None:
    never = threading.Event()
    hangs, fails, stops = (
        Axis("lasers", lambda: never.wait(PATIENCE_S) and None),
        Axis("rotation", lost),
        Axis("stage"),
    )
    silent, failed, confirmed = bring_to_rest([hangs, fails, stops], deadline_s=0.05)
    never.set()
    assert (silent.confirmed, silent.why) == (False, "no answer within 0.05 s")
    assert (failed.confirmed, failed.why) == (False, "no connection; check power")
    assert confirmed.confirmed
    assert confirmed.took_s < PATIENCE_S
    with pytest.raises(
        RigError, match=r"^NOT known to be at rest: lasers: no answer.*; rotation: no connection; check"
    ):
        require_rest((silent, failed, confirmed))
    require_rest((confirmed,))
    assert bring_to_rest([]) == ()


@pytest.mark.parametrize("spoilt", [BadReply, LinkTimeout, OutOfStep])
def test_a_spoilt_reply_to_a_stop_is_asked_for_again_once(spoilt: type[RigError]) -> None:
    replies = [spoilt("stage: AP was answered by b'??'")]

    def answer() -> None:
        if replies:
            raise replies.pop()

    (rest,) = bring_to_rest([Axis("stage", answer)])
    assert rest.confirmed
    replies = [spoilt("first"), spoilt("second")]
    (rest,) = bring_to_rest([Axis("stage", answer)])
    assert (rest.confirmed, rest.why) == (False, "first")
    assert not replies


def test_a_refused_stop_is_not_asked_for_again() -> None:
    asked = []

    def refuse() -> None:
        asked.append(1)
        raise InstrumentError("stage: refused")

    (rest,) = bring_to_rest([Axis("stage", refuse)])
    assert (rest.confirmed, len(asked)) == (False, 1)


def test_a_rest_reads_as_the_operator_is_told_it() -> None:
    assert str(Rest("stage", True, 0.0123)) == "stage: confirmed at rest (12 ms)"
    assert str(Rest("stage", False, 5.0, "no answer within 5 s")) == "stage: NOT CONFIRMED: no answer within 5 s"


def test_all_are_stopped_at_once() -> None:
    together = threading.Barrier(3, timeout=PATIENCE_S)
    rests = bring_to_rest([Axis(name, lambda: together.wait() and None) for name in "abc"])
    assert all(rest.confirmed for rest in rests)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, making_safe.STOP_SIGNAL])
def test_a_signal_aborts_on_another_thread_while_the_main_one_waits(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    reasons, aborted = [], threading.Event()

    def abort(reason: str) -> None:
        reasons.append((reason, threading.current_thread() is threading.main_thread()))
        os.kill(os.getpid(), number)  # impatient: twice
        aborted.set()

    with ended_by_signals(abort):
        os.kill(os.getpid(), number)
        assert aborted.wait(PATIENCE_S)
    told = {signal.SIGHUP: "the terminal was lost", making_safe.STOP_SIGNAL: "STOP, by the operator at a console"}
    wording = told.get(number, f"interrupted by {number.name}")
    assert reasons == [(wording, False)]
    assert signal.getsignal(number) == before
    assert signal.set_wakeup_fd(-1) == -1


def test_the_stops_go_before_anything_more_that_the_main_thread_would_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(making_safe, "STOPS_FIRST_S", PATIENCE_S)
    before_s = sys.getswitchinterval()
    done: list[str] = []
    with ended_by_signals(lambda _: done.append("stopped")):
        assert sys.getswitchinterval() == pytest.approx(making_safe.TURN_S)
        os.kill(os.getpid(), signal.SIGTERM)
        done.append("moved")
    assert done == ["stopped", "moved"]
    assert sys.getswitchinterval() == before_s


def test_a_terminal_may_be_lost_by_who_goes_on_without() -> None:
    reasons: list[str] = []
    with ended_by_signals(reasons.append, "continue"):
        os.kill(os.getpid(), signal.SIGHUP)
    assert reasons == []


def test_what_does_not_leave_is_interrupted_where_it_waits() -> None:
    forever = threading.Event()

    def wait() -> None:
        with ended_by_signals(lambda _: None, leave_s=0.01):
            os.kill(os.getpid(), signal.SIGTERM)
            assert forever.wait(PATIENCE_S), "it waited to its end"

    with pytest.raises(Aborted, match="interrupted by SIGTERM"):
        wait()


def test_outside_the_main_thread_signals_are_left_to_others() -> None:
    before = signal.getsignal(signal.SIGTERM)
    seen = []

    def work() -> None:
        with ended_by_signals(lambda _: None):
            seen.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [before]
