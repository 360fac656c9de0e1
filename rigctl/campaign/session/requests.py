"""What may be asked of a campaign from another process, through its store."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from rigctl.campaign.session import questions
from rigctl.campaign.session.locks import is_held, store_lock
from rigctl.campaign.session.questions import Question, open_question
from rigctl.campaign.store.store import Store
from rigctl.core.errors import RigError

Request = Literal["pause", "resume", "abort"]


def is_running(store: Path) -> bool:
    """True while a process runs the campaign of a store."""
    return is_held(store_lock(store))


def request(store: Path, kind: Request) -> None:
    """Ask a running campaign to pause, go on or abort; `RigError` when none runs."""
    with Store.open(store) as opened:
        if not is_running(store):
            raise RigError(f"{store}: no campaign is running on it; `rigctl status` tells how it ended")
        opened.add_request(kind)


def stop(store: Path) -> None:
    """Ask a campaign to abort because of a STOP; one that has ended is stopped already. `DataError`."""
    with Store.open(store) as opened:
        if is_running(store):
            opened.add_request("stop")


def answer(store: Path, text: str, number: int | None = None) -> Question:
    """Answer what a running campaign asks, only question `number` if given. `RigError`, `DataError`."""
    with Store.open(store) as opened:
        question = open_question(opened) if is_running(store) else None
        if question is None:
            raise RigError(f"{store}: nothing is being asked; `rigctl status` tells how far it is")
        questions.answer(opened, question.number if number is None else number, text)
    return question


def add_note(store: Path, action: str) -> None:
    """Keep an operator's action among the events of the store it was for."""
    with Store.open(store) as opened:
        opened.add_event("operator", {"action": action})
