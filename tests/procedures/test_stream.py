"""The two meters' rows come in order whatever happens to a record: what was lost is NaN, and said."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from procedures.pace import TIMING_S
from procedures.rotating_platform.stream import RETRIES_S, Stream
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import Aborted, InstrumentError, LinkLost, OutOfStep, ProcedureError
from simulators.clock import VirtualClock

PERIOD_S, DELAY_S = 0.1, 0.003


@dataclass
class Hall:
    """A session's clock and events, and nothing else of it."""

    clock: VirtualClock = field(default_factory=VirtualClock)
    told: list[tuple[str, dict[str, Any]]] = field(default_factory=list)
    aborted: bool = False

    def wait_s(self, duration_s: float) -> None:
        if self.aborted:
            raise Aborted("asked to")
        self.clock.sleep_s(duration_s)

    def event(self, kind: str, **data: Any) -> None:
        self.told.append((kind, data))

    def of(self, kind: str) -> list[dict[str, Any]]:
        return [data for name, data in self.told if name == kind]


class Edges:
    """The trigger line: when the record began, and how many edges it has; the timer stands still once, or drifts."""

    first_s, count = np.inf, 0
    jump_at_s, jump_s, drift = np.inf, 0.0, 0.0

    def at_s(self) -> FloatArray:
        """When each edge of the record really is."""
        even_s = self.first_s + np.arange(self.count) * PERIOD_S * (1.0 + self.drift)
        stood_still = (even_s > self.jump_at_s) & (self.first_s < self.jump_at_s)
        return even_s + np.where(stood_still, self.jump_s, 0.0)


class Meter:
    """Reads the time of each edge; raises what it is told to at certain fetches."""

    def __init__(self, name: str, hall: Hall, edges: Edges, longest: int, fails: dict[int, Exception]) -> None:
        self.name, self._hall, self._edges, self._longest = name, hall, edges, longest
        self._fails, self._fetches, self._taken, self._on = fails, 0, 0, False
        self.first_sample_after_s = DELAY_S
        self.starts = 0
        self.doubts: dict[int, Exception] = {}
        self.refuses: Exception | None = None
        self.opened, self.dead_until_s = 0, 0.0
        self.misses: Callable[[FloatArray], Any] = lambda edges_s: np.zeros(len(edges_s), dtype=bool)

    def longest_record(self, period_s: float) -> int:
        return self._longest

    def start(self, samples: int, period_s: float, at_s: float | None = None) -> float:
        self._begin(samples)
        if at_s is not None:
            self._hall.clock.sleep_s(max(at_s - self._hall.clock.now_s(), 0.0))
        self._edges.first_s, self._edges.count = self._hall.clock.now_s() + DELAY_S, samples
        return self._hall.clock.now_s()

    def follow(self, samples: int, period_s: float) -> None:
        self._begin(samples)

    def _begin(self, samples: int) -> None:
        assert 1 <= samples <= self._longest
        if self.refuses is not None:
            raise self.refuses
        self.starts += 1
        self._taken, self._on = 0, True

    def stop(self) -> None:
        self._on = False

    def confirm_in_step(self) -> None:
        if (error := self.doubts.pop(self._fetches, None)) is not None:
            raise error

    def close(self) -> None:
        self._on = False

    def open(self) -> None:
        if self._hall.clock.now_s() < self.dead_until_s:
            raise LinkLost(f"{self.name}: still no connection")
        self.opened += 1

    def fetch(self) -> FloatArray:
        self._fetches += 1
        if (error := self._fails.pop(self._fetches, None)) is not None:
            raise error
        if not self._on:
            return np.empty((0, 1))
        edges_s = self._edges.at_s()
        came_s = edges_s[(edges_s <= self._hall.clock.now_s() + 1e-6) & ~self.misses(edges_s)][self._taken :]
        self._taken += len(came_s)
        return came_s[:, np.newaxis]


def setting(
    samples: int, longest: int = 10**6, breaks: tuple[int, ...] = (), **fails: dict[int, Exception]
) -> tuple[Hall, Stream, Meter, Meter]:
    hall, edges = Hall(), Edges()
    a = Meter("a", hall, edges, longest, dict(fails.get("a", {})))
    b = Meter("b", hall, edges, longest, dict(fails.get("b", {})))
    return hall, Stream(hall, (a, b), samples, PERIOD_S, breaks), a, b  # type: ignore[arg-type]


def everything(hall: Hall, stream: Stream, look_s: float, within_s: float = 1e-6) -> FloatArray:
    """All rows, made sure to come in order and at the times they belong to."""
    stream.begin()
    rows, at = [], 0
    while not stream.finished:
        hall.wait_s(look_s)
        for block in stream.fetch():
            assert block.first == at
            times_s = stream.begun_s + (block.first + np.arange(len(block.rows))) * PERIOD_S + block.late_s
            known = ~np.isnan(block.rows)
            assert block.rows[known] == pytest.approx(np.stack([times_s, times_s], axis=1)[known], abs=within_s)
            assert abs(block.late_s) <= 0.5 * PERIOD_S
            at += len(block.rows)
            rows.append(block.rows)
    return np.concatenate(rows)


def test_a_short_run_is_one_record() -> None:
    hall, stream, a, b = setting(500)
    rows = everything(hall, stream, 7.0)
    assert rows.shape == (500, 2)
    assert not np.isnan(rows).any()
    assert (a.starts, b.starts, stream.lost, hall.told) == (1, 1, 0, [])


def test_a_run_longer_than_a_record_is_several_which_end_at_a_break() -> None:
    hall, stream, a, _ = setting(1000, longest=300, breaks=(100, 280, 290, 500, 560, 800, 830))
    rows = everything(hall, stream, 0.5)
    begun = [0, *(told["sample"] for told in hall.of("record"))]
    assert a.starts == 4
    for at, wanted in zip(begun[1:], (290, 560, 830), strict=True):
        assert wanted <= at <= wanted + 6, "a record ends at the last break it reaches"
    lost = np.flatnonzero(np.isnan(rows).any(axis=1))
    assert stream.lost == len(lost) == sum(told["samples"] for told in hall.of("gap"))


def test_without_breaks_hardly_anything_is_lost_between_records() -> None:
    hall, stream, a, _ = setting(1000, longest=250)
    rows = everything(hall, stream, 0.1)
    assert a.starts == 4
    assert np.isnan(rows).any(axis=1).sum() <= 6


@pytest.mark.parametrize("error", [InstrumentError("a: its memory overflowed"), LinkLost("a: no connection")])
@pytest.mark.parametrize("which", ["a", "b"])
def test_one_glitch_costs_a_gap_and_not_the_run(error: Exception, which: str) -> None:
    hall, stream, a, b = setting(600, **{which: {5: error}})
    rows = everything(hall, stream, 3.0)
    assert len(rows) == 600
    assert 0 < np.isnan(rows).any(axis=1).sum() < 70
    assert [told["error"] for told in hall.of("record-lost")] == [str(error)]
    assert a.starts == b.starts == 2
    assert sum(told["samples"] for told in hall.of("gap")) == stream.lost == np.isnan(rows).any(axis=1).sum()


def test_rows_that_one_meter_alone_has_are_kept() -> None:
    hall, stream, _, _ = setting(400, b={4: InstrumentError("b: edges were lost")})
    rows = everything(hall, stream, 3.0)
    only_a = ~np.isnan(rows[:, 0]) & np.isnan(rows[:, 1])
    assert only_a.sum() == 30


def test_a_meter_that_fails_again_and_again_ends_the_run_with_its_words() -> None:
    hall, stream, a, _ = setting(60_000)
    stream.begin()
    a._fails[1] = InstrumentError("a: broken")
    a.refuses = InstrumentError("a: still broken")
    hall.wait_s(3.0)
    with pytest.raises(ProcedureError, match="records in a row failed, the last one: a: still broken"):
        stream.fetch()
    assert len(hall.of("record-lost")) == len(RETRIES_S)
    assert hall.clock.now_s() == pytest.approx(3.0 + sum(RETRIES_S), abs=1.0)


@pytest.mark.parametrize("which", ["a", "b"])
def test_a_meter_whose_every_record_fails_after_some_rows_ends_the_run(which: str) -> None:
    hall, stream, a, b = setting(60_000)
    # A record gives some rows at the first look after its start, and fails at the next.
    {"a": a, "b": b}[which]._fails = {fetch: InstrumentError(f"{which}: no number") for fetch in range(2, 400, 3)}
    stream.begin()

    def look_on() -> None:
        while not stream.finished:
            hall.wait_s(2.0)
            assert sum(len(block.rows) for block in stream.fetch()) > 10
            hall.wait_s(60.0)
            stream.fetch()

    with pytest.raises(ProcedureError, match=f"^{len(RETRIES_S) + 1} records in a row failed, .* {which}: no number"):
        look_on()
    # The last record's rows are lost as well, and were given up with the run.
    assert sum(told["samples"] for told in hall.of("gap")) == stream.lost > 3000


def test_a_long_silence_is_over_when_a_record_has_given_what_it_kept_back() -> None:
    hall, stream, _, b = setting(20_000, b={4: LinkLost("b: no connection")})
    b.dead_until_s = 200.0
    # A minute and more after it is back, and long before as much has come as was lost meanwhile.
    b._fails[20] = LinkLost("b: no connection again")
    rows = everything(hall, stream, 10.0)
    *silence, again = hall.of("record-lost")
    assert (len(silence), again["error"]) == (len(RETRIES_S), "b: no connection again")
    lost = np.isnan(rows[:, 1])
    assert lost[: again["sample"]].sum() > 2 * (~lost[lost.argmax() : again["sample"]]).sum()


def test_records_that_give_more_than_their_failures_cost_go_on() -> None:
    fails = {look: InstrumentError("b: its memory overflowed") for look in range(5, 200, 5)}
    hall, stream, _, _ = setting(20_000, b=fails)
    rows = everything(hall, stream, 20.0)
    assert len(hall.of("record-lost")) > 2 * len(RETRIES_S)
    assert np.isnan(rows).any(axis=1).mean() < 0.5


def test_a_line_that_was_broken_is_connected_again() -> None:
    hall, stream, _, b = setting(9000, b={4: LinkLost("b: no connection")})
    b.dead_until_s = 60.0
    rows = everything(hall, stream, 10.0)
    lost = np.isnan(rows).any(axis=1)
    assert 300 < lost.sum() < 1500
    assert lost[lost.argmax() : lost.argmax() + lost.sum()].all(), "one gap"
    assert b.opened == 1
    assert len(hall.of("record-lost")) == 4


def test_a_meter_that_stays_silent_is_started_anew() -> None:
    hall, stream, _, b = setting(300)
    stream.begin()
    hall.wait_s(20.0)
    b.stop()
    rows = []
    while not stream.finished:
        hall.wait_s(10.0)
        rows += [block.rows for block in stream.fetch()]
    assert sum(map(len, rows)) == 300
    assert "b: 300 samples never came" in hall.of("record-lost")[0]["error"]


def test_an_abort_is_not_taken_for_a_glitch() -> None:
    hall, stream, a, _ = setting(600)
    stream.begin()
    hall.wait_s(3.0)
    a._fails[1] = InstrumentError("a: readings never came; was it stopped from elsewhere?")
    hall.aborted = True
    with pytest.raises(Aborted):
        stream.fetch()
    assert a.starts == 1


@settings(deadline=None, max_examples=80)
@given(
    samples=st.integers(1, 900),
    longest=st.integers(40, 400),
    breaks=st.sets(st.integers(1, 900), max_size=12),
    failing=st.lists(st.tuples(st.sampled_from("ab"), st.integers(2, 40)), max_size=3),
    look_s=st.sampled_from([0.03, 0.1, 1.0, 7.7]),
)
def test_whatever_fails_when_no_row_is_out_of_its_place(
    samples: int, longest: int, breaks: set[int], failing: list[tuple[str, int]], look_s: float
) -> None:
    fails: dict[str, dict[int, Exception]] = {
        name: {n: InstrumentError(f"{name}: failed") for meter, n in failing if meter == name} for name in "ab"
    }
    hall, stream, _, _ = setting(samples, longest, tuple(sorted(breaks)), **fails)
    rows = everything(hall, stream, look_s)
    assert len(rows) == samples
    assert stream.lost == np.isnan(rows).any(axis=1).sum()


def test_rows_in_doubt_are_not_given_out_and_another_record_is_begun() -> None:
    hall, stream, a, b = setting(500)
    b.doubts = {3: OutOfStep("b: a reply too many")}
    rows = everything(hall, stream, 7.0)
    assert (a.starts, b.starts) == (2, 2)
    doubted = np.flatnonzero(np.isnan(rows[:, 1]))
    assert 70 <= len(doubted) <= 90, "seven seconds, and what it takes to begin another record"
    assert [told["error"] for told in hall.of("fault")] == ["OutOfStep"]


@pytest.mark.parametrize("jump_s", [0.3, 5.0])
def test_a_timer_that_stands_still_leaves_no_row_away_from_its_time(jump_s: float) -> None:
    hall, stream, a, _ = setting(900)
    a._edges.jump_at_s, a._edges.jump_s = 30.0, jump_s
    rows = everything(hall, stream, 7.0)
    assert re.match(r"a: sample 3\d\d comes .* too late for its time stamp", hall.of("fault")[0]["text"])
    assert a.starts == 2
    assert 70 <= np.isnan(rows[:, 0]).sum() <= 90, "seven seconds, and what it takes to begin another record"


@pytest.mark.parametrize("drift", [1e-3, -1e-3])
def test_a_timer_that_drifts_is_started_anew_before_its_rows_are_away_from_their_times(drift: float) -> None:
    hall, stream, a, _ = setting(9000)
    a._edges.drift = drift
    rows = everything(hall, stream, 1.0, within_s=TIMING_S + PERIOD_S)
    assert 3 <= a.starts - 1 <= 5, "900 s of 1e-3 are four times the tolerance"
    assert np.isnan(rows).any(axis=1).sum() < 30 * a.starts


@pytest.mark.parametrize("missed", [1, 40])
def test_after_an_edge_that_one_meter_missed_no_row_has_anothers_place(missed: int) -> None:
    hall, stream, _, b = setting(900)
    b.misses = lambda edges_s: (edges_s > 30.0) & (edges_s < 30.0 + missed * PERIOD_S - 1e-6)
    rows = everything(hall, stream, 7.0)
    assert f"b: {missed} samples never came" in hall.of("fault")[0]["text"]
    assert np.isnan(rows[:, 0]).sum() < 10
    assert 70 <= np.isnan(rows[:, 1]).sum() <= 90
