"""Trials are counted once for noise that differs by a factor, and again for noise that differs in kind."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from rigctl.analysis.lengths import lengths
from rigctl.core.arrays import FloatArray, IntArray
from rigctl.workbench.verdict.account import account_of
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.noise import Noise
from rigctl.workbench.verdict.shared import Shared, common_ratio
from rigctl.workbench.verdict.trials import Trials

ROWS = 6


def noise(sigma: FloatArray, factors: tuple[tuple[IntArray, FloatArray], ...] = ()) -> Noise:
    return Noise(sigma, np.full(len(sigma), np.inf), factors, ())


def counter() -> tuple[Callable[[], Trials], list[Trials]]:
    made: list[Trials] = []

    def count() -> Trials:
        made.append(Trials({}, 1.0, float(len(made) + 1)))
        return made[-1]

    return count, made


def test_noise_that_differs_by_a_factor_shares_its_trials() -> None:
    count, made = counter()
    shared, sigma = Shared(), np.linspace(1.0, 2.0, ROWS)
    first = shared.trials("model", noise(sigma), count)
    assert shared.trials("model", noise(3.7 * sigma), count) is first
    assert len(made) == 1


@pytest.mark.parametrize(
    "other",
    [
        noise(np.linspace(1.0, 2.1, ROWS)),
        noise(np.ones(ROWS + 1)),
        noise(np.linspace(1.0, 2.0, ROWS), ((np.arange(2), np.array([[1.0, 0.0], [0.6, 0.8]])),)),
    ],
    ids=["other weights", "other data", "correlated"],
)
def test_other_noise_is_counted_anew(other: Noise) -> None:
    count, made = counter()
    shared = Shared()
    shared.trials("model", noise(np.linspace(1.0, 2.0, ROWS)), count)
    assert shared.trials("model", other, count) is made[1]


def test_noise_that_is_correlated_otherwise_is_counted_anew() -> None:
    count, made = counter()
    shared = Shared()
    for share in (0.6, 0.8):
        factor = np.array([[1.0, 0.0], [share, np.sqrt(1.0 - share**2)]])
        shared.trials("model", noise(np.ones(ROWS), ((np.arange(2), factor),)), count)
    assert len(made) == 2


def test_another_model_is_counted_anew() -> None:
    count, made = counter()
    shared = Shared()
    shared.trials("one", noise(np.ones(ROWS)), count)
    shared.trials("other", noise(np.ones(ROWS)), count)
    assert len(made) == 2


def test_trials_of_an_account_are_those_of_a_model_by_itself(made_up: Any) -> None:
    study = made_up.study(3, {"roll": 15.0})
    account = account_of(study, [()])
    assert account.known is not None
    alone = Attempt(study, (), known=account.known)
    assert account.attempt(study, ()).trials == alone.trials


def test_a_factor_is_common_but_for_the_last_digit() -> None:
    sigma = np.array([1.0, 3.0, 7.0])
    assert common_ratio(sigma, 3.0 * sigma) == pytest.approx(1.0 / 3.0, rel=1e-15)
    assert common_ratio(sigma, sigma * np.array([1.0, 1.0, 1.0 + 1e-9])) is None


def test_lengths_are_those_of_the_columns() -> None:
    columns = np.random.default_rng(1).normal(size=(50, 3)) * [1e-9, 1.0, 1e9]
    np.testing.assert_allclose(lengths(columns), np.linalg.norm(columns, axis=0), rtol=1e-14)
