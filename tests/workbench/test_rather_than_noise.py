"""A step, or readings that hang together along their order: compared by likelihood, and both said."""

from __future__ import annotations

import numpy as np
from scipy import stats

from rigctl.campaign.recording import READINGS, Header, ImportReport, Recording, RunRecord
from rigctl.core.arrays import FloatArray
from rigctl.experiments.table.study import TableStudy
from rigctl.report.verdicts import verdict_sentence
from rigctl.workbench.verdict.account import account_of
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.compare import compared
from rigctl.workbench.verdict.diagnose import diagnose
from rigctl.workbench.verdict.rather_than_noise import BY_CHANCE, break_rather_than_noise
from rigctl.workbench.verdict.search import Search
from tests.foreign.false_alarms import recording

DAYS = 80


def study_of(flow: FloatArray) -> TableStudy:
    spec = {"response": "flow", "baseline": "b0", "start": {}, "order": "day"}
    columns = {"flow": flow, "day": np.arange(float(len(flow)))}
    run = RunRecord(READINGS, READINGS, "import", {})
    return TableStudy(Recording(Header("table", extra={"table": spec}), (run,), {READINGS: columns}, ImportReport(1)))


def relaxing(seed: int, days: int = DAYS, of: float = 0.7) -> FloatArray:
    """First-order autoregressive noise of unit variance."""
    drawn = np.random.default_rng(seed).normal(size=days)
    for day in range(1, days):
        drawn[day] = of * drawn[day - 1] + np.sqrt(1.0 - of**2) * drawn[day]
    return drawn


def test_a_step_that_correlated_noise_may_stand_for_is_named_and_so_is_the_noise() -> None:
    """The flow of the Nile, as it were: two levels 1.9 sigma apart, early in the record."""
    flow = np.random.default_rng(1).normal(size=DAYS) - 1.9 * (np.arange(DAYS) >= 24)
    study = study_of(flow)
    account = account_of(study, [()])
    found = diagnose(study, (), account=account)
    assert found.verdict == "ambiguous"
    assert [term.effect for term in found.suggested] == ["step[day]"]
    assert found.or_correlated_noise == (("step[day]", "day"),)
    assert compared(account.attempt(study, ()), account, 1).p_value < 0.01
    with_it = diagnose(study, found.suggested, account=account)
    assert (with_it.verdict, with_it.or_correlated_noise) == ("adequate", found.or_correlated_noise)
    assert verdict_sentence(with_it.as_json()).endswith("along day: these data do not tell which.")
    said = verdict_sentence(found.as_json())
    assert said.startswith("step[day] (at 2")
    assert said.endswith("and so does noise that is correlated along day: these data do not tell which.")


def test_correlated_noise_is_seldom_taken_for_a_step() -> None:
    tables = 40
    attempts = [Attempt(study_of(relaxing(seed)), ()) for seed in range(tables)]
    # Both criteria together; of so many tables at the level of the second, one study in a thousand has more.
    assert sum(break_rather_than_noise(each) is not None for each in attempts) <= stats.binom.isf(
        1e-3, tables, BY_CHANCE
    )


def test_no_effect_that_shows_nothing_takes_the_place_of_a_break_for_being_simpler() -> None:
    """Flicker noise that a step describes: a drift is as likely beside the noise, but is significant beside none."""
    study = TableStudy(recording("flicker", 116))
    search = Search(study, (), 0.01, 0, lambda _: None)
    search.run()
    assert [term.effect for term in search.suggested] == ["step[time_s]"]
    # By the noise beside it the step is none of the significant ones: it is no part of the account.
    account = account_of(study, [()])
    assert account.richest.terms == ()
    found = diagnose(study, (), account=account)
    assert (found.verdict, found.suggested) == ("adequate", ())
    assert compared(account.attempt(study, ()), account, 1).p_value > 0.01
