"""What first order settles is not fitted; what it leaves open is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rigctl.workbench.study import Term
from rigctl.workbench.verdict import first_order
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.first_order import LINEAR, found_at_least, found_at_most, least_comparable
from rigctl.workbench.verdict.score import p_of
from rigctl.workbench.verdict.search import Search


@pytest.fixture
def fitted_sets(monkeypatch: pytest.MonkeyPatch) -> list[set[str]]:
    """The effects of every whole model that is made."""
    made: list[set[str]] = []
    begin = Attempt.__init__

    def noting(self: Attempt, study: Any, terms: Any, *arguments: Any, **named: Any) -> None:
        made.append({term.effect for term in terms})
        begin(self, study, terms, *arguments, **named)

    monkeypatch.setattr(Attempt, "__init__", noting)
    return made


def searched(study: Any) -> Search:
    search = Search(study, (), 0.01, 0, lambda _: None)
    search.run()
    return search


def test_without_curvature_amplitudes_say_what_a_fit_without_them_loses(made_up: Any) -> None:
    """Chi-square's rise in a linear model is Wald's statistic; the p-value is of the part that any fit finds."""
    effects = made_up.catalogue()
    study = made_up.study(3, {"roll": 9.0, "lag": 6.0}, effects=effects)
    both = Attempt(study, (Term("roll"), Term("lag")))
    for effect, other in (("roll", "lag"), ("lag", "roll")):
        # Fitted in the noise of the fuller model: the least there is.
        one = Attempt(study, (Term(other),)).with_noise(both.noise)
        rise = one.result.chi2 - both.result.chi2
        shown, rest = both.shown(effect)
        q = np.linalg.qr(rest)[0]
        wald = float(np.sum((shown - q @ (q.T @ shown)) ** 2))
        assert wald == pytest.approx(rise, rel=1e-6)
        assert both.p_without(effect) > float(p_of(rise, 1, np.inf))


def test_a_term_far_beyond_the_level_stays_without_a_fit_of_the_rest(made_up: Any, fitted_sets: Any) -> None:
    effects = made_up.catalogue()
    del effects["resonance"]  # it imitates the lag
    search = searched(made_up.study(1, {"lag": 25.0, "hysteresis": 15.0}, effects=effects))
    assert {term.effect for term in search.suggested} == {"lag", "hysteresis"}
    assert {"hysteresis"} not in fitted_sets


def test_a_term_near_the_level_is_judged_by_fits(
    made_up: Any, fitted_sets: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    effects = made_up.catalogue()
    del effects["resonance"]  # it imitates the lag
    # Where first order settles nothing all are judged so.
    monkeypatch.setattr(first_order, "_LEAST", 0.0)
    searched(made_up.study(1, {"lag": 25.0, "hysteresis": 15.0}, effects=effects))
    assert {"hysteresis"} in fitted_sets


def test_what_another_effect_imitates_is_compared_with_it(made_up: Any) -> None:
    effects = made_up.catalogue()
    alone = Attempt(made_up.study(2, {"lag": 12.0}, effects=effects), (Term("lag"),))
    assert alone.p_beside_others("lag") > 0.5  # the resonance has the lag's column, and one more
    del effects["resonance"]
    alone = Attempt(made_up.study(2, {"lag": 12.0}, effects=effects), (Term("lag"),))
    assert alone.p_beside_others("lag") < 1e-9


def test_a_search_that_cannot_end_below_what_it_has_to_beat_is_left(made_up: Any, fitted_sets: Any) -> None:
    """Something foreign is left whatever is added, so that the search is tried with each found effect barred."""
    effects = made_up.catalogue()
    del effects["resonance"]
    other = np.random.default_rng(9).standard_normal((144, 1))
    # A fifth of the lag's square: it gets in where the lag is barred, and is far from enough.
    effects["proxy"] = made_up.sized(effects["lag"], 1.0)[:, None] + 2.0 * other / np.linalg.norm(other)
    wave = np.concatenate([np.cos(np.radians(3.0 * made_up.conditions()["theta_deg"])), np.zeros(96)])[:, None]
    search = searched(made_up.study(4, {"lag": 60.0}, foreign=made_up.sized(wave, 25.0), effects=effects))
    assert search.unexplained is not None
    without = [terms for terms in fitted_sets if "lag" not in terms and terms]
    assert not without


def test_a_huge_term_that_the_rest_imitates_nearly_all_of_is_judged_by_a_fit(made_up: Any) -> None:
    effects = made_up.catalogue()
    lag = effects["lag"]
    other = np.random.default_rng(6).standard_normal((144, 1))
    effects["twin"] = lag + 0.1 * np.linalg.norm(lag) * other / np.linalg.norm(other)
    study = made_up.study(5, {"lag": 400.0}, foreign=3.0 * effects["twin"][:, 0], effects=effects)
    both = Attempt(study, (Term("lag"), Term("twin")))
    assert both.p_without("lag") == 1.0
    alone = Attempt(made_up.study(5, {"lag": 400.0}, effects=effects), (Term("lag"),))
    assert alone.p_without("lag") < 1e-50


def test_bounds() -> None:
    assert found_at_least(100.0, 120.0) == pytest.approx(60.0)
    # Of a huge statistic that others imitate nearly all of, first order says nothing.
    assert found_at_least(2.0 * LINEAR, 20.0 * LINEAR) == 0.0
    assert found_at_most(100.0) == pytest.approx(125.0)
    assert found_at_most(LINEAR) == np.inf
    assert least_comparable(100.0) == pytest.approx(70.0)
    assert least_comparable(4.0 * LINEAR) == pytest.approx(LINEAR)
