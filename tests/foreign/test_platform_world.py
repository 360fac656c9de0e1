"""The second world of the rotating platform, and what the commands say of recordings made in it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl.campaign.bundle.bundle import read_bundle
from rigctl.experiments.rotating_platform.study import PlatformStudy
from rigctl.workbench.verdict.fitted_model import fit_with_given_noise
from tests.foreign.platform_bundle import Habits, Noise, noises, write
from tests.foreign.platform_score import PLATFORM
from tests.foreign.platform_size import Sight, kept_sign, operator, whitener
from tests.foreign.platform_trial import Trial, drawn, drawn_bench, drawn_noise, drawn_runs
from tests.foreign.platform_world import Floats, Platform, Run, angle, readings
from tests.foreign.sessions import CHECKS, Session, command, run, taken_through
from tests.foreign.trials import scored, summary

# Up to a minute's work each, on a computer that may be busy.
pytestmark = pytest.mark.timeout(600)

HABITS = Habits(wrapped_angle=False, with_temperature=True, with_biases=False, dropped=0.0)
BASELINE_P = 1e-3
QUIETER = 30.0
"""So much less noise, in amplitude: the converter's steps are still drowned in it."""


def plain(effects: dict[str, float], **changes: object) -> Platform:
    """The seed's bench, with the constants that the page's leaks are stated for."""
    bench = Platform(
        assumed_gain_v={"z": 846.73, "y": 804.32},
        assumed_servo_gain_v={"z": 825.0, "y": 805.0},
        gain_error={"z": 0.0, "y": 0.0},
        servo_gain_error={"z": 0.0, "y": 0.0},
        rest_m_s2={"z": 1.5 / 825.0, "y": -2.98e-4},
        bias_m_s2={"z": 10.54e-4, "y": -14.33e-4},
        effects=effects,
    )
    return replace(bench, **changes)  # type: ignore[arg-type]


def leak(pattern: str, effects: dict[str, float], **changes: object) -> Floats:
    """What an effect adds to the four outputs of the second of three periods: accel mean, slope, bias mean, slope."""
    made = Run(pattern, 60.0, 3, 10.0, 20.0, "constant", 0.0, 0.0, 0.0, 0.0)
    with_it, without = plain(effects, **changes), plain({}, **changes)
    m = readings(made, with_it)["z"] - readings(made, without)["z"]
    middle = slice(600, 1200)
    c, t = kept_sign(made, with_it)[middle], made.time_s[middle]
    t = t - t[c != 0.0].mean()
    kept = np.abs(c)
    square = kept @ t**2
    return np.array([c @ m[middle], c * t @ m[middle], kept @ m[middle], kept * t @ m[middle]]) / [
        kept.sum(), square, kept.sum(), square,
    ]  # fmt: skip


SHORT, CENTRIFUGAL = {"mask_short_s": 0.5}, {"r_cos[z]": 0.05}


@pytest.mark.parametrize("pattern", ["b", "c"])
@pytest.mark.parametrize(
    ("effects", "changes", "output", "leaks"),
    [
        # Leaks of the page's table into accel mean (0) and bias mean (2) at 60 s, for b and c.
        ({"r_sin[z]": -0.05}, SHORT, 0, (7.3231e-5, 1.0914e-3)),
        (CENTRIFUGAL, SHORT, 2, (-1.0942e-7, -1.3065e-5)),
        ({"delay_s": 0.2, "r_sin[z]": -0.05}, {}, 0, (6.1941e-6, 9.8742e-5)),
        ({"e[z]": 1e-6, "T_r": 60.0}, {}, 2, (8.5111e-7, 9.1826e-7)),
        ({"e_signed[z]": -1e-6, "T_r": 60.0}, {}, 0, (8.5111e-7, 9.1826e-7)),
        ({"kx[z]": 1e-3}, {}, 0, (-2.98e-7, -2.98e-7)),
        ({"K2[z]": 3e-5}, {}, 0, (1.1498e-10, 1.1498e-10)),
        ({"K2[z]": 3e-5}, {}, 2, (1.3250e-10, 1.3250e-10)),
        ({"e_abs[z]": 1e-4}, {}, 0, (1.0540e-7, 1.0540e-7)),
        ({"e_abs[z]": 1e-4}, {}, 2, (1.8182e-7, 1.8182e-7)),
        ({"k1[z]": 1e-4 / 3600.0}, {}, 1, (5.0505e-11, 5.0505e-11)),
    ],
)
def test_effects_leak_as_the_page_says(
    pattern: str, effects: dict[str, float], changes: dict[str, float], output: int, leaks: tuple[float, float]
) -> None:
    """The page takes a recovery from the beginning of each sample, half a tenth of a second before its middle."""
    expected = leaks["bc".index(pattern)]
    tolerance = 0.05 / 60.0 if "T_r" in effects else 1e-4
    assert leak(pattern, effects, **changes)[output] == pytest.approx(expected, rel=1.1 * tolerance)


def test_a_filter_rings_as_much_as_the_page_says() -> None:
    """Its two figures are of another realisation of the filter: 3.6e-6 and 5.8e-5."""
    for pattern, expected in (("b", 3.6e-6), ("c", 5.8e-5)):
        assert abs(leak(pattern, {"filter": 1.0, "r_sin[z]": 0.05})[0]) == pytest.approx(expected, rel=0.1)


def test_the_noise_is_that_from_which_sizes_are_computed() -> None:
    random = np.random.default_rng(5)
    noise, bench = drawn_noise(random), drawn_bench(random)
    made = Run("c", 60.0, 4, 4.0, 20.0, "constant", 0.0, 0.0, 0.0, 0.0)
    weights = operator(made, bench)
    rows = whitener(made, bench, noise, weights) @ weights
    theta, _, _ = angle(made, bench, made.time_s)
    white = np.array([rows @ each for _ in range(150) for each in noises(random, noise, made, theta).values()])
    assert (white**2).mean() == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / white.size))


def test_both_worlds_have_the_same_conventions(tmp_path: Path) -> None:
    """Without effects and almost without noise the baseline describes this world."""
    random = np.random.default_rng(2)
    runs, bench, noise = drawn_runs(random), drawn_bench(random), drawn_noise(random)
    constant = [each for each in runs if each.external == "constant" and each.period_s < 100.0]
    quiet = Noise(
        noise.white / QUIETER**2, noise.flicker / QUIETER**2, noise.exponent, noise.pendulum / QUIETER, 1e-9
    )
    write(constant, replace(bench, forward=True), quiet, replace(HABITS, wrapped_angle=True), 1, tmp_path / "quiet")
    store = str(tmp_path / "quiet.rig.sqlite")
    run("import", str(tmp_path / "quiet"), "--store", store)
    compared = command("compare", store)
    assert compared["p_value"] > BASELINE_P, compared["channels"]


def test_sizes_are_in_sigma_and_linear() -> None:
    trial = small(3)
    size = trial.hidden["recovery"]
    assert size == pytest.approx(15.0, rel=1e-6)
    sight = Sight(trial.runs, trial.bench.with_effects({}), trial.noise)
    assert sight.size({"e[z]": 2.0 * trial.parameters["e[z]"], "T_r": 6.0}) == pytest.approx(2.0 * size, rel=1e-6)


RECOVERY = {"e[z]": 1e-6, "T_r": 6.0}
CREEP = {"creep[z]": 1e-6, "creep_turns": 7.0}
SUPPLY = {"per_v[z]": 1e-2}


def small(seed: int, name: str = "recovery", effect: Mapping[str, float] = RECOVERY) -> Trial:
    """One effect of 15 sigma, a sensor z that recovers after every turn if nothing else is said, in short runs."""
    random = np.random.default_rng(seed)
    bench, noise = drawn_bench(random), drawn_noise(random)
    runs = [
        Run("c", 60.0, 6, 4.0, 20.0, "constant", v_z, 0.0, 0.0, 500.0 * number)
        for number, v_z in enumerate((0.0, 1.5, -0.75, 1.0, 0.5))
    ]
    sight = Sight(runs, bench, noise)
    scale = 15.0 / sight.size(dict(effect))
    sized = {part: value * scale if "[" in part else value for part, value in effect.items()}
    return Trial(runs, bench.with_effects(sized), noise, HABITS, {name: sight.size(sized)})


@pytest.mark.parametrize(
    ("name", "effect", "size", "told", "drafted"),
    [
        ("creeping-bias", CREEP, "creep[z]", "turns_in_run_modulo_7", "run.turns_in_run % 7"),
        ("supply-gain", SUPPLY, "per_v[z]", "signal*supply_v", 'run.column("supply_v")'),
    ],
)
def test_what_is_in_no_catalogue_is_told_by_what_it_follows_and_drafted(
    tmp_path: Path, name: str, effect: dict[str, float], size: str, told: str, drafted: str
) -> None:
    """Each output of a period shows a part of it that need not stand out; the draft, added, explains it."""
    trial = small(4, name, effect)
    write(trial.runs, trial.bench, trial.noise, trial.habits, 4, tmp_path / "elsewhere")
    store, draft = str(tmp_path / "unknown.rig.sqlite"), str(tmp_path / "my_effect.py")
    run("import", str(tmp_path / "elsewhere"), "--store", store)
    found = command("diagnose", store, "--draft", draft)
    assert (found["verdict"], found["suggested"]) == ("unknown", [])
    assert found["unexplained"]["channel"] == "m_z"
    assert found["unexplained"]["details"]["covariate"] == told
    assert drafted in Path(draft).read_text()
    run("model", "add", store, "drafted", "--plugin", draft)
    before, after = command("model", "history", store, "--plugin", draft)
    assert after["error_held_out"] < before["error_held_out"]
    assert command("compare", store, "--plugin", draft)["p_value"] > BASELINE_P
    k = command("fit", store, "--plugin", draft)["parameters"]["k[z]"]
    assert k["value"] == pytest.approx(trial.parameters[size], abs=4.0 * k["sigma"])


@pytest.fixture(scope="module")
def squared(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Noise]:
    """A square in both readings, seen by a sine at the tilt in a quiet world, and that world's noise.

    Nothing tilts Y: there the square is a shift of what is fitted.
    """
    random = np.random.default_rng(11)
    bench, noise = drawn_bench(random), drawn_noise(random)
    quiet = Noise(noise.white / 400.0, noise.flicker / 400.0, noise.exponent, noise.pendulum / 20.0, 1e-9)
    runs = [
        Run("c", 60.0, 6, 4.0, 20.0, "constant", v_z, 0.0, 0.0, 500.0 * number)
        for number, v_z in enumerate((0.0, 1.5, -0.75, 1.0, 0.5))
    ]
    runs.append(Run("c", 60.0, 20, 4.0, 20.0, "sine", 1.0, 600.0, 0.0, 3000.0))
    bundle = tmp_path_factory.mktemp("squared") / "elsewhere"
    write(runs, bench.with_effects({"K2[z]": 1.0, "K2[y]": 1.0}), quiet, HABITS, 5, bundle)
    return bundle, quiet


def test_what_an_external_sine_bends_within_a_period_is_no_noise(squared: tuple[Path, Noise]) -> None:
    """Of some 100 degrees of freedom a density is known to a seventh; the sine's bend was a hundred times it."""
    bundle, noise = squared
    frequency_hz = np.array([1.0 / 60.0, 0.2, 1.0])
    pendulum = noise.pendulum * np.clip((frequency_hz / 0.2) ** 2, 1.0, 100.0)
    true = noise.white + noise.flicker / frequency_hz**noise.exponent + pendulum**2
    for each in PlatformStudy(read_bundle(bundle)).recorded.channels:
        assert each.noise(frequency_hz) / true == pytest.approx(1.0, abs=4.0 / 7.0), each.run.run_id


def test_a_square_that_one_channel_cannot_show_is_held_there_and_the_ladder_falls_as_promised(
    squared: tuple[Path, Noise],
) -> None:
    session = taken_through(squared[0], reference={"known": "a square in the readings"})
    assert session.suggested == ["quadratic"]
    assert session.diagnose["joint_fit"]["held"] == ["K2[y]"]
    for check in ("noise", "ladder", "promise", "agree"):
        CHECKS[check](session)
    found = session.fit["parameters"]
    assert found["K2[z]"]["value"] == pytest.approx(1.0, abs=4.0 * found["K2[z]"]["sigma"])
    assert found["K2[y]"] == {"value": 0.0, "sigma": None, "unit": "s2/m"}


@pytest.fixture(scope="module")
def short_mask(tmp_path_factory: pytest.TempPathFactory) -> tuple[Trial, Mapping[str, Any]]:
    """A trial whose samples count 0.57 s into every turn, its sensor a micrometre off the axis, as fitted."""
    trial = drawn(4020)
    directory = tmp_path_factory.mktemp("short")
    write(trial.runs, trial.bench, trial.noise, trial.habits, 2, directory / "elsewhere")
    store = str(directory / "short.rig.sqlite")
    run("import", str(directory / "elsewhere"), "--store", store)
    run("model", "add", store, "off-centre")
    return trial, command("fit", store)


def test_between_the_stops_a_chains_own_gain_is_not_a_force(short_mask: tuple[Trial, Mapping[str, Any]]) -> None:
    """Y's chain reads 3.7 % more of a_Z than Z's does: taken as one gain, r_cos[y] was 6 sigma off."""
    trial, fit = short_mask
    found = fit["parameters"]
    gains = trial.bench.gain_error
    true = {"gain_mismatch": (1.0 + gains["y"]) / (1.0 + gains["z"]) - 1.0} | {
        f"{name}[{channel}]": trial.parameters.get(f"{name}[{channel}]", 0.0)
        for name in ("r_cos", "r_sin")
        for channel in "zy"
    }
    pulls = {name: (found[name]["value"] - value) / found[name]["sigma"] for name, value in true.items()}
    assert all(abs(pull) < 4.0 for pull in pulls.values()), pulls


def test_an_encoders_noise_is_no_noise_of_the_readings(short_mask: tuple[Trial, Mapping[str, Any]]) -> None:
    """Fitted to what the command differs by from period to period, its noise made chi-squared 0.84 of what it is."""
    _, fit = short_mask
    assert fit["chi2_per_dof"] == pytest.approx(1.0, abs=3.0 * np.sqrt(2.0 / fit["dof"]))


@pytest.mark.parametrize("seed", [4029, 4006, 4012])
def test_what_the_temperature_bends_within_long_periods_is_no_noise(seed: int, tmp_path: Path) -> None:
    """Runs of three periods of 300 s, through which the room swings by half a kelvin.

    Of such a run's bias the fit leaves nothing: as that output outweighed all others, levels
    were told up to 277 times too high.
    """
    trial = drawn(seed)
    write(trial.runs, trial.bench, trial.noise, trial.habits, seed, tmp_path / "elsewhere")
    # Above what the world's slowest state cuts off, below the pendulum's rise.
    true = trial.noise.white + trial.noise.flicker / 0.05**trial.noise.exponent
    for each in PlatformStudy(read_bundle(tmp_path / "elsewhere")).recorded.channels:
        # Of 20 degrees of freedom a density is known to a third.
        assert 1.0 / 2.4 < float(each.noise(np.array([0.05]))[0]) / true < 2.4, (each.run.run_id, each.channel)


QUIET_SEEDS = range(7000, 7006)


def test_the_noise_of_every_output_is_as_large_as_is_said(tmp_path: Path) -> None:
    """Of benches on which nothing acts. What fits took of the slow bias was spread over all outputs once: then the
    bias scattered 1.26 times as much in variance as was said, the acceleration 0.89, the spectrum's peaks 1.40.
    """
    chi2, dof = np.zeros(4), np.zeros(4)
    kinds = {"accel mean": 0, "accel slope": 0, "bias mean": 1, "bias slope": 2, "spectrum": 3}
    for seed in QUIET_SEEDS:
        random = np.random.default_rng(seed)
        runs, bench, noise = drawn_runs(random), drawn_bench(random), drawn_noise(random)
        write(runs, bench, noise, HABITS, seed, tmp_path / f"{seed}")
        fit = fit_with_given_noise(PlatformStudy(read_bundle(tmp_path / f"{seed}")).model(()), {})
        left, basis = fit.whitened(), fit.projector.basis
        given = fit.model.observations
        freedom = 1.0 - np.einsum("ij,ij->i", basis[: len(left)], basis[: len(left)])
        for number, series in enumerate(given.series):
            if (kind := kinds.get(series.component)) is not None:
                chi2[kind] += left[given.series_of == number] @ left[given.series_of == number]
                dof[kind] += freedom[given.series_of == number].sum()
    # Levels themselves are known to some per cent.
    assert chi2 / dof == pytest.approx(np.ones(4), abs=0.03 + 3.0 * np.sqrt(2.0 / dof.min())), chi2 / dof
    assert np.abs(chi2 / dof - 1.0)[:3].max() < 0.06 + 3.0 * np.sqrt(2.0 / dof[:3].min())


def test_a_trial_scores_what_was_said() -> None:
    """A recovery and a line told; the line was not there. Whole sessions are `python -m tests.foreign.trials`."""
    trial = small(7)
    e, sigma = trial.parameters["e[z]"], 1e-7
    told = {"e[z]": {"value": e + 2.0 * sigma, "sigma": sigma}, "t_r": {"value": 6.0, "sigma": None}}
    ranking = [{"effect": "recovery", "equivalent_to": []}, {"effect": "line", "equivalent_to": []}]
    session = Session(
        reference={},
        response="",
        compare={"p_value": 1e-9},
        diagnose={"verdict": "effect", "suggested": ["recovery", "line"], "ranking": ranking, "unexplained": None},
        again={},
        after={"p_value": 0.5},
        fit={"parameters": told},
        history=[{"error_fit": 1.0, "error_held_out": 1.0}],
    )
    score = {"seed": 7, **scored(PLATFORM, trial, session)}
    assert score["all_named"]
    assert score["invented"] == ["line"]
    assert score["pulls"] == {"e[z]": pytest.approx(2.0)}
    said = summary([json.loads(json.dumps(score))])
    assert "one effect named      1 of 1" in said
    assert "nothing invented      0 of 1" in said


def test_parameters_of_one_name_are_scored_each_with_its_own() -> None:
    """A recovery and an asymmetry of the gain both have an e: in a fit of both the second is told by its effect's."""
    parameters = ["e[z]", "gain-asymmetry.e[z]"]
    assert PLATFORM.fitted_name(None, "gain-asymmetry", "e_abs[z]", parameters) == "gain-asymmetry.e[z]"
    assert PLATFORM.fitted_name(None, "recovery", "e[z]", parameters) == "e[z]"
