"""The choices of a scan are scored by moments: the same as each alone, as far as rounding allows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rigctl.analysis.unit_columns import UnitColumns
from rigctl.core.arrays import FloatArray
from rigctl.workbench.verdict.noise import orthonormal
from rigctl.workbench.verdict.scan import OwnNoise, ScanScores
from rigctl.workbench.verdict.score import Projector, Score, p_of
from rigctl.workbench.verdict.trials import Family, trials

ROWS, CHOICES = 60, 40
ROUNDING = 1e-9


def waves() -> FloatArray:
    """A wave of each frequency; of frequency 0 the second column is nothing, of the first the model spans all."""
    phase = np.outer(np.linspace(0.0, 2.0 * np.pi, ROWS), np.linspace(0.0, 7.0, CHOICES))
    stack = np.stack([np.cos(phase), np.sin(phase)], axis=2)
    stack[:, 5] *= 1e6
    return stack


def projector(dof: FloatArray, priors: int) -> Projector:
    rng = np.random.default_rng(1)
    jacobian = np.vstack([np.stack([np.ones(ROWS), np.linspace(0.0, 1.0, ROWS) ** 2], axis=1), np.eye(priors, 2)])
    return Projector(jacobian, rng.standard_normal(ROWS + priors), dof, ROWS)


def alone(given: Projector, columns: FloatArray) -> Score:
    priors = len(given.left) - ROWS
    return given.score(np.vstack([columns, np.zeros((priors, columns.shape[1]))]))


@pytest.mark.parametrize("priors", [0, 2])
@pytest.mark.parametrize("dofs", [(40.0, 40.0), (np.inf, np.inf), (12.0, 300.0)])
def test_every_choice_has_the_score_it_has_alone(dofs: tuple[float, float], priors: int) -> None:
    given = projector(np.repeat(dofs, ROWS // 2), priors)
    scores = ScanScores(given, UnitColumns(3.0 * waves()), 1.0 / 3.0, None).scores
    assert (scores[0].dimension, scores[-1].dimension) == (1 if priors else 0, 2)
    for score, columns in zip(scores, waves().transpose(1, 0, 2), strict=True):
        expected = alone(given, columns)
        for name in ("statistic", "dimension", "dof", "p_value", "estimate", "sigma"):
            np.testing.assert_allclose(getattr(score, name), getattr(expected, name), rtol=ROUNDING, err_msg=name)
        np.testing.assert_allclose(score.keep, expected.keep, atol=1e-7)
        shared = score.basis @ (score.basis.T @ expected.basis)
        np.testing.assert_allclose(shared, expected.basis, atol=ROUNDING)


@pytest.mark.parametrize("priors", [0, 2])
def test_the_scale_of_the_noise_is_the_one_with_the_choice_in(priors: int) -> None:
    given, dof = projector(np.full(ROWS, 50.0), priors), 50.0
    frame = orthonormal(np.vander(np.linspace(-1.0, 1.0, ROWS), 10), 1e-9)
    scores = ScanScores(given, UnitColumns(waves()), 1.0, OwnNoise(frame, dof)).scores
    for score, columns in zip(scores, waves().transpose(1, 0, 2), strict=True):
        expected = alone(given, columns)
        if expected.dimension:
            outside = expected.basis[:ROWS] - frame @ (frame.T @ expected.basis[:ROWS])
            rest = dof - float(np.sum(outside**2))
            scale = (dof - float(np.sum((outside.T @ given.left[:ROWS]) ** 2))) / rest
            p_value = float(p_of(expected.statistic / scale, expected.dimension, rest))
            expected = replace(expected, dof=rest, p_value=p_value)
        assert (score.dof, score.p_value) == pytest.approx((expected.dof, expected.p_value), rel=ROUNDING)


def test_a_scan_is_so_many_trials_as_its_choices_are_alone() -> None:
    given = projector(np.full(ROWS, np.inf), 2)
    scan = ScanScores(given, UnitColumns(waves()), 1.0, None)
    # Written out, the choices span more than there is, and the same draws meet both.
    bases = [alone(given, columns).basis for columns in waves().transpose(1, 0, 2)]
    assert sum(basis.shape[1] for basis in bases) > len(given.left)
    rows = len(given.left)
    alike = trials({"": Family(bases)}, rows, 7).all
    assert trials({"": Family(scans=[scan])}, rows, 7).all == pytest.approx(alike, rel=1e-3)


def test_a_choice_that_the_model_spans_is_no_trial() -> None:
    """Without a prior a wave of frequency 0 is a constant, which is fitted: it has no dimension, and no p-value."""
    given = projector(np.full(ROWS, np.inf), 0)
    waves_of_all = ScanScores(given, UnitColumns(waves()), 1.0, None)
    waves_of_others = ScanScores(given, UnitColumns(waves()[:, 1:]), 1.0, None)
    assert waves_of_all.scores[0].dimension == 0
    assert waves_of_all.scores[0].p_value == 1.0
    count = trials({"": Family(scans=[waves_of_all])}, ROWS, 7).all
    others = trials({"": Family(scans=[waves_of_others])}, ROWS, 7).all
    assert count == pytest.approx(others, rel=1e-6)
    assert count > 1.0
