"""The person at the rig, typed answers, and the hands of a simulated one."""

from __future__ import annotations

import json
import os
import re
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import pytest

from rigctl.campaign.session.operator import Operator, TerminalOperator, TypedLines
from rigctl.campaign.session.operator_link import TcpOperatorLink
from rigctl.core.clock import RealClock
from rigctl.core.errors import Aborted, BadReply, ConfigError, LinkLost, LinkTimeout, ProcedureError


@dataclass
class Hands:
    """Does what it is asked and remembers it."""

    answer: dict[str, Any] = field(default_factory=lambda: {"done": True})
    done: list[dict[str, Any]] = field(default_factory=list)

    def request(self, action: dict[str, Any]) -> dict[str, Any]:
        self.done.append(action)
        return self.answer


def typed(*lines: str) -> Callable[[], str]:
    """Somebody who types these lines and then is gone."""
    rest = iter(lines)

    def ask() -> str:
        try:
            return next(rest)
        except StopIteration:
            raise EOFError from None

    return ask


# At a terminal


def test_a_mounting_is_made_when_the_person_says_done(capsys: pytest.CaptureFixture[str]) -> None:
    hands = Hands()
    TerminalOperator(hands, typed("", "what?", " DONE ")).remount("X", "flag", 3)
    assert hands.done == [{"remount": {"axis": "X", "configuration": "flag", "mounting": 3}}]
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("Mount the package for axis X in flag (mounting 3)") == 3


def test_a_person_may_abort_instead() -> None:
    hands = Hands()
    with pytest.raises(Aborted, match="the operator aborted at: Level the package"):
        TerminalOperator(hands, typed("abort")).level(0.5)
    assert hands.done == []


@pytest.mark.parametrize(
    ("sign", "asked"), [(1, r"that \+g acts .* bypass"), (-1, r"that -g acts .* bypass"), (0, "back on the platform")]
)
def test_sensors_are_turned_over_when_the_person_says_done(
    sign: int, asked: str, capsys: pytest.CaptureFixture[str]
) -> None:
    hands = Hands()
    TerminalOperator(hands, typed("done")).flip(sign)
    assert hands.done == [{"flip": sign}]
    assert re.search(asked, capsys.readouterr().err)
    with pytest.raises(Aborted, match="the operator aborted at: "):
        TerminalOperator(hands, typed("abort")).flip(sign)
    assert len(hands.done) == 1


def test_nobody_at_the_terminal_is_an_error_with_its_mend() -> None:
    with pytest.raises(ProcedureError, match=r"nobody at the terminal .*Level the package.*--yes"):
        TerminalOperator(Hands(), typed()).level(0.5)


@pytest.mark.parametrize(("answers", "accepted"), [(("y",), True), (("maybe", "YES"), True), (("", "n"), False)])
def test_a_question_is_asked_until_it_is_answered(answers: tuple[str, ...], accepted: bool) -> None:
    assert TerminalOperator(None, typed(*answers)).accept("Start anyway?") is accepted


def test_a_mounting_that_is_still_in_place_is_made_again_in_a_simulated_world_only() -> None:
    hands = Hands()
    assert TerminalOperator(hands, typed("y")).still_mounted("X", "flag", 3)
    assert [list(action) for action in hands.done] == [["stands"], ["remount"], ["level"]]
    assert TerminalOperator(None, typed("y")).still_mounted("X", "flag", 3)
    hands.done.clear()
    assert not TerminalOperator(hands, typed("n")).still_mounted("X", "flag", 3)
    assert hands.done == []


# What is typed


@contextmanager
def keyboard(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A standard input; yields where to type."""
    reader, writer = os.pipe()
    with os.fdopen(reader) as stream:
        monkeypatch.setattr(sys, "stdin", stream)
        try:
            yield writer
        finally:
            os.close(writer)


def test_lines_typed_at_once_are_answers_to_one_question_each(monkeypatch: pytest.MonkeyPatch) -> None:
    with keyboard(monkeypatch) as keys:
        lines = TypedLines(lambda: None)
        os.write(keys, b"done\ny\nhal")
        assert lines() == "done"
        assert lines() == "y"
        os.write(keys, "b µm\n".encode())
        assert lines() == "halb µm"


def test_an_abort_ends_the_waiting_for_an_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    looks = []

    def heed() -> None:
        looks.append(1)
        if len(looks) == 3:
            raise Aborted("interrupted by SIGINT")

    with keyboard(monkeypatch), pytest.raises(Aborted, match="SIGINT"):
        TypedLines(heed)()


def test_the_end_of_the_input_and_a_closed_one_are_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    reader, writer = os.pipe()
    os.write(writer, b"unfinished")
    os.close(writer)
    with os.fdopen(reader) as stream:
        monkeypatch.setattr(sys, "stdin", stream)
        with pytest.raises(EOFError):
            TypedLines(lambda: None)()
    for gone in (stream, None):
        monkeypatch.setattr(sys, "stdin", gone)
        with pytest.raises(EOFError):
            TypedLines(lambda: None)()


# Hands


def test_the_simulated_operator_acts_and_never_accepts_a_bad_start() -> None:
    hands = Hands()
    operator = Operator(hands)
    operator.remount("Y", "pendulum", 2)
    operator.level(7.5)
    operator.announce_run(9)
    assert hands.done == [
        {"remount": {"axis": "Y", "configuration": "pendulum", "mounting": 2}},
        {"level": True},
        {"run": 9},
    ]
    assert operator.accept("The room is loud. Start anyway?") is False
    Operator(None).remount("Y", "pendulum", 2)


def test_hands_that_cannot_do_it_say_why() -> None:
    with pytest.raises(ProcedureError, match=r"could not do .*remount.*: no sensor 'Q'"):
        Operator(Hands({"error": "no sensor 'Q'"})).remount("Q", "flag", 1)


@contextmanager
def port(serve: Callable[[socket.socket], None]) -> Iterator[str]:
    """Somebody who serves one connection at an address."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def accept() -> None:
            client, _ = listener.accept()
            with client:
                serve(client)

        thread = threading.Thread(target=accept)
        thread.start()
        yield f"tcp://127.0.0.1:{listener.getsockname()[1]}"
        thread.join()


def test_an_action_is_one_line_of_json_and_its_answer_another() -> None:
    asked = []

    def serve(client: socket.socket) -> None:
        with client.makefile("rwb") as lines:
            asked.append(json.loads(lines.readline()))
            lines.write(b'{"done": true, "at": 5}\n')

    with port(serve) as address:
        assert TcpOperatorLink(address, RealClock()).request({"level": True}) == {"done": True, "at": 5}
    assert asked == [{"level": True}]


@pytest.mark.parametrize(
    ("answer", "error", "words"),
    [
        (b"", LinkLost, "hung up; is `rigctl simulate` running"),
        (b"READY>\n", BadReply, "b'READY>.*' is no operator's answer"),
        (b"[1]\n", BadReply, "no operator's answer"),
        (b"\xff\xfe\n", BadReply, "no operator's answer"),
    ],
)
def test_what_is_no_operators_port_is_found_out(answer: bytes, error: type[Exception], words: str) -> None:
    def serve(client: socket.socket) -> None:
        client.recv(4096)
        client.sendall(answer)

    with port(serve) as address, pytest.raises(error, match=words):
        TcpOperatorLink(address, RealClock()).request({"level": True})


def test_an_operator_who_does_not_answer_is_not_waited_for_for_ever() -> None:
    answered = threading.Event()

    def serve(_: socket.socket) -> None:
        answered.wait(10.0)

    with port(serve) as address:
        link = TcpOperatorLink(address, RealClock())
        link._timeout_s = 0.05
        with pytest.raises(LinkTimeout, match="did not answer"):
            link.request({"level": True})
        answered.set()


def test_an_abort_does_not_wait_for_hands_that_are_at_work() -> None:
    at_work, done = threading.Event(), threading.Event()

    class Slow:
        def request(self, action: dict[str, Any]) -> dict[str, Any]:
            at_work.set()
            done.wait(60.0)
            return {"done": True}

    def heed() -> None:
        assert at_work.wait(10.0)
        raise Aborted("interrupted by SIGTERM")

    with pytest.raises(Aborted, match="SIGTERM"):
        Operator(Slow(), heed=heed).remount("X", "flag", 1)
    assert not done.is_set(), "it was waited for"
    done.set()


def test_nobody_at_the_port_is_an_error_with_its_mend() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        address = f"tcp://127.0.0.1:{listener.getsockname()[1]}"
    with pytest.raises(LinkLost, match=rf"{address}: no simulated operator .*rigctl simulate"):
        TcpOperatorLink(address, RealClock()).request({"level": True})


@pytest.mark.parametrize("address", ["127.0.0.1:5", "tcp://127.0.0.1", "tcp://:5", "tcp://localhost:five"])
def test_an_address_that_is_none_is_refused(address: str) -> None:
    with pytest.raises(ConfigError, match="write tcp://host:port"):
        TcpOperatorLink(address, RealClock())
