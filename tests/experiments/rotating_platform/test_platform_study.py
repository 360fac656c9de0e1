"""The rotating platform on the workbench: nothing found where nothing is, what is hidden named and sized."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.platform_sampler import SampledRun, sampled
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ConfigError, DataError
from rigctl.effects.catalogue import catalogue
from rigctl.effects.plugins import load
from rigctl.experiments.rotating_platform.model.model import at_rest
from rigctl.experiments.rotating_platform.observe.covariance import Q_FLEX_NOISE_V
from rigctl.experiments.rotating_platform.study import PlatformStudy
from rigctl.workbench.next.recommend import recommend
from rigctl.workbench.study import Plannable, Term
from rigctl.workbench.verdict.account import account_of
from rigctl.workbench.verdict.compare import compare
from rigctl.workbench.verdict.diagnose import diagnose
from rigctl.workbench.verdict.fit import fit, parameters_of
from simulators.worlds.platform_effects import EFFECTS
from simulators.worlds.platform_settings import PlatformSettings

RUNS = [
    SampledRun("c", 60.0, 20, v_z_v=0.0),
    SampledRun("b", 60.0, 20, v_z_v=1.0),
    SampledRun("c", 300.0, 8, v_z_v=1.5),
    SampledRun("c", 60.0, 20, v_z_v=0.5, v_y_v=1.0),
]
LONG = [replace(run, periods=2 * run.periods) for run in RUNS]
"""For what shows within long times, or little."""


def study(
    effects: Mapping[str, Mapping[str, float]] | None = None, runs: Sequence[SampledRun] = RUNS
) -> PlatformStudy:
    nature = PlatformSettings.model_validate(
        {
            "kind": "rotating-platform",
            "seed": 21,
            "temperature": {"mean_c": 22.0, "daily_k": 0.3, "cycle_k": 0.3, "cycle_s": 5000.0},
            "effects": effects or {},
        }
    )
    return PlatformStudy(sampled(nature, runs))


def short_masks(by_s: float) -> list[SampledRun]:
    return [replace(run, mask_short_s=by_s) for run in RUNS]


@pytest.fixture(scope="module")
def clean() -> PlatformStudy:
    return study()


def test_the_catalogue_has_what_nature_may_do() -> None:
    assert set(catalogue("rotating-platform")) == set(EFFECTS)


def test_the_baseline_describes_a_clean_recording(clean: PlatformStudy) -> None:
    found = compare(clean, ())
    assert found.p_value > 1e-3
    wanted = ["accel mean", "accel slope", "bias mean", "bias slope", "after turn", "before turn", "spectrum"]
    assert [each.component for each in found.channels if each.channel == "m_z"] == wanted
    for each in found.channels:
        assert each.chi2 / each.data < 1.0 + 6.0 * (2.0 / each.data) ** 0.5, each


def test_the_fit_finds_the_tilt_whatever_the_bias_does(clean: PlatformStudy) -> None:
    found = parameters_of(clean, ())
    assert list(found)[:4] == ["tilt_gain", "accel_z0", "accel_y0", "bias_z[r01]"]
    assert {"bias_y[r02]", "bias_rate_z[r03]", "bias_rate_y[r04]"} <= set(found)
    for name, true, unit in (
        ("tilt_gain", 0.964, "1"),
        ("accel_z0", 2.8757e-4, "m/s2"),
        ("accel_y0", -2.98e-4, "m/s2"),
    ):
        assert found[name].value == pytest.approx(true, abs=4.0 * found[name].sigma)
        assert found[name].unit == unit
    assert found["tilt_gain"].sigma < 5e-4
    assert found["accel_z0"].sigma < 5e-7


def test_nothing_is_named_where_nothing_is(clean: PlatformStudy) -> None:
    found = diagnose(clean, ())
    assert found.verdict == "adequate"
    assert {(each.effect, each.other) for each in found.inseparable} >= {
        ("theta-locked-bias", "baseline:accel_z0"),
        ("theta-locked-bias", "baseline:accel_y0"),
        ("pendulum-reaction", "baseline:accel_z0"),
    }
    assert "off-centre" in found.not_testable


def test_each_runs_noise_is_that_of_its_chain(clean: PlatformStudy) -> None:
    frequency = np.array([3e-3, 2e-2, 1.0])
    for each in clean.recorded.channels:
        gain = 846.73 if each.channel == "z" else 804.32
        ratio = each.noise(frequency) / Q_FLEX_NOISE_V.in_units_of(gain)(frequency)
        assert ratio == pytest.approx(np.ones(3), abs=0.6), each.run.run_id
        assert ratio[2] == pytest.approx(1.0, abs=0.3)


@pytest.mark.parametrize(
    ("effect", "sizes", "shown"),
    [
        ("recovery-signed", {"e": 4e-6, "t_r": 6.0}, {"e[z]": 4e-6, "e[y]": 4e-6}),
        ("thermal-bias", {"b1": 2e-4}, {"b1[z]": 2e-4}),
        ("cross-axis", {"k": 5e-3}, {"k[z]": 5e-3, "k[y]": 5e-3}),
    ],
)
def test_what_is_hidden_is_named_and_sized(effect: str, sizes: dict[str, float], shown: dict[str, float]) -> None:
    found = diagnose(study({effect: sizes}, LONG if effect == "thermal-bias" else RUNS), ())
    assert [term.effect for term in found.suggested] == [effect]
    rank = next(each for each in found.ranking if each.term.effect == effect)
    for name, true in shown.items():
        estimate = rank.parameters[name]
        assert estimate.value == pytest.approx(true, abs=4.0 * estimate.sigma)
        assert abs(estimate.value) > 3.0 * estimate.sigma
    assert rank.held_out_error_ratio < 1.0


def test_what_the_baseline_imitates_is_asked_where_the_baseline_is() -> None:
    """The square of a reading shows by the bias in it: where none was fitted yet, it would be taken for absorbed."""
    squared = study({"quadratic": {"K2": 1.0}})
    account = account_of(squared, [()])
    base, found = (fit(squared, terms, account) for terms in ((), (Term("quadratic"),)))
    size = found.parameters["K2[y]"]
    assert size.value == pytest.approx(1.0, abs=4.0 * size.sigma)
    assert size.sigma < 0.2
    assert found.chi2 < base.chi2 - 25.0
    moved = found.parameters["accel_y0"].value - base.parameters["accel_y0"].value
    assert abs(moved) < 3e-6


def test_a_strong_square_is_found_at_its_own_minimum_and_not_at_its_mirror_image() -> None:
    """With no square and a bias that differs from run to run as the tilts do, readings are almost the same."""
    found = diagnose(study({"quadratic": {"K2": 40.0}}, [*LONG[:2], *RUNS[2:]]), ())
    assert [term.effect for term in found.suggested] == ["quadratic"]
    size = found.ranking[0].parameters["K2[z]"]
    assert size.value == pytest.approx(40.0, abs=4.0 * size.sigma)
    assert size.sigma < 10.0


def test_where_biases_are_alike_the_gain_of_the_tilts_is_another_too() -> None:
    """A square and a bias so large that they take a third of the gain: seen from a fit without the square."""
    large = {"scale_v_per_m_s2": 846.73, "amplifier": 1010.9, "bias_v": -1.8}
    nature = PlatformSettings.model_validate(
        {"kind": "rotating-platform", "seed": 23, "chain_a": large, "effects": {"quadratic": {"K2[z]": 80.0}}}
    )
    squared = PlatformStudy(sampled(nature, RUNS))
    without = account_of(squared, [()]).attempt(squared, ())
    assert without.values["tilt_gain"] == pytest.approx(0.64, abs=0.02)
    model = squared.model([Term("quadratic")])
    names = [each.name for each in model.parameters]
    (there,) = (
        {names[place]: value for place, value in each.values.items()}
        for each in model.elsewhere(np.array([without.values.get(name, 0.0) for name in names]))
        if names[each.of] == "K2[z]"
    )
    # Before anything is fitted: a per cent of the square moves it.
    assert there["K2[z]"] == pytest.approx(80.0, rel=0.05)
    assert there["tilt_gain"] == pytest.approx(0.98, abs=0.05)


def test_a_gain_that_differs_for_the_sign_is_no_curve_where_all_readings_have_one_sign(clean: PlatformStudy) -> None:
    """There it is a gain alone. With one of -1 nothing is left, and biases of nothing are as alike as can be."""
    model = clean.model([Term("gain-asymmetry")])
    elsewhere = model.elsewhere(np.append(clean.recorded.start, [0.0, 0.0]))
    read = {channel: at_rest(clean.recorded, channel, clean.recorded.start) for channel in ("z", "y")}
    signs = {channel: np.unique(np.sign(run.along + run.signal)).tolist() for channel, run in read.items()}
    assert signs == {"z": [-1.0, 1.0], "y": [-1.0]}
    assert [model.parameters[each.of].name for each in elsewhere] == ["e[z]"]


def test_a_bias_that_creeps_with_every_turn_and_snaps_back_after_seven_is_told_by_their_count() -> None:
    turned = 0

    def creeps(number: int, samples: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        nonlocal turned
        del number
        ends = np.flatnonzero((samples["moving"][:-1] > 0.0) & (samples["moving"][1:] == 0.0)) + 1
        turns = turned + np.searchsorted(ends, np.arange(samples["t_s"].size), side="right")
        turned += ends.size
        return {**samples, "q_a_v": samples["q_a_v"] + 846.73 * 3e-6 * (turns % 7)}

    nature = PlatformSettings(kind="rotating-platform", seed=22)
    creeping = PlatformStudy(sampled(nature, RUNS[:2], creeps))
    found = diagnose(creeping, ())
    assert found.verdict == "unknown"
    assert found.unexplained is not None
    assert found.unexplained.channel == "m_z"
    covariate = found.unexplained.details["covariate"]
    assert covariate.startswith("turns_modulo_7")
    run = creeping.recorded.chain["z"]
    assert PlatformStudy.expressions[covariate.partition("^")[0]] == "run.turns % 7"
    assert run.turns[-1] == turned


def test_a_mask_that_is_too_short_shows_the_sensor_off_its_axis() -> None:
    found = diagnose(study({"off-centre": {"r_sin": 5e-4}}, short_masks(0.5)), ())
    assert [term.effect for term in found.suggested] == ["off-centre"]
    size = found.ranking[0].parameters["r_sin[z]"]
    assert size.value == pytest.approx(5e-4, abs=max(4.0 * size.sigma, 2e-5))


@pytest.mark.parametrize(
    ("effect", "sizes", "short_s"),
    [
        ("clock-skew", {"r_sin": 0.05, "delay": 0.2}, 0.0),
        ("filter-ringing", {"r_sin": 0.05, "cutoff": 5.0}, 0.0),
        ("off-centre", {"r_sin": 0.05}, 0.5),
        ("recovery", {"e": 1e-5, "t_r": 5.0}, 0.0),
        ("recovery-signed", {"e": 1e-5, "t_r": 30.0}, 0.0),
    ],
)
def test_what_a_turn_leaves_behind_is_sized_between_the_values_of_its_scan(
    effect: str, sizes: dict[str, float], short_s: float
) -> None:
    """At the sizes of a sensor 5 cm off its axis: thousands of sigma, of which nothing may be left for another."""
    found = diagnose(study({effect: sizes}, short_masks(short_s)), ())
    assert [term.effect for term in found.suggested] == [effect]
    assert found.verdict == "effect"
    assert found.ranking[0].equivalent_to in {(), ("clock-skew",)}  # a delay of nothing does what a short mask does
    for name, estimate in found.ranking[0].parameters.items():
        true = sizes.get(name.partition("[")[0], 0.0)
        assert estimate.value == pytest.approx(true, abs=4.0 * estimate.sigma), name
        # Profiled: the time constant of half a minute is known by the dwells of a quarter to a fifth.
        assert 0.0 < estimate.sigma < (0.25 * true if true else 0.1), name
    assert found.steps[-1].error_held_out < 1.1 < found.steps[0].error_held_out


def test_what_every_turn_leaves_behind_is_no_noise() -> None:
    """Nor is the first dwell, which follows no turn."""
    hidden = study({"clock-skew": {"r_sin": 0.05, "delay": 0.2}}, LONG)
    frequency = np.array([3e-3, 2e-2, 1.0])
    for each, bare in zip(hidden.recorded.channels, study(runs=LONG).recorded.channels, strict=True):
        assert each.noise(frequency) == pytest.approx(bare.noise(frequency), rel=0.3), each.run.run_id


def swung(gain: float = 0.0, leak_per_s: float = 0.0, pressure: float = 0.0) -> PlatformStudy:
    """Sines at the tilt's input, of which a part goes into the bias of sensor A, straight and integrated; and a
    pressure that does."""

    def spoil(number: int, samples: dict[str, FloatArray]) -> dict[str, FloatArray]:
        pressure_pa = 100.0 * np.cos(samples["t_s"] / (90.0 + 20.0 * number))
        volts = samples["dm1_z_v"]
        leaked = gain * volts + leak_per_s * np.cumsum(volts) * 0.1 + pressure * pressure_pa
        return {**samples, "q_a_v": samples["q_a_v"] + leaked, "pressure_pa": pressure_pa}

    runs = [
        SampledRun("c", 60.0, 40, external="sine", v_z_v=1.0, external_period_s=600.0),
        SampledRun("b", 60.0, 40, external="sine", v_z_v=1.5, external_period_s=900.0),
        SampledRun("c", 60.0, 40, v_z_v=0.5),
    ]
    return PlatformStudy(sampled(PlatformSettings(kind="rotating-platform", seed=23), runs, spoil))


@pytest.fixture(scope="module")
def not_leaking() -> PlatformStudy:
    return swung()


@pytest.mark.parametrize("hidden", [{"gain": 0.05}, {"leak_per_s": 1e-3}, {"pressure": 1e-3}])
def test_a_bias_that_follows_what_is_recorded_is_no_noise(
    hidden: dict[str, float], not_leaking: PlatformStudy
) -> None:
    """It was the noise of the runs it was in, whatever its size: chi-square was that of chance."""
    frequency = np.array([2e-3, 2e-2, 1.0])
    leaking = swung(**hidden)
    for each, bare in zip(leaking.recorded.channels, not_leaking.recorded.channels, strict=True):
        assert each.noise(frequency) == pytest.approx(bare.noise(frequency), rel=0.3), each.run.run_id
    found = compare(leaking, ())
    assert found.p_value < 1e-6
    assert max(found.channels, key=lambda each: each.chi2 / each.data).channel == "m_z"


def test_a_line_is_found_and_taken_off() -> None:
    hidden = study({"line": {"amplitude": 2e-6, "frequency": 0.14321}}, LONG)
    (line,) = hidden.lines(hidden.model(()))
    assert line.frequency_hz == pytest.approx(0.14321, abs=3e-5)
    assert line.amplitude == pytest.approx(2e-6, rel=0.15)
    assert line.held_out_error_ratio < 0.7
    spectra = [each for each in compare(hidden, ()).channels if each.component == "spectrum"]
    assert all(each.rms > 4.0 for each in spectra)
    after = compare(hidden, (line.term,))
    assert all(each.rms < 2.5 for each in after.channels if each.component == "spectrum")
    assert not hidden.lines(hidden.model((line.term,)))


@pytest.mark.parametrize(("column", "channel", "gain"), [("q_a_v", "m_z", 846.73), ("q_b_v", "m_y", 804.32)])
def test_a_strong_line_is_one_line_and_as_large_as_in_the_channel_that_has_it(
    column: str, channel: str, gain: float
) -> None:
    """Both channels' mean told sqrt(2) too little, and side lobes were further lines."""

    def spoil(_: int, samples: dict[str, FloatArray]) -> dict[str, FloatArray]:
        return {**samples, column: samples[column] + gain * 2e-5 * np.sin(2.0 * np.pi * 0.237 * samples["t_s"])}

    made = sampled(PlatformSettings(kind="rotating-platform", seed=24), RUNS, spoil)
    hidden = PlatformStudy(made)
    (line,) = hidden.lines(hidden.model(()))
    assert line.channel == channel
    assert line.amplitude == pytest.approx(2e-5, abs=4.0 * line.sigma)
    assert line.sigma < 2e-7


def test_each_of_several_lines_is_ranked_as_itself() -> None:
    def spoil(_: int, samples: dict[str, FloatArray]) -> dict[str, FloatArray]:
        turns = 2.0 * np.pi * samples["t_s"]
        waves = 2e-5 * np.sin(0.237 * turns) + 1e-5 * np.sin(1.7137 * turns)
        return {**samples, "q_a_v": samples["q_a_v"] + 846.73 * waves}

    made = sampled(PlatformSettings(kind="rotating-platform", seed=24), RUNS, spoil)
    ranks = [each for each in diagnose(PlatformStudy(made), ()).ranking if each.term.effect == "line"]
    found = {round(each.parameters["frequency"].value, 3): each.parameters["amplitude"].value for each in ranks}
    assert found == pytest.approx({0.237: 2e-5, 1.714: 1e-5}, rel=0.03)


def swayed(amplitude_m_s2: float, frequency_hz: float) -> PlatformStudy:
    """A recording whose sensor A sees a sine."""

    def spoil(_: int, samples: dict[str, FloatArray]) -> dict[str, FloatArray]:
        wave = amplitude_m_s2 * np.sin(2.0 * np.pi * frequency_hz * samples["t_s"])
        return {**samples, "q_a_v": samples["q_a_v"] + 846.73 * wave}

    return PlatformStudy(sampled(PlatformSettings(kind="rotating-platform", seed=25), RUNS, spoil))


def test_a_line_on_a_harmonic_of_the_modulation_is_a_line_and_no_effect_of_the_turns() -> None:
    """All periods have it alike, as what turns leave behind: effects took its place one after the other."""
    hidden = swayed(2e-5, 7.0 / 60.0)
    (line,) = hidden.lines(hidden.model(()))
    assert line.in_data
    assert line.channel == "m_z"
    assert line.frequency_hz == pytest.approx(7.0 / 60.0, abs=1e-5)
    found = diagnose(hidden, ())
    assert [term.effect for term in found.suggested] == ["line"]
    assert found.verdict == "effect"


@pytest.mark.parametrize(
    "effects",
    [
        {"recovery": {"e": 3e-4, "t_r": 40.0}},
        {"recovery-signed": {"e": 3e-4, "t_r": 4.0}},
        {"filter-ringing": {"r_cos": 0.05, "r_sin": 0.05, "cutoff": 1.0}},
    ],
)
def test_what_turns_leave_behind_is_no_line(effects: dict[str, dict[str, float]]) -> None:
    hidden = study(effects)
    assert not [line for line in hidden.lines(hidden.model(())) if line.in_data]


def test_a_model_of_two_motions_works_out_once_what_each_leaves(clean: PlatformStudy) -> None:
    model = clean.model(())
    run = at_rest(clean.recorded, "z", np.array([each.start for each in model.parameters]))
    late, ringing = run.late(0.2), run.ringing(2.0)
    other_amplitudes = run.at(signal=2.0 * run.signal)
    assert other_amplitudes.late(0.2) is late
    assert other_amplitudes.ringing(2.0) is ringing


def test_an_effect_of_ones_own_is_fitted(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(
        "from rigctl.effects import effect\n"
        '@effect("tilt-square", on="reading_m_s2", parameters={"q": "s2/m"}, typical={"q": 1.0}, scope="channel")\n'
        "def tilt_square(run, q):\n"
        '    """The commanded tilt enters squared, whatever the angle."""\n'
        "    return q * run.c_z**2 * run.cos\n"
    )
    nature = PlatformSettings(kind="rotating-platform", seed=22)
    own = PlatformStudy(sampled(nature, RUNS), [load(file)])
    size = parameters_of(own, (Term("tilt-square"),))["q[z]"]
    assert abs(size.value) < 4.0 * size.sigma


def test_two_that_are_scanned_for_are_rivals_neither_wider_than_the_other() -> None:
    """What is scanned for counts on both sides: five parameters each, however alike they are."""
    found = diagnose(study({"filter-ringing": {"r_sin": 4e-4, "cutoff": 5.0}}), ())
    assert found.verdict == "ambiguous"
    assert {found.suggested[0].effect, *found.ranking[0].equivalent_to} == {"clock-skew", "filter-ringing"}


def test_motions_that_runs_cannot_tell_apart_are_said_to_be_so_with_what_would_tell_them() -> None:
    """Within the first half second after a turn these bins see one number; what is left goes as the turn's speed."""
    hidden = study({"clock-skew": {"r_sin": 1.4e-4, "delay": 0.2}})
    found = diagnose(hidden, ())
    assert found.verdict == "ambiguous"
    assert len(found.suggested) == 1
    alike = {found.ranking[0].term.effect, *found.ranking[0].equivalent_to}
    assert alike == {"clock-skew", "filter-ringing"}
    turning = [run for run in hidden.options() if run.settings["modulation_period_s"] == 60.0]
    usual = recommend(hidden, (), found, offered=[run for run in turning if "rotation_s" not in run.settings])
    assert ("clock-skew", "filter-ringing") in {(e.question.term.effect, e.question.other) for e in usual.hopeless}
    faster = recommend(hidden, (), found, offered=turning)
    assert faster.purpose == "separate"
    assert all(run.settings["rotation_s"] < 5.0 for run in faster.runs)
    assert max(each.lambda_promised for each in faster.answers) > 25.0


def test_the_next_run_would_tell_what_cannot_be_told(clean: PlatformStudy) -> None:
    assert isinstance(clean, Plannable)
    options = clean.options()
    wider = clean.extended([options[0], options[-1]])
    before, after = clean.model(()).observations, wider.model(()).observations
    assert len(after.value) > len(before.value) - 8
    assert after.run_ids[-1] == "next 2"
    names = [each.name for each in wider.model(()).parameters]
    assert "bias_z[next 1]" in names
    assert "bias_rate_y[next 2]" in names


def test_recordings_that_cannot_be_asked_say_so() -> None:
    nature = PlatformSettings(kind="rotating-platform", seed=23)
    alone = PlatformStudy(sampled(nature, [SampledRun("c", 60.0, 10)]))
    gain = parameters_of(alone, ())["tilt_gain"]
    assert gain.value == 1.0
    with pytest.raises(ConfigError, match="unknown effect 'recoveries'; the nearest are recovery"):
        alone.model((Term("recoveries"),))
    scan = PlatformStudy(sampled(nature, [SampledRun(angles_deg=(0.0, 90.0, 180.0), dwell_s=30.0)]))
    with pytest.raises(DataError, match="no modulated run"):
        _ = scan.recorded


@pytest.mark.parametrize(
    ("column", "change", "why"),
    [
        ("theta_deg", lambda x: x + 3.0, r"theta_deg rests more than 0\.02 degrees from 0 and 180; correct its zero"),
        ("theta_deg", lambda x: x + np.linspace(0.0, 4.0, x.size), "theta_deg rests more than 0"),
        ("q_a_v", lambda x: np.full(x.size, 11.0), "q_a_v is at full_scale"),
        ("q_a_v", lambda x: np.full(x.size, np.nan), "q_a_v, theta_deg or moving are missing"),
    ],
)
def test_a_run_without_a_period_that_counts_says_what_took_them(
    column: str, change: Callable[[FloatArray], FloatArray], why: str
) -> None:
    def spoil(_: int, samples: dict[str, FloatArray]) -> dict[str, FloatArray]:
        return {**samples, column: change(samples[column])}

    made = sampled(PlatformSettings(kind="rotating-platform", seed=23), [SampledRun("c", 60.0, 10)], spoil)
    with pytest.raises(DataError, match=f"run r01: none of its 10 periods has half of its samples: {why}"):
        _ = PlatformStudy(made).recorded
