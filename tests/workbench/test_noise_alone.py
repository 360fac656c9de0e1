"""What noise that is correlated along the order of the data shows by itself is no effect; what it does not, is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats

from rigctl.campaign.recording import READINGS, Header, ImportReport, Recording, RunRecord
from rigctl.core.arrays import FloatArray
from rigctl.experiments.table.study import TableStudy
from rigctl.workbench.study import Term
from rigctl.workbench.verdict.account import Account, account_of
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.compare import compared
from rigctl.workbench.verdict.diagnose import diagnose
from rigctl.workbench.verdict.kernels import kernel
from rigctl.workbench.verdict.noise import Correlation
from rigctl.workbench.verdict.noise_alone import DRAWS, EVERY, Asked, NoiseAlone
from rigctl.workbench.verdict.noise_pool import Whitenings
from rigctl.workbench.verdict.offsets import from_units, in_units
from rigctl.workbench.verdict.significance import is_adequate
from tests.foreign.false_alarms import recording

DAYS = 80


def study_of(flow: FloatArray, **columns: FloatArray) -> TableStudy:
    spec = {"response": "flow", "baseline": "b0", "start": {}, "order": "day"}
    given = {"flow": flow, "day": np.arange(float(len(flow))), **columns}
    run = RunRecord(READINGS, READINGS, "import", {})
    return TableStudy(Recording(Header("table", extra={"table": spec}), (run,), {READINGS: given}, ImportReport(1)))


def relaxing(seed: int, days: int = DAYS, of: float = 0.7) -> FloatArray:
    """First-order autoregressive noise of unit variance."""
    drawn = np.random.default_rng(seed).normal(size=days)
    for day in range(1, days):
        drawn[day] = of * drawn[day - 1] + np.sqrt(1.0 - of**2) * drawn[day]
    return drawn


def least_minus_2_log_l(flow: FloatArray, columns: FloatArray, alone: NoiseAlone) -> float:
    """Over the same correlations, with covariance matrices and a determinant as they stand in a textbook."""
    day = np.arange(float(len(flow)))
    apart = np.abs(day[:, None] - day[None, :])
    least = np.inf
    for whitenings in alone.whitenings:
        for each in whitenings.correlations[::EVERY]:
            r = np.eye(len(flow))
            if each.kernel:
                r = r + each.ratio * kernel(each.kernel, apart, (1.0, float(len(flow) - 1)))
            inverse = np.linalg.inv(r)
            beta = np.linalg.solve(columns.T @ inverse @ columns, columns.T @ inverse @ flow)
            left = flow - columns @ beta
            least = min(least, len(flow) * np.log(left @ inverse @ left) + float(np.linalg.slogdet(r)[1]))
    return float(least)


def asked_beside(attempt: Attempt, *asked: Asked) -> NoiseAlone:
    pool = attempt.estimator.whole_pool
    assert pool is not None
    return NoiseAlone(attempt, pool, asked, attempt.seed)


def test_what_an_effect_gains_is_the_difference_of_two_likelihoods_at_its_best_choice() -> None:
    flow = relaxing(3, 30) + 2.0 * (np.arange(30) >= 12)
    attempt = Attempt(study_of(flow), ())
    steps = np.stack([1.0 * (np.arange(30) >= place) for place in (4, 12, 20)], axis=1)[:, :, None]
    waves = np.stack([np.cos(np.arange(30) / 3.0), np.sin(np.arange(30) / 3.0)], axis=1)[:, None]
    powers = np.stack([(np.arange(30) / 30.0) ** power for power in (1, 2, 3)], axis=1)[:, None]
    alone = asked_beside(attempt, Asked(waves, 7.0), Asked(steps, 5.0), Asked(powers, 0.0))
    constant = np.ones((30, 1))
    without = least_minus_2_log_l(flow, constant, alone)
    beside = [least_minus_2_log_l(flow, np.hstack([constant, steps[:, place]]), alone) for place in range(3)]
    wave = least_minus_2_log_l(flow, np.hstack([constant, waves[:, 0]]), alone)
    cubic = least_minus_2_log_l(flow, np.hstack([constant, powers[:, 0]]), alone)
    expected = [without - wave - 7.0, without - min(beside) - 5.0, without - cubic]
    assert alone.gained == pytest.approx(expected, abs=1e-6)
    # Draws are in single precision, which costs their gains less than any of them differ by.
    single = alone.gains(attempt.unexplained()[:, None], np.float32)[:, 0]
    assert single == pytest.approx(alone.gained, abs=0.01)


def test_what_an_effect_gains_does_not_depend_on_the_size_of_its_columns() -> None:
    """The cube of seconds over a year: its square is more than single precision holds."""
    flow = relaxing(5, 60)
    attempt = Attempt(study_of(flow), ())
    cube = np.linspace(-1.0, 1.0, 60)[:, None, None] ** 3
    alone = asked_beside(attempt, Asked(cube, 1.0), Asked(1e22 * cube, 1.0), Asked(1e-22 * cube, 1.0))
    for precision in (np.float64, np.float32):
        gained = alone.gains(flow[:, None], precision)[:, 0]
        assert gained == pytest.approx(np.full(3, gained[0]), rel=1e-6)


def test_beside_a_step_whose_place_has_no_slope_the_likeliest_noise_is_still_told() -> None:
    flow = relaxing(5) + 6.0 * (np.arange(DAYS) >= 30)
    study = study_of(flow)
    beside = Attempt(study, [Term("step[day]", {"at": 29.5})])
    assert not beside.model.jacobian(beside.result.values).any(axis=0).all()
    alone = asked_beside(beside, Asked(np.arange(DAYS)[:, None, None] ** 2.0, 0.0))
    # Noise of which half is left after a day and a half is not white.
    assert alone._likeliest[0] is not alone.whitenings[0]


def test_laws_are_as_probable_as_their_restricted_likelihoods() -> None:
    days = 25
    flow = 3.0 * relaxing(11, days) + np.random.default_rng(12).normal(size=days)
    alone = asked_beside(Attempt(study_of(flow), ()), Asked(np.arange(days)[:, None, None] ** 2.0, 0.0))
    laws, probable = alone._laws
    apart, ones = np.abs(np.subtract.outer(np.arange(days), np.arange(days))).astype(float), np.ones((days, 1))
    costs = []
    for each in [correlation for whitenings in alone.whitenings for correlation in whitenings.correlations]:
        r = np.eye(days)
        if each.kernel:
            r = r + each.ratio * kernel(each.kernel, apart, (1.0, days - 1.0))
        # Patterson and Thompson's likelihood, of contrasts that see no level: any basis of them does.
        contrasts = np.linalg.svd(ones)[0][:, 1:]
        of_contrasts, seen = contrasts.T @ r @ contrasts, contrasts.T @ flow
        size = seen @ np.linalg.solve(of_contrasts, seen)
        costs.append((days - 1) * np.log(size) + np.linalg.slogdet(of_contrasts)[1])
    expected = np.exp(-0.5 * (np.array(costs) - min(costs)))
    assert len(laws) == len(expected)
    assert probable == pytest.approx(expected / expected.sum(), rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("seed", [8, 37, 88])
def test_a_walk_that_looks_tame_is_no_effect(seed: int) -> None:
    """Draws of the likeliest law alone, and no draws where a p-value was below 1e-12, named something in each."""
    study = TableStudy(recording("walk", seed))
    found = diagnose(study, (), account=account_of(study, [()]))
    assert (found.verdict, found.suggested) == ("adequate", ())


def test_what_gains_more_than_slow_noise_ever_does_needs_no_draws() -> None:
    flow = relaxing(3) + 40.0 * (np.arange(DAYS) >= 40) * np.sin(np.arange(DAYS))
    alone = asked_beside(
        Attempt(study_of(flow), ()), Asked(((np.arange(DAYS) >= 40) * np.sin(np.arange(DAYS)))[:, None, None], 0.0)
    )
    assert alone.probability(0) == 0.0
    assert not alone._batches


def test_of_few_degrees_of_freedom_draws_are_made_where_many_would_need_none() -> None:
    """Of eight readings with five coefficients what is left beside one column more is next to nothing by chance."""
    rng = np.random.default_rng(1)
    conditions = {name: rng.normal(size=8) for name in "pqrs"}
    spec = {"response": "flow", "baseline": "b0 + b1 * p + b2 * q + b3 * r + b4 * s", "start": {}, "order": "day"}
    given = {"flow": rng.normal(size=8), "day": np.arange(8.0), **conditions}
    run = RunRecord(READINGS, READINGS, "import", {})
    report = ImportReport(1)
    attempt = Attempt(
        TableStudy(Recording(Header("table", extra={"table": spec}), (run,), {READINGS: given}, report)), ()
    )
    left = attempt.unexplained()
    column = left + 0.02 * np.linalg.norm(left) * rng.normal(size=8)
    alone = asked_beside(attempt, Asked(column[:, None, None], 0.0))
    assert alone.gained[0] > 50.0
    assert alone.probability(0) > 0.0


@pytest.mark.parametrize("step", [0.0, 50.0])
def test_exact_curves_are_judged_without_a_logarithm_of_nothing(step: float) -> None:
    """What a fit leaves of them is rounding: its squares were none in single precision. Warnings are errors here."""
    x = np.random.default_rng(2).uniform(0.0, 10.0, 40)
    study = study_of(1.0 + 0.3 * x + step * (np.arange(40) >= 20), x=x)
    found = diagnose(study, (Term("linear[x]"),), account=account_of(study, [(Term("linear[x]"),)]))
    assert [term.effect for term in found.suggested] == (["step[day]"] if step else [])


def test_how_often_chance_does_as_much_is_a_probability() -> None:
    by_chance = []
    for seed in range(40):
        attempt = Attempt(study_of(relaxing(seed)), ())
        steps = [each.derivative for each in attempt.candidates if each.term.effect == "step[day]"]
        by_chance.append(asked_beside(attempt, Asked(np.stack(steps, axis=1), 0.0)).probability(0))
    # The correlation that is drawn is an estimate: it may make the step less sure, but not surer.
    assert stats.kstest(by_chance, "uniform", alternative="greater").pvalue > 1e-3
    assert stats.kstest(by_chance, "uniform", alternative="less").pvalue > 1e-6


def test_beyond_the_draws_gains_fall_off_exponentially(monkeypatch: pytest.MonkeyPatch) -> None:
    attempt = Attempt(study_of(relaxing(1, 20)), ())
    alone = asked_beside(attempt, Asked(np.arange(20.0)[:, None, None] ** 2, 0.0))
    rng = np.random.default_rng(2)
    monkeypatch.setattr(alone, "gains", lambda drawn, precision: rng.exponential(2.0, (1, drawn.shape[1])))
    for gained in (5.0, 12.0):
        alone.gained = np.array([gained])
        # A tenth of the draws tell the slope, and how far out it begins.
        error = 3.0 * (gained / 2.0 - np.log(10.0)) / np.sqrt(0.1 * sum(DRAWS)) + 3.0 * 0.14
        assert np.log(alone.probability(0)) == pytest.approx(-gained / 2.0, abs=error)


@pytest.fixture(scope="module", params=[1, 98])
def flicker(request: pytest.FixtureRequest) -> tuple[TableStudy, Account]:
    """Flicker noise that looks white, searched."""
    study = TableStudy(recording("flicker", request.param))
    return study, account_of(study, [()])


def test_flicker_noise_that_looks_white_is_neither_an_effect_nor_a_shape(flicker: tuple[TableStudy, Account]) -> None:
    """The slow part is projected out where the noise is estimated, and nothing of it was left to be seen."""
    study, account = flicker
    attempt = account.attempt(study, ())
    assert attempt.noise.correlations[0].kernel == ""
    # By the noise that was estimated, an effect or a shape is beyond doubt.
    shape = attempt.best_shape
    assert shape is not None
    assert shape.p_value_corrected < 1e-3
    assert is_adequate(attempt, 0.01)
    search = account.search(study, ())
    assert not search.suggested
    assert compared(attempt, account, 1).p_value > 0.01


def test_draws_of_correlated_noise_do_not_depend_on_the_signs_of_eigenvectors() -> None:
    apart = np.abs(np.arange(12.0)[:, None] - np.arange(12.0))
    strength, vectors = np.linalg.eigh(kernel("power 1.64", apart, (1.0, 11.0)))
    ratio, basis = 3.0, np.ones((12, 1)) / np.sqrt(12.0)
    signs = np.where(np.arange(12) % 3, 1.0, -1.0)
    drawn = []
    for turned in (vectors, vectors * signs):
        of_kernel = Whitenings([Correlation("power 1.64", ratio)], ratio * strength[None], turned, basis)
        (scale, _), *_ = of_kernel.strengths()
        drawn.append(of_kernel.coloured(np.eye(12), scale))
    assert drawn[0] == pytest.approx(drawn[1], rel=1e-12, abs=1e-12)
    # Of unit white noise, so that what comes of it has the covariance 1 + q K.
    covariance = np.eye(12) + ratio * kernel("power 1.64", apart, (1.0, 11.0))
    assert drawn[0] @ drawn[0].T == pytest.approx(covariance, abs=1e-9)


@pytest.mark.parametrize("flicker", [98], indirect=True)
def test_what_noise_alone_may_be_is_told_as_hidden_and_how_large_it_would_have_to_be(
    flicker: tuple[TableStudy, Account],
) -> None:
    study, account = flicker
    found = diagnose(study, (), account=account)
    assert found.verdict == "adequate"
    hidden = found.hidden_in_slow_noise[0]
    assert hidden.order == "time_s"
    assert hidden.p_value_if_white < 1e-3
    assert hidden.p_value_corrected > 0.01
    assert set(hidden.detectable) == set(hidden.detectable_if_white) != set()
    for name, size in hidden.detectable.items():
        assert size > 1.5 * hidden.detectable_if_white[name]


def test_uncertainties_in_the_likeliest_noise_are_those_of_generalised_least_squares() -> None:
    attempt = Attempt(study_of(relaxing(3, 30)), ())
    day = np.arange(30.0)[:, None]
    alone = asked_beside(attempt, Asked(day[:, None] ** 2, 0.0))
    whitenings, scale = alone._likeliest
    white = np.hstack([np.ones((30, 1)), day])
    root = whitenings.coloured(np.eye(30), scale)
    r = root @ root.T
    inverse = np.linalg.inv(r)
    covariance = np.linalg.inv(white.T @ inverse @ white)
    left = attempt.unexplained() - attempt.unexplained().mean()
    left = left - (inverse @ left).sum() / inverse.sum()
    expected = np.sqrt(covariance[1, 1] * (left @ inverse @ left) / 29.0)
    given = attempt.model.observations
    in_sigma = in_units(given, np.arange(30), np.hstack([day, 1e6 * day**2]))
    assert alone.sigma(in_sigma[:, :1]) == pytest.approx([expected], rel=1e-6)
    # Beside the square a slope is less sure, in whatever unit the square is.
    assert alone.sigma(in_sigma)[0] > 2.0 * expected
    assert not np.isfinite(alone.sigma(in_sigma[:, [0, 0]])).any()


@pytest.mark.parametrize(
    ("sizes", "named"),
    [
        ({"slow": 6.0}, "day]"),
        ({"fast": 0.9}, "z]"),
    ],
)
def test_what_noise_alone_does_not_show_is_named(sizes: dict[str, float], named: str) -> None:
    rng = np.random.default_rng(11)
    z = rng.normal(size=DAYS)
    along = (np.arange(DAYS) / DAYS) ** 2
    flow = sizes.get("slow", 0.0) * along + sizes.get("fast", 0.0) * z + rng.normal(size=DAYS)
    found = diagnose(study_of(flow, z=z), ())
    assert found.verdict in {"effect", "ambiguous"}
    assert any(term.effect.endswith(named) or term.effect == "drift" for term in found.suggested)


def test_units_are_put_back_as_they_were_taken_off() -> None:
    rng = np.random.default_rng(12)
    lot = np.repeat(np.arange(10), 5)
    flow = rng.normal(size=50) + 2.0 * rng.normal(size=10)[lot]
    spec = {"response": "flow", "baseline": "b0", "start": {}, "sigma": "u", "batch": ["lot"]}
    given = {"flow": flow, "z": rng.normal(size=50), "u": rng.uniform(0.5, 2.0, 50)}
    run = RunRecord(READINGS, READINGS, "import", {"lot": [f"L{each}" for each in lot]})
    made = Recording(Header("table", extra={"table": spec}), (run,), {READINGS: given}, ImportReport(1))
    observed = TableStudy(made).observations
    assert observed.offsets
    columns, where = rng.normal(size=(50, 3)), np.arange(50)
    assert from_units(observed, where, in_units(observed, where, columns)) == pytest.approx(columns, rel=1e-9)


def test_a_slope_in_slow_noise_is_known_as_well_as_is_said(at_least: Any) -> None:
    """The noise that a search finds is what is left beside all that might be hidden: it makes a slope too certain."""
    spec = {"response": "flow", "baseline": "b0 + b1 * (day - 20)", "start": {"b0": 0.1, "b1": 0.1}, "order": "day"}
    run, day, draws = RunRecord(READINGS, READINGS, "import", {}), np.arange(40.0), 80
    within, searched = 0, 0
    for seed in range(draws):
        rng = np.random.default_rng([seed, 3])
        flow = relaxing(seed, len(day), 0.95) + 0.3 * rng.normal(size=len(day))
        given = {"flow": flow, "day": day, **{name: rng.normal(size=len(day)) for name in ("warm_c", "press_bar")}}
        recording = Recording(Header("table", extra={"table": spec}), (run,), {READINGS: given}, ImportReport(1))
        attempt = Attempt(TableStudy(recording), [])
        slope = attempt.estimates()["b1"]
        within += abs(slope.value) < 3.0 * slope.sigma
        searched += abs(slope.value) < 3.0 * np.sqrt(attempt.result.covariance[1, 1])
    # The slope is 0; t of some six degrees of freedom is beyond 3 in 2.4 %.
    assert at_least(within, draws, 0.97)
    assert searched < within


@pytest.mark.parametrize("shape", ["of the catalogue", "of none"])
def test_what_is_hidden_is_no_noise_that_parameters_are_uncertain_by(shape: str) -> None:
    """A slow signal that the model lacks would look like slow noise, and the level be uncertain by all of it."""
    rng, day = np.random.default_rng(3), np.arange(80.0)
    warm = np.cumsum(rng.normal(size=80)) + 20.0
    hidden = warm - warm.mean() if shape == "of the catalogue" else np.where((day > 30.0) & (day < 50.0), 3.0, 0.0)
    study = study_of(hidden + 0.3 * rng.normal(size=80), warm_c=warm)
    attempt = account_of(study, [()]).attempt(study, ())
    assert attempt.estimates()["b0"].sigma < 2.0 * np.sqrt(attempt.result.covariance[0, 0])
