"""Which effect is missing: named when the data say, honest when they do not."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from rigctl.cli.io import print_json
from rigctl.core.arrays import FloatArray
from rigctl.workbench.findings import Diagnosis
from rigctl.workbench.study import Candidate, NotTestable, Term
from rigctl.workbench.verdict.compare import compare
from rigctl.workbench.verdict.diagnose import diagnose

SINGLE = ("roll", "pitch", "lag", "resonance", "square", "hysteresis", "tilt")
PAIRS = (("roll", "lag"), ("hysteresis", "square"), ("pitch", "tilt"), ("late-gain", "roll"), ("resonance", "square"))
SIGMAS = 8.0


def suggested(found: Diagnosis) -> list[str]:
    return [term.effect for term in found.suggested]


def ranks(found: Diagnosis) -> dict[str, Any]:
    return {rank.term.effect: rank for rank in found.ranking}


def test_one_effect_is_named_and_nothing_else(made_up: Any, at_least: Any) -> None:
    exact = 0
    for seed in range(21):
        name = SINGLE[seed % len(SINGLE)]
        found = diagnose(made_up.study(seed, {name: SIGMAS}, order=None), ())
        exact += (found.verdict, suggested(found)) == ("effect", [name])
    assert at_least(exact, 21, 0.95)


def test_two_effects_are_named_and_nothing_else(made_up: Any, at_least: Any) -> None:
    exact = 0
    for seed in range(20):
        pair = PAIRS[seed % len(PAIRS)]
        found = diagnose(made_up.study(seed, dict.fromkeys(pair, SIGMAS), order=None), ())
        # Late and warm gains are much alike: the truth is among what is suggested.
        alike = {"warm-gain"} if "late-gain" in pair else set()
        exact += set(pair) <= set(suggested(found)) <= set(pair) | alike
    assert at_least(exact, 20, 0.95)


def test_alike_effects_are_in_the_confidence_set(made_up: Any, at_least: Any) -> None:
    """They correlate 0.9: at eight sigma one may not rule out the other."""
    held = 0
    for seed in range(14):
        name = ("warm-gain", "late-gain")[seed % 2]
        found = diagnose(made_up.study(seed, {name: SIGMAS}), ())
        (named,) = suggested(found)
        alternatives = ranks(found)[named].equivalent_to
        held += name in {named, *alternatives} <= {"warm-gain", "late-gain"}
        assert (found.verdict == "ambiguous") == bool(alternatives)
    assert at_least(held, 14, 0.98)


def test_nothing_missing_is_adequate(made_up: Any, at_least: Any) -> None:
    quiet = 0
    for seed in range(30):
        found = diagnose(made_up.study(seed), (), alpha=0.05, seed=seed)
        quiet += found.verdict == "adequate"
        assert (found.verdict == "adequate") == (not found.suggested and found.unexplained is None)
    assert at_least(quiet, 30, 1.0 - 1.5 * 0.05)


def test_what_no_effect_describes_is_unknown_and_its_place_is_named(made_up: Any, at_least: Any) -> None:
    theta, w = np.radians(made_up.conditions()["theta_deg"]), made_up.conditions()["frequency_hz"] / 0.5
    zero = np.zeros_like(theta)
    shapes = {
        "nu quadrature": np.concatenate([zero, np.cos(3.0 * theta), zero]),
        "nu in-phase": np.concatenate([np.sin(4.0 * theta) * w, zero, zero]),
    }
    unknown = named = 0
    for seed in range(20):
        where = ("nu quadrature", "nu in-phase")[seed % 2]
        foreign = made_up.sized(shapes[where][:, None], SIGMAS)
        found = diagnose(made_up.study(seed, foreign=foreign), ())
        unknown += found.verdict == "unknown"
        named += bool(found.suggested)
        if found.unexplained is not None:
            assert (found.unexplained.channel, found.unexplained.component) == ("v", where)
            assert found.unexplained.p_value < 0.01
            assert where in found.unexplained.description
    assert at_least(unknown, 20, 0.85)
    assert at_least(20 - named, 20, 0.9)


def test_an_effect_that_is_only_like_the_unknown_is_not_named(made_up: Any) -> None:
    """A gain that goes with the approach looks like hysteresis to a catalogue that has no such gain."""
    theta, w = np.radians(made_up.conditions()["theta_deg"]), made_up.conditions()["frequency_hz"] / 0.5
    column = np.cos(theta) * made_up.conditions()["approach"]
    foreign = made_up.sized(np.concatenate([column / w, np.zeros(96)])[:, None], 16.0)
    for seed in range(4):
        found = diagnose(made_up.study(seed, foreign=foreign), ())
        assert found.verdict == "unknown"
        assert not found.suggested


def test_a_weak_unknown_is_seldom_named_either(made_up: Any) -> None:
    """The same gain at 8 sigma: which of the two it is, is one question at the whole level."""
    theta, w = np.radians(made_up.conditions()["theta_deg"]), made_up.conditions()["frequency_hz"] / 0.5
    column = np.cos(theta) * made_up.conditions()["approach"]
    foreign = made_up.sized(np.concatenate([column / w, np.zeros(96)])[:, None], 8.0)
    # At the share of the level at which something is found at all it was three of these six.
    assert sum(bool(diagnose(made_up.study(seed, foreign=foreign), ()).suggested) for seed in range(6)) <= 1


def test_a_known_effect_beside_an_unknown_one_is_suggested_and_the_rest_is_unknown(made_up: Any) -> None:
    theta = np.radians(made_up.conditions()["theta_deg"])
    foreign = np.concatenate([np.zeros(48), 6.0 * np.cos(3.0 * theta), np.zeros(48)])
    found = diagnose(made_up.study(3, {"roll": 15.0}, foreign=foreign), ())
    assert found.verdict == "unknown"
    assert suggested(found) == ["roll"]
    assert found.unexplained is not None
    assert found.unexplained.component == "nu quadrature"


def test_scatter_beyond_the_noise_is_unknown_though_no_shape_describes_it(made_up: Any) -> None:
    """A component scatters by 1.7 of what its noise was said to be: compare and diagnose say the same of it."""
    told = 0
    for seed in range(4):
        scatter = np.concatenate([np.random.default_rng([seed, 9]).normal(0.0, 1.4, 48), np.zeros(96)])
        study = made_up.study(seed, foreign=scatter, order=None)
        found, compared = diagnose(study, ()), compare(study, ())
        assert (found.verdict == "adequate") == (compared.p_value >= 0.01)
        if found.unexplained is not None and "as no single effect" in found.unexplained.description:
            told += 1
            assert (found.unexplained.component, found.verdict) == ("nu in-phase", "unknown")
    assert told


@pytest.mark.parametrize("true", ["warm-bias", "late-bias"])
def test_effects_that_do_the_same_are_ambiguous_and_the_simplest_stands_for_them(
    made_up: Any, at_least: Any, true: str
) -> None:
    effects = made_up.catalogue()
    effects["late-bias"] = -3.0 * effects["warm-bias"]
    right = 0
    for seed in range(10):
        found = diagnose(made_up.study(seed, {true: 12.0}, effects=effects, order=None), ())
        right += (found.verdict, suggested(found)) == ("ambiguous", ["warm-bias"])
        assert ("warm-bias", "late-bias") in [(each.effect, each.other) for each in found.inseparable]
    assert at_least(right, 10, 0.95)


def test_whatever_an_effect_of_the_model_absorbs_is_equivalent_to_that_effect(made_up: Any) -> None:
    effects = made_up.catalogue()
    effects["late-bias"] = -3.0 * effects["warm-bias"]
    found = diagnose(made_up.study(1, {"warm-bias": 20.0}, effects=effects, order=None), ())
    assert suggested(found) == ["warm-bias"]
    assert ranks(found)["late-bias"].equivalent_to == ("warm-bias",)
    assert ranks(found)["warm-bias"].equivalent_to == ("late-bias",)


def test_an_effect_within_a_wider_one_is_named_without_it(made_up: Any, at_least: Any) -> None:
    right = 0
    for seed in range(12):
        found = diagnose(made_up.study(seed, {"lag": SIGMAS}), ())
        right += (found.verdict, suggested(found)) == ("effect", ["lag"])
    assert at_least(right, 12, 0.95)


def test_an_absorbed_effect_is_inseparable_and_said_to_move_the_result(made_up: Any) -> None:
    found = diagnose(made_up.study(5, foreign=20.0 * made_up.catalogue()["recoil"][:, 0]), ())
    assert found.verdict == "adequate"
    (pair,) = [each for each in found.inseparable if each.effect == "recoil"]
    assert pair.other == "baseline:b1"
    assert pair.shift == "its typical size moves b1 by 1"
    rank = ranks(found)["recoil"]
    assert rank.equivalent_to == ("baseline:b1",)
    assert rank.keep < 1e-6
    assert rank.parameters["recoil.0"].value == 0.0
    assert np.isinf(rank.parameters["recoil.0"].sigma)
    assert not rank.detectable


def test_the_sizes_are_those_that_were_hidden(made_up: Any) -> None:
    pulls = []
    for seed in range(8):
        study = made_up.study(seed, {"roll": 15.0, "lag": 12.0})
        found = ranks(diagnose(study, ()))
        for name, sigmas in (("roll", 15.0), ("lag", 12.0)):
            (size,) = found[name].parameters.values()
            pulls.append(abs(size.value) / size.sigma - sigmas)
    assert np.abs(np.mean(pulls)) < 4.0 / np.sqrt(len(pulls)) + 0.3
    assert np.std(pulls) == pytest.approx(1.0, abs=4.0 / np.sqrt(2 * len(pulls)))


def test_held_out_errors_fall_for_what_is_missing_and_not_for_what_is_not(made_up: Any) -> None:
    found = diagnose(made_up.study(6, {"roll": 20.0}), ())
    first, *others = found.ranking
    assert first.term.effect == "roll"
    assert first.held_out_error_ratio < 0.7
    ratios = [each.held_out_error_ratio for each in others if np.isfinite(each.held_out_error_ratio)]
    assert len(ratios) >= 8
    assert min(ratios) > 0.95


def test_steps_tell_the_way_from_the_start_to_noise(made_up: Any) -> None:
    found = diagnose(made_up.study(7, {"roll": 20.0, "lag": 15.0}), ())
    assert [step.added for step in found.steps] == [None, "roll", "lag"]
    assert [len(step.terms) for step in found.steps] == [0, 1, 2]
    chi2 = [step.chi2_per_dof for step in found.steps]
    assert chi2 == sorted(chi2, reverse=True)
    assert found.steps[0].p_value < 1e-6 < found.steps[-1].p_value
    assert found.steps[-1].error_held_out == pytest.approx(1.0, abs=4.0 / np.sqrt(2 * 144))


def test_the_smallest_detectable_size_is_found_and_half_of_it_is_not(made_up: Any, at_least: Any) -> None:
    quiet = ranks(diagnose(made_up.study(8), ()))["roll"]
    (size,) = quiet.detectable.values()
    (estimate,) = quiet.parameters.values()
    sigmas = size / estimate.sigma
    detected = {
        share: sum(
            "roll" in suggested(diagnose(made_up.study(seed, {"roll": share * sigmas}), ())) for seed in range(16)
        )
        for share in (1.0, 0.5)
    }
    # The catalogue's promise, less what shapes of the same series take away.
    assert at_least(detected[1.0], 16, 0.9)
    assert at_least(16 - detected[0.5], 16, 0.5)


def test_the_level_is_respected(made_up: Any) -> None:
    study = made_up.study(9, {"roll": 5.0})
    p_value = next(rank.p_value_corrected for rank in diagnose(study, (), alpha=1e-12).ranking)
    assert diagnose(study, (), alpha=2.0 * p_value).verdict == "effect"
    assert diagnose(study, (), alpha=0.5 * p_value).verdict == "adequate"


def test_a_seed_gives_the_same_answer_again(made_up: Any) -> None:
    def walk(rng: np.random.Generator, start_s: FloatArray) -> FloatArray:
        return np.asarray(np.cumsum(rng.standard_normal(len(start_s))))

    study = made_up.study(10, {"square": 20.0}, noise=walk)
    first, again = (json.dumps(diagnose(study, (), seed=3).as_json()) for _ in range(2))
    assert first == again
    assert diagnose(made_up.study(10), (), seed=4).n_eff != diagnose(made_up.study(10), (), seed=3).n_eff


def test_what_the_model_has_is_neither_ranked_nor_suggested(made_up: Any) -> None:
    found = diagnose(made_up.study(11, {"lag": 15.0}), (Term("lag"),))
    assert found.verdict == "adequate"
    assert "lag" not in ranks(found)
    assert found.as_json()["model"] == {"effects": ["lag"]}


def test_what_cannot_be_asked_is_said_with_its_reason(made_up: Any) -> None:
    class Lacking(type(made_up.study(1))):  # type: ignore[misc]
        def candidates(self, model: Any, values: FloatArray) -> tuple[list[Candidate], list[NotTestable]]:
            found, _ = super().candidates(model, values)
            kept = [each for each in found if each.term.effect != "warm-gain"]
            return kept, [NotTestable("warm-gain", "the temperature was not recorded")]

    found = diagnose(Lacking(**vars(made_up.study(12))), ())
    assert found.not_testable == {"warm-gain": "the temperature was not recorded"}
    assert "warm-gain" not in ranks(found)


def test_effects_that_cannot_be_fitted_end_in_unknown_not_in_an_error(made_up: Any) -> None:
    found = diagnose(made_up.study(13, {"roll": 15.0}, refused=frozenset(made_up.catalogue())), ())
    assert found.verdict == "unknown"
    assert not found.suggested
    assert ranks(found)["roll"].p_value < 1e-6


@pytest.mark.parametrize("runs", [3, 4, 6, 9, 12])
def test_few_runs_are_no_error_and_seldom_an_alarm(made_up: Any, at_least: Any, runs: int) -> None:
    quiet = 0
    for seed in range(8):
        found = diagnose(made_up.study(seed, runs=runs), ())
        quiet += found.verdict == "adequate"
        json.dumps(found.as_json())
    assert at_least(quiet, 8, 0.95)


@pytest.mark.parametrize("values", [np.full(48, 3.0), np.full(48, np.nan), np.where(np.arange(48) == 5, np.nan, 1.0)])
def test_constant_and_unknown_covariates_change_nothing(made_up: Any, values: FloatArray) -> None:
    study = made_up.study(14, {"roll": 12.0})
    further = made_up.study(14, {"roll": 12.0}, further={"humidity": values})
    assert json.dumps(diagnose(further, ()).as_json()) == json.dumps(diagnose(study, ()).as_json())


def test_one_block_leaves_held_out_errors_open_and_the_effect_named(made_up: Any) -> None:
    found = diagnose(made_up.study(15, {"roll": 12.0}, blocks=1), ())
    assert suggested(found) == ["roll"]
    assert all(np.isnan(rank.held_out_error_ratio) for rank in found.ranking)


def test_the_json_has_the_keys_of_the_command_and_no_nan(made_up: Any, capsys: pytest.CaptureFixture[str]) -> None:
    print_json(diagnose(made_up.study(16, {"lag": 15.0}, blocks=1), ()).as_json())

    def refuse(name: str) -> float:
        raise AssertionError(f"{name} is no JSON")

    document = json.loads(capsys.readouterr().out, parse_constant=refuse)
    assert {"verdict", "suggested", "ranking", "inseparable", "unexplained", "next_measurement"} <= set(document)
    assert document["suggested"] == ["lag"]
    assert len(document["ranking"]) == len(made_up.catalogue())
    for rank in document["ranking"]:
        assert {
            "effect",
            "p_value",
            "p_value_corrected",
            "parameters",
            "held_out_error_ratio",
            "equivalent_to",
        } <= set(rank)
        for each in rank["parameters"].values():
            assert set(each) == {"value", "sigma", "unit"}
    assert {"effect": "recoil", "from": "baseline:b1"}.items() <= document["inseparable"][0].items()
    theta = np.radians(made_up.conditions()["theta_deg"])
    foreign = np.concatenate([np.zeros(48), 6.0 * np.cos(3.0 * theta), np.zeros(48)])
    print_json(diagnose(made_up.study(17, foreign=foreign), ()).as_json())
    assert {"channel", "description"} <= set(json.loads(capsys.readouterr().out)["unexplained"])
