"""The sessions of the test that a recording has, each reduced once and kept in the store."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rigctl.analysis.kept import Kept, Packed, Recipe, Reduction, each_reduced
from rigctl.campaign.recording import RunRecord, RunSource
from rigctl.core.arrays import FloatArray
from rigctl.experiments.inflight.model.residual_samples import pulses_between
from rigctl.experiments.inflight.observe.equivalence import TestRun, known_lines, reduce_test
from rigctl.experiments.inflight.observe.grid import grid_of
from rigctl.experiments.inflight.observe.sessions import EQUIVALENCE, Session, session_of
from rigctl.experiments.inflight.observe.store_reduction import orbit_period_of

RECIPE = Recipe("inflight-equivalence", 2)
"""Its version is counted up whenever equivalence.py would give other numbers."""


def runs_of_test(source: RunSource, centre_m_s2: float) -> Reduction[TestRun]:
    """All valid sessions of the test; `centre_m_s2` is the level of m_dx while the calibration was flown."""
    records = [each for each in source.runs(valid_only=True) if each.conditions.get("session") in EQUIVALENCE]
    # Quadratic factors count from that level: another calibration makes another reduction.
    recipe = replace(RECIPE, settings=(f"{zlib.crc32(np.float64(centre_m_s2).tobytes()):08x}",))

    def make(record: RunRecord) -> Packed:
        orbit_s, samples = orbit_period_of(source), source.samples(record.run_id)
        return _packed(tested(record.run_id, record.conditions, samples, orbit_s, centre_m_s2))

    return Reduction.of(each_reduced(Kept(source, recipe), records, make, _unpacked, None))


def tested(
    run_id: str,
    conditions: Mapping[str, object],
    samples: Mapping[str, FloatArray],
    orbit_period_s: float,
    centre_m_s2: float,
) -> TestRun:
    """A session reduced without the pulses that its samples show; `DataError` as `reduce_test` says."""
    grid = grid_of(run_id, samples)
    session = session_of(run_id, conditions, orbit_period_s, grid.step_s)
    lines_hz = [session.orbital_hz + session.spin_hz, *known_lines(session, grid.duration_s)]
    pulses = pulses_between(grid, lines_hz)
    run = reduce_test(run_id, conditions, samples, orbit_period_s, centre_m_s2, pulses.at_s)
    return replace(run, pulses=len(pulses.at_s))


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
