"""The multipoint tumble test: every position of every mounting, forwards and backwards, each a run of its own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import groupby
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from procedures import campaigns
from procedures.campaigns import Instruments
from procedures.paced_record import record
from rigctl.campaign.origin import campaign_of
from rigctl.campaign.recording import ChannelInfo, LaserInfo
from rigctl.campaign.session.recovery import Apparatus
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.parts import Part
from rigctl.campaign.store.run_writer import RunWriter
from rigctl.campaign.store.store import Store
from rigctl.core.errors import ConfigError, ImplausibleSample, LimitError, ProcedureError
from rigctl.core.file_tables import Table
from rigctl.effects.plugins import Plugin
from rigctl.files.campaign_file import CampaignFile
from rigctl.files.toml_files import validated
from rigctl.workbench.study import Allowed, Proposal
from tumble_test.positions import AXES

ANGLE_TOLERANCE_DEG = 0.01
"""Largest difference between the angle asked for and the encoder's: what drivers take for arrived."""

Position = Mapping[str, Any]
"""A run as planned: the conditions it begins with."""


class ListedMounting(Table):
    """A `[[procedure.mountings]]` table: which axis of the case points out of the head, and how far it is clocked."""

    out: Literal["+x", "-x", "+y", "-y", "+z", "-z"]
    clocking_deg: Annotated[float, Field(ge=-360.0, le=360.0)] = 0.0


class ListedRun(ListedMounting):
    """A `[[procedure.runs]]` table: one position of a test that is given as a list."""

    angle_deg: float
    approach: Literal[1, -1] = 1


class Procedure(Table):
    """The `[procedure]` table: `positions` evenly spaced over a turn, gone through forwards and then backwards.

    Where there are `runs`, they alone are measured, in their order; one in the mounting before stays in it.
    """

    name: Literal["multipoint"] = "multipoint"
    mountings: tuple[ListedMounting, ...] = ()
    positions: Annotated[int, Field(ge=4, le=360)] = 24
    repeats: Annotated[int, Field(ge=1, le=100)] = 1
    runs: tuple[ListedRun, ...] = ()
    settle_s: Annotated[float, Field(ge=0.0, le=1e5)] = 5.0
    dwell_s: Annotated[float, Field(gt=0.0, le=1e5)] = 10.0
    sample_rate_hz: Annotated[float, Field(ge=0.1, le=1e4)] = 20.0
    overshoot_deg: Annotated[float, Field(ge=0.0, le=30.0)] = 1.0
    mounting: Literal["new", "kept"] = "new"


def seat_of(position: Position) -> tuple[str, str, int]:
    """Axis out, clocking and number of a mounting, as an operator is told and stores keep it."""
    return position["out"], f"{position['clocking_deg']:g} deg", position.get("mounting", 0)


@dataclass(frozen=True)
class Plan(campaigns.Plan):
    """A test ready to run, after what earlier campaigns of the store have left."""

    procedure: Procedure
    mountings_before: int = 0
    left: tuple[str, str, int] | None = None

    @cached_property
    def positions(self) -> tuple[Position, ...]:
        """All runs in order."""
        return tuple(self._listed() if self.procedure.runs else self._turns())

    @property
    def runs(self) -> int:
        """How many runs are expected."""
        return len(self.positions)

    def on(self, rig: Instruments) -> Test:
        """With its instruments; `ConfigError`, or `LimitError` for what they cannot do."""
        meters = [rig.only("readout"), *rig.by_role("voltmeter")]
        for meter in meters:
            if meter.channels()[0].name not in (names := [f"{name}_v" for name in AXES]):
                raise ConfigError(f"{rig.file.path}: {meter.name}.channel has to be one of {', '.join(names)}")
        test = Test(self, rig.only("rotation"), meters[0], meters[1:], rig.by_role("thermometer")[:1])
        test.check()
        return test

    def forecast(self, rig: Instruments) -> Mapping[str, Any]:
        """Which mountings it takes."""
        del rig
        return {"mountings": list(dict.fromkeys(" ".join(map(str, seat_of(each))) for each in self.positions))}

    def _turns(self) -> Iterator[Position]:
        asked, sweep = self.procedure, 0
        angles = [place * 360.0 / asked.positions for place in range(asked.positions)]
        for number, seat in enumerate(asked.mountings, start=self.mountings_before + 1):
            for approach in (1, -1) * asked.repeats:
                sweep += 1
                for angle_deg in angles[::approach]:
                    yield _position(seat, number, angle_deg, approach, sweep)

    def _listed(self) -> Iterator[Position]:
        seat, number = self.left if self.procedure.mounting == "kept" else None, self.mountings_before
        for run in self.procedure.runs:
            if seat is None or seat[:2] != seat_of(run.model_dump())[:2]:
                number += 1
            yield (position := _position(run, number, run.angle_deg, run.approach, 1))
            seat = seat_of(position)


def _position(seat: ListedMounting, number: int, angle_deg: float, approach: int, sweep: int) -> Position:
    mounting = {"mounting": number, "out": seat.out, "clocking_deg": seat.clocking_deg}
    return {**mounting, "angle_asked_deg": angle_deg, "approach": approach, "sweep": sweep}


@dataclass
class Test(campaigns.Work):
    """A plan and its instruments by role: the readout paces the followers, a meter for each sensor."""

    plan: Plan
    rotation: Any
    readout: Any
    followers: Sequence[Any]
    thermometers: Sequence[Any]
    _in_place: tuple[str, str, int] | None = field(default=None, init=False)
    _left_deg: float | None = field(default=None, init=False)

    def check(self) -> None:
        """`LimitError` when head or meters cannot do it, before anything moves."""
        asked = self.plan.procedure
        for each in self.plan.positions:
            overshot_deg = each["angle_asked_deg"] - each["approach"] * asked.overshoot_deg
            for angle_deg in (each["angle_asked_deg"], overshot_deg):
                self.rotation.limits.require_angle(self.rotation.name, angle_deg)
        for meter in (self.readout, *self.followers):
            if (most := meter.longest_record(1.0 / asked.sample_rate_hz)) < self._samples:
                raise LimitError(f"{meter.name}: {self._samples} samples asked for; at most {most} are possible")

    def run(self, session: Session) -> None:
        """Carry out the test; everything it finds is in the session's store."""
        session.plan(self.plan.runs)
        with session.step("prepare"):
            session.guarded("prepare", self._apparatus, self._prepare)
            session.when_taken_up(self._restore)
        for seat, positions in groupby(self.plan.positions, key=seat_of):
            with session.step(" ".join(map(str, seat))):
                if seat != self.plan.left:
                    self._mount(session, seat)
                for position in positions:
                    self._measure(session, seat, position)

    @property
    def _samples(self) -> int:
        return max(round(self.plan.procedure.dwell_s * self.plan.procedure.sample_rate_hz), 2)

    @property
    def _apparatus(self) -> Apparatus:
        return Apparatus((self.rotation,), (self.readout, *self.followers, *self.thermometers))

    def _prepare(self) -> None:
        if not self.rotation.is_homed():
            self.rotation.home()

    def _restore(self) -> None:
        """After a restart: the head as the last recorded run has left it."""
        if self._left_deg is not None:
            self.rotation.move_to(self._left_deg)

    def _mount(self, session: Session, seat: tuple[str, str, int]) -> None:
        seated = "{} {} {} mounted".format(*seat)
        if not session.done(seated):
            session.checkpoint()
            session.take_up()
            session.operator.remount(*seat)
            self._in_place = seat
        session.once(seated, lambda: seat)

    def _measure(self, session: Session, seat: tuple[str, str, int], position: Position) -> None:
        """One position, unless it is recorded already; a mounting of before a restart is asked after."""
        angle_deg = position["angle_asked_deg"]
        key = "{} {} {}".format(*seat) + f", sweep {position['sweep']}, {angle_deg:g} deg {position['approach']:+d}"
        if session.recorded(key):
            self._left_deg = angle_deg
        elif self._in_place != seat:
            if not session.operator.still_mounted(*seat):
                raise ProcedureError(f"mounting {seat[2]} was disturbed: run the campaign into a new store")
            self._in_place = seat
        session.acquire(key, position, lambda writer: self._run(session, writer, position), self._apparatus)

    def _run(self, session: Session, writer: RunWriter, position: Position) -> dict[str, Any]:
        asked_deg = position["angle_asked_deg"]
        self.rotation.move_to(asked_deg - position["approach"] * self.plan.procedure.overshoot_deg)
        self.rotation.move_to(asked_deg)
        session.wait_s(self.plan.procedure.settle_s)
        angle_deg, warm_c = self.rotation.angle().value, self._temperatures_c()
        period_s = 1.0 / self.plan.procedure.sample_rate_hz
        start_s, columns = record(session, writer, self.readout, self.followers, self._samples, period_s)
        warm_c += self._temperatures_c()
        for each in (angle_deg, self.rotation.angle().value):
            if not abs(each - asked_deg) <= ANGLE_TOLERANCE_DEG:
                said = f"{self.rotation.name}: {each:g} deg where {asked_deg:g} deg was asked for"
                raise ImplausibleSample(said, channel="angle_deg", instrument=self.rotation.name)
        found = {"angle_deg": angle_deg, "start_s": start_s, "temperature_c": float(np.mean(warm_c or np.nan))}
        overloaded = [name for name, column in columns.items() if not np.isfinite(column).all()]
        return {**found, "valid": False, "reason": f"overload in {', '.join(overloaded)}"} if overloaded else found

    def _temperatures_c(self) -> list[float]:
        return [float(each.temperature().value) for each in self.thermometers]


def plan(campaign: CampaignFile, part: Part | None, plugins: Sequence[Plugin]) -> Plan:
    """The positions a campaign file asks for, after what earlier campaigns have left; `ConfigError`."""
    del plugins
    before = () if part is None else (part.mountings_before, part.mounted)
    found = Plan(validated(Procedure, campaign.procedure, campaign.path, "procedure"), *before)
    if not found.positions:
        raise ConfigError(f"{campaign.path}: procedure.mountings is missing; add a table [[procedure.mountings]]")
    return found


def mounted(store: Store) -> Sequence[tuple[str, str, int]]:
    """Axis out, clocking and number of all mountings, in order."""
    made = [event.data["result"] for event in store.events("once") if event.data["key"].endswith(" mounted")]
    return [(out, clocking, number) for out, clocking, number in made]


def channels(rig: Instruments) -> tuple[Mapping[str, ChannelInfo], Mapping[str, LaserInfo]]:
    """The columns that runs will have."""
    found = [each for role in ("readout", "voltmeter") for meter in rig.by_role(role) for each in meter.channels()]
    return {c.name: ChannelInfo(c.unit, "accelerometer", None, c.full_scale, c.latency_s) for c in found}, {}


def further(store: Store, runs: Sequence[Proposal], campaign: CampaignFile) -> Mapping[str, Any]:
    """These positions, those of one mounting together, the one that is there first."""
    left, asked = mounted(store)[-1][:2], [dict(run.settings) for run in runs]
    seats = sorted(dict.fromkeys(seat_of(each)[:2] for each in asked), key=lambda seat: seat != left)
    listed = sorted(asked, key=lambda each: seats.index(seat_of(each)[:2]))
    whole = {"mountings", "positions", "repeats"}
    kept = {name: value for name, value in campaign.procedure.items() if name not in whole}
    return {**kept, "mounting": "kept", "runs": listed}


def allowed(store: Store, rig: Instruments | None) -> Allowed | None:
    """What the head's limits leave."""
    if rig is None:
        return None
    instruments, campaign = rig, campaign_of(store)
    asked = validated(Procedure, campaign.procedure, campaign.path, "procedure")

    def within(proposal: Proposal) -> bool:
        try:
            Plan(asked.model_copy(update={"runs": (ListedRun(**proposal.settings),)})).on(instruments)
        except LimitError:
            return False
        return True

    return within
