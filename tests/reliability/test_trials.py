"""The trials themselves: they see what they are to see, and keep count."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from simulators.faults import FaultPlan
from tests.reliability import fuzzed_replies, simulated_days, single_faults, truth
from tests.reliability.__main__ import table, with_table
from tests.reliability.bounds import upper_bound
from tests.reliability.campaigns import SMALL_CAMPAIGNS
from tests.reliability.commands import Outcome, here
from tests.reliability.records import Records, tally
from tests.reliability.stops import orders
from tests.reliability.truth import wrong_number
from tests.reliability.wires import Sent


def test_the_bound_is_that_of_clopper_and_pearson() -> None:
    assert upper_bound(0, 300) == pytest.approx(1.0 - 0.05 ** (1 / 300))
    assert upper_bound(1, 20) == pytest.approx(0.2161, abs=1e-4)  # Clopper and Pearson 1934
    assert upper_bound(5, 5) == 1.0


def test_lines_add_up_over_runs_and_a_torn_one_is_tried_again(tmp_path: Path) -> None:
    Records(tmp_path).add("kind", {"seed": 1, "failed": "", "tried": 10})
    with (tmp_path / "kind.jsonl").open("a") as file:
        file.write('{"seed": 2, "fai')
    again = Records(tmp_path)
    assert [line["seed"] for line in again.lines("kind")] == [1]
    again.add("kind", {"seed": 2, "failed": "broken", "tried": 10, "failures": 3})
    found = tally(again.lines("kind"))
    assert (found.seeds, found.tried, found.failures) == (2, 20, 3)


def test_directories_add_up_into_the_table_of_a_page(tmp_path: Path) -> None:
    Records(tmp_path / "a").add("signals", {"seed": 1, "failed": ""})
    Records(tmp_path / "b").add("signals", {"seed": 2, "failed": "broken"})
    rows = table(Records(tmp_path / "a", tmp_path / "b"), ["signals"])
    assert "| 2 | 2 endings | 1 |" in rows[2]
    assert with_table(f"Before.\n\n{rows[0]}\n|---|\n| old |\n\nAfter.\n", rows) == "\n".join(
        ["Before.", "", *rows, "", "After.", ""]
    )


@pytest.mark.parametrize(
    ("outcome", "said"),
    [
        (Outcome(0, "", ""), ""),
        (Outcome(1, "", "stage: no connection; check power"), ""),
        (Outcome(1, "", ""), "without a word"),
        (Outcome(-9, "", ""), "exit status -9"),
        (Outcome(1, "", "Traceback (most recent call last):\nKeyError: 3"), "untyped"),
        (Outcome(0, "", "x.py:3: RuntimeWarning: Mean of empty slice"), "untyped"),
    ],
)
def test_a_command_that_ends_badly_is_seen(outcome: Outcome, said: str) -> None:
    assert said in outcome.broken()
    assert bool(outcome.broken()) == bool(said)


def test_a_number_that_no_instrument_measured_is_seen(tmp_path: Path) -> None:
    small = SMALL_CAMPAIGNS["angle-scan"]
    small.write(tmp_path, small.rig_text.replace("[world]\n", '[world]\nmeasured = "measured.jsonl"\n', 1))
    assert here(tmp_path, "run", "campaign.toml", "--store", "x.rig.sqlite", "--yes").status == 0
    store, measured = tmp_path / "x.rig.sqlite", tmp_path / "measured.jsonl"
    assert wrong_number(store, measured) == ""
    lines = [json.loads(line) for line in measured.read_text().splitlines()]
    recorded = max((line for line in lines if line["channel"] == "laser_3_mm"), key=lambda line: len(line["values"]))
    recorded["values"][7] += 1e-4
    measured.write_text("".join(json.dumps(line) + "\n" for line in lines))
    assert "1 of " in wrong_number(store, measured)
    assert re.search(r"laser_3_mm are wrong: sample \d", wrong_number(store, measured))


def test_what_moves_and_what_stops_is_told_from_the_wire() -> None:
    sent = [
        Sent(1.0, "rotation", b"GroupStatusGet(Group1,int *)"),
        Sent(2.0, "rotation", b"GroupMoveAbsolute(Group1,20)"),
        Sent(3.0, "stage", b"ABORT X\nAXISSTATUS(X)\nENABLE X\n"),
        Sent(4.0, "spare", b"1MO?\r1PA?\r1PA20\r1ST\r1MD?\r"),
    ]
    found = [(order.instrument, order.what) for order in orders(sent)]
    moving, stopping = "motion", "stop"
    assert found == [
        ("rotation", moving),
        ("stage", stopping),
        ("stage", moving),
        ("spare", moving),
        ("spare", stopping),
    ]


def test_an_untyped_error_of_a_driver_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Careless:
        def __init__(self, endpoint: Any, clock: Any) -> None:
            self._line = endpoint.connect(lambda data: int(data))

        def identify(self) -> None:
            self._line.receive(b"?")

        open = stop = identify

        def close(self) -> None:
            pass

    monkeypatch.setattr(fuzzed_replies, "_recorded", lambda: {"careless": (Careless, {b"?": [b"1"]})})
    found = fuzzed_replies.trial(2, tmp_path)
    assert "careless: ValueError" in found["failed"]
    assert "careless: ValueError" in (tmp_path / "failures.txt").read_text()


def test_every_driver_is_answered_from_what_its_simulator_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fuzzed_replies, "REPLIES", 4000)
    found = fuzzed_replies.trial(1, tmp_path)
    assert found["failed"] == ""
    assert found["tried"] > 1000
    assert len(found["refused"]) >= 10


def test_a_day_that_a_fault_refused_is_begun_again_with_other_faults(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(simulated_days, "_with_faults", lambda draw, rig, work: {str(draw): FaultPlan()})

    def refused_twice(work: Path, *arguments: object) -> Outcome:
        tried.append(arguments)
        if len(tried) == 3:
            (work / "x.rig.sqlite").touch()
        return Outcome(int(len(tried) < 3), "", "stage: no connection; check power")

    tried: list[tuple[object, ...]] = []
    monkeypatch.setattr(simulated_days, "here", refused_twice)
    outcomes, faults = simulated_days.begun(13, "any", tmp_path)
    assert [outcome.status for outcome in outcomes] == [1, 1, 0]
    assert list(faults) == ["2000013"]
    assert len(set(tried)) == 1


def test_every_kind_of_fault_has_a_campaign_that_tells_of_it() -> None:
    kinds = set(FaultPlan.model_fields) - {"seed"}
    assert {single.fault for single in single_faults.SINGLE_FAULTS if not single.silence} == kinds


@pytest.mark.parametrize(
    ("fault", "instrument", "said"),
    [
        ("following_error", "stage", r"stage: it is homed no more.*following error"),
        ("target_lost", "lasers_a", r"\d+ of 666 samples of laser_1_mm are missing; does the head see its target"),
        ("saturation", "q_b", "q_b: 20 readings were beyond its range"),
        ("command_bits", "lasers_b", r"lasers_b: SW,CI,0,001167,03 is CI,.* when it is read back"),
        ("command_lost", "rotation", "rotation: '1OR' has not begun"),
    ],
)
def test_the_operator_is_told_of_a_fault_first(tmp_path: Path, fault: str, instrument: str, said: str) -> None:
    (single,) = [s for s in single_faults.SINGLE_FAULTS if (s.fault, s.instrument) == (fault, instrument)]
    assert re.match(f".*{said}", single_faults.said_of(single, tmp_path)[0])


@pytest.mark.parametrize("late_rows", [0.0, 0.3, 0.5, -1.5, 2.4])
def test_a_clock_that_drifts_past_half_a_row_is_laid_where_its_values_were_measured(late_rows: float) -> None:
    at_s = 0.01 * np.arange(2400)
    measured = truth.Truth(at_s, np.random.default_rng(1).normal(size=2400))
    taken = slice(200, 2200)
    own_s = (at_s[taken] - at_s[200]) * (1.0 + 4e-5) + at_s[200] + 0.01 * late_rows - 4e-4
    laid_s = truth._nearest_rows(own_s, measured.values[taken], 0.0, measured)
    assert np.array_equal(measured.at(laid_s)[0], measured.values[taken])
