"""Two meters on one grid of times for as long as it takes: rows come in order, what was lost of them is NaN.

Time stamps are the host's: a record whose samples do not come at their times is given up (`pace.py`). So is one in
which a trigger edge was lost; where edges follow each other as fast as questions, that may show some fetches later.

A meter's record holds a limited number of samples. A longer run is several of them, which end where the platform
turns if they can, so that what passes between two records is mostly not wanted. A record that fails is given up and
another begun: a run of days is not repeated for one glitch.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from procedures.pace import Pace
from rigctl.campaign.session.recovery import Apparatus, fault_data
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.entries import FAULT
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import InstrumentError, LinkError, ProcedureError, RigError
from rigctl.core.interfaces import Instrument, PacingRecorder, StreamedRecorder, Voltmeter

PREPARE_S = 0.05
"""Setting up the pacing meter for a record that begins at a given time."""
RETRIES_S = (PREPARE_S, 1.0, 10.0, 60.0, 300.0)
"""How long to wait before another record, after one failure in a row, after two ...: then the run is given up.

Failures are in a row until as many rows have come as the last failed record kept back: else a meter whose every
record gives a few rows before it fails would cost days, and nobody would be told.
"""
GRACE_S = 2.0
"""How long after its edge a sample may come."""
LOOK_S, LOOKS = 0.01, 3
"""A meter whose sample is not there yet is asked again so much later, so often."""
GAP_ROWS = 100_000
"""Rows of a gap that are made at a time."""


class PacingMeter(Voltmeter, PacingRecorder, Protocol):
    """The meter whose sample timer all follow; it can begin at a given time."""

    def start(self, samples: int, period_s: float, at_s: float | None = None) -> float:
        """As `PacingRecorder.start`, not before `at_s`."""
        ...


class FollowingMeter(Instrument, StreamedRecorder, Protocol):
    """A meter that follows its edges."""

    @property
    def first_sample_after_s(self) -> float:
        """From an edge to its sample."""
        ...


@dataclass(frozen=True)
class Block:
    """Successive rows, shape (n, 2): the pacing meter's column, then the other's.

    Row i was taken at `first` + i sample periods after the stream's beginning, and `late_s` more.
    """

    first: int
    rows: FloatArray
    late_s: float


class Stream:
    """`samples` rows, `period_s` apart; records end before one of the sorted sample numbers `breaks` if they can."""

    def __init__(
        self,
        session: Session,
        meters: tuple[PacingMeter, FollowingMeter],
        samples: int,
        period_s: float,
        breaks: Sequence[int] = (),
    ) -> None:
        self._session = session
        self._pacing, self._following = meters
        self._apparatus = Apparatus(others=meters)
        self._samples, self._period_s = samples, period_s
        self._breaks = list(breaks)
        self._longest = self._pacing.longest_record(period_s)
        self._begun_s = math.nan
        self._next = 0
        self._first = self._end = 0
        self._pace = Pace(math.inf, period_s, 0, 0.0)
        self._late_s = 0.0
        self._waiting = [np.empty(0), np.empty(0)]
        self._blocks: list[Block] = []
        self._failures = 0
        self._owed = 0
        self.lost = 0
        self._overloads = {meter.name: 0 for meter in meters}

    @property
    def finished(self) -> bool:
        """Whether all rows have been given out."""
        return self._next >= self._samples

    @property
    def record_ends_s(self) -> float:
        """Rig time of the last sample of the record that is running."""
        return self._time_s(self._end - 1)

    @property
    def begun_s(self) -> float:
        """Rig time of the first sample; NaN before `begin`."""
        return self._begun_s

    def remark(self, samples: int) -> str:
        """What is said of the `samples` that are kept: how many were lost, and how many beyond a meter's range."""
        lost = [f"{self.lost} of {samples} samples were lost"] if self.lost else []
        beyond = [f"{name}: {n} readings were beyond its range" for name, n in self._overloads.items() if n]
        return "; ".join([*lost, *beyond])

    def begin(self) -> None:
        """Start the first record; errors of the meters are not borne here: nothing would be lost by a new start."""
        self._begin_record(None)

    def fetch(self) -> list[Block]:
        """The rows since the last call; begins the next record when one is complete.

        Raises `ProcedureError` when several records in a row fail.
        """
        # A record that ends between two fetches begins the next one at once, which may have rows already.
        while not self.finished:
            try:
                self._take()
                if self._next < self._end:
                    break
                self._go_on()
            except (InstrumentError, LinkError) as error:
                self._recover(error)
        blocks, self._blocks = self._blocks, []
        return blocks

    def give_up(self, error: RigError, doubted: range) -> None:
        """Begin another record: what came of this one cannot be true, `doubted` of the rows that were given out."""
        self._lose(doubted)
        if self.finished:
            self._tell(error)
        else:
            self._recover(error, len(doubted))

    def _take(self) -> None:
        """Rows that both meters have, after waiting for the last of a record that is over."""
        while True:
            self._take_pairs()
            a, b = self._waiting
            # Rows are pairs: one meter may be a sample ahead of the other.
            count = min(len(a), len(b), self._end - self._next)
            self._waiting = [a[count:], b[count:]]
            if count:
                self._came(count)
                self._give(np.stack([a[:count], b[:count]], axis=1))
            over_s = self._session.clock.now_s() - self.record_ends_s
            if self._next >= self._end or over_s < 0.0:
                return
            if over_s > GRACE_S:
                raise InstrumentError(
                    f"{self._following.name}: {self._end - self._next} samples at the end of a record never came"
                )
            self._session.wait_s(LOOK_S)

    def _take_pairs(self) -> None:
        """What both have; nothing of the following meter where it lacks a sample: whose are the others?"""
        reading_s = self._following.first_sample_after_s + LOOK_S
        # So many samples may lie between the answers of the two.
        behind = int(2.0 * reading_s / self._period_s)
        for _ in range(LOOKS):
            # One after the other: what the first has is kept when the second fails.
            self._take_paces()
            self._waiting[1] = np.concatenate([self._waiting[1], self._rows_of(self._following)])
            missing = len(self._waiting[0]) - len(self._waiting[1])
            if missing <= behind:
                return
            self._session.wait_s(reading_s)
        # Which edge it missed is unknown, so none of its samples can be given a time.
        self._waiting[1] = np.empty(0)
        raise InstrumentError(
            f"{self._following.name}: {missing} samples never came; check the trigger line",
            instrument=self._following.name,
        )

    def _take_paces(self) -> None:
        """What the pacing meter has; none of it where samples do not come when they should."""
        asked_s = self._session.clock.now_s()
        rows = self._rows_of(self._pacing)
        # Counted from the beginning of the record, as its time stamps are.
        came = self._next - self._first + len(self._waiting[0]) + len(rows)
        self._pace.require(self._pacing.name, came, asked_s, self._session.clock.now_s())
        self._waiting[0] = np.concatenate([self._waiting[0], rows])

    def _rows_of(self, meter: PacingMeter | FollowingMeter) -> FloatArray:
        rows = meter.fetch()[:, 0]
        if len(rows):
            meter.confirm_in_step()
        # A meter gives NaN for an overload; what is lost it does not give at all.
        self._overloads[meter.name] += int(np.sum(np.isnan(rows)))
        return rows

    def _go_on(self) -> None:
        """The next record, and rows for what passed meanwhile."""
        if not self.finished:
            self._pass(self._begin_record(self._next))

    def _came(self, count: int) -> None:
        """So many rows count as measured: they may end a series of failures."""
        self._owed = max(self._owed - count, 0)
        if not self._owed:
            self._failures = 0

    def _lose(self, rows: range) -> None:
        """Note that nothing, or nothing of one meter, is known of these rows."""
        if rows:
            self._session.event("gap", sample=rows.start, samples=len(rows))
            self.lost += len(rows)

    def _recover(self, error: RigError, doubted: int = 0) -> None:
        """After a record failed: what one meter alone had, and another record."""
        # What passes until the next record begins is kept back by nobody.
        due = math.ceil((self._session.clock.now_s() - self._time_s(self._next)) / self._period_s)
        self._owed = doubted + max(due, 0)
        self._give_unpaired()
        while True:
            if self._failures >= len(RETRIES_S):
                raise ProcedureError(
                    f"{self._failures + 1} records in a row failed, the last one: {error}"
                ) from error
            self._tell(error)
            # Both, whichever failed: their samples are pairs, and both begin the next record.
            for meter in (self._pacing, self._following):
                with suppress(RigError):
                    meter.stop()
            # Longer after every failure in a row; the samples of that time are a gap.
            self._session.wait_s(RETRIES_S[self._failures])
            self._failures += 1
            try:
                if isinstance(error, LinkError):
                    self._reconnect()
                return self._go_on()
            except (InstrumentError, LinkError) as again:
                error = again

    def _tell(self, error: RigError) -> None:
        """Note that a record is given up, and what for."""
        self._session.event("record-lost", sample=self._next, error=str(error))
        self._session.event(FAULT, during=f"sample {self._next}", **fault_data(error, self._apparatus))

    def _reconnect(self) -> None:
        """Nobody can tell whose line it was."""
        for meter in (self._pacing, self._following):
            meter.close()
            meter.open()

    def _give_unpaired(self) -> None:
        a, b = self._waiting
        count = min(max(len(a), len(b)), self._end - self._next)
        rows = np.full((count, 2), np.nan)
        rows[: len(a), 0], rows[: len(b), 1] = a[:count], b[:count]
        self._waiting = [np.empty(0), np.empty(0)]
        self._lose(range(self._next, self._next + count))
        self._give(rows)

    def _pass(self, number: int) -> None:
        """Rows up to a sample number, of which nothing is known."""
        self._lose(range(self._next, number))
        while self._next < number:
            self._give(np.full((min(number - self._next, GAP_ROWS), 2), np.nan))

    def _give(self, rows: FloatArray) -> None:
        if len(rows):
            self._blocks.append(Block(self._next, rows, self._late_s))
            self._next += len(rows)

    def _begin_record(self, number: int | None) -> int:
        """Start a record at a sample number, or as soon after it as can be; returns the number it began with."""
        delay_s = self._pacing.first_sample_after_s
        self._waiting = [np.empty(0), np.empty(0)]
        if number is None:
            end = self._end_after(0)
            # Armed before the other starts, or its first edges would be missed.
            self._following.follow(end, self._period_s)
            started_s = self._pacing.start(end, self._period_s)
            self._set_pace(started_s, end)
            self._begun_s = started_s + delay_s
            self._first, self._end = 0, end
            return 0
        soonest_s = self._session.clock.now_s() + PREPARE_S + delay_s
        # A grid time far enough ahead to be set up for.
        planned = max(number, math.ceil((soonest_s - self._begun_s) / self._period_s))
        if planned >= self._samples:
            self._first = self._end = self._samples
            return self._samples
        end = self._end_after(planned)
        self._following.follow(end - planned, self._period_s)
        at_s = self._time_s(planned) - delay_s
        started_s = self._pacing.start(end - planned, self._period_s, at_s)
        self._set_pace(started_s, end - planned)
        first_s = started_s + delay_s
        # The start may come later than asked for; samples are then numbered by when they really come.
        began = round((first_s - self._begun_s) / self._period_s)
        self._late_s = first_s - self._time_s(began)
        # As many samples as planned, but none beyond the run.
        self._first, self._end = began, min(end + began - planned, self._samples)
        self._session.event("record", sample=began, late_s=self._late_s)
        return began

    def _set_pace(self, started_s: float, samples: int) -> None:
        delay_s = self._pacing.first_sample_after_s
        self._pace = Pace.of_record(self._session.clock, started_s, delay_s, self._period_s, samples)

    def _end_after(self, number: int) -> int:
        """Where a record from `number` on ends: at the last break it reaches, if that is not its own beginning."""
        reach = number + self._longest
        if reach >= self._samples:
            return self._samples
        # The last turn within reach, since no sample counts there.
        index = bisect.bisect_right(self._breaks, reach) - 1
        return self._breaks[index] if index >= 0 and self._breaks[index] > number else reach

    def _time_s(self, number: int) -> float:
        return self._begun_s + number * self._period_s
