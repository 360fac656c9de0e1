"""The frequency response: runs planned within the limits of the stage, and carried out in each direction."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import groupby, product
from typing import Any

import numpy as np

from procedures import campaigns
from procedures.campaigns import Instruments
from procedures.frequency_response.tables import ListedRun, Procedure
from procedures.paced_record import record
from procedures.sensing_axis.bench import OSCILLATION_MARGIN_S, check_oscillation
from procedures.sensing_axis.run_checks import CapturingStage, Recorders, require_steady
from rigctl.campaign.session.recovery import Apparatus
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.run_writer import RunWriter
from rigctl.core.errors import ConfigError, LimitError, ProcedureError
from rigctl.experiments.frequency_response.columns import ACCEL, is_head

AXIS = "X"
"""What operators are told to mount; there is one sensor."""

SIGNS = {"forward": 1, "reversed": -1}
_SAMPLES_PER_PERIOD = 8.0
"""Fewer do not hold the three harmonics that are fitted."""


@dataclass(frozen=True)
class Point:
    """One run as planned."""

    direction: str
    mounting: int
    frequency_hz: float
    amplitude_mm: float
    number: int

    @property
    def seat(self) -> tuple[str, str, int]:
        """Axis, direction and number of its mounting."""
        return AXIS, self.direction, self.mounting

    @property
    def key(self) -> str:
        """Its name in the store."""
        return (
            f"{self.direction} {self.mounting}, {self.frequency_hz:g} Hz, {self.amplitude_mm:.6g} mm #{self.number}"
        )


@dataclass(frozen=True)
class Plan(campaigns.Plan):
    """Runs ready to be made, after what earlier campaigns of the store have left."""

    procedure: Procedure
    mountings_before: int = 0
    left: tuple[str, str, int] | None = None

    @cached_property
    def points(self) -> tuple[Point, ...]:
        """All runs, mounting after mounting."""
        asked, found = self.procedure, []
        for place, direction in enumerate(dict.fromkeys(run.direction for run in self._listed)):
            kept = asked.mounting == "kept" and self.left is not None and self.left[1] == direction
            number = self.left[2] if kept and self.left is not None else self.mountings_before + place + 1
            own = [run for run in self._listed if run.direction == direction]
            # The same order whenever the campaign is resumed, another one in every mounting.
            order = np.random.default_rng([asked.order_seed, place]).permutation(len(own))
            runs = [(own[i].frequency_hz, self._amplitude_mm(own[i])) for i in order]
            found += [Point(direction, number, *run, runs[: i + 1].count(run)) for i, run in enumerate(runs)]
        return tuple(found)

    @property
    def runs(self) -> int:
        """How many runs are expected."""
        return len(self.points)

    def on(self, rig: Instruments) -> Response:
        """With its instruments; `ConfigError`, or `LimitError` for what they cannot do."""
        lasers = rig.by_role("displacement")
        heads = [channel.name for laser in lasers for channel in laser.channels()]
        if not heads:
            raise ConfigError(
                f'{rig.file.path}: no instrument has the role "displacement"; the lasers are the reference'
            )
        for name in heads:
            if not is_head(name) or name not in rig.file.lasers:
                raise ConfigError(
                    f"{rig.file.path}: heads: '{name}' wants a name laser_..._mm and a table [lasers.{name}]"
                )
        readout = rig.only("readout")
        if (name := readout.channels()[0].name) != ACCEL:
            raise ConfigError(f"{rig.file.path}: the readout's channel is '{name}'; call it {ACCEL}")
        work = Response(self, rig.only("linear"), readout, lasers, rig.by_role("thermometer")[:1])
        work.check()
        return work

    def forecast(self, rig: Instruments) -> Mapping[str, Any]:
        """Frequencies and the largest acceleration of each."""
        del rig
        largest: dict[str, float] = {}
        for each in self.points:
            peak = 1e-3 * each.amplitude_mm * (2.0 * math.pi * each.frequency_hz) ** 2
            largest[f"{each.frequency_hz:g} Hz"] = max(peak, largest.get(f"{each.frequency_hz:g} Hz", 0.0))
        return {"largest_m_s2": {name: float(f"{value:.4g}") for name, value in largest.items()}}

    @cached_property
    def _listed(self) -> tuple[ListedRun, ...]:
        asked = self.procedure
        if asked.runs:
            return asked.runs
        grid = product(asked.directions, asked.frequencies_hz, asked.accelerations_m_s2)
        listed = [
            ListedRun(direction=direction, frequency_hz=frequency_hz, acceleration_m_s2=acceleration)
            for direction, frequency_hz, acceleration in grid
        ]
        # Where the travel limits them, larger accelerations are one and the same run.
        distinct = {(run.direction, run.frequency_hz, self._amplitude_mm(run)): run for run in listed}
        return tuple(distinct.values()) * asked.repeats

    def _amplitude_mm(self, run: ListedRun) -> float:
        asked_mm = 1e3 * run.acceleration_m_s2 / (2.0 * math.pi * run.frequency_hz) ** 2
        return min(float(f"{asked_mm:.6g}"), self.procedure.amplitude_max_mm)


@dataclass
class Response(campaigns.Work):
    """A plan and its instruments by role: the readout paces, stage and lasers follow."""

    plan: Plan
    linear: CapturingStage
    readout: Any
    lasers: Sequence[Any]
    thermometers: Sequence[Any]
    _in_place: tuple[str, str, int] | None = field(default=None, init=False)

    def check(self) -> None:
        """`LimitError` when stage or recorders cannot do it, before anything moves."""
        rate_hz = self.plan.procedure.sample_rate_hz
        highest_hz = max(each.frequency_hz for each in self.plan.points)
        if rate_hz < _SAMPLES_PER_PERIOD * highest_hz:
            raise LimitError(
                f"procedure.sample_rate_hz: {rate_hz:g} Hz is too slow for {highest_hz:g} Hz; "
                f"at least {_SAMPLES_PER_PERIOD * highest_hz:g} Hz"
            )
        for each in self.plan.points:
            check_oscillation(self.linear, each.amplitude_mm, each.frequency_hz)
            for recorder in (self.readout, self.linear, *self.lasers):
                if (most := recorder.longest_record(1.0 / rate_hz)) < self._samples(each):
                    raise LimitError(
                        f"{recorder.name}: {self._samples(each)} samples asked for; at most {most} are possible: "
                        "a shorter dwell_s, or a lower sample_rate_hz"
                    )

    def run(self, session: Session) -> None:
        """Carry it out; everything it finds is in the session's store."""
        session.plan(self.plan.runs, mountings=len({point.seat for point in self.plan.points} - {self.plan.left}))
        with session.step("prepare"):
            session.guarded("prepare", self._apparatus, self._prepare)
            session.when_taken_up(self._restore)
        for seat, points in groupby(self.plan.points, key=lambda each: each.seat):
            with session.step(" ".join(map(str, seat))):
                if seat != self.plan.left:
                    self._mount(session, seat)
                for point in points:
                    self._measure(session, seat, point)

    def rest(self) -> None:
        """End an oscillation."""
        self.linear.rest()

    @property
    def _apparatus(self) -> Apparatus:
        return Apparatus((self.linear,), (self.readout, *self.lasers, *self.thermometers))

    def _samples(self, point: Point) -> int:
        asked = self.plan.procedure
        periods = max(math.ceil(asked.dwell_s * point.frequency_hz - 1e-6), 1)
        return math.ceil(periods / point.frequency_hz * asked.sample_rate_hz)

    def _prepare(self) -> None:
        if not self.linear.is_homed():
            self.linear.home()

    def _restore(self) -> None:
        """After a restart: the stage as every run leaves it."""
        self.linear.move_to(0.0)

    def _mount(self, session: Session, seat: tuple[str, str, int]) -> None:
        seated = "{} {} {} mounted".format(*seat)
        replayed = session.done(seated)
        if not replayed:
            session.checkpoint()
            session.take_up()
            session.operator.remount(*seat)
            self._in_place = seat
        session.once(seated, lambda: seat)
        session.mounted(replayed=replayed)

    def _measure(self, session: Session, seat: tuple[str, str, int], point: Point) -> None:
        if not session.recorded(point.key) and self._in_place != seat:
            if not session.operator.still_mounted(*seat):
                raise ProcedureError(f"mounting {seat[2]} was disturbed: run the campaign into a new store")
            self._in_place = seat
        asked = {
            "mounting": point.mounting,
            "direction": SIGNS[point.direction],
            "frequency_hz": point.frequency_hz,
            "amplitude_mm": point.amplitude_mm,
        }
        session.acquire(point.key, asked, lambda writer: self._run(session, writer, point), self._apparatus)

    def _run(self, session: Session, writer: RunWriter, point: Point) -> dict[str, Any]:
        asked = self.plan.procedure
        # It ends by itself, so it has to outlast settling, arming and the record.
        lasting_s = 1.5 * asked.dwell_s + asked.settle_s + 2.0 * OSCILLATION_MARGIN_S
        self.linear.oscillate(0.0, point.amplitude_mm, point.frequency_hz, lasting_s)
        session.wait_s(asked.settle_s)
        warm_c = self._temperatures_c()
        followers = [self.linear, *self.lasers]
        period_s = 1.0 / asked.sample_rate_hz
        start_s, columns = record(session, writer, self.readout, followers, self._samples(point), period_s)
        warm_c += self._temperatures_c()
        require_steady(warm_c)
        recorded = Recorders(self.linear, self.readout, self.lasers)
        recorded.require_possible(point.frequency_hz, asked.sample_rate_hz, columns)
        recorded.require_amplitude(point.amplitude_mm, columns)
        self.linear.rest()
        self.linear.move_to(0.0)
        found = {"start_s": start_s, "temperature_c": float(np.mean(warm_c or np.nan))}
        return {**found, **(recorded.saturation(columns) or recorded.missing(columns))}

    def _temperatures_c(self) -> list[float]:
        return [float(each.temperature().value) for each in self.thermometers]
