"""Shapes without physics name where it is, along what, and how it goes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rigctl.core.arrays import FloatArray
from rigctl.workbench.findings import Unexplained
from rigctl.workbench.study import NoisePool, Observations, Series
from rigctl.workbench.verdict import generic
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.description import described
from rigctl.workbench.verdict.generic import Generic
from rigctl.workbench.verdict.shapes import POLYNOMIAL

SEEDS = 6
COMPONENTS = ("nu in-phase", "nu quadrature", "DC")


def found(made_up: Any, seed: int, column: FloatArray, series: int, sigmas: float) -> Unexplained:
    """What the strongest shape says once a series has so many sigma (after refitting, in white noise) of a column."""
    runs = len(column)
    foreign = np.zeros(3 * runs)
    foreign[series * runs : (series + 1) * runs] = column
    attempt = Attempt(made_up.study(seed, foreign=made_up.sized(foreign[:, None], sigmas)), ())
    return what_is_left(attempt)


def what_is_left(attempt: Attempt) -> Unexplained:
    shape = attempt.best_shape
    assert shape is not None
    score = attempt.projector.score(attempt.whitened_columns(shape.described_columns))
    return described(attempt.model.observations, shape, score)


def shape_of(conditions: Any, harmonic: int, power: int, covariate: str, phase_deg: float = 25.0) -> FloatArray:
    column = np.cos(np.radians(harmonic * conditions["theta_deg"] - phase_deg)) if harmonic else 1.0
    column = column * (conditions["frequency_hz"] / 0.5) ** power
    if covariate:
        values = conditions[covariate]
        column = column * (values - values.mean()) / values.std()
    return np.broadcast_to(column, conditions["theta_deg"].shape).astype(np.float64)


SHAPES = [
    (1, 2, 0, ""),
    (0, 3, 2, ""),
    (1, 0, -1, ""),
    (1, 1, 1, "approach"),
    (0, 2, 0, "approach"),
    (1, 0, 0, "start_s"),
    (2, 4, 0, ""),
]
"""Series, harmonic of the angle, power of the frequency, covariate."""


@pytest.mark.parametrize(("sigmas", "powers"), [(10.0, {-1, 0, 1}), (20.0, {0})])
def test_injected_shapes_are_named(made_up: Any, at_least: Any, sigmas: float, powers: set[int]) -> None:
    """Frequencies of 0.3 to 0.6 Hz: neighbouring powers are 0.97 alike, three sigma apart at 10 and five at 20."""
    named = 0
    for series, harmonic, power, covariate in SHAPES:
        column = shape_of(made_up.conditions(), harmonic, power, covariate)
        for seed in range(SEEDS):
            what = found(made_up, seed, column, series, sigmas)
            assert (what.channel, what.component) == ("v", COMPONENTS[series])
            assert what.p_value < 1e-3
            along = what.details["harmonic_of_angle"], what.details["covariate"]
            named += along == (harmonic, covariate) and what.details["frequency_power"] - power in powers
    assert at_least(named, SEEDS * len(SHAPES), 0.95)


def test_the_size_the_phase_and_the_words_are_those_of_the_shape(made_up: Any) -> None:
    column = 8.0 * shape_of(made_up.conditions(), 2, 0, "", phase_deg=40.0)
    foreign = np.concatenate([np.zeros(48), column, np.zeros(48)])
    attempt = Attempt(made_up.study(1, foreign=foreign), ())
    what = what_is_left(attempt)
    assert what.details["size"] == pytest.approx(8.0, abs=4.0 * what.details["sigma"])
    # Amplitudes of 48 data of unit noise: sqrt(2 / 48) for each of cosine and sine.
    assert what.details["sigma"] == pytest.approx(np.sqrt(4.0 / 48.0), rel=0.4)
    assert what.details["phase_deg"] == pytest.approx(40.0, abs=4.0 * np.degrees(what.details["sigma"] / 8.0))
    assert what.description.startswith("v nu quadrature is off by ")
    assert "cos(2 theta_deg - " in what.description
    assert what.description.endswith("whatever the frequency")


@pytest.mark.parametrize("sign", [1, -1])
def test_the_sign_of_what_has_no_phase_is_said(made_up: Any, sign: int) -> None:
    column = sign * shape_of(made_up.conditions(), 0, 0, "start_s")
    foreign = np.concatenate([np.zeros(48), 4.0 * column, np.zeros(48)])
    attempt = Attempt(made_up.study(2, foreign=foreign), ())
    what = what_is_left(attempt)
    assert what.details["sign"] == sign
    assert ("off by -" in what.description) == (sign < 0)
    assert what.details["covariate"] in what.description


def test_a_factor_that_follows_a_covariate_is_described_by_it(made_up: Any) -> None:
    """Its constant part is nine sigma in every run, beside which what varies is little."""
    humidity = np.random.default_rng(7).uniform(30.0, 60.0, 48)
    foreign = np.concatenate([np.zeros(48), 0.2 * humidity, np.zeros(48)])
    what = what_is_left(Attempt(made_up.study(5, foreign=foreign, further={"humidity": humidity}), ()))
    assert (what.details["covariate"], what.details["harmonic_of_angle"]) == ("humidity", 0)
    assert what.details["size"] == pytest.approx(0.2 * humidity.std(), abs=4.0 * what.details["sigma"])


def test_no_shape_is_significant_in_noise(made_up: Any, at_least: Any) -> None:
    p_values = [Attempt(made_up.study(seed, order=None), ()).best_shape for seed in range(30)]
    quiet = sum(shape is None or shape.p_value_corrected > 0.05 for shape in p_values)
    # The mean's own degrees of freedom are few: 1.5 times nominal is the promise.
    assert at_least(quiet, 30, 1.0 - 1.5 * 0.05)


def test_what_the_model_imitates_is_no_shape_of_its_own(made_up: Any) -> None:
    """The baseline's own columns, however large, leave nothing to be named."""
    study = made_up.study(3)
    study.value += made_up.baseline(made_up.observations(study.value)) @ np.array([1e4, 1e4, 1e4])
    shape, other = Attempt(study, ()).best_shape, Attempt(made_up.study(3), ()).best_shape
    assert shape is not None
    assert other is not None
    assert shape.shape == other.shape
    assert shape.statistic == pytest.approx(other.statistic, rel=1e-5)


def table(covariates: dict[str, FloatArray], value: FloatArray) -> Observations:
    """Readings with neither angle nor frequency."""
    n = len(value)
    zero = np.zeros(n, dtype=np.intp)
    return Observations(
        tuple(f"r{i}" for i in range(n)),
        (Series("output", "", "mV/V"),),
        (NoisePool("output", 0.0),),
        value,
        np.ones(n),
        zero,
        np.arange(n),
        zero,
        zero,
        np.arange(n) // (n // 4),
        covariates,
    )


def degrees(given: Observations, name: str) -> list[int]:
    """Powers of a covariate among the main columns: how many of them a polynomial of each degree needs."""
    columns = Generic(given).main_columns(np.arange(len(given.value)))
    values = given.covariates[name]
    scaled = (values - values.mean()) / values.std()
    spans = []
    for degree in range(1, 9):
        basis = np.linalg.qr(np.vander(scaled, degree + 1))[0]
        inside = np.linalg.norm(basis.T @ columns, axis=0) > 1.0 - 1e-9
        spans.append(int(inside.sum()))
    return spans


def test_where_nothing_turns_or_swings_a_covariate_goes_up_to_its_sixth_power() -> None:
    load = np.tile(np.linspace(0.0, 10.0, 21), 2)
    given = table({"load": load}, np.zeros(42))
    # A constant, and one more with every degree.
    assert degrees(given, "load") == [2, 3, 4, 5, 6, POLYNOMIAL + 1, POLYNOMIAL + 1, POLYNOMIAL + 1]


def test_powers_are_no_more_than_distinct_values_can_tell() -> None:
    load = np.tile([0.0, 1.0, 2.0, 5.0, 9.0], 6)
    assert degrees(table({"load": load}, np.zeros(30)), "load")[-1] == 3


def test_constant_and_unknown_and_copied_covariates_give_no_shapes() -> None:
    load = np.linspace(0.0, 10.0, 20)
    alone = Generic(table({"load": load}, np.zeros(20))).main_columns(np.arange(20))
    more = {
        "load": load,
        "load_kg": 0.102 * load,
        "site": np.full(20, 3.0),
        "lost": np.where(load > 5.0, np.nan, load),
    }
    np.testing.assert_allclose(Generic(table(more, np.zeros(20))).main_columns(np.arange(20)), alone)


def test_shapes_of_a_series_are_told_apart_once(made_up: Any) -> None:
    """No two main columns are the same, though harmonics of few angles repeat."""
    columns = Generic(made_up.observations(np.zeros(144))).main_columns(np.arange(144))
    normal = columns / np.linalg.norm(columns, axis=0)
    alike = np.abs(normal.T @ normal) - np.eye(columns.shape[1])
    assert alike.max() < 1.0 - 1e-9
    touched = np.any(columns.reshape(3, -1, columns.shape[1]) != 0.0, axis=1)
    assert np.all(touched.sum(axis=0) == 1)
    assert np.all(np.any(touched, axis=1))


def test_a_template_tells_what_no_series_shows_alone(made_up: Any) -> None:
    """Eight sigma over all data, along nothing that a series goes with: each series has less than it takes."""
    rng = np.random.default_rng(12)
    column = rng.standard_normal(len(made_up.study(0).model(()).observations.value))
    attempt = Attempt(made_up.study(3, foreign=made_up.sized(column[:, None], 8.0)), ())
    given = attempt.model.observations
    told = Generic(replace(given, templates={(2, "count"): column}))
    best = told.best(attempt.noise, attempt.projector, (1,))
    alone = Generic(given).best(attempt.noise, attempt.projector, (1,))
    assert best is not None
    assert alone is not None
    assert alone.p_value_corrected > 0.01
    assert best.p_value_corrected < 1e-6
    assert (best.shape.series, best.shape.covariate) == (2, "count")
    assert best.described_by == best.shape
    assert np.array_equal(best.columns[:, 0], column)


def test_a_statistic_is_that_of_its_p_value(made_up: Any) -> None:
    """A constant beside a shape serves to describe it, and is no part of what stands out."""
    theta = np.radians(made_up.conditions()["theta_deg"])
    foreign = np.concatenate([np.zeros(48), 6.0 * np.cos(3.0 * theta) + 2.0, np.zeros(48)])
    attempt = Attempt(made_up.study(3, foreign=foreign), ())
    best = Generic(attempt.model.observations).best(attempt.noise, attempt.projector, (1,))
    assert best is not None
    exact = attempt.projector.score(attempt.whitened_columns(best.columns))
    assert (best.statistic, best.dimension) == (pytest.approx(exact.statistic), exact.dimension)


def test_shapes_of_long_data_are_those_that_are_kept_of_short_ones(
    made_up: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Some at a time, made once for series of the same runs."""
    column = shape_of(made_up.conditions(), 2, 0, "")
    foreign = np.concatenate([np.zeros(48), 2.0 * column, np.zeros(48)])
    kept = Attempt(made_up.study(1, foreign=foreign), ()).best_shape
    monkeypatch.setattr(generic, "_FEW_DATA", 100)
    monkeypatch.setattr(generic, "_HARDLY", float("inf"))
    in_turn = Attempt(made_up.study(1, foreign=foreign), ()).best_shape
    monkeypatch.setattr(generic, "_HARDLY", 0)
    counted_once = Attempt(made_up.study(1, foreign=foreign), ()).best_shape
    assert kept is not None
    assert in_turn is not None
    assert counted_once is not None
    assert kept.shape.series == 1
    assert kept.shape == in_turn.shape == counted_once.shape
    assert in_turn.statistic == pytest.approx(kept.statistic, rel=1e-9)
    assert counted_once.statistic == in_turn.statistic
    # Counted from twenty of a thousand draws below the quantile, and three fitted columns take some trials away.
    assert in_turn.n_eff == pytest.approx(kept.n_eff, rel=3.0 * np.sqrt(2.0 / 20.0))
    assert counted_once.n_eff == pytest.approx(in_turn.n_eff, rel=3.0 * np.sqrt(2.0 / 20.0))
    assert counted_once.n_eff != in_turn.n_eff
