"""Undo takes back what was changed here, in the store that is open, and gives back what was there before."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from rigctl.console.analyses import Analyses
from rigctl.core.errors import DataError

HERE, THERE = Path("here.rig.sqlite"), Path("there.rig.sqlite")


class Analyst:
    """Notes what is asked; `locked`, it fails."""

    def __init__(self) -> None:
        self.asked: list[tuple[Any, ...]] = []
        self.locked = False

    async def ask(self, what: str, store: Path, *arguments: Any) -> Any:
        self.asked.append((what, store, *arguments))
        if self.locked:
            raise DataError("another program has been writing")
        return {"run_id": "0003", "before": {"valid": False, "reason": "a door slammed"}}


def analyses_of(analyst: Analyst, told: list[str]) -> Analyses:
    panes: Any = SimpleNamespace(workbench=SimpleNamespace(is_running=False), results=None)
    made = Analyses(panes, (), lambda _, work: asyncio.run(work), lambda text, _: told.append(text))
    vars(made)["_analyst"] = analyst
    return made


def test_a_mark_taken_back_gives_the_run_the_reason_it_had() -> None:
    analyst = Analyst()
    analyses = analyses_of(analyst, [])
    analyses.ask(HERE, "mark", "0003", True, "it was another door")
    assert analyses.undo(HERE) == "mark of run 0003"
    assert analyst.asked[-1] == ("mark", HERE, "0003", False, "a door slammed")
    assert analyses.undo(HERE) == ""


def test_nothing_is_taken_back_in_a_store_that_is_not_open() -> None:
    analyst = Analyst()
    analyses = analyses_of(analyst, [])
    analyses.ask(HERE, "add", ["roll-gravity"])
    analyses.ask(THERE, "add", ["resonance"])
    assert analyses.undo(HERE) == "add roll-gravity"
    assert analyst.asked[-1] == ("remove", HERE, ["roll-gravity"])
    assert analyses.undo(HERE) == ""
    assert analyses.undo(THERE) == "add resonance"


def test_what_could_not_be_taken_back_still_can_be() -> None:
    analyst, told = Analyst(), []
    analyses = analyses_of(analyst, told)
    analyses.ask(HERE, "remove", ["resonance"])
    analyst.locked = True
    assert analyses.undo(HERE) == "remove resonance"
    assert told == ["another program has been writing"]
    analyst.locked = False
    assert analyses.undo(HERE) == "remove resonance"
    assert analyst.asked[-1] == ("add", HERE, ["resonance"])
