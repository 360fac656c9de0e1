"""What was found, in sentences and numbers."""

from __future__ import annotations

import itertools
import math
import re
from typing import Any

import pytest

from rigctl.report.quantities import probability, quantity
from rigctl.report.tables.workbench import channels_table, ladder_table, parameters_table, ranking_table
from rigctl.report.terminal_workbench import print_comparison, print_diagnosis, print_fit, print_history
from rigctl.report.verdicts import (
    advice,
    comparison_sentence,
    fitted_choice,
    inseparable_sentences,
    named,
    repeats_sentence,
    scatter_sentences,
    sizes,
    slow_noise_sentences,
    verdict_sentence,
)


def rank(effect: str, *, p: float = 1e-9, same: tuple[str, ...] = (), **choice: Any) -> dict[str, Any]:
    return {
        "effect": effect,
        "choice": choice,
        "p_value": p,
        "p_value_corrected": p,
        "parameters": {"rho1": {"value": 9.7123e-5, "sigma": 1.2e-6, "unit": "rad/m"}},
        "held_out_error_ratio": 0.25,
        "equivalent_to": list(same),
        "chi2_fall": 81.0,
        "smallest_detectable": {"rho1": 4.5e-6},
    }


def diagnosis(verdict: str, *ranks: dict[str, Any], suggested: tuple[str, ...] = (), **more: Any) -> dict[str, Any]:
    return {
        "verdict": verdict,
        "alpha": 0.01,
        "suggested": list(suggested),
        "ranking": list(ranks),
        "inseparable": [],
        "unexplained": None,
        "not_testable": {},
        "impossible": {},
        **more,
    }


@pytest.mark.parametrize(
    ("value", "sigma", "unit", "text"),
    [
        (9.7123e-5, 1.2e-6, "rad/m", "(9.71 ± 0.12)e-05 rad/m"),
        (12.3456, 0.0123, "V", "12.346 ± 0.012 V"),
        (-123456.0, 1200.0, "", "-123456 ± 1200"),
        (0.0, 0.5, "K", "0.00 ± 0.50 K"),
        (1e-9, 3e-8, "m", "(0.1 ± 3.0)e-08 m"),
        (0.99999, 0.0, "1", "0.99999"),
        (1.0, None, "s", "1 s"),
        (math.nan, 1.0, "s", "not determined"),
        (0.0, math.inf, "s", "not determined"),
        (None, None, "s", "not determined"),
    ],
)
def test_a_quantity_has_as_many_digits_as_it_deserves(value: Any, sigma: Any, unit: str, text: str) -> None:
    assert quantity(value, sigma, unit) == text


def test_probabilities_too_small_to_matter_are_powers_of_ten() -> None:
    assert [probability(p) for p in (0.5, 0.012, 3e-9, 0.0, None)] == ["0.5", "0.012", "3.0e-09", "<1e-300", "-"]


def test_what_slow_noise_may_hide_is_said_with_the_sizes_that_would_show() -> None:
    hidden = {
        "effect": "bias-drift",
        "choice": {},
        "order": "start_s",
        "p_value_corrected": 0.4,
        "p_value_if_white": 2e-6,
        "smallest_detectable": {"rate[X]": 4.2e-7},
        "smallest_detectable_if_white": {"rate[X]": 9.1e-8},
        "units": {"rate[X]": "V/s"},
    }
    assert slow_noise_sentences(diagnosis("adequate")) == []
    said, then = slow_noise_sentences(diagnosis("adequate", hidden_in_slow_noise=[hidden]))
    assert said == (
        "Slow noise may hide bias-drift: if the noise were white along start_s it would be significant "
        "(p = 2.0e-06), as it is these data show rate[X] from 4.2e-07 V/s, not from 9.1e-08 V/s."
    )
    assert then == "In which order, and when, to measure so that it shows, rigctl next tells."


@pytest.mark.parametrize(("count", "ends"), [(7, False), (8, True)])
def test_a_diagnosis_that_ends_with_as_many_effects_as_it_may_says_so(count: int, ends: bool) -> None:
    effects = tuple(f"e{number}" for number in range(count))
    said = verdict_sentence(diagnosis("effect", *map(rank, effects), suggested=effects))
    assert said.endswith(" A diagnosis ends with 8 effects: ask again once they are added.") is ends


@pytest.mark.parametrize(("words", "sizes"), [(2, "1 V at w0, 2 V at w1"), (40, "1 V at w0 to 40 V at w39, of 40")])
def test_of_very_many_words_the_ends_of_the_scatter_are_said(words: int, sizes: str) -> None:
    uneven = {
        "along": "lot",
        "unit": "V",
        "of_stated": False,
        "p_value_corrected": 0.001,
        "by_word": {f"w{number}": number + 1.0 for number in range(words)},
    }
    said = scatter_sentences({"scatter": [uneven]})[0]
    assert said == f"The scatter differs by lot: {sizes} (p = 0.001)."


def test_each_verdict_is_a_sentence_and_a_command() -> None:
    adequate = diagnosis("adequate")
    assert "adequate" in verdict_sentence(adequate)
    assert "1 %" in verdict_sentence(adequate)
    assert advice(adequate, "x") == "rigctl result x"
    one = diagnosis("effect", rank("roll-gravity"), suggested=("roll-gravity",))
    assert verdict_sentence(one) == "An effect is missing: roll-gravity."
    both = diagnosis("effect", rank("a"), rank("b"), suggested=("a", "b"))
    assert verdict_sentence(both) == "2 effects are missing: a, b."
    assert advice(both, "x") == "rigctl model add x a b"
    # A shell would look for files named like it, and split it at its spaces.
    words = diagnosis("effect", rank("slope[a by b]"), suggested=("slope[a by b]",))
    assert advice(words, "x") == "rigctl model add x 'slope[a by b]'"
    either = diagnosis("ambiguous", rank("a", same=("c", "b")), rank("b"), suggested=("a",))
    assert verdict_sentence(either) == "The data are explained, but by more than one effect equally: a or c or b."
    assert advice(either, "x") == "rigctl next x"
    partly = diagnosis("ambiguous", rank("d"), rank("a", same=("b",)), suggested=("d", "a"))
    assert verdict_sentence(partly).startswith("An effect is missing: d. What is left is explained, but by more")
    assert verdict_sentence(partly).endswith("equally: a or b.")
    left = {"channel": "accel_v", "component": "DC", "description": "a step with humidity.", "p_value": 1e-6}
    unknown = diagnosis("unknown", rank("a"), suggested=("a",), unexplained=left)
    assert verdict_sentence(unknown).startswith("Something remains that none of the known effects explains: a step")
    assert verdict_sentence(unknown).endswith(
        "explains: a step with humidity, p = 1.0e-06. An effect is missing: a, and it does not suffice."
    )
    assert verdict_sentence(diagnosis("unknown", suggested=("a", "b"), unexplained=left)).endswith(
        "2 effects are missing: a, b, and they do not suffice."
    )
    assert "rigctl model add x ID --plugin FILE" in advice(diagnosis("unknown", unexplained=left), "x")


def test_what_is_unexplained_is_said_once(capsys: pytest.CaptureFixture[str]) -> None:
    left = {"channel": "accel_v", "component": "DC", "description": "accel_v DC is off by 3 V", "p_value": 1e-6}
    print_diagnosis(diagnosis("unknown", rank("a", p=1.0), unexplained=left), "x.rig.sqlite")
    told = " ".join(capsys.readouterr().out.split())
    assert told.count("accel_v DC") == 1
    assert told.count("1.0e-06") == 1


def test_a_choice_is_told_with_its_effect() -> None:
    assert named("laser-cosine", {"head": "laser_2_mm"}) == "laser-cosine (head laser_2_mm)"
    assert named("mains-pickup", {"frequency_hz": 49.987654}) == "mains-pickup (frequency_hz 49.988)"


@pytest.mark.parametrize("sigma", [math.nan, None])
def test_a_parameter_that_a_fit_held_says_so_wherever_it_is_told(sigma: float | None) -> None:
    """Kept in a store NaN is null: a rate at the end of its scan was told as "-0.05" there."""
    rate = {"value": -0.05, "sigma": sigma, "unit": "1/s"}
    said = "not determined, held at -0.05"
    found = rank("exponential[t_s]")
    found["parameters"] = {"exponential[t_s].rate": rate}
    assert sizes(found) == [f"rate = {said} 1/s"]
    rung = {"version": 1, "effects": [], "added": None, "removed": None, "result": {"rate": rate}}
    (row,) = ladder_table([{**rung, "chi2_per_dof": 1.0, "error_fit": 1.0, "error_held_out": 1.0}]).rows
    assert row[0].endswith(f"rate = {said} 1/s")
    fit = {"effects": [], "parameters": {"rate": rate}, "result": {}, "p_value": 0.5, "chi2_per_dof": 1.0, "dof": 9}
    assert parameters_table({**fit, "error_fit": 1.0, "error_held_out": 1.0}).rows == [["rate", said, "1/s"]]


def test_a_scanned_choice_is_told_where_its_fit_ended() -> None:
    found = rank("periodic[day]", period=0.40344, origin=3.0)
    assert fitted_choice(found) == {"period": 0.40344, "origin": 3.0}
    found["parameters"] = {"periodic[day].period": {"value": 0.412, "sigma": 1e-3, "unit": "day"}}
    assert fitted_choice(found) == {"period": 0.412, "origin": 3.0}


def test_what_cannot_be_told_apart_is_told_once_for_each_effect() -> None:
    pairs = [
        {"effect": "bench-recoil", "from": "baseline:theta0", "shift": "moves theta0 by 2 arcsec"},
        {"effect": "bench-recoil", "from": "yaw", "shift": ""},
    ]
    (told,) = inseparable_sentences(pairs)
    assert told == "bench-recoil cannot be told from the baseline's theta0 (moves theta0 by 2 arcsec), yaw"


@pytest.mark.parametrize(
    ("suggested", "said"),
    [((), "  1 pair of other effects: --json has it"), (("a",), "  and 1 pair of other effects: --json has it")],
)
def test_pairs_that_concern_nobody_are_counted_whether_or_not_others_are_named(
    suggested: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    pairs = [{"effect": "a", "from": "b", "shift": ""}, {"effect": "c", "from": "d", "shift": ""}]
    pairs = pairs if suggested else pairs[1:]
    print_diagnosis(diagnosis("effect" if suggested else "adequate", suggested=suggested, inseparable=pairs), "store")
    assert said in capsys.readouterr().out.splitlines()


def test_of_very_many_parameters_a_terminal_shows_the_ends(capsys: pytest.CaptureFixture[str]) -> None:
    """A slope for each of 79 words filled hundreds of lines of every table; a page and JSON have them all."""
    slopes = {f"slope[w{i:02}]": {"value": float(i), "sigma": 0.5, "unit": "V"} for i in range(79)}
    errors = {"chi2_per_dof": 1.0, "error_fit": 1.0, "error_held_out": 1.0}
    fit = {**errors, "effects": [], "parameters": slopes, "result": {}, "p_value": 0.5, "dof": 9, "version": 1}
    found = rank("slope")
    found["parameters"] = slopes
    print_fit(fit)
    print_history([{**fit, "added": None, "removed": None, "result": slopes}])
    print_diagnosis(diagnosis("effect", found, suggested=("slope",)), "store")
    # The line of a version, and of an effect, counts too.
    parts = re.split(r"\.\.\. 6[34] more, --json has all", capsys.readouterr().out)
    assert len(parts) == 4
    for before, after in itertools.pairwise(parts):
        assert "w10" in before
        assert "w12" not in before
        assert "w74" not in after
        assert "w75" in after
    assert len(parameters_table(fit).rows) == 79


def test_a_comparison_without_degrees_of_freedom_says_nothing_of_the_model() -> None:
    assert "nothing can be said" in comparison_sentence({"p_value": math.nan, "chi2_per_dof": math.nan, "dof": 0})


def test_names_with_brackets_survive_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    left = {"channel": "accel_v", "component": "DC", "description": "a step [red]", "p_value": 1e-6}
    ranks = [rank("power2[bold]"), *(rank(f"linear[c{i}]", p=1.0) for i in range(12))]
    found = diagnosis(
        "unknown", *ranks, suggested=("power2[bold]",), unexplained=left, not_testable={"inverse[x]": "x is zero"}
    )
    print_diagnosis(found, "store[1]")
    told = capsys.readouterr().out
    for text in ("power2[bold]", "(9.71 ± 0.12)e-05 rad/m", "a step [red]", "inverse[x]: x is zero", "store[1]"):
        assert text in told
    assert "7 more" in told
    assert max(map(len, told.splitlines())) <= 80


def test_a_channel_that_fits_is_not_marked(capsys: pytest.CaptureFixture[str]) -> None:
    channel = {"channel": "accel_v", "rms": 1.0, "noise": 1.0, "unit": "V", "data": 40}
    found = {
        "model": {"version": 3, "effects": ["roll-gravity"]},
        "chi2_per_dof": 2.0,
        "dof": 70,
        "p_value": 1e-5,
        "channels": [{**channel, "component": "DC", "chi2": 41.0}, {**channel, "component": "nu", "chi2": 120.0}],
        "worst": [{"run_id": "7", "channel": "accel_v", "component": "nu", "sigma": -6.2}],
        "trends": [],
        "lines": [{"channel": "accel_v", "frequency_hz": 49.99, "amplitude": 1e-3, "sigma": 1e-5, "unit": "V"}],
    }
    print_comparison(found)
    told = capsys.readouterr().out
    assert [line.count("FAILS") for line in told.splitlines() if "accel_v │" in line][:2] == [0, 1]
    assert "follow no covariate" in told
    assert "49.99 Hz" in told
    assert "Model version 3: baseline + roll-gravity" in told


@pytest.mark.parametrize(("series", "marked"), [(1, 1), (14, 0)])
def test_the_worst_of_many_channels_is_as_bad_as_chance_has_it(series: int, marked: int) -> None:
    """Chi-square 10 of one datum: p = 0.0016, and 0.02 as the largest of fourteen."""
    channel = {"channel": "m_y", "component": "", "rms": 1.0, "noise": 1.0, "unit": "1", "data": 1}
    channels = [{**channel, "chi2": 10.0}, *[{**channel, "chi2": 1.0}] * (series - 1)]
    assert failing({"channels": channels, "p_value": 1e-3}) == marked


@pytest.mark.parametrize(("p_value", "marked"), [(0.061, 0), (math.nan, 0), (1e-3, 1)])
@pytest.mark.parametrize("chi2", [120.0, 40.0])
def test_the_only_channel_fails_where_the_model_does(p_value: float, marked: int, chi2: float) -> None:
    """By one p-value: that considers what noise told by the same data says of a chi-square, and asks more than it."""
    channel = {"channel": "m_y", "component": "", "rms": 1.0, "noise": 1.0, "unit": "1", "data": 40, "chi2": chi2}
    assert failing({"channels": [channel], "p_value": p_value}) == marked


def failing(comparison: dict[str, Any]) -> int:
    return [row[-1] for row in channels_table(comparison).rows].count("FAILS")


def test_a_version_without_numbers_says_why(capsys: pytest.CaptureFixture[str]) -> None:
    rung = {"version": 1, "effects": [], "added": None, "removed": None, "chi2_per_dof": None}
    print_history([{**rung, "error_fit": None, "error_held_out": None, "note": "its file is gone"}])
    assert "version 1: not fitted: its file is gone" in capsys.readouterr().out


def test_what_is_not_significant_is_told_with_what_would_have_shown() -> None:
    found = diagnosis("effect", rank("roll-gravity"), rank("yaw", p=0.3), suggested=("roll-gravity",))
    named, other = (row[0] for row in ranking_table(found, most=6).rows)
    assert "would show" not in named
    assert "rho1 = (9.71 ± 0.12)e-05 rad/m" in other
    assert "would show from 4.5e-06 rad/m" in other


def test_the_unit_of_a_ratio_is_not_written() -> None:
    other = rank("roll-gravity", p=0.3)
    other["parameters"]["rho1"]["unit"] = "1"
    found = diagnosis("adequate", other)
    (row,) = (row[0] for row in ranking_table(found, most=6).rows)
    assert row.endswith("would show from 4.5e-06")


def test_repeats_are_told_with_the_lack_of_fit() -> None:
    lack = {"f": 214.7, "dof": 18, "pure_dof": 20, "p_value": 5e-19, "pure_error": 2.15e-4, "unit": "in"}
    said = repeats_sentence({"lack_of_fit": lack})
    assert said == "Repeats: 0.000215 in from 20 degrees of freedom; lack of fit F(18, 20) = 215, p = 5.0e-19."
    assert repeats_sentence({"lack_of_fit": None}) == ""
