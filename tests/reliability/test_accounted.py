"""What the trials hold a campaign's events to: nothing given up in silence, no alarm before its fault."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from rigctl.campaign.recording import Header
from rigctl.campaign.store.store import Store
from simulators.measured import Measurement, into_file
from tests.reliability.accounted import unaccounted

STRUCK_S = 100.0


class Scene:
    """A store, and a file in which one fault has struck."""

    def __init__(self, place: Path, store: Store) -> None:
        self.store, self.measured = store, place / "measured.jsonl"
        at_s = np.array([STRUCK_S])
        into_file(self.measured)(Measurement("stage", "fault late", 1, 1, at_s, np.ones(1)))

    def give_up(self, key: str, why: str) -> None:
        with pytest.raises(RuntimeError), self.store.begin_run(key, "s", {"axis": "X"}):
            raise RuntimeError(why)

    def judged(self, *planned: str, own_clock: bool = False) -> str:
        return unaccounted(self.store.path, self.measured, planned, own_clock=own_clock)


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[Scene]:
    with Store.create(tmp_path / "x.rig.sqlite", Header("sensing-axis")) as store:
        yield Scene(tmp_path, store)


def test_a_run_that_was_given_up_needs_an_event_of_its_own(scene: Scene) -> None:
    scene.give_up("a", "no answer")
    scene.store.add_event("run-repeated", {"key": "b"}, STRUCK_S)
    assert "(a) was given up (RuntimeError: no answer), and no event says so" in scene.judged("late")
    scene.store.add_event("run-repeated", {"key": "a"}, STRUCK_S)
    assert scene.judged("late") == ""


def test_a_run_that_is_not_valid_needs_a_reason(scene: Scene) -> None:
    with scene.store.begin_run("a", "s", {"axis": "X"}) as writer:
        writer.finish(valid=False)
    assert "is not valid and has no reason" in scene.judged("late")


def test_an_alarm_before_the_first_strike_is_false(scene: Scene) -> None:
    scene.store.add_event("fault", {"text": "stage: gone"}, STRUCK_S)
    assert scene.judged("late") == ""
    scene.store.add_event("fault", {"text": "lasers: gone"}, STRUCK_S - 5.0)
    assert scene.judged("late") == "an event tells of a fault before there was one: lasers: gone"
    assert scene.judged("late", "clock_drift") == "", "which strikes without a word"
    assert scene.judged("late", own_clock=True) == "", "its times are those of another clock"
