"""The sessions of the test that a recording has, each reduced once and kept in the store."""

from __future__ import annotations

import zlib
from dataclasses import replace

import numpy as np

from rigctl.analysis.kept import Kept, Packed, Recipe, Reduction, each_reduced
from rigctl.campaign.recording import RunRecord, RunSource
from rigctl.experiments.inflight.observe.equivalence import TestRun, reduce_test
from rigctl.experiments.inflight.observe.sessions import EQUIVALENCE, Session
from rigctl.experiments.inflight.observe.store_reduction import orbit_period_of

RECIPE = Recipe("inflight-equivalence", 3)
"""Its version is counted up whenever equivalence.py or pulses.py would give other numbers."""


def runs_of_test(source: RunSource, centre_m_s2: float) -> Reduction[TestRun]:
    """All valid sessions of the test; `centre_m_s2` is the level of m_dx while the calibration was flown."""
    records = [each for each in source.runs(valid_only=True) if each.conditions.get("session") in EQUIVALENCE]
    # Quadratic factors count from that level: another calibration makes another reduction.
    recipe = replace(RECIPE, settings=(f"{zlib.crc32(np.float64(centre_m_s2).tobytes()):08x}",))

    def make(record: RunRecord) -> Packed:
        orbit_s, samples = orbit_period_of(source), source.samples(record.run_id)
        return _packed(reduce_test(record.run_id, record.conditions, samples, orbit_s, centre_m_s2))

    return Reduction.of(each_reduced(Kept(source, recipe), records, make, _unpacked, None))


def _packed(run: TestRun) -> Packed:
    session = run.session
    head = {
        "session": [session.name, session.orbit_period_s, session.sample_period_s, session.spin_hz],
        "orbits": run.orbits,
        "missing": run.missing,
        "pulses": run.pulses,
    }
    return Packed(head, {"amplitudes": run.amplitudes, "beside": run.beside, "spread": run.spread})


def _unpacked(kept: Packed, run: RunRecord) -> TestRun:
    name, orbit_s, step_s, spin_hz = kept.head["session"]
    return TestRun(
        run.run_id,
        Session(name, orbit_s, step_s, spin_hz=spin_hz),
        kept.head["orbits"],
        kept.head["missing"],
        **kept.arrays,
        pulses=kept.head["pulses"],
    )
