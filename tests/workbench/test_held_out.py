"""Held-out errors are those of really fitting again without each block."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.core.arrays import FloatArray
from rigctl.workbench.study import NoisePool, Observations, Series
from rigctl.workbench.verdict.held_out import HeldOut
from rigctl.workbench.verdict.noise import orthonormal


def observations(blocks: int, runs: int) -> Observations:
    """Two series of every run."""
    which = np.repeat(np.arange(2), runs)
    zero = np.zeros(2 * runs, dtype=np.intp)
    return Observations(
        tuple(f"r{i}" for i in range(runs)),
        (Series("v", "nu in-phase", "V"), Series("v", "DC", "V")),
        (NoisePool("all", 60.0),),
        np.zeros(2 * runs),
        np.ones(2 * runs),
        which,
        np.tile(np.arange(runs), 2),
        zero,
        zero,
        np.arange(runs) % blocks,
    )


def by_refitting(given: Observations, design: FloatArray, z: FloatArray, series: int | None = None) -> float:
    """Fit the rest, predict the block; parameters of the block alone are fitted to it. Priors are further rows."""
    blocks = given.block_of[given.run_of]
    square = expected = 0.0
    for number in np.unique(blocks):
        out = np.flatnonzero(blocks == number)
        rest = np.setdiff1d(np.arange(len(z)), out)
        only_here = ~np.any(design[rest] != 0.0, axis=0)
        shared = design[:, ~only_here]
        values, *_ = np.linalg.lstsq(shared[rest], z[rest], rcond=None)
        seen = out if series is None else out[given.series_of[out] == series]
        error = z[seen] - shared[seen] @ values
        covariance = np.eye(len(seen)) + shared[seen] @ np.linalg.inv(shared[rest].T @ shared[rest]) @ shared[seen].T
        root = np.linalg.inv(np.linalg.cholesky(covariance))
        local = root @ design[np.ix_(seen, np.flatnonzero(only_here))]
        own, *_ = np.linalg.lstsq(local, root @ error, rcond=None)
        square += float(np.sum((root @ error - local @ own) ** 2))
        expected += len(seen) - np.linalg.matrix_rank(local) if local.size else len(seen)
    return float(np.sqrt(square / expected))


def drawn(
    seed: int, blocks: int, shared: int, local: int, priors: int = 0
) -> tuple[Observations, FloatArray, FloatArray]:
    """Data and a design of shared parameters, and of so many in each block's own data."""
    rng = np.random.default_rng(seed)
    given = observations(blocks, 6 * blocks)
    rows = len(given.value) + priors
    design = rng.standard_normal((rows, shared))
    columns = [design]
    for number in range(blocks):
        own = np.zeros((rows, local))
        mine = np.flatnonzero(given.block_of[given.run_of] == number)
        own[mine] = rng.standard_normal((len(mine), local))
        columns.append(own)
    return given, np.hstack(columns), rng.standard_normal(rows)


def of_fit(given: Observations, design: FloatArray, z: FloatArray) -> HeldOut:
    basis = orthonormal(design, 1e-10)
    return HeldOut(given, basis, z - basis @ (basis.T @ z))


@given(
    seed=st.integers(0, 10**6),
    blocks=st.integers(2, 6),
    shared=st.integers(1, 5),
    local=st.integers(0, 2),
    priors=st.integers(0, 2),
)
@settings(max_examples=60, deadline=None)
def test_the_error_is_that_of_refitting_without_each_block(
    seed: int, blocks: int, shared: int, local: int, priors: int
) -> None:
    observed, design, z = drawn(seed, blocks, shared, local, priors)
    held_out = of_fit(observed, design, z)
    assert held_out.error() == pytest.approx(by_refitting(observed, design, z), rel=1e-5)
    for series in (0, 1):
        assert held_out.error(series=np.array([series])) == pytest.approx(
            by_refitting(observed, design, z, series), rel=1e-5
        )


@pytest.mark.parametrize("seed", range(5))
def test_further_columns_count_as_fitted(seed: int) -> None:
    given, design, z = drawn(seed, 4, 3, 1)
    further = np.random.default_rng([seed, 1]).standard_normal((len(z), 2))
    basis = orthonormal(design, 1e-10)
    outside = orthonormal(further - basis @ (basis.T @ further), 1e-10)
    found = of_fit(given, design, z).error(outside)
    assert found == pytest.approx(by_refitting(given, np.hstack([design, further]), z), rel=1e-6)


def test_a_right_model_is_off_by_the_noise_alone() -> None:
    squares = []
    for seed in range(150):
        given, design, z = drawn(seed, 4, 3, 1)
        squares.append(of_fit(given, design, z).error() ** 2)
    # Four standard errors, those from the scatter of the 150 themselves.
    assert np.mean(squares) == pytest.approx(1.0, abs=4.0 * np.std(squares) / np.sqrt(150))
    assert np.std(squares) < 0.5


def test_a_model_that_lacks_something_is_off_by_more() -> None:
    given, design, z = drawn(3, 4, 3, 0)
    lacking = np.random.default_rng(9).standard_normal(len(z))
    wrong = of_fit(given, design, z + 5.0 * lacking).error()
    right = of_fit(given, np.hstack([design, lacking[:, None]]), z + 5.0 * lacking).error()
    assert wrong > 3.0
    assert right < 1.5


def test_parameters_that_fit_noise_alone_make_held_out_data_worse_than_fitted_ones() -> None:
    given, design, z = drawn(4, 3, 12, 0)
    left = z - design @ np.linalg.lstsq(design, z, rcond=None)[0]
    in_the_fit = np.sqrt(left @ left / len(z))
    assert of_fit(given, design, z).error() > in_the_fit


def test_one_block_cannot_be_held_out() -> None:
    held_out = of_fit(*drawn(5, 1, 2, 0))
    assert not held_out.possible
    assert np.isnan(held_out.error())


def test_blocks_that_only_know_themselves_say_nothing() -> None:
    """As many parameters as data in each block: whatever the data, they are no error."""
    given = observations(3, 3)
    assert np.isnan(of_fit(given, np.eye(6), np.arange(6.0)).error())


def test_the_noise_of_a_fit_comes_out_as_one_on_the_made_up_experiment(made_up: Any) -> None:
    from rigctl.workbench.verdict.attempt import Attempt

    squares = np.array([Attempt(made_up.study(seed), ()).held_out.error() ** 2 for seed in range(25)])
    assert squares.mean() == pytest.approx(1.0, abs=4.0 * squares.std() / 5.0 + 0.02)
    wrong = np.array([Attempt(made_up.study(seed, {"roll": 20.0}), ()).held_out.error() for seed in range(5)])
    assert (wrong**2 > squares.mean() + 10.0 * squares.std()).all()
