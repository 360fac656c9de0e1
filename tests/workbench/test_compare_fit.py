"""The model beside the data: how far off, where, and along what."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from scipy import stats

from rigctl.core.errors import DataError, ProcedureError
from rigctl.workbench.study import Term
from rigctl.workbench.verdict.compare import TRENDS, WORST, compare
from rigctl.workbench.verdict.fit import fit

SEEDS = range(80)


@pytest.fixture(scope="module")
def fits(made_up: Any) -> list[Any]:
    """Right models, by seed."""
    return [fit(made_up.study(seed), ()) for seed in SEEDS]


def test_the_baseline_comes_out_with_its_parameters(made_up: Any, fits: list[Any]) -> None:
    pulls = []
    for seed, found in zip(SEEDS, fits, strict=True):
        rng = np.random.default_rng(seed)
        rng.standard_normal(144)
        truth = rng.normal(0, 30, 3)
        assert list(found.parameters) == ["b0", "b1", "b2"]
        pulls += [
            (each.value - true) / each.sigma for each, true in zip(found.parameters.values(), truth, strict=True)
        ]
    # The mean's noise is known no better than its scatter: the tails are Student's.
    assert np.sqrt(np.mean(np.square(pulls))) == pytest.approx(1.0, abs=4.0 / np.sqrt(2 * len(pulls)) + 0.1)


def test_errors_of_a_right_model_are_the_noise(fits: list[Any]) -> None:
    fitted = np.array([found.error_fit for found in fits])
    held_out = np.array([found.error_held_out for found in fits])
    for errors in (fitted, held_out):
        assert np.mean(errors**2) == pytest.approx(1.0, abs=4.0 * np.std(errors**2) / np.sqrt(len(errors)) + 0.02)
    np.testing.assert_allclose(fitted**2, [found.chi2_per_dof for found in fits])
    assert {found.dof for found in fits} == {144 - 3}


def test_p_values_of_right_models_are_not_too_small(fits: list[Any]) -> None:
    """Sigmas of 60 degrees of freedom that are exact here count as doubtful: p-values may only err upwards."""
    p_values = np.array([found.p_value for found in fits])
    assert stats.kstest(p_values, "uniform", alternative="greater").pvalue > 1e-3
    assert p_values.mean() < 0.75


def test_both_errors_are_far_from_one_when_an_effect_is_missing_and_back_once_it_is_in(made_up: Any) -> None:
    study = made_up.study(1, {"roll": 30.0})
    without, with_it = fit(study, ()), fit(study, (Term("roll"),))
    assert without.p_value < 1e-6
    assert min(without.error_fit, without.error_held_out) > 2.0
    assert max(with_it.error_fit, with_it.error_held_out) < 1.4
    found = with_it.parameters["roll"]
    column = made_up.catalogue()["roll"][:, 0]
    size = np.linalg.norm(made_up.sized(column[:, None], 30.0)) / np.linalg.norm(column)
    assert abs(found.value) == pytest.approx(size, abs=4.0 * found.sigma)
    assert abs(found.value) / found.sigma == pytest.approx(30.0, abs=4.0)


def test_noise_that_the_sigmas_do_not_have_shows_as_a_p_value(made_up: Any) -> None:
    study = made_up.study(2)
    study.value[:96] += np.random.default_rng(3).standard_normal(96) * 2.0
    assert fit(study, ()).p_value < 1e-6


def test_nan_in_place_of_errors_that_nothing_tells(made_up: Any) -> None:
    assert np.isnan(fit(made_up.study(1, blocks=1), ()).error_held_out)


def test_a_model_that_the_runs_do_not_determine_is_refused(made_up: Any) -> None:
    with pytest.raises(ProcedureError, match="singular"):
        fit(made_up.study(1), (Term("recoil"),))


def test_nothing_measured_is_refused(made_up: Any) -> None:
    with pytest.raises(DataError, match="no run"):
        fit(made_up.study(1, runs=0), ())


def test_the_fits_json_has_the_keys_of_the_command(fits: list[Any]) -> None:
    document = json.loads(json.dumps(fits[0].as_json(), allow_nan=False))
    assert {"chi2_per_dof", "p_value", "error_fit", "error_held_out", "parameters", "result"} <= set(document)
    assert {frozenset(each) for each in document["parameters"].values()} == {frozenset({"value", "sigma", "unit"})}


def test_the_comparisons_json_has_the_keys_of_the_command(made_up: Any) -> None:
    document = json.loads(json.dumps(compare(made_up.study(1), (Term("lag"),), version=3).as_json(), allow_nan=False))
    assert document["model"] == {"version": 3, "effects": ["lag"]}
    assert {"chi2_per_dof", "p_value", "channels", "worst"} <= set(document)
    assert [each["component"] for each in document["channels"]] == ["nu in-phase", "nu quadrature", "DC"]
    for each in document["channels"]:
        assert {"channel", "component", "rms", "noise", "unit"} <= set(each)
    for each in document["worst"]:
        assert {"run_id", "channel", "sigma"} <= set(each)


def test_a_channels_rms_is_its_noise_where_the_model_is_right(made_up: Any) -> None:
    ratios = [each.rms / each.noise for seed in range(10) for each in compare(made_up.study(seed), ()).channels]
    # 48 data each; the noise of the mean comes from a third of them.
    assert np.mean(ratios) == pytest.approx(1.0, abs=4.0 * np.std(ratios) / np.sqrt(30) + 0.05)


def test_only_the_channel_that_is_off_stands_above_its_noise(made_up: Any) -> None:
    first, second, third = compare(made_up.study(3, {"lag": 40.0}), ()).channels
    assert second.rms > 3.0 * second.noise
    assert max(first.rms / first.noise, third.rms / third.noise) < 1.5
    assert second.chi2 > 3.0 * second.data


def test_chi_square_is_that_of_the_channels_together(made_up: Any) -> None:
    found = compare(made_up.study(4), ())
    assert sum(each.chi2 for each in found.channels) == pytest.approx(found.chi2)
    assert sum(each.data for each in found.channels) == len(found.residuals)


@pytest.mark.parametrize(("where", "component"), [(17, "nu in-phase"), (48 + 31, "nu quadrature")])
def test_the_worst_outlier_is_named(made_up: Any, where: int, component: str) -> None:
    study = made_up.study(5)
    study.value[where] -= 12.0
    worst = compare(study, ()).worst
    assert (worst[0].run_id, worst[0].channel, worst[0].component) == (f"r{where % 48}", "v", component)
    assert -16.0 < worst[0].sigma < -8.0
    assert len(worst) == WORST
    sizes = [abs(each.sigma) for each in worst]
    assert sizes == sorted(sizes, reverse=True)


@pytest.mark.parametrize("covariate", ["temperature_c", "approach"])
def test_a_trend_is_found_with_its_covariate(made_up: Any, covariate: str) -> None:
    values = made_up.conditions()[covariate]
    foreign = np.zeros(144)
    foreign[48:96] = 3.0 * (values - values.mean()) / values.std()
    first = compare(made_up.study(6, foreign=foreign), ()).trends[0]
    assert (first.channel, first.component, first.covariate) == ("v", "nu quadrature", covariate)
    assert first.p_value_corrected < 1e-6
    # Bins keep most of a smooth trend: it is 3 in 1.
    assert 2.0 < first.rms_explained < 3.5


def test_trends_are_seldom_seen_in_noise(made_up: Any, at_least: Any) -> None:
    quiet = 0
    for seed in range(30):
        trends = compare(made_up.study(seed, order=None), ()).trends
        assert [each.p_value for each in trends] == sorted(each.p_value for each in trends)
        assert len(trends) <= TRENDS
        assert all(each.p_value <= each.p_value_corrected <= 1.0 for each in trends)
        quiet += trends[0].p_value_corrected > 0.05
    assert at_least(quiet, 30, 1.0 - 1.5 * 0.05)
