"""The campaign of the rotating platform: flips, angle scans, noise records and modulated runs, one after the other.

What a pattern can tell apart is looked at before anything moves; one that leaves in the acceleration what the
campaign says it has to reject is refused.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import zip_longest
from typing import Any

import numpy as np

from procedures.rotating_platform import time_table
from procedures.rotating_platform.bench import TILT_Y, TILT_Z, PlatformBench, Wanted
from procedures.rotating_platform.live_estimate import LiveEstimate
from procedures.rotating_platform.recording import measure
from procedures.rotating_platform.tables import ListedRun, Procedure, Turning
from procedures.rotating_platform.time_table import TimeTable
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.run_writer import RunWriter
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ConfigError
from rigctl.core.voltage_sources import Waveform
from rigctl.experiments.rotating_platform.observe.estimators import Estimator
from rigctl.experiments.rotating_platform.observe.patterns import (
    Pattern,
    SampledPattern,
    custom_pattern,
    named_pattern,
)
from rigctl.experiments.rotating_platform.result.separation import DRIFT, Separation, require, separation

SCAN_TURN_S = 5.0
"""For one step of an angle scan, where the campaign does not say."""
FLIP_SIGNS = (1, -1)


@dataclass(frozen=True)
class Recording:
    """One run as planned: its key in the store, what it is asked to be, and its table."""

    key: str
    conditions: Mapping[str, Any]
    wanted: Wanted
    sampled: SampledPattern | None = None
    g_sign: int = 0


@dataclass(frozen=True)
class Plan:
    """A campaign ready to run."""

    procedure: Procedure

    @cached_property
    def recordings(self) -> tuple[Recording, ...]:
        """All runs in order; `ConfigError` for a pattern that cannot be carried out or does not reject enough."""
        recordings = []
        for number, run in enumerate(self.procedure.runs):
            try:
                recordings += [replace(each, key=f"{number + 1}: {each.key}") for each in self._recordings(run)]
            except ConfigError as error:
                raise ConfigError(f"procedure.runs.{number}: {error}") from None
        return tuple(recordings)

    @property
    def separations(self) -> dict[str, Separation]:
        """What the campaign's patterns can tell apart, by pattern, period and rate."""
        return {
            f"{each.sampled.pattern.label} at {each.sampled.sample_rate_hz:g} Hz": separation(
                each.sampled, self.procedure.estimator
            )
            for each in self.recordings
            if each.sampled is not None
        }

    @property
    def custom_dwells(self) -> dict[str, list[Any]]:
        """The columns of a bundle's patterns.csv; empty without custom patterns."""
        rows = [
            ("custom", custom.modulation_period_s, index, *dwell)
            for custom in self.procedure.custom
            for index, dwell in enumerate(custom.dwells)
        ]
        names = ("pattern", "period_s", "dwell_index", "sign_cos_theta", "start_s", "stop_s")
        # Without custom patterns there are no columns, which strict would refuse.
        return {name: list(column) for name, column in zip(names, zip(*rows, strict=True), strict=False)}

    def check(self, bench: PlatformBench) -> None:
        """Whether the rig can do all of it, before anything moves: `ConfigError` or `LimitError`."""
        for recording in self.recordings:
            bench.check(recording.wanted)

    def _recordings(self, run: ListedRun) -> Iterator[Recording]:
        rate_hz = run.sample_rate_hz or self.procedure.sample_rate_hz
        if run.external_period_s is not None and rate_hz * run.external_period_s <= 2.0:
            raise ConfigError(
                f"sample_rate_hz: {rate_hz:g} Hz does not show an external_period_s of {run.external_period_s:g} s; "
                f"take more than {2.0 / run.external_period_s:g} Hz, or a longer period"
            )
        sampled = self._pattern(run).sampled(rate_hz) if run.modulated else None
        if sampled is not None:
            self._require(run, sampled)
        table = self._table(run, sampled)
        common = {
            "pattern": run.pattern,
            "sample_rate_hz": rate_hz,
            "external": run.external,
            **({} if sampled is None else self._modulation(run, sampled.pattern)),
            **({} if run.external_period_s is None else {"external_period_asked_s": run.external_period_s}),
        }
        name = run.pattern if sampled is None else f"{run.pattern} of {run.modulation_period_s:g} s"
        for level_v in run.levels_v:
            wanted = Wanted(table, _tilt(run, level_v), rate_hz)
            conditions = {**common, "v_z_v": level_v, "v_y_v": run.v_y_v}
            if run.pattern == "flip":
                for sign in FLIP_SIGNS:
                    yield Recording(f"flip to {sign:+d} g", {**conditions, "g_sign": sign}, wanted, None, sign)
            else:
                yield Recording(f"{name}, {run.external} {level_v:g} V", conditions, wanted, sampled)

    def _modulation(self, run: ListedRun, pattern: Pattern) -> dict[str, Any]:
        return {
            "modulation_period_s": pattern.period_s,
            "periods": run.periods,
            "rotation_s": pattern.rotation_s,
            "guard_s": pattern.guard_s,
            "lead_s": pattern.lead_s,
            "turning": self._turning(run),
            "estimator": self.procedure.estimator,
        }

    def _turning(self, run: ListedRun) -> Turning:
        return run.turning or self.procedure.turning

    def _pattern(self, run: ListedRun) -> Pattern:
        procedure = self.procedure
        period_s = run.modulation_period_s or 0.0
        rotation_s = procedure.rotation_s if run.rotation_s is None else run.rotation_s
        guard_s = procedure.guard_s if run.guard_s is None else run.guard_s
        lead_s = procedure.lead_s if run.lead_s is None else run.lead_s
        if run.pattern != "custom":
            return named_pattern(run.pattern, period_s, rotation_s, guard_s=guard_s, lead_s=lead_s)
        if rotation_s is None:
            raise ConfigError("rotation_s is missing; a custom pattern has to say how long a half turn may take")
        (dwells,) = (custom.dwells for custom in procedure.custom if custom.modulation_period_s == period_s)
        return custom_pattern(period_s, dwells, rotation_s, guard_s=guard_s, lead_s=lead_s)

    def _require(self, run: ListedRun, sampled: SampledPattern) -> None:
        rejects = run.rejects or self.procedure.rejects
        if rejects == "nothing":
            return
        require(sampled, DRIFT.index(rejects), self.procedure.estimator)

    def _table(self, run: ListedRun, sampled: SampledPattern | None) -> TimeTable:
        if sampled is not None:
            forward = self._turning(run) == "forward"
            return time_table.modulation(sampled.pattern, run.periods or 1, forward=forward)
        if run.pattern == "scan":
            # Half a step short of a whole turn, so that rounding cannot add 360 deg, which is 0 deg again.
            angles_deg = np.arange(0.0, 360.0 - 0.5 * run.step_deg, run.step_deg).tolist()
            return time_table.scan(
                angles_deg, run.dwell_s, run.rotation_s or self.procedure.rotation_s or SCAN_TURN_S
            )
        return time_table.rest(run.duration_s or 0.0)


def run(session: Session, bench: PlatformBench, plan: Plan) -> None:
    """Carry out a campaign; everything it finds is in the session's store."""
    plan.check(bench)
    session.plan(len(plan.recordings), [recording.wanted.table.duration_s for recording in plan.recordings])
    with session.step("prepare"):
        session.guarded("prepare", bench.apparatus(), bench.prepare)
        session.when_taken_up(bench.restore)
        session.once(
            "patterns", lambda: {label: list(separated.says) for label, separated in plan.separations.items()}
        )
    for recording, after in zip_longest(plan.recordings, plan.recordings[1:]):
        with session.step(recording.key):
            _record(session, bench, recording, plan.procedure.estimator)
            # Sensors are put back when the last of successive flips is over, not between +g and -g.
            if recording.g_sign and (after is None or not after.g_sign):
                session.once(f"{recording.key}: put back", lambda: session.operator.flip(0))
    session.guarded("level", bench.apparatus(), bench.level)


def _record(session: Session, bench: PlatformBench, recording: Recording, estimator: Estimator) -> None:
    def recorded(writer: RunWriter) -> dict[str, Any]:
        # Inside the run: a run that is repeated after a fault asks for the sensors as they have to lie.
        if recording.g_sign:
            session.operator.flip(recording.g_sign)
        live = _live(session, recording, estimator)
        conditions = measure(session, bench, writer, recording.wanted, live or _nobody)
        # One glitch costs a gap; a run of which nothing can be told counts in no result.
        if live is not None and live.missing:
            remark = conditions.get("reason")
            conditions |= {"valid": False, "reason": f"{live.missing}: {remark}" if remark else live.missing}
        return conditions

    # It is not done again, but has left the platform where its table ends.
    if session.recorded(recording.key):
        bench.replayed(recording.wanted.table)
    session.acquire(recording.key, recording.conditions, recorded, bench.apparatus())


def _live(session: Session, recording: Recording, estimator: Estimator) -> LiveEstimate | None:
    if recording.sampled is None:
        return None
    return LiveEstimate(session, recording.sampled, estimator, recording.conditions["periods"])


def _nobody(columns: Mapping[str, FloatArray]) -> None:
    """Nothing is estimated without a pattern."""


def _tilt(run: ListedRun, level_v: float) -> dict[str, Waveform]:
    """What the source is to give: a constant on y, and on z the run's signal."""
    if run.external_period_s is None:
        return {TILT_Y: Waveform(offset_v=run.v_y_v), TILT_Z: Waveform(offset_v=level_v)}
    z = Waveform(run.external, 0.0, level_v, run.external_period_s)
    return {TILT_Y: Waveform(offset_v=run.v_y_v), TILT_Z: z}
