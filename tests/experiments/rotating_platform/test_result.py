"""What a recording amounts to: the paper's numbers out of recordings of its world, and what becomes of bad data."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from benchmarks.platform_sampler import Columns, SampledRun, sampled
from rigctl.campaign.recording import Header, ImportReport, Recording, RunRecord
from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.analysis import results_of
from rigctl.experiments.rotating_platform.observe.covariance import Q_FLEX_NOISE_V, PowerLawNoise
from rigctl.experiments.rotating_platform.observe.noise_fit import fit_noise
from rigctl.experiments.rotating_platform.observe.recorded import chains
from rigctl.experiments.rotating_platform.observe.spectrum import noise_spectrum
from rigctl.experiments.rotating_platform.result.bench_runs import flips, scans
from rigctl.experiments.rotating_platform.result.chain_noise import (
    EQUATION_1,
    ChainNoise,
    NoiseRecord,
    chain_noise,
    noise_records,
)
from rigctl.experiments.rotating_platform.result.result import (
    PlatformResult,
    platform_result,
)
from rigctl.experiments.rotating_platform.study import PlatformStudy
from rigctl.workbench.verdict.attempt import Attempt
from simulators.worlds.platform_settings import PlatformSettings

SILENT: dict[str, Any] = {
    "chain_noise": {"white_v2_hz": 1e-14, "red_v2_hz": 0.0},
    "pendulum_noise": {"asd_m_s2_rthz": 0.0},
    "repeatability_rad": 0.0,
    "adc": {"bits": 32},
}


def result(
    runs: list[SampledRun], spoil: Callable[[int, Columns], Columns] | None = None, **settings: Any
) -> PlatformResult:
    nature = PlatformSettings.model_validate({"kind": "rotating-platform", "seed": 31, **settings})
    recording = sampled(nature, runs, spoil)
    study = PlatformStudy(recording)
    noises = chain_noise(recording.header, ())
    return platform_result(study.recorded, recording.header, results_of(Attempt(study, ())), study.left_out, noises)


@pytest.fixture(scope="module")
def steady() -> PlatformResult:
    return result([SampledRun("c", 60.0, 60, v_z_v=level) for level in (0.0, 0.5, 1.0, 1.5)])


def test_the_recordings_own_numbers(steady: PlatformResult) -> None:
    told = steady.as_json()
    assert told["sided"] == 2
    assert told["not_tested"] == ["theta-locked-bias", "pendulum-reaction"]
    assert told["tilt_gain"]["value"] == pytest.approx(0.964, abs=4.0 * told["tilt_gain"]["sigma"])
    assert told["accel_m_s2"]["z"]["value"] == pytest.approx(2.8757e-4, abs=1e-6)
    assert told["accel_m_s2"]["y"]["value"] == pytest.approx(-2.98e-4, abs=1e-6)
    for sensor, true in (("a", -8.07e-5), ("b", 1.394e-4)):
        wobble = told["wobble_rad"][sensor]
        assert wobble["value"] == pytest.approx(true, abs=5.0 * wobble["sigma"])
        assert wobble["sigma"] < 3e-6


def test_each_run_has_what_the_contract_names(steady: PlatformResult) -> None:
    first, second = steady.as_json()["runs"][:2]
    assert {k: first[k] for k in ("run_id", "pattern", "modulation_period_s", "sample_rate_hz", "external")} == {
        "run_id": "r01",
        "pattern": "c",
        "modulation_period_s": 60.0,
        "sample_rate_hz": 10.0,
        "external": "constant",
    }
    assert (first["estimator"], first["guard_s"], first["periods"], first["refitted"]) == ("projection", 0.0, 60, 0)
    assert first["dropped"] == {"gap": 0, "saturated": 0, "angle": 0}
    assert first["conditions"]["m2"] == pytest.approx(-2.96765e-3, abs=1e-8)
    assert first["response"] is None
    rise = second["accel_z_m_s2"]["value"] - first["accel_z_m_s2"]["value"]
    assert rise == pytest.approx(0.964 * 0.5 / 825.0, abs=5.0 * first["accel_z_m_s2"]["sigma"])
    assert first["bias_y_m_s2"]["value"] == pytest.approx(-1.433e-3, abs=6.0 * first["bias_y_m_s2"]["sigma"])
    for name in ("accel_slope_z", "accel_slope_y", "bias_slope_z", "bias_slope_y"):
        slope = first[f"{name}_m_s3"]
        assert abs(slope["value"]) < 5.0 * slope["sigma"]


def test_the_precision_is_that_of_table_4(steady: PlatformResult) -> None:
    runs = steady.as_json()["runs"]
    for run in runs:
        z, y = run["precision_1h_m_s2"]["z"], run["precision_1h_m_s2"]["y"]
        assert z["theory"] == pytest.approx(1.80834e-7, abs=2e-10)
        assert y["theory"] == pytest.approx(1.80834e-7 * 846.73 / 804.32, abs=3e-10)
        low, high = z["interval_99"]
        assert low < z["measured"] < high
    inside = [r["precision_1h_m_s2"][c]["interval_99"] for r in runs for c in "yz"]
    assert sum(low < 1.1 * 1.85e-7 and high > 0.9 * 1.85e-7 for low, high in inside) == 8


@pytest.mark.parametrize(
    ("pattern", "bias_pp", "tolerance"), [("a", 3.0428e-4, 2e-7), ("b", 2.1265e-5, 2e-7), ("c", 2.07e-8, 3e-9)]
)
def test_a_sine_outside_does_to_the_bias_what_figure_8_shows(pattern: str, bias_pp: float, tolerance: float) -> None:
    sine = SampledRun(pattern, 300.0, 24, v_z_v=1.0, external="sine", external_period_s=3600.0)
    found = result([sine, SampledRun("c", 300.0, 6)], **SILENT).as_json()["runs"][0]
    response = found["response"]
    assert found["estimator"] == "projection"
    assert response["bias_pp_m_s2"] == pytest.approx(bias_pp, abs=tolerance)
    assert response["accel_pp_m_s2"] == pytest.approx(0.964 * 2.0 / 825.0, rel=0.03)
    if pattern == "a":
        assert [response["shift_min"][place] for place in ("start", "centre", "end")] == pytest.approx(
            [12.5, 15.0, 17.5], abs=0.02
        )


def test_a_guard_is_applied_as_its_table_was_made() -> None:
    guarded = SampledRun("c", 60.0, 20, guard_s=2.0)
    found = result([guarded, SampledRun("c", 60.0, 20, v_z_v=1.0)]).as_json()["runs"][0]
    assert found["guard_s"] == 2.0
    assert (found["refitted"], found["estimator"]) == (0, "projection")
    assert abs(found["conditions"]["m0"]) < 1e-12
    assert abs(found["conditions"]["m2"]) < 5e-3
    assert found["precision_1h_m_s2"]["z"]["theory"] == pytest.approx(2.0e-7, rel=0.04)


def spoilt(number: int, samples: Columns) -> Columns:
    if number == 1:
        keep = np.ones(samples["t_s"].size, dtype=bool)
        keep[1300:1312] = False
        return {name: values[keep] for name, values in samples.items()}
    if number == 2:
        full = samples["q_a_v"].copy()
        full[2050:2054] = -10.0
        return {**samples, "q_a_v": full}
    if number == 3:
        lost = samples["q_b_v"].copy()
        lost[1200:1700] = np.nan
        return {**samples, "q_b_v": lost}
    own_s = samples["t_s"] * (1.0 - 5e-4)
    place = np.clip(np.rint(own_s * 10.0 - 0.5).astype(int), 0, own_s.size - 1)
    return {**samples, **{name: samples[name][place] for name in ("moving", "theta_deg", "q_a_v", "q_b_v")}}


def test_bad_data_are_refitted_and_said() -> None:
    runs = [SampledRun("c", 60.0, 20, v_z_v=level) for level in (0.0, 1.0, 0.0, 1.0)]
    gap, full, lost, late = result(runs, spoilt).as_json()["runs"]
    assert (gap["refitted"], gap["dropped"]["gap"], gap["invalid"]) == (1, 12, 0)
    assert (full["refitted"], full["dropped"]["saturated"]) == (1, 4)
    assert (lost["refitted"], lost["invalid"]) == (0, 1)
    assert lost["remarks"] == ["r03: 1 of 20 periods have lost half their samples"]
    assert late["estimator"] == "joint-ls"
    assert late["refitted"] > 5
    assert "the platform's clock is not that of the samples" in late["remarks"][0]
    for run, tilt in ((gap, 0.0), (full, 1.0), (lost, 0.0), (late, 1.0)):
        mean = run["accel_z_m_s2"]
        assert mean["value"] == pytest.approx(2.8757e-4 + 0.964 * tilt / 825.0, abs=5.0 * mean["sigma"])


def test_a_run_without_a_whole_period_is_left_out_with_a_sentence() -> None:
    def cut(number: int, samples: Columns) -> Columns:
        return {name: values[:500] for name, values in samples.items()} if number == 2 else samples

    runs = [SampledRun("c", 60.0, 12, v_z_v=level) for level in (0.0, 0.0, 1.0)]
    found = result(runs, cut)
    assert [run.run.run_id for run in found.runs] == ["r01", "r03"]
    assert found.left_out == {
        "r02": "run r02: 500 samples hold no whole period of 60 s with the platform at rest; record longer"
    }


REFUSED: dict[str, tuple[dict[str, Any], Callable[[Columns], Columns], str]] = {
    "period": (
        {"modulation_period_s": 50.0},
        lambda s: s,
        "modulation_period_s is 50, the platform turns every 60 s; correct modulation_period_s in runs.csv",
    ),
    "two periods in one": (
        {"modulation_period_s": 120.0},
        lambda s: s,
        "modulation_period_s is 120, the platform turns every 60 s; correct modulation_period_s in runs.csv",
    ),
    "radians": (
        {},
        lambda s: {**s, "theta_deg": np.radians(s["theta_deg"])},
        "theta_deg never comes near 180 while the platform rests, at most 3.14: it looks like radians; write degrees",
    ),
    "never moving": (
        {},
        lambda s: {**s, "moving": np.zeros(len(s["moving"]))},
        "moving is never 1 although theta_deg turns; write 1 while the platform turns",
    ),
    "nil": (
        {},
        lambda s: {**s, "q_a_v": np.zeros(len(s["q_a_v"]))},
        "q_a_v does not tell its noise (what its fit leaves is nil or no number): "
        "look whether it hangs at one value, and mark the run invalid",
    ),
}


@pytest.mark.parametrize("flaw", REFUSED)
@pytest.mark.parametrize("pattern", ["b", "c"])
def test_what_no_modulation_can_have_recorded_is_left_out_with_what_to_mend(pattern: str, flaw: str) -> None:
    stated, spoil, reason = REFUSED[flaw]
    nature = PlatformSettings.model_validate({"kind": "rotating-platform", "seed": 31})
    runs = [SampledRun(pattern, 60.0, 12), SampledRun(pattern, 60.0, 12)]
    recording = sampled(nature, runs, lambda number, samples: spoil(samples) if number == 1 else samples)
    first, second = recording.records
    records = (replace(first, conditions={**first.conditions, **stated}), second)
    study = PlatformStudy(replace(recording, records=records))
    assert study.left_out == {first.run_id: f"run {first.run_id}: {reason}"}
    assert [each.run.run_id for each in study.recorded.channels] == [second.run_id] * 2


def test_a_recording_whose_runs_are_all_invalid_says_why() -> None:
    nature = PlatformSettings.model_validate({"kind": "rotating-platform", "seed": 31})
    recording = sampled(nature, [SampledRun("b", 60.0, 2)])
    records = tuple(replace(each, valid=False, reason="the door was open") for each in recording.records)
    with pytest.raises(DataError, match="no valid run could be reduced: run r01 is invalid: the door was open"):
        PlatformStudy(replace(recording, records=records)).recorded  # noqa: B018


@pytest.mark.filterwarnings("error")
def test_dwells_whose_angle_is_lost_in_every_second_period_leave_what_the_others_tell() -> None:
    """Bins that no usual period has were weighed by nothing: nil over nil reached the fit."""

    def lose(_: int, columns: Columns) -> Columns:
        lost = (columns["moving"] == 0) & (np.arange(len(columns["moving"])) // 300 % 4 == 1)
        return {**columns, "theta_deg": np.where(lost, np.nan, columns["theta_deg"])}

    runs = [SampledRun("c", 60.0, 20, v_z_v=level) for level in (0.0, 1.5)]
    told = result(runs, lose).as_json()
    assert all(run["refitted"] + run["invalid"] == 10 and run["dropped"]["gap"] > 0 for run in told["runs"])
    assert told["accel_m_s2"]["y"]["value"] == pytest.approx(-2.98e-4, abs=5.0 * told["accel_m_s2"]["y"]["sigma"])
    assert told["tilt_gain"]["value"] == pytest.approx(0.964, abs=5.0 * told["tilt_gain"]["sigma"])


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kept", [1, 2])
def test_periods_that_a_fit_takes_up_whole_tell_no_noise(kept: int) -> None:
    """Waves are seen only at the periods that are left: what few of them leave was rounding, and taken for noise."""

    def lose(_: int, columns: Columns) -> Columns:
        lost = np.arange(len(columns["q_a_v"])) >= 600 * kept
        return {**columns, **{name: np.where(lost, np.nan, columns[name]) for name in ("q_a_v", "q_b_v")}}

    runs = [SampledRun("b", 60.0, 20, v_z_v=level) for level in (0.0, 1.0)]
    if kept == 1:
        with pytest.raises(DataError, match="too short to tell their noise"):
            result(runs, lose)
    else:
        whole, told = (result(runs, spoil).as_json()["accel_m_s2"]["z"]["sigma"] for spoil in (None, lose))
        assert told > whole


def test_commands_that_were_not_sampled_are_those_of_the_table() -> None:
    def bare(_: int, samples: Columns) -> Columns:
        return {name: values for name, values in samples.items() if not name.startswith("dm1")}

    sine = SampledRun("a", 300.0, 24, v_z_v=1.0, external="sine", external_period_s=3600.0)
    runs = [sine, SampledRun("c", 60.0, 12), SampledRun("c", 60.0, 12, v_z_v=1.0)]
    with_them, without = result(runs), result(runs, bare)
    for given, taken in zip(with_them.as_json()["runs"], without.as_json()["runs"], strict=True):
        assert taken["accel_z_m_s2"]["value"] == given["accel_z_m_s2"]["value"]
    assert without.tilt_gain.value == pytest.approx(with_them.tilt_gain.value, abs=1e-4)


def test_a_scan_gives_the_axes() -> None:
    angles = tuple(float(angle) for angle in range(0, 360, 30))
    nature = PlatformSettings.model_validate(
        {"kind": "rotating-platform", "seed": 5, "effects": {"cross-axis": {"k[z]": 0.0435}}}
    )
    recording = sampled(nature, [SampledRun(angles_deg=angles, dwell_s=120.0)])
    (scan,), left_out = scans(recording, chains(recording.header), chain_noise(recording.header, ()))
    assert not left_out
    assert scan.theta_rad.size == 12
    assert scan.fits["y"].value("cos") == pytest.approx(-2.98e-4, abs=2e-5)
    excess = scan.axes.nonorthogonality_rad
    assert abs(excess.value) == pytest.approx(0.0435, abs=4.0 * excess.sigma + 2e-3)
    assert scan.axes.amplitude_ratio.value == pytest.approx(1.0, abs=0.1)
    assert flips(recording, chains(recording.header)) == {}
    assert noise_records(recording) == ([], {})


def test_uncertainties_of_scans_are_their_scatter_under_a_wandering_bias() -> None:
    """A bias wanders from dwell to dwell; seeds are twins, with the noise that the paper prints of a Q-Flex."""
    angles = tuple(float(angle) for angle in range(0, 360, 30))
    count, nature = 50, np.array([2.8757e-4 - 0.964 * 0.5 / 825.0, 2.98e-4])
    constants = {f"noise_{part}_q_a": value for part, value in vars(Q_FLEX_NOISE_V).items()}
    by_known, by_scatter = np.empty((2, count, 2))
    for seed in range(count):
        settings = PlatformSettings.model_validate({"kind": "rotating-platform", "seed": 100 + seed})
        recording = sampled(settings, [SampledRun(angles_deg=angles, dwell_s=60.0, v_z_v=-0.5)])
        for pulls, more in ((by_known, constants), (by_scatter, {})):
            header = replace(recording.header, constants={**recording.header.constants, **more})
            (scan,), _ = scans(recording, chains(header), chain_noise(header, ()))
            fit = scan.fits["z"]
            pulls[seed] = (fit.values[1:] - nature) / np.sqrt(np.diag(fit.covariance)[1:])
    # Of a level from the residuals of twelve angles: the mean square of a twin's two pulls is as F(2, 9).
    for pulls, law in ((by_known, stats.f(2, 1e9)), (by_scatter, stats.f(2, 9))):
        assert abs((pulls**2).mean() - law.mean()) < 3.3 * law.std() / math.sqrt(count)
        assert abs(pulls.mean()) < 3.3 * math.sqrt(law.mean() / (2 * count))


def test_a_dwell_without_samples_is_left_out_of_a_scan() -> None:
    angles = tuple(float(angle) for angle in range(0, 360, 30))
    nature = PlatformSettings.model_validate({"kind": "rotating-platform", "seed": 5, **SILENT})

    def lose(_: int, columns: Columns) -> Columns:
        return {**columns, "q_b_v": np.where(np.arange(len(columns["q_b_v"])) < 650, np.nan, columns["q_b_v"])}

    recording = sampled(nature, [SampledRun(angles_deg=angles, dwell_s=60.0)], lose)
    (scan,), left_out = scans(recording, chains(recording.header), chain_noise(recording.header, ()))
    assert not left_out
    assert scan.theta_rad.size == 11
    assert np.isfinite(scan.readings_m_s2["y"]).all()


def test_a_flip_whose_samples_are_lost_tells_nothing_of_its_channel() -> None:
    header = sampled(PlatformSettings.model_validate({"kind": "rotating-platform", "seed": 5}), []).header
    volts = np.random.default_rng(1).normal(0.0, 1e-5, 200)
    records = tuple(
        RunRecord(run_id, run_id, "", {"pattern": "flip", "g_sign": sign})
        for run_id, sign in (("up", 1), ("down", -1))
    )
    samples = {
        run_id: {"q_a_v": sign * 1.0 + volts, "q_b_v": np.where(np.arange(200) < kept, -sign * 1.0 + volts, np.nan)}
        for run_id, sign, kept in (("up", 1, 200), ("down", -1, 30))
    }
    found = flips(Recording(header, records, samples, ImportReport(2)), chains(header))
    assert set(found) == {"z"}


def test_a_flip_that_agrees_by_chance_is_no_better_than_its_readings() -> None:
    """Three readings scatter with one degree of freedom: once in twelve by less than a tenth of what they do."""
    header = sampled(PlatformSettings.model_validate({"kind": "rotating-platform", "seed": 5}), []).header
    rng, g_m_s2 = np.random.default_rng(2), float(header.constants["g_m_s2"])
    signs = {"up": 1, "down": -1, "again": 1}
    records = tuple(RunRecord(name, name, "", {"pattern": "flip", "g_sign": sign}) for name, sign in signs.items())
    pulls = []
    for _ in range(200):
        samples = {
            name: {"q_a_v": sign * 8.0 + 1e-4 * rng.standard_normal(600), "q_b_v": np.full(600, np.nan)}
            for name, sign in signs.items()
        }
        found = flips(Recording(header, records, samples, ImportReport(3)), chains(header))["z"].sensor
        pulls.append((found.value("gain_v_per_m_s2") - 8.0 / g_m_s2) / found.sigma("gain_v_per_m_s2"))
    # Of Student's t of one degree of freedom 13 of 200 are beyond 10.
    assert max(np.abs(pulls)) < 5.0
    assert 0.6 < np.sqrt(np.mean(np.square(pulls))) < 1.1


def test_theory_is_of_the_sensor_that_is_there() -> None:
    """A noise record says more than the rig file, and the rig file more than the paper."""
    printed = chain_noise(Header("rotating-platform"), ())
    assert {each.source for each in printed.values()} == {EQUATION_1}
    assert printed["z"].noise == Q_FLEX_NOISE_V
    constants = {"noise_white_q_a": 1e-5, "noise_coefficient_q_a": 2e-8, "noise_exponent_q_a": 1.2}
    header = Header("rotating-platform", constants=constants)
    assert chain_noise(header, ())["z"] == ChainNoise(PowerLawNoise(1e-5, 2e-8, 1.2), "constants")
    assert chain_noise(header, ())["y"].source == EQUATION_1
    rng = np.random.default_rng(3)
    drifting = np.cumsum(1e-4 * rng.normal(size=20_000)) + 1e-2 * rng.normal(size=20_000)
    spectrum = noise_spectrum(drifting, 10.0)
    record = NoiseRecord("r07", "z", spectrum, fit_noise(spectrum))
    measured = chain_noise(header, [record])["z"]
    assert measured == ChainNoise(record.fit.noise, "noise record r07")
    white = noise_spectrum(rng.normal(size=2000), 10.0)
    assert chain_noise(header, [NoiseRecord("r08", "z", white, fit_noise(white))])["z"].source == "constants"
    with pytest.raises(DataError, match="noise_white_q_a, noise_coefficient_q_a, noise_exponent_q_a go together"):
        chain_noise(Header("rotating-platform", constants={"noise_white_q_a": 1e-5}), ())
