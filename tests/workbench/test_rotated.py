"""Where few degrees of freedom are left, rotations say what chance shows: a few readings of noise are no effect."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from rigctl.campaign.recording import READINGS, Header, ImportReport, Recording, RunRecord
from rigctl.core.arrays import FloatArray
from rigctl.experiments.table.study import TableStudy
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.diagnose import diagnose
from rigctl.workbench.verdict.rotated import FEW, Rotated
from rigctl.workbench.verdict.scan import OwnNoise
from rigctl.workbench.verdict.score import Projector
from rigctl.workbench.verdict.significance import p_of_scored
from rigctl.workbench.verdict.trials import Family


def table(y: FloatArray, **columns: FloatArray) -> TableStudy:
    header = Header("table", extra={"table": {"response": "y", "baseline": "b0", "start": {}}})
    record = RunRecord(READINGS, READINGS, "import", {})
    return TableStudy(Recording(header, (record,), {READINGS: {"y": y, **columns}}, ImportReport(1)))


def columns(rng: np.random.Generator, rows: int) -> dict[str, FloatArray]:
    return {"x": rng.uniform(0.0, 10.0, rows), "s": rng.lognormal(0.0, 0.5, rows), "z": rng.normal(20.0, 1.0, rows)}


def around(left: FloatArray, frame: FloatArray, *families: Family) -> Rotated:
    """What a fit of a constant leaves of readings, rotated."""
    projector = Projector(np.ones((len(left), 1)), left, np.full(len(left), np.inf), len(left))
    named = {str(number): family for number, family in enumerate(families)}
    return Rotated(projector, OwnNoise(frame, float(len(left) - frame.shape[1])), named, 0)


def direction(rng: np.random.Generator, rows: int) -> FloatArray:
    column = rng.normal(size=(rows, 1))
    column -= column.mean()
    return np.asarray(column / np.linalg.norm(column))


def test_one_candidate_keeps_its_f_test() -> None:
    rng = np.random.default_rng(1)
    rotated = around(rng.normal(size=6), np.full((6, 1), 6**-0.5), Family([direction(rng, 6)]))
    for p_value in (0.5, 0.1, 0.03):
        error = 3.0 * np.sqrt(p_value * (1.0 - p_value) / 2000)  # three times the binomial error
        assert rotated.corrected("0", p_value) == pytest.approx(p_value, abs=error)


def test_noise_told_beside_what_may_be_hidden_keeps_it_too() -> None:
    rng = np.random.default_rng(2)
    frame = np.linalg.qr(np.hstack([np.ones((12, 1)), rng.normal(size=(12, 3))]))[0]
    rotated = around(rng.normal(size=12), frame, Family([direction(rng, 12)]))
    drawn = np.array([rotated.corrected("0", p) for p in (0.4, 0.05)])
    # Its scale is told by what is left beside frame and candidate: F with a degree of freedom less.
    assert drawn == pytest.approx([0.4, 0.05], abs=0.035)


def test_of_many_separate_candidates_and_families_the_best_is_as_probable_as_chance_makes_it() -> None:
    rng = np.random.default_rng(3)
    families = [Family([direction(rng, 5) for _ in range(60)]) for _ in range(3)]
    frame = np.full((5, 1), 5**-0.5)
    rotated = around(rng.normal(size=5), frame, *families)
    p_values = []
    for _ in range(400):
        noise = rng.normal(size=5)
        noise -= noise.mean()
        share = [
            max(float(noise @ basis[:, 0]) ** 2 for basis in family.bases) / float(noise @ noise)
            for family in families
        ]
        single = [stats.f.sf(each / (1.0 - each) * 3.0, 1, 3) for each in share]
        p_values.append(min(rotated.corrected(str(number), p) for number, p in enumerate(single)))
    # Uniform; the tails drawn once for all 400 err by a twentieth of the level themselves.
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3
    assert np.mean(np.array(p_values) < 0.05) <= stats.binom.isf(1e-3, 400, 0.06) / 400


def test_a_few_readings_of_noise_seldom_show_anything() -> None:
    """Corrected by the number of trials, a quarter of such tables are below 5 %."""
    tables, below = 40, 0
    for seed in range(tables):
        rng = np.random.default_rng([seed, 4])
        rows = int(rng.integers(5, 8))
        given = {**columns(rng, rows), "u": rng.uniform(size=rows), "v": rng.normal(size=rows)}
        attempt = Attempt(table(rng.normal(size=rows), **given), ())
        below += any(
            attempt.corrected(p_of_scored(attempt, each), each.candidate.term.effect) < 0.05
            for each in attempt.scored
        )
    assert below <= stats.binom.isf(1e-3, tables, 0.05)


def test_an_effect_that_leaves_next_to_nothing_of_seven_readings_is_named() -> None:
    rng = np.random.default_rng(5)
    given = columns(rng, 7)
    found = diagnose(table(3.0 + 0.5 * given["z"] + 0.001 * rng.normal(size=7), **given), ())
    assert found.verdict in {"effect", "ambiguous"}
    assert any(term.effect.endswith("[z]") for term in found.suggested)


def test_more_readings_are_not_rotated() -> None:
    rng = np.random.default_rng(6)
    attempt = Attempt(table(rng.normal(size=40), **columns(rng, 40)), ())
    assert attempt.estimator.dof > FEW
    assert attempt.rotated is None
