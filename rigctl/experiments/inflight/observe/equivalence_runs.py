"""The sessions of the test that a recording has, each reduced once and kept in the store."""

from __future__ import annotations

from rigctl.analysis.kept import Kept, Packed, Recipe, Reduction, each_reduced
from rigctl.campaign.recording import RunRecord, RunSource
from rigctl.experiments.inflight.observe.equivalence import TestRun, reduce_test
from rigctl.experiments.inflight.observe.sessions import EQUIVALENCE, Session
from rigctl.experiments.inflight.observe.store_reduction import orbit_period_of

RECIPE = Recipe("inflight-equivalence", 6)
"""Its version is counted up whenever equivalence.py or pulses.py would give other numbers."""


def runs_of_test(source: RunSource) -> Reduction[TestRun]:
    """All valid sessions of the test."""
    records = [each for each in source.runs(valid_only=True) if each.conditions.get("session") in EQUIVALENCE]

    def make(record: RunRecord) -> Packed:
        orbit_s, samples = orbit_period_of(source), source.samples(record.run_id)
        return _packed(reduce_test(record.run_id, record.conditions, samples, orbit_s))

    return Reduction.of(each_reduced(Kept(source, RECIPE), records, make, _unpacked, None))


def _packed(run: TestRun) -> Packed:
    session = run.session
    head = {
        "session": [session.name, session.orbit_period_s, session.sample_period_s, session.spin_hz],
        "orbits": run.orbits,
        "missing": run.missing,
    }
    return Packed(
        head, {"amplitudes": run.amplitudes, "beside": run.beside, "spread": run.spread, "pulses_s": run.pulses_s}
    )


def _unpacked(kept: Packed, run: RunRecord) -> TestRun:
    name, orbit_s, step_s, spin_hz = kept.head["session"]
    at = kept.arrays
    return TestRun(
        run.run_id,
        Session(name, orbit_s, step_s, spin_hz=spin_hz),
        kept.head["orbits"],
        kept.head["missing"],
        at["amplitudes"],
        at["beside"],
        at["spread"],
        at["pulses_s"],
    )
