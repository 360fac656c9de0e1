"""Who asks urgently does not wait for replies that others await; nobody is given another's reply."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest

from drivers.conversation import Check, Conversation
from drivers.transport import Transport, lost, timed_out
from rigctl.core.errors import LinkError, LinkLost, LinkTimeout, OutOfStep

PATIENCE_S = 10.0


class Wire:
    """A transport whose replies are said beforehand; reading b"..." waits until somebody closes it."""

    def __init__(self, replies: list[bytes]) -> None:
        self.address, self.guarded = "wire", True
        self.replies = replies
        self.written: list[bytes] = []
        self.stray = b""
        self.closed, self.waiting = threading.Event(), threading.Event()

    def write(self, data: bytes) -> None:
        if self.closed.is_set():
            raise lost(self.address, "it is closed here")
        self.written.append(data)

    def read_until(self, terminator: bytes, timeout_s: float) -> bytes:
        reply = self.replies.pop(0) if self.replies else b""
        if reply == b"...":
            self.waiting.set()
            assert self.closed.wait(PATIENCE_S)
            raise lost(self.address, "it is closed here")
        if not reply:
            raise timed_out(self.address, repr(terminator), timeout_s, b"")
        return reply

    def read_exactly(self, count: int, timeout_s: float) -> bytes:
        raise NotImplementedError

    def unread(self) -> bytes:
        if self.closed.is_set():
            raise lost(self.address, "it is closed here")
        stray, self.stray = self.stray, b""
        return stray

    def close(self) -> None:
        self.closed.set()


def line(transport: Transport) -> bytes:
    return transport.read_until(b"\n", 1.0)


def conversation(*wires: Wire, anew: bool = True) -> Conversation:
    left = list(wires)

    def connect() -> Transport:
        return left.pop(0)

    return Conversation("it", connect, Check(b"who?", lambda transport: line(transport) == b"me"), anew=anew)


def in_thread(call: Callable[[], object]) -> tuple[threading.Thread, list[BaseException]]:
    raised: list[BaseException] = []

    def run() -> None:
        try:
            call()
        except LinkLost as error:
            raised.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    return thread, raised


def test_who_is_urgent_takes_the_connection_from_who_awaits_a_reply() -> None:
    first, second = Wire([b"..."]), Wire([b"stopped"])
    talk = conversation(first, second)
    talk.open()
    waiting, raised = in_thread(lambda: talk.ask(b"long?", line))
    assert first.waiting.wait(PATIENCE_S)
    with talk.urgently():
        assert talk.ask(b"stop", line) == b"stopped"
    waiting.join(PATIENCE_S)
    assert [type(error) for error in raised] == [LinkLost]
    assert (first.written, second.written) == ([b"long?"], [b"stop"])


def test_two_who_are_urgent_do_not_cut_each_other_off() -> None:
    wire = Wire([b"one", b"two"])
    talk = conversation(wire)
    talk.open()
    begun, let_go = threading.Event(), threading.Event()

    def slowly() -> None:
        with talk.urgently():
            begun.set()
            assert not let_go.wait(0.2)  # longer than an exchange may take before it is overtaken
            talk.ask(b"stop", line)

    one, raised = in_thread(slowly)
    assert begun.wait(PATIENCE_S)
    with talk.urgently():
        assert talk.ask(b"stop", line) == b"two"
    one.join(PATIENCE_S)
    assert raised == []
    assert wire.written == [b"stop", b"stop"]


def test_what_has_no_reply_goes_out_past_who_awaits_one() -> None:
    wire = Wire([b"..."])
    talk = conversation(wire)
    talk.open()
    waiting, _ = in_thread(lambda: talk.ask(b"long?", line))
    assert wire.waiting.wait(PATIENCE_S)
    talk.shout(b"stop")
    assert wire.written == [b"long?", b"stop"]
    assert not wire.closed.is_set()
    talk.close()
    waiting.join(PATIENCE_S)


@dataclass
class SlowConnection:
    """A conversation whose connection takes until `made` is set."""

    wire: Wire
    making: threading.Event = field(default_factory=threading.Event)
    made: threading.Event = field(default_factory=threading.Event)
    times: int = 0

    def connect(self) -> Transport:
        self.times += 1
        self.making.set()
        assert self.made.wait(PATIENCE_S)
        return self.wire

    def conversation(self) -> Conversation:
        return Conversation("it", self.connect, Check(b"who?", lambda _: True), anew=True)


def shouting(talk: Conversation) -> None:
    with talk.reachable():
        talk.shout(b"stop")


def asking_urgently(talk: Conversation) -> None:
    with talk.urgently():
        talk.ask(b"stop", line)


@pytest.mark.parametrize("stop", [shouting, asking_urgently])
def test_who_is_urgent_while_somebody_connects_uses_that_connection(stop: Callable[[Conversation], None]) -> None:
    slow = SlowConnection(Wire([b"stopped"]))
    talk, waits = slow.conversation(), threading.Event()
    talk.lock = Noted(talk.lock, waits)
    opening, not_opened = in_thread(talk.open)
    assert slow.making.wait(PATIENCE_S)
    stopping, not_stopped = in_thread(lambda: stop(talk))
    assert waits.wait(PATIENCE_S)
    slow.made.set()
    opening.join(PATIENCE_S)
    stopping.join(PATIENCE_S)
    assert (not_opened, not_stopped) == ([], [])
    assert (slow.wire.written, slow.times) == ([b"stop"], 1)


class Noted:
    """A lock that says when it was asked for in vain."""

    def __init__(self, lock: Any, in_vain: threading.Event) -> None:
        self._lock, self._in_vain = lock, in_vain

    def acquire(self, *, timeout: float = -1) -> bool:
        if not (got := self._lock.acquire(timeout=timeout)):
            self._in_vain.set()
        return bool(got)

    def release(self) -> None:
        self._lock.release()

    def __enter__(self) -> None:
        self._lock.acquire()

    def __exit__(self, *_: object) -> None:
        self._lock.release()


def test_who_was_not_open_is_closed_again() -> None:
    wire = Wire([b"stopped"])
    talk = conversation(wire)
    with talk.urgently():
        talk.ask(b"stop", line)
    assert wire.closed.is_set()
    with pytest.raises(LinkLost, match="open it first"):
        talk.ask(b"next?", line)


def test_what_is_unread_at_a_question_is_told_once_and_the_next_connection_is_in_step() -> None:
    first, second = Wire([b"1"]), Wire([b"2"])
    talk = conversation(first, second)
    talk.open()
    talk.ask(b"a?", line)
    first.stray = b"1"
    talk.tell(b"halt")  # goes out whatever is unread, which is not forgotten
    with pytest.raises(OutOfStep, match=r"b'1' was unread at b'b\?'"):
        talk.ask(b"b?", line)
    assert talk.ask(b"b?", line) == b"2"
    assert (first.written, second.written) == ([b"a?", b"halt"], [b"b?"])


@pytest.mark.parametrize(
    ("stray", "mend"),
    [
        (b"\n", "set the delimiter of the instrument, or of a terminal server"),
        (b"\r\n", "set the delimiter of the instrument, or of a terminal server"),
        (b"1\r\n", "replies may have been taken for others: measure again"),
    ],
)
def test_what_is_unread_says_what_to_do(stray: bytes, mend: str) -> None:
    first, second = Wire([b"1"]), Wire([b"2"])
    talk = conversation(first, second)
    talk.open()
    talk.ask(b"a?", line)
    first.stray = stray
    with pytest.raises(OutOfStep, match=mend):
        talk.ask(b"b?", line)
    assert talk.ask(b"b?", line) == b"2"


def test_late_replies_are_read_past_and_so_are_those_to_earlier_check_questions() -> None:
    wire = Wire([b"", b"", b"late", b"me", b"me", b"own"])
    talk = conversation(wire, anew=False)
    talk.open()
    with pytest.raises(LinkTimeout):
        talk.ask(b"a?", line)
    with pytest.raises(LinkTimeout):  # the check question is not answered either, yet
        talk.ask(b"b?", line)
    assert talk.ask(b"c?", line) == b"own"
    assert wire.written == [b"a?", b"who?", b"who?", b"c?"]
    assert wire.replies == []


def test_another_reply_to_the_check_question_is_out_of_step() -> None:
    first, second = Wire([b"previous"]), Wire([b"me"])
    talk = conversation(first, second)
    talk.open()
    with pytest.raises(OutOfStep, match="not answered by its own reply"):
        talk.confirm_in_step()
    talk.confirm_in_step()
    assert second.written == [b"who?"]


ASKED = [
    pytest.param(lambda talk: talk.ask(b"how?\r\n", line), "it: how?: wire: ", id="ask"),
    pytest.param(lambda talk: talk.ask_each([b"one?", b"two?"], line, bool), "it: two?: wire: ", id="ask each"),
    pytest.param(lambda talk: talk.confirm_in_step(), "it: who?: wire: ", id="confirm"),
]


@pytest.mark.parametrize(("asked", "begins"), ASKED)
@pytest.mark.parametrize(("error", "ends"), [(LinkTimeout, "nothing came; "), (LinkLost, "no connection, ")])
def test_what_a_wire_raises_says_whose_wire_it_is_and_what_was_asked(
    asked: Callable[[Conversation], object], begins: str, error: type[LinkError], ends: str
) -> None:
    wire = Wire([b"1"] if "two" in begins else [])
    talk = conversation(wire, wire)
    talk.open()
    if error is LinkLost:
        wire.replies.append(b"...")
        wire.closed.wait = lambda timeout=None: True  # type: ignore[method-assign] # the wire ends at once
    with pytest.raises(error, match=f"^{re.escape(begins)}.*{re.escape(ends)}") as raised:
        asked(talk)
    assert raised.value.instrument == "it"
    assert str(raised.value).count("it:") == 1


def test_an_instrument_that_cannot_be_reached_is_named() -> None:
    def connect() -> Transport:
        raise lost("wire", "connection refused")

    talk = Conversation("it", connect, Check(b"who?", lambda _: True), anew=True)
    with pytest.raises(LinkLost, match=r"^it: wire: no connection, connection refused; check power") as raised:
        talk.open()
    assert raised.value.instrument == "it"
