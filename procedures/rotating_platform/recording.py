"""One run of the rotating platform while it is recorded."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from itertools import zip_longest
from typing import Any

import numpy as np

from procedures.rotating_platform.bench import TILT_Z, PlatformBench, Wanted, Watch
from procedures.rotating_platform.course import Course, Leg
from procedures.rotating_platform.stream import Block, FollowingMeter, PacingMeter, Stream
from procedures.rotating_platform.time_table import EARLY_S, Motion, shortest_turn_s
from procedures.sample_checks import voltages_flaw
from rigctl.campaign.session.recovery import Faults, fault_data
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.entries import FAULT, TEMPERATURE_MISSED
from rigctl.campaign.store.run_writer import RunWriter
from rigctl.core.arrays import BoolArray, FloatArray
from rigctl.core.errors import InstrumentError, LinkError, RigError
from rigctl.core.voltage_sources import Started

FETCH_S, FETCH_ROWS = 60.0, 10_000
"""Meters are read at least so often: what a crash costs, and what their memories hold many times."""
AT_ONCE_S = 1e-6
SLACK = 1.001
"""The stage reckons with where it stands, not with where it should."""
RUN_UP_S = 0.5
"""Where the platform turns as a run begins, the meters start so long before the turn does."""
ASK_AGAIN_S = 0.01
"""A platform that does not answer is asked once more before its dwell is given up."""
PREPARING_S = 900.0
"""How long platform and meters may take until a record begins: the source's waveforms last for that as well."""
THERMOMETER_S = 3.0
"""A temperature is only read where there is so much time."""


def measure(
    session: Session, bench: PlatformBench, writer: RunWriter, wanted: Wanted, watch: Watch
) -> dict[str, Any]:
    """Carry out a recording into `writer`; returns the conditions found."""
    started = bench.source.start(wanted.tilt, wanted.table.duration_s + bench.settle_s + PREPARING_S)
    bench.platform.move_to(wanted.table.begin_deg)
    session.wait_s(bench.settle_s)
    return RecordingUnderWay(session, bench, writer, wanted, started, watch).made()


class RecordingUnderWay:
    """One run under way. Times are from its beginning, half a sample before its first."""

    def __init__(
        self,
        session: Session,
        bench: PlatformBench,
        writer: RunWriter,
        wanted: Wanted,
        started: Started,
        watch: Watch,
    ) -> None:
        self._session, self._bench, self._writer, self._watch = session, bench, writer, watch
        self._wanted, self._started = wanted, started
        self._period_s = 1.0 / wanted.sample_rate_hz
        motions = wanted.table.motions
        before_s = RUN_UP_S - motions[0].start_s if motions and motions[0].start_s < RUN_UP_S else 0.0
        # Whole samples, so that the run's grid is part of the meters' grid.
        self._run_up = math.ceil(before_s * wanted.sample_rate_hz)
        self._course = Course(wanted.table, bench.standing_deg(wanted.table.begin_deg), self._period_s)
        self._stream = Stream(
            session,
            (bench.readout, bench.voltmeter),
            self._run_up + wanted.samples,
            self._period_s,
            [self._run_up + math.ceil(motion.start_s * wanted.sample_rate_hz - 0.5) for motion in motions],
        )
        self._temperatures_c: list[float] = []
        self._felt_s = self._fetched_s = self._stood_s = 0.0

    def made(self) -> dict[str, Any]:
        """The whole recording."""
        self._temperatures_c.append(self._temperature_c())
        self._stream.begin()
        self._stood_s = self._now_s()
        for motion, after in zip_longest(self._wanted.table.motions, self._wanted.table.motions[1:]):
            self._wait_until(motion.start_s)
            # After a meter's long silence the turns of that time are not made up for.
            if after is None or self._now_s() < after.start_s:
                self._turn(motion)
        self._wait_until(self._wanted.table.duration_s)
        # The last samples are still on their way, or a record is being begun again.
        while not self._stream.finished:
            self._fetch()
            self._session.wait_s(min(self._period_s, 1.0))
        self._feel()
        return self._found()

    def _found(self) -> dict[str, Any]:
        conditions: dict[str, Any] = {
            "start_s": self._rig_time_s(0.5 * self._period_s),
            "temperature_c": _mean(self._temperatures_c),
        }
        driven = self._started.waveforms.get(TILT_Z)
        if driven is not None and driven.shape != "constant":
            conditions["external_period_s"] = driven.period_s
        if remark := self._stream.remark(self._wanted.samples):
            conditions["reason"] = remark
        return conditions

    def _turn(self, motion: Motion) -> None:
        """A turn that begins late takes less time, within limits, so as to be over in time."""
        # A record that ends here is taken in first: the next one begins while the platform turns and nothing counts.
        if self._stream.record_ends_s < self._bench.clock.now_s() + self._period_s:
            self._fetch()
        else:
            self._stands()
        self._carry_out(motion)

    def _carry_out(self, motion: Motion) -> None:
        from_deg, began_s, task = self._course.last_theta_deg, self._now_s(), f"turn to {motion.to_deg:g} deg"
        # The turn alone is tried again; meters and source go on, and its samples count as moving until it is done.
        to_deg, ended_s = self._session.guarded(task, self._bench.turning, lambda: self._turned(motion))
        self._course.add(Leg(began_s, ended_s, from_deg, to_deg))
        self._stood_s = ended_s

    def _stands(self) -> bool:
        """Ask the platform whether it is where it should be.

        If not, nobody knows since when: from when it said so last it counts as moving. A run in which it should not
        move at all is given up: raises what is wrong.
        """
        fault = self._astray()
        if fault is not None:
            self._session.wait_s(ASK_AGAIN_S)
            fault = self._astray()
        if fault is not None and not self._wanted.table.motions:
            raise fault
        now_s, at_deg = self._now_s(), self._course.last_theta_deg
        if fault is not None:
            self._session.event(FAULT, during=f"dwell at {at_deg:g} deg", **fault_data(fault, self._bench.turning))
            self._course.add(Leg(self._stood_s, now_s, at_deg, at_deg))
        self._stood_s = now_s
        return fault is None

    def _astray(self) -> RigError | None:
        """Why the platform cannot be said to stand where it was sent."""
        try:
            self._bench.standing_deg(self._course.last_theta_deg)
        except Faults as fault:
            return fault
        return None

    def _turned(self, motion: Motion) -> tuple[float, float]:
        """Turn from wherever it is; the angle it came to, and when the controller said that it had [deg, s]."""
        stage, from_deg = self._bench.platform, self._bench.platform.angle().value
        shortest_s = SLACK * shortest_turn_s(stage.limits, abs(motion.to_deg - from_deg))
        # Over a little before its time, and never faster than the limits allow, however late it is begun.
        stage.turn_to(motion.to_deg, max(motion.stop_s - EARLY_S - self._now_s(), shortest_s, EARLY_S))
        ended_s = self._now_s()
        return self._bench.standing_deg(motion.to_deg), ended_s

    def _wait_until(self, time_s: float) -> None:
        """Let time pass, and take in what the instruments have meanwhile."""
        every_s = min(FETCH_S, FETCH_ROWS * self._period_s)
        while (left_s := time_s - self._now_s()) > AT_ONCE_S:
            if left_s > THERMOMETER_S and self._now_s() >= self._felt_s + self._bench.temperature_every_s:
                self._feel()
                continue
            due_s = self._fetched_s + every_s - self._now_s()
            self._session.wait_s(min(left_s, max(due_s, 0.0)))
            if due_s < left_s:
                self._fetch()

    def _feel(self) -> None:
        """One more temperature."""
        self._temperatures_c.append(self._temperature_c())
        self._felt_s = self._now_s()

    def _temperature_c(self) -> float:
        """Now; NaN from a thermometer that fails, for which no run is given up."""
        thermometer = self._bench.thermometer
        if thermometer is None:
            return math.nan
        try:
            value_c, why = thermometer.temperature().value, f"{thermometer.name}: no valid value"
        except (InstrumentError, LinkError) as error:
            value_c, why = math.nan, str(error)
            with suppress(RigError):
                thermometer.close()
                thermometer.open()
        if math.isnan(value_c):
            self._session.event(TEMPERATURE_MISSED, error=why)
        return value_c

    def _fetch(self) -> None:
        blocks = self._stream.fetch()
        self._bench.source.require_running()
        if not self._stands():
            now_s = self._now_s()
            # A turn to where it should stand, of no duration: at once.
            self._carry_out(Motion(now_s, now_s, self._course.last_theta_deg))
        for block in blocks:
            self._keep(block)
        self._fetched_s = self._now_s()

    def _keep(self, block: Block) -> None:
        """Write the rows of a block that belong to the run, not to its run-up."""
        needless = max(self._run_up - block.first, 0)
        rows = block.rows[needless:]
        if not len(rows):
            return
        index = np.arange(len(rows), dtype=np.float64) + (block.first + needless - self._run_up)
        # The run begins half a period before its first sample.
        times_s: FloatArray = (index + 0.5) * self._period_s + block.late_s
        moving, theta_deg = self._course.moving(times_s), self._course.theta_deg(times_s)
        rows = self._believed(rows, moving, block.first + needless)
        # By the source's own start: its waveform runs since then, not since the run began.
        elapsed_s = self._rig_time_s(0.0) + times_s - self._started.start_s
        tilt = {name: waveform.volts(elapsed_s) for name, waveform in self._started.waveforms.items()}
        columns = {
            "t_s": index * self._period_s,
            "theta_deg": theta_deg,
            self._bench.readout.channels()[0].name: rows[:, 0],
            self._bench.voltmeter.channels()[0].name: rows[:, 1],
            **tilt,
            "moving": moving.astype(np.float64),
            "temperature_c": np.full(len(rows), self._temperatures_c[-1]),
        }
        # Written before it is watched: what the live estimate makes of it must not keep it from the store.
        self._writer.stream(columns)
        self._course.forget(float(times_s[-1]))
        self._watch(columns)

    def _believed(self, rows: FloatArray, moving: BoolArray, first: int) -> FloatArray:
        """The rows from `first` on without what cannot be true: from such a sample on its record is not believed."""
        meters: tuple[PacingMeter | FollowingMeter, ...] = (self._bench.readout, self._bench.voltmeter)
        for place, meter in enumerate(meters):
            (channel,) = meter.channels()
            # While the platform moves its samples change as no noise does.
            resting = np.where(moving, np.nan, rows[:, place])
            if (flaw := voltages_flaw(channel, resting)) is not None:
                rows = rows.copy()
                rows[flaw.sample :, place] = np.nan
                # From here on replies may be shifted; a new record is in step again.
                self._stream.give_up(flaw.of(meter.name), range(first + flaw.sample, first + len(rows)))
        return rows

    def _now_s(self) -> float:
        return self._bench.clock.now_s() - self._rig_time_s(0.0)

    def _rig_time_s(self, time_s: float) -> float:
        """Rig time of a time of the run."""
        return self._stream.begun_s + (self._run_up - 0.5) * self._period_s + time_s


def _mean(values: Sequence[float]) -> float:
    """Of the numbers among them; NaN without any."""
    known = [value for value in values if math.isfinite(value)]
    return float(np.mean(known)) if known else math.nan
