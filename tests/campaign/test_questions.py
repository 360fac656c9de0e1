"""What a campaign asks is answered once, by whoever is first, and never by mistake."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from rigctl.campaign.recording import Header
from rigctl.campaign.session.operator import TerminalOperator, TypedLines
from rigctl.campaign.session.questions import Questions, answer, open_question
from rigctl.campaign.status import status_of
from rigctl.campaign.store.entries import RESUMED
from rigctl.campaign.store.store import Store
from rigctl.core.errors import DataError


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    with Store.create(tmp_path / "x.rig.sqlite", Header("sensing-axis")) as made:
        yield made


def test_a_question_is_open_until_it_is_answered(store: Store) -> None:
    assert open_question(store) is None
    board = Questions(store)
    board.post("Mount the package. Type 'done', or 'abort': ")
    question = open_question(store)
    assert question is not None
    assert question.choices == ("done", "abort")
    assert board.heard() is None
    answer(store, question.number, "done")
    assert board.heard() == "done"
    assert open_question(store) is None


def test_an_answer_to_an_earlier_question_confirms_no_later_one(store: Store) -> None:
    board = Questions(store)
    board.post("Mount the package. Type 'done', or 'abort': ")
    first = open_question(store)
    assert first is not None
    answer(store, first.number, "done")
    board.post("Level the package. Type 'done', or 'abort': ")
    with pytest.raises(DataError, match="not open any more"):
        answer(store, first.number, "done")
    assert board.heard() is None


def test_only_the_words_of_a_question_answer_it(store: Store) -> None:
    Questions(store).post("Start anyway? [y/n] ")
    question = open_question(store)
    assert question is not None
    with pytest.raises(DataError, match="'done' is no answer; one of yes, no"):
        answer(store, question.number, "done")
    answer(store, question.number, "no")


def test_a_campaign_that_is_resumed_does_not_wait_for_what_was_asked_before(store: Store) -> None:
    Questions(store).post("Mount the package. Type 'done', or 'abort': ")
    store.add_event(RESUMED, {"after": "running"})
    assert open_question(store) is None
    Questions(store).post("Is it still mounted? [y/n] ")
    question = open_question(store)
    assert question is not None
    assert question.choices == ("yes", "no")


def test_the_status_says_what_a_campaign_waits_for(desk: Any) -> None:
    campaign = desk.process("run", "campaign.toml", "--store", desk.store, stdin=subprocess.PIPE)
    found: dict[str, Any] = {}

    def asked() -> bool:
        if desk.store.exists():
            found.update(status_of(desk.store))
        return bool(found.get("question"))

    desk.until(asked, campaign)
    question = desk.rigctl("status", desk.store, "--json").json["question"]
    assert question["text"].startswith("Mount the package for axis X in pendulum")
    assert question["choices"] == ["done", "abort"]
    said = desk.rigctl("status", desk.store).out
    assert "WAITS FOR YOU: Mount the package for axis X in pendulum" in said
    assert "`rigctl answer STORE done|abort`" in said
    assert desk.rigctl("answer", desk.store, "abort").status == 0
    # Its input stays open until it has ended: the end of it would be an answer too.
    assert campaign.wait(60.0) == 130
    assert desk.rigctl("status", desk.store, "--json").json["question"] is None


def test_what_is_typed_at_the_terminal_is_kept_too(store: Store) -> None:
    operator = TerminalOperator(None, iter(["done"]).__next__, Questions(store))
    operator.level(0.5)
    assert [event.data["answer"] for event in store.events("answer")] == ["done"]
    assert open_question(store) is None


def test_a_campaign_without_a_terminal_takes_the_answer_from_its_store(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    board = Questions(store)

    def somebody_elsewhere() -> None:
        question = open_question(store)
        assert question is not None
        answer(store, question.number, "yes")

    monkeypatch.setattr("select.select", lambda *_: ([], [], []))
    operator = TerminalOperator(None, TypedLines(somebody_elsewhere, board.heard), board)
    assert operator.accept("Start anyway?")
    assert len(store.events("answer")) == 1
