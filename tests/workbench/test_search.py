"""The search adds what is missing, drops what is no longer needed, and stops."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ConfigError
from rigctl.workbench.study import Line, Term
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.diagnose import diagnose
from rigctl.workbench.verdict.fitted_model import FittedModel, held_out_ratio, stated_noise
from rigctl.workbench.verdict.rivals import rivals_of
from rigctl.workbench.verdict.score import contained, likeness
from rigctl.workbench.verdict.search import Search
from rigctl.workbench.verdict.significance import (
    CATALOGUE_SHARE,
    LINES_SHARE,
    SHAPES_SHARE,
    corrected_for,
    p_of_scored,
)
from rigctl.workbench.verdict.simplest import NEAR_TIE
from tests.workbench.test_long_table import table


def searched(study: Any, terms: tuple[Term, ...] = (), alpha: float = 0.01, seed: int = 0) -> Search:
    search = Search(study, terms, alpha, seed, lambda _: None)
    search.run()
    return search


def names(search: Search) -> set[str]:
    return {term.effect for term in search.suggested}


def test_the_shares_of_the_level_are_all_of_it() -> None:
    shares = CATALOGUE_SHARE + SHAPES_SHARE + LINES_SHARE
    assert shares == pytest.approx(1.0)


def free_column(made_up: Any, effect: FloatArray) -> FloatArray:
    """What the baseline leaves of an effect, at unit length."""
    base = np.linalg.qr(made_up.baseline(made_up.observations(np.zeros(len(effect)))))[0]
    left = effect[:, 0] - base @ (base.T @ effect[:, 0])
    return np.asarray(left / np.linalg.norm(left))


def imitation(made_up: Any, share: float = 0.6) -> dict[str, FloatArray]:
    """Two effects and a proxy: their sum, and a share of something else."""
    catalogue = made_up.catalogue()
    a, b = free_column(made_up, catalogue["lag"]), free_column(made_up, catalogue["hysteresis"])
    other = free_column(made_up, np.random.default_rng(8).standard_normal((144, 1)) * (np.arange(144) < 96)[:, None])
    return {
        **{name: catalogue[name] for name in ("roll", "pitch", "square", "lag", "hysteresis")},
        "proxy": (a + b + share * other)[:, None],
    }


def test_a_proxy_gives_way_to_what_it_stands_for(made_up: Any, at_least: Any) -> None:
    effects, exact = imitation(made_up), 0
    a, b = free_column(made_up, effects["lag"]), free_column(made_up, effects["hysteresis"])
    for seed in range(10):
        exact += names(searched(made_up.study(seed, foreign=30.0 * a + 22.0 * b, effects=effects))) == {
            "lag",
            "hysteresis",
        }
    assert at_least(exact, 10, 0.95)


def test_an_effect_is_none_that_needs_shapes_beside_it_which_do_without_it(made_up: Any) -> None:
    """Something foreign at one place: what resembles it elsewhere a little is not named."""
    effects = imitation(made_up, 0.6)
    a, b = free_column(made_up, effects["lag"]), free_column(made_up, effects["hysteresis"])
    del effects["lag"], effects["hysteresis"]
    for seed in range(4):
        search = searched(made_up.study(seed, foreign=30.0 * a + 22.0 * b, effects=effects))
        assert "proxy" not in names(search)
        assert search.unexplained is not None


def test_a_proxy_that_keeps_out_both_it_stands_for_is_barred_for_once(made_up: Any) -> None:
    """Beside the proxy neither of the two is significant: one step at a time does not get there."""
    effects = imitation(made_up, 0.35)
    a, b = free_column(made_up, effects["lag"]), free_column(made_up, effects["hysteresis"])
    for seed in range(4):
        search = searched(made_up.study(seed, foreign=40.0 * (a + b), effects=effects))
        assert names(search) == {"lag", "hysteresis"}


def test_two_that_are_one_plain_shape_together_are_both_named(made_up: Any, at_least: Any) -> None:
    """A shape with amplitude and phase in the angle is a cosine and a sine: neither is needed beside it."""
    around = made_up.conditions()
    late = (around["start_s"] - around["start_s"].mean()) / around["start_s"].std()
    null = late * around["frequency_hz"] ** 2 * np.cos(np.radians(around["theta_deg"]))
    effects = {**made_up.catalogue(), "late-null": np.concatenate([null, np.zeros(2 * len(null))])[:, None]}
    exact = 0
    for seed in range(10):
        hidden = {"late-gain": 10.0, "late-null": 10.0}
        exact += names(searched(made_up.study(seed, hidden, effects=effects))) == set(hidden)
    assert at_least(exact, 10, 0.95)


def test_two_that_imitate_a_third_leave_when_it_comes(made_up: Any, at_least: Any) -> None:
    effects, exact = imitation(made_up), 0
    for seed in range(10):
        search = searched(made_up.study(seed, {"proxy": 25.0}, effects=effects))
        exact += names(search) == {"proxy"}
    assert at_least(exact, 10, 0.95)


def test_given_terms_stay_though_nothing_needs_them(made_up: Any) -> None:
    search = searched(made_up.study(1, {"lag": 15.0}), (Term("roll"), Term("square")))
    assert search.terms[:2] == (Term("roll"), Term("square"))
    assert names(search) == {"lag"}


def test_what_is_given_is_not_suggested_again(made_up: Any) -> None:
    assert names(searched(made_up.study(2, {"lag": 15.0}), (Term("lag"),))) == set()


def test_every_step_lowers_the_held_out_error(made_up: Any) -> None:
    study = made_up.study(3, {"roll": 12.0, "lag": 14.0, "square": 16.0})
    search = searched(study)
    assert names(search) == {"roll", "lag", "square"}
    errors = [search.attempt(move.terms).held_out.error() for move in search.moves]
    assert errors == sorted(errors, reverse=True)
    for before, after in zip(search.moves, search.moves[1:], strict=False):
        assert held_out_ratio(search.attempt(after.terms), search.attempt(before.terms)) < 1.0


def test_a_candidate_that_cannot_be_fitted_is_left_out(made_up: Any) -> None:
    """Something else may be significant: the search goes on with what can be fitted."""
    search = searched(made_up.study(4, {"roll": 15.0, "lag": 15.0}, refused=frozenset({"roll"})))
    assert names(search) == {"lag"}
    assert search.unexplained is not None


def test_of_two_parameters_that_do_the_same_one_is_held(made_up: Any) -> None:
    effects = made_up.catalogue()
    twice = {"lag": effects["lag"], "twice": np.hstack([effects["roll"], effects["roll"]])}
    search = searched(made_up.study(5, {"twice": 25.0, "lag": 15.0}, effects=twice))
    assert names(search) == {"lag", "twice"}
    assert len(search.attempt(search.terms).held) == 1


def test_a_strong_candidate_that_cannot_be_fitted_hides_no_other(made_up: Any) -> None:
    search = searched(made_up.study(5, {"roll": 25.0, "lag": 15.0}, refused=frozenset({"roll"})))
    assert "lag" in names(search)
    assert "roll" not in names(search)


def test_an_absorbed_parameter_is_held_while_the_effects_others_are_fitted(made_up: Any) -> None:
    effects = made_up.catalogue()
    partly = {"roll": effects["roll"], "partly": np.hstack([effects["recoil"], effects["lag"]])}
    foreign = made_up.sized(effects["lag"], 15.0)
    assert names(searched(made_up.study(6, foreign=foreign, effects=partly))) == {"partly"}


def test_a_model_is_fitted_once_whatever_the_order_of_its_terms(made_up: Any) -> None:
    search = Search(made_up.study(6), (), 0.01, 0, lambda _: None)
    assert search.attempt((Term("roll"), Term("lag"))) is search.attempt((Term("lag"), Term("roll")))
    assert search.attempt((Term("roll"),)) is not search.attempt((Term("lag"),))


def test_progress_is_told(made_up: Any) -> None:
    said: list[str] = []
    Search(made_up.study(7, {"roll": 15.0}), (), 0.01, 0, said.append).run()
    assert said == ["effects added: 0, candidates: 12", "effects added: 1, candidates: 11"]


def test_the_first_order_statistic_is_what_the_refit_brings(made_up: Any) -> None:
    search = Search(made_up.study(8, {"roll": 9.0}), (), 0.01, 0, lambda _: None)
    before, after = search.attempt(()), search.attempt((Term("roll"),))
    scored = next(each for each in before.scored if each.candidate.term.effect == "roll")
    white = before.noise.whiten(after.unexplained())
    assert before.result.chi2 - white @ white == pytest.approx(scored.score.statistic, rel=0.02)
    assert search.p_of_term((Term("roll"),), Term("roll")) == pytest.approx(scored.score.p_value, rel=0.5)


def test_the_bootstrap_never_makes_noise_from_the_scatter_more_certain(made_up: Any) -> None:
    def walk(rng: np.random.Generator, start_s: FloatArray) -> FloatArray:
        return np.asarray(np.cumsum(rng.standard_normal(len(start_s))))

    for seed in range(3):
        search = Search(made_up.study(seed, {"square": 60.0}, noise=walk), (), 0.01, 0, lambda _: None)
        attempt = search.attempt(())
        for each in attempt.scored:
            assert p_of_scored(attempt, each) >= each.score.p_value
        law = attempt.bootstrap.law("square")
        square = next(each for each in attempt.scored if each.candidate.term.effect == "square")
        assert attempt.to_be_drawn(square.score.basis)
        assert p_of_scored(attempt, square) >= law.p_value(square.score.statistic, square.score.dimension)
        assert law.scale >= 1.0
        assert law.dof <= attempt.noise.dof[-1]


def test_what_is_drawn_hangs_on_no_rounding(made_up: Any) -> None:
    """Draws of data of known noise, on which effects that the scatter's data share are held too."""
    whole = made_up.catalogue()
    both = {f"{a} {b}": whole[a] + whole[b] for a in ("roll", "pitch") for b in ("square", "warm-bias")}
    rounding = np.random.default_rng(1)
    rounded = {name: column * (1.0 + 1e-15 * rounding.standard_normal(column.shape)) for name, column in both.items()}
    laws = [
        Search(made_up.study(3, effects=effects), (), 0.01, 0, print).attempt(()).bootstrap.law(name)
        for effects in (both, rounded)
        for name in both
    ]
    told = np.array([(law.scale, law.dof) for law in laws])
    assert told[: len(both)] == pytest.approx(told[len(both) :], rel=1e-9)


@pytest.mark.parametrize("name", ["white", "relaxing", "random walk"])
def test_nothing_is_found_in_noise(made_up: Any, at_least: Any, name: str) -> None:
    """Alarms of catalogue and shapes together: 1.5 times nominal is the promise."""

    def noise(rng: np.random.Generator, start_s: FloatArray) -> FloatArray:
        steps, found = rng.standard_normal(len(start_s)), np.zeros(len(start_s))
        kept = {"white": 0.0, "relaxing": 0.8, "random walk": 1.0}[name]
        for i in range(1, len(start_s)):
            found[i] = kept * found[i - 1] + steps[i]
        return found

    quiet = 0
    for seed in range(16):
        search = searched(made_up.study(seed, noise=noise), alpha=0.05, seed=seed)
        quiet += not search.suggested and search.unexplained is None
    assert at_least(quiet, 16, 1.0 - 1.5 * 0.05)


def test_levels_grow_what_is_found(made_up: Any) -> None:
    study = made_up.study(11, {"roll": 5.0})
    p_value = min(
        corrected_for(Search(study, (), 0.01, 0, print).attempt(()), each.score.p_value, each.candidate.term.effect)
        for each in Search(study, (), 0.01, 0, print).attempt(()).scored
    )
    assert names(searched(study, alpha=2.0 * p_value)) == {"roll"}
    assert names(searched(study, alpha=0.5 * p_value)) == set()


def test_rivals_are_those_of_the_same_class_and_what_contains_the_simpler_is_wider(made_up: Any) -> None:
    effects = made_up.catalogue()
    effects["late-bias"] = effects["square"] * 2.0
    search = searched(made_up.study(12, {"square": 20.0}, effects=effects))
    (term,) = search.suggested
    (rival,) = rivals_of(search, term)
    assert {term.effect, rival.term.effect} == {"square", "late-bias"}
    assert not rival.wider
    lag = searched(made_up.study(13, {"lag": 20.0}))
    assert names(lag) == {"lag"}
    assert all(rival.wider for rival in rivals_of(lag, Term("lag")))
    scores = {each.candidate.term.effect: each.score for each in lag.attempt(()).scored}
    assert likeness(scores["lag"].basis, scores["resonance"].basis) > 0.99
    assert contained(scores["lag"].basis, scores["resonance"].basis) > 0.99


def test_of_effects_that_do_nearly_as_well_the_first_is_named_until_the_data_tell(made_up: Any) -> None:
    """The second acts, and correlates 0.98 with the first: evidence within 1 is no reason to prefer it."""
    first = free_column(made_up, made_up.catalogue()["square"])
    beside = np.random.default_rng(4).standard_normal((144, 1)) * (np.arange(144) < 96)[:, None]
    second = first + 0.2 * free_column(made_up, beside)
    effects, decided = {"first": first[:, None], "second": second[:, None]}, []
    for seed in range(12):
        search = searched(made_up.study(seed, foreign=12.0 * second, effects=effects, order=None))
        noise = search.attempt(search.terms).noise
        by_first, by_second = (search.attempt([Term(name)]).chi2_with(noise) for name in effects)
        if names(search) != set(effects):  # chance may ask for both
            decided.append(by_first - by_second > 2.0 * NEAR_TIE)
            assert names(search) == {"second" if decided[-1] else "first"}, seed
    assert {True, False} == set(decided)
    assert len(decided) >= 10


def with_lines(study: Any, *lines: Line) -> Any:
    """The study with steady lines in its samples."""

    class Lined(type(study)):  # type: ignore[misc]
        def effects(self) -> dict[str, str]:
            return {**super().effects(), "line": "a steady line"}

        def model(self, terms: Any) -> Any:
            model = super().model([term for term in terms if term.effect != "line"])
            model.terms = tuple(terms)
            return model

        def lines(self, model: Any) -> list[Line]:
            return [line for line in lines if line.term not in model.terms]

    return Lined(**vars(study))


def line(frequency_hz: float, p_value: float) -> Line:
    term = Term("line", {"frequency_hz": frequency_hz})
    size = {"amplitude": {"value": 3.0, "sigma": 0.1, "unit": "V"}}
    return Line(term, "v", frequency_hz, 3.0, 0.1, "V", p_value, 0.8, size)


def test_lines_below_their_share_of_the_level_are_added_the_surest_first(made_up: Any) -> None:
    sure, surer, doubtful = line(1.7, 1e-6), line(2.9, 1e-9), line(4.1, 2.0 * LINES_SHARE * 0.01)
    search = searched(with_lines(made_up.study(14), sure, surer, doubtful))
    assert search.suggested == (surer.term, sure.term)
    assert [move.added for move in search.moves] == [None, "line", "line"]


def test_an_effect_nobody_knows_is_refused_by_the_study(made_up: Any) -> None:
    class Strict(type(made_up.study(1))):  # type: ignore[misc]
        def model(self, terms: Any) -> Any:
            for term in terms:
                if term.effect not in self.columns:
                    raise ConfigError(f"no effect {term.effect}")
            return super().model(terms)

    with pytest.raises(ConfigError, match="no effect phlogiston"):
        searched(Strict(**vars(made_up.study(1))), (Term("phlogiston"),))


@pytest.mark.parametrize("seed", range(3))
def test_what_was_let_go_is_worked_out_again_to_the_last_bit(
    made_up: Any, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def found() -> str:
        study = made_up.study(seed, {"lag": 12.0, "hysteresis": 9.0})
        return repr(diagnose(study, ()))

    kept = found()
    monkeypatch.setattr("rigctl.workbench.verdict.search._NUMBERS_WHOLE", 0)
    monkeypatch.setattr("rigctl.workbench.verdict.search._LEAST_WHOLE", 1)
    assert found() == kept


def test_a_search_keeps_the_derivatives_of_the_last_models_alone(
    made_up: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rigctl.workbench.verdict.search._NUMBERS_WHOLE", 0)
    search = Search(made_up.study(1), (), 0.01, 0, lambda _: None)
    attempts = [search.attempt([Term(name)]) for name in ("roll", "pitch", "square", "lag", "hysteresis")]
    data = len(attempts[0].result.residuals)
    assert [len(each.result.jacobian) for each in attempts] == [0, 0, data, data, data]
    assert all(each.scored and len(each.jacobian) == data for each in attempts)


def test_a_model_with_a_term_more_is_fitted_anew_where_it_explains_less() -> None:
    """Two lines that began at one place stayed one: of four effects of a series (quarterly gas) one was left."""
    rng, t_s = np.random.default_rng(4), np.arange(120.0)
    columns = {"t_s": t_s, "z": rng.normal(size=120)}
    y = 2.0 * np.sin(2.0 * np.pi * t_s / 7.0) + 0.5 * columns["z"] + 0.1 * rng.standard_normal(120)
    study = table(y, "b0", **columns)
    line, linear = Term("periodic[t_s]", {"period": 7.0, "origin": 0.0}), Term("linear[z]")
    search = Search(study, (), 0.01, 0, lambda _: None)
    smaller = search.attempt([line])
    assert search._no_worse(smaller) is smaller
    model = study.model([line, linear])
    astray = FittedModel.where_it_ended(
        model, stated_noise(model), frozenset(), {**smaller.values, "periodic[t_s].period": 9.3}
    )
    stuck = Attempt(study, [line, linear], fitted=astray)
    assert np.std(stuck.unexplained()) > 2.0 * np.std(smaller.unexplained())
    found = search._no_worse(stuck)
    assert np.std(found.unexplained()) == pytest.approx(
        np.std(search.attempt([line, linear]).unexplained()), rel=1e-3
    )
    assert found.values["periodic[t_s].period"] == pytest.approx(7.0, abs=0.01)
