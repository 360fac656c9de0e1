"""The campaigns of the sensing-axis experiment: what a campaign file's `[procedure]` may name.

`six-mountings`: every axis in pendulum (phase 1) and flag (phase 2), each repeated as a new mounting.
`null-search`: one mounting. `scan`: every combination of set-points, or a list of runs. `angle-scan`: a scan in order
that needs the lasers at every angle, for comparison with the null search. `quick-check`: the evening before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from procedures import campaigns
from procedures.campaigns import Instruments
from procedures.sensing_axis import scan
from procedures.sensing_axis.bench import Bench, SetPoint, check_rate
from procedures.sensing_axis.forecast import theta0_sigma_arcsec
from procedures.sensing_axis.mounting import Fixture, Mounting, MountingLostError, Seated
from procedures.sensing_axis.noise_check import NOISE_CHECK, check_noise, require_seen
from procedures.sensing_axis.null_search import NullSearch, NullSearchSettings, expected_dwells_s
from procedures.sensing_axis.quick_check import DWELL_S, quick_check, reversal_points
from procedures.sensing_axis.tables import Procedure, Targets
from procedures.sensing_axis.wiring import bench_of
from rigctl.campaign.session.session import Session
from rigctl.core.errors import ConfigError
from rigctl.effects.catalogue import Effect
from rigctl.experiments.sensing_axis.model.fit import ROLL
from rigctl.experiments.sensing_axis.observe.set_points import OVERHEAD_S
from rigctl.files.package import Package

# A coarse run, then one each at the lowest and the highest frequency.
RUNS_PER_MOUNTING = 3

FEWEST_VECTORS = 3
"""Two lie in a plane however they scatter, which says nothing of how well it is known."""

SCANS = ("scan", "angle-scan")
"""Procedures whose runs are all known before the first one."""

NULL_SEARCHES = ("six-mountings", "null-search")
"""Procedures that end when they know the null as well as they are asked to."""


@dataclass(frozen=True)
class Plan(campaigns.Plan):
    """What a campaign file asks for; `seated` is what earlier campaigns of its store have left."""

    procedure: Procedure
    targets: Targets
    effects: tuple[Effect, ...]
    seated: Seated = field(default_factory=Seated)

    @property
    def mountings(self) -> list[Mounting]:
        """All mountings in order; numbers count through the store and are never used twice."""
        if self.procedure.name in SCANS:
            return [stretch.mounting for stretch in self.stretches]
        chosen = [
            (axis, configuration)
            for axis in self.procedure.axes
            for configuration in self.procedure.configurations
            for _ in range(self.procedure.mountings)
        ]
        return [
            Mounting(axis, configuration, i) for i, (axis, configuration) in enumerate(chosen, self.seated.count + 1)
        ]

    @property
    def stretches(self) -> list[scan.Stretch]:
        """A scan's runs, by mounting; `ConfigError`."""
        return scan.stretches(self.procedure, self.seated)

    @property
    def spare(self) -> int:
        """The first mounting number that nothing is planned for."""
        # Beyond those of other campaigns of the store and of this one's plan.
        return max([self.seated.count, *(mounting.number for mounting in self.mountings)]) + 1

    def search(self, noise_m_s2_rthz: float) -> NullSearchSettings:
        """Settings of the null search in a room of this noise."""
        return NullSearchSettings(
            frequencies_hz=self.procedure.frequencies_hz,
            amplitude_mm=self.procedure.amplitude_mm,
            sample_rate_hz=self.procedure.sample_rate_hz,
            theta0_sigma_arcsec=self.targets.theta0_sigma_arcsec,
            coarse_s=self.procedure.coarse_s,
            start_deg=self.procedure.start_deg,
            noise_m_s2_rthz=noise_m_s2_rthz,
        )

    @property
    def runs(self) -> int:
        """How many runs are expected."""
        if self.procedure.name in SCANS:
            return sum(len(stretch.wanted) for stretch in self.stretches)
        return len(self.mountings) * RUNS_PER_MOUNTING

    @property
    def points(self) -> list[SetPoint]:
        """The runs expected, in order of mountings; a null search's as they are in the noisiest room allowed."""
        procedure = self.procedure
        if procedure.name in SCANS:
            return [wanted.point for stretch in self.stretches for wanted in stretch.wanted]
        if procedure.name == "quick-check":
            start = self.point(self.mountings[0], procedure.start_deg, max(procedure.frequencies_hz))
            return [replace(start, dwell_s=DWELL_S), *reversal_points(start)]
        dwells_s = expected_dwells_s(self.search(self.targets.noise_m_s2_rthz), self.effects)
        return [
            replace(self.point(mounting, procedure.start_deg, frequency_hz), dwell_s=dwell_s)
            for mounting in self.mountings
            for frequency_hz, dwell_s in dwells_s
        ]

    def on(self, rig: Instruments) -> Work:
        """With the instruments of a rig, checked against what they can do."""
        bench = bench_of(rig)
        self.check(bench)
        return Work(bench, self)

    def forecast(self, rig: Instruments) -> dict[str, Any]:
        """What it would do with a rig, and how well theta0 would be known after it (None: not determined)."""
        bench, points = bench_of(rig), self.points
        searches = self.procedure.name in NULL_SEARCHES
        target_arcsec = self.targets.theta0_sigma_arcsec
        return {
            "mountings": [mounting.key for mounting in self.mountings],
            "theta0_sigma_arcsec": target_arcsec if searches else theta0_sigma_arcsec(bench, points, self.effects),
            "rig_time_s": round(
                self.procedure.noise_check_s * searches + sum(point.dwell_s + OVERHEAD_S for point in points)
            ),
            "warnings": self._warnings(bench.package),
        }

    def _warnings(self, package: Package) -> Sequence[str]:
        """Of mountings that determine no axis: its plane takes three motion vectors, along more than one line."""
        asked = self.procedure
        if asked.name != "six-mountings":
            return ()
        if parallel := [axis for axis in asked.axes if not package.spans_plane(axis, asked.configurations)]:
            return [
                f"procedure.configurations: in {' and '.join(asked.configurations)} alone {parallel[0]} moves along "
                "one line of the cube, which tells no sensing axis; add a configuration where it moves along another"
            ]
        if asked.mountings * len(asked.configurations) < FEWEST_VECTORS:
            return [
                f"procedure.mountings: {asked.mountings} in each of {len(asked.configurations)} configurations give "
                f"fewer than the {FEWEST_VECTORS} motion vectors that a sensing axis takes; ask for more mountings"
            ]
        return ()

    def check(self, bench: Bench) -> None:
        """Whether the rig can do all of it, before anything moves: `ConfigError` or `LimitError`."""
        procedure = self.procedure
        self._require("procedure.axes", "axis", procedure.axes, bench.package.axes)
        self._require(
            "procedure.configurations", "configuration", procedure.configurations, bench.package.configurations
        )
        check_rate(procedure.sample_rate_hz, max(self._driven_hz()))
        if procedure.name in SCANS:
            self._check_scan(bench)
        # Its runs were checked one by one; the keys below are those of other procedures.
        if procedure.name == "scan":
            return
        # Roll and angle differ by their dependence on frequency alone.
        if any(effect.id == ROLL for effect in self.effects) and len(procedure.frequencies_hz) == 1:
            raise ConfigError(
                f"model.effects: at one frequency {ROLL} cannot be told from theta0; "
                "give procedure.frequencies_hz another, or leave it out"
            )
        for point in self._extremes():
            bench.check(point, lasers=True)
        if procedure.name == "quick-check":
            # A quarter turn aside the spots have left the cube, and the lasers are not read.
            for point in reversal_points(self._extremes()[0]):
                bench.check(point, lasers=False)
        # It refuses a target that no search of allowed length reaches.
        if procedure.name in NULL_SEARCHES:
            expected_dwells_s(self.search(self.targets.noise_m_s2_rthz), self.effects)
            if procedure.noise_check_s > 0.0:
                require_seen(procedure.frequencies_hz, procedure.noise_check_s)

    def _driven_hz(self) -> list[float]:
        """The frequencies of all drives."""
        if self.procedure.name in SCANS:
            return [run.frequency_hz for run in scan.listed(self.procedure)]
        return list(self.procedure.frequencies_hz)

    def _check_scan(self, bench: Bench) -> None:
        for i, run in enumerate(self.procedure.runs):
            self._require(f"procedure.runs.{i}.axis", "axis", [run.axis], bench.package.axes)
            self._require(
                f"procedure.runs.{i}.configuration",
                "configuration",
                [run.configuration],
                bench.package.configurations,
            )
        scan.check(self.stretches, bench)

    @staticmethod
    def _require(key: str, kind: str, named: Iterable[str | None], known: Iterable[str]) -> None:
        for name in named:
            if name is not None and name not in known:
                raise ConfigError(f"{key}: the rig's package has no {kind} {name}; it has {', '.join(known)}")

    def _extremes(self) -> list[SetPoint]:
        procedure = self.procedure
        return [
            self.point(Mounting(procedure.axes[0], procedure.configurations[0], 0), angle, frequency)
            for angle in (*procedure.angles_deg, procedure.start_deg)
            for frequency in procedure.frequencies_hz
        ]

    def point(self, mounting: Mounting, theta_deg: float, frequency_hz: float) -> SetPoint:
        """A set-point of this campaign."""
        return SetPoint(
            mounting.axis,
            mounting.configuration,
            mounting.number,
            theta_deg,
            frequency_hz,
            self.procedure.amplitude_mm,
            self.procedure.dwell_s,
            self.procedure.sample_rate_hz,
        )


@dataclass(frozen=True)
class Work(campaigns.Work):
    """A plan on its bench."""

    bench: Bench
    plan: Plan

    def run(self, session: Session) -> None:
        """Carry it out."""
        run(session, self.bench, self.plan)

    def rest(self) -> None:
        """End an oscillation."""
        self.bench.rest()


def run(session: Session, bench: Bench, plan: Plan) -> None:
    """Carry out a campaign; everything it finds is in the session's store."""
    plan.check(bench)
    session.plan(plan.runs, mountings=len(plan.mountings))
    with session.step("prepare"):
        session.guarded("prepare", bench.apparatus(), bench.prepare)
    session.when_taken_up(bench.restore)
    _PROCEDURES[plan.procedure.name](session, bench, plan)
    session.guarded("rest", bench.apparatus(), bench.rest)


def _six_mountings(session: Session, bench: Bench, plan: Plan) -> None:
    fixture = Fixture(session, bench)
    pending = plan.mountings
    spare = plan.spare
    noise_m_s2_rthz: float | None = None
    while pending:
        mounting = pending.pop(0)
        phase = "phase 2" if mounting.configuration == "flag" else "phase 1"
        with session.step(f"axis {mounting.axis} {phase}"), session.step(f"mounting {mounting.number}"):
            try:
                fixture.mount(mounting)
                # Once, in the first mounting: it is the room that is asked about, not the package.
                if noise_m_s2_rthz is None:
                    noise_m_s2_rthz = _check_noise(session, bench, fixture, plan, mounting)
                NullSearch(session, bench, fixture, mounting, plan.search(noise_m_s2_rthz), plan.effects).find()
            except MountingLostError as lost:
                session.event("mounting-lost", mounting=mounting.key, reason=str(lost))
                _discard(session, mounting)
                # At once, in the place of the one that was lost.
                pending.insert(0, Mounting(mounting.axis, mounting.configuration, spare))
                spare += 1


def _discard(session: Session, mounting: Mounting) -> None:
    """Runs of a mounting that was disturbed before its search ended are not used."""
    for run in session.store.runs(valid_only=True):
        if run.conditions.get("mounting") == mounting.number:
            session.store.mark(run.run_id, valid=False, reason=f"{mounting.key} was disturbed")


def _scan(session: Session, bench: Bench, plan: Plan) -> None:
    scanning = scan.Scan(session, bench, Fixture(session, bench), plan.spare)
    for stretch in plan.stretches:
        with session.step(f"scan {stretch.mounting.key}"):
            scanning.measure(stretch, in_place=stretch.mounting == plan.seated.last)


def _quick_check(session: Session, bench: Bench, plan: Plan) -> None:
    fixture = Fixture(session, bench)
    mounting = plan.mountings[0]
    with session.step(f"quick check {mounting.key}"):
        fixture.mount(mounting)
        high_hz = max(plan.procedure.frequencies_hz)
        quick_check(session, bench, fixture, plan.point(mounting, plan.procedure.start_deg, high_hz))


def _check_noise(session: Session, bench: Bench, fixture: Fixture, plan: Plan, mounting: Mounting) -> float:
    """The room's noise at the drive's frequencies [m/s2/rtHz]: measured, or what the targets allow."""
    if plan.procedure.noise_check_s == 0:
        return plan.targets.noise_m_s2_rthz
    with session.step("noise check"):
        # A resumed campaign asks for the package only where something is left to measure.
        if not session.done(NOISE_CHECK):
            fixture.confirm(mounting)
        sensor = bench.package.axes[mounting.axis].sensor[mounting.configuration]
        return check_noise(
            session,
            bench,
            sensor.gain_v_per_m_s2,
            plan.procedure.frequencies_hz,
            plan.targets.noise_m_s2_rthz,
            plan.procedure.noise_check_s,
        )


_PROCEDURES: dict[str, Callable[[Session, Bench, Plan], None]] = {
    "six-mountings": _six_mountings,
    "null-search": _six_mountings,
    "angle-scan": _scan,
    "scan": _scan,
    "quick-check": _quick_check,
}
