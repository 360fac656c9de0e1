"""A run's complex sensitivity against samples that are made here, and how well its sigma tells its error."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigctl.analysis.budget import budget, compare, monte_carlo
from rigctl.campaign.bundle.bundle import read_bundle, write_bundle
from rigctl.campaign.recording import ChannelInfo, Header, ImportReport, Recording, RunRecord
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.frequency_response.chain import trial_run
from rigctl.experiments.frequency_response.imagined import imagined, options
from rigctl.experiments.frequency_response.model import Bench, recorded
from rigctl.experiments.frequency_response.observables import Sensitivity, fitted_run, sensitivities
from rigctl.experiments.frequency_response.reference import Reference, reference_of
from rigctl.experiments.frequency_response.result import OUTPUTS, measurement, response_result
from rigctl.experiments.frequency_response.study import ResponseStudy

RATE_HZ, LENGTH_S, S = 200.0, 12.0, 1.3 * np.exp(-0.4j)
NOISE_V, NOISE_MM = 2e-3, 1e-3
CASES = [(0.5, 5.0, 1), (2.03, 2.0, -1), (7.0, 0.3, 1), (19.0, 0.05, -1)]
"""Frequency, amplitude in mm, direction."""


def samples(
    frequency_hz: float, amplitude_mm: float, direction: int, rng: np.random.Generator, late_s: float = 0.0
) -> dict[str, FloatArray]:
    """A run of three channels: stage and head see a sine, the output is S times its second derivative."""
    t = np.arange(round(RATE_HZ * LENGTH_S)) / RATE_HZ
    w, phase = 2.0 * math.pi * frequency_hz, rng.uniform(0.0, 6.0)
    turn = np.exp(1j * (w * t + phase))
    acceleration = -(w**2) * 1e-3 * amplitude_mm * turn * np.exp(-1j * w * late_s)
    output = direction * (S * acceleration).real + 0.3 + 0.001 * t
    return {
        "t_s": t,
        "stage_x_mm": amplitude_mm * turn.real + 1.0,
        "laser_1_mm": amplitude_mm * turn.real - 2.0 + NOISE_MM * rng.standard_normal(t.size),
        "laser_2_mm": amplitude_mm * turn.real + 3.0 + NOISE_MM * rng.standard_normal(t.size),
        "accel_v": output + NOISE_V * rng.standard_normal(t.size),
    }


def reduced(seed: int) -> list[Sensitivity]:
    rng = np.random.default_rng([16063, seed])
    runs = []
    for number, (frequency_hz, amplitude_mm, direction) in enumerate(CASES):
        given = {"direction": direction, "frequency_hz": frequency_hz, "mounting": 1, "amplitude_mm": amplitude_mm}
        made = samples(frequency_hz, amplitude_mm, direction, rng)
        runs.append(fitted_run(str(number), given, made, {}, {}))
    return sensitivities(runs)


def test_pulls_of_both_parts_are_standard_normal() -> None:
    found = [reduced(seed) for seed in range(80)]
    pulls = np.array([[(run.value - S) / run.sigma for run in runs] for runs in found])
    parts = np.concatenate([pulls.real, pulls.imag])
    for case, run in enumerate(found[0]):
        values = parts[:, case]
        # Student's t with the degrees of freedom behind sigma.
        rms = math.sqrt(run.dof / (run.dof - 2.0))
        # Four standard errors, of mean and rms: eight checks, of which one in two thousand fails by chance.
        assert abs(values.mean()) < 4.0 * rms / math.sqrt(len(values))
        assert abs(np.sqrt(np.mean(values**2)) / rms - 1.0) < 4.0 / math.sqrt(2.0 * len(values))


def test_what_a_channel_is_late_is_taken_out_as_far_as_it_is_said() -> None:
    late_s, (frequency_hz, amplitude_mm, direction) = 2e-3, CASES[2]
    given = {"direction": direction, "frequency_hz": frequency_hz}
    made = samples(frequency_hz, amplitude_mm, direction, np.random.default_rng(1), late_s)
    # A reading that is made late shows what was later: its phase runs ahead.
    known = {"accel_v": ChannelInfo(latency_s=-late_s)}
    (corrected,) = sensitivities([fitted_run("1", given, made, known, {})])
    (left,) = sensitivities([fitted_run("1", given, made, {}, {})])
    assert abs(corrected.value - S) < 5.0 * corrected.sigma
    turned = S * np.exp(-2j * math.pi * frequency_hz * late_s)
    assert abs(left.value - turned) < 5.0 * left.sigma


def test_a_tilted_beam_reads_more_than_the_motion() -> None:
    frequency_hz, amplitude_mm, direction = CASES[1]
    given = {"direction": direction, "frequency_hz": frequency_hz}
    made = samples(frequency_hz, amplitude_mm, direction, np.random.default_rng(2))
    tilt = math.radians(5.0)
    longer = {name: made[name] / math.cos(tilt) for name in ("laser_1_mm", "laser_2_mm")}
    tilts = dict.fromkeys(longer, tilt)
    (run,) = sensitivities([fitted_run("1", given, {**made, **longer}, {}, tilts)])
    assert abs(run.value - S) < 5.0 * run.sigma


def test_lasers_on_their_own_clock_give_the_size_and_the_encoder_the_phase() -> None:
    frequency_hz, amplitude_mm, direction = CASES[1]
    given = {"direction": direction, "frequency_hz": frequency_hz}
    made = samples(frequency_hz, amplitude_mm, direction, np.random.default_rng(3))
    del made["laser_2_mm"]
    own = {"laser_1_mm.t_s": made["t_s"] + 3e-3}
    channels = {"laser_1_mm": ChannelInfo(clock="own", clock_u_s=0.01)}
    (run,) = sensitivities([fitted_run("1", given, {**made, **own}, channels, {})])
    assert run.own_clock
    assert abs(run.value - S) < 5.0 * run.sigma


@pytest.mark.parametrize("clock_u_s", [0.01, 0.2])
def test_a_head_on_the_other_side_reads_the_other_way(clock_u_s: float) -> None:
    frequency_hz, amplitude_mm, direction = CASES[1]
    given = {"direction": direction, "frequency_hz": frequency_hz}
    made = samples(frequency_hz, amplitude_mm, direction, np.random.default_rng(5))
    made["laser_1_mm"] = -made["laser_1_mm"]
    own = {"laser_2_mm.t_s": made["t_s"] + 2e-3}
    channels = {"laser_2_mm": ChannelInfo(clock="own", clock_u_s=clock_u_s)}
    (run,) = sensitivities([fitted_run("1", given, {**made, **own}, channels, {})])
    assert abs(run.value - S) < 5.0 * run.sigma


def test_a_run_without_a_laser_has_no_reference() -> None:
    made = samples(*CASES[0], np.random.default_rng(4))
    without = {name: column for name, column in made.items() if not name.startswith("laser")}
    with pytest.raises(DataError, match="no laser head"):
        fitted_run("1", {"direction": 1, "frequency_hz": CASES[0][0]}, without, {}, {})


@pytest.mark.parametrize("factor", [0.0, 0.5, 2.0])
def test_a_head_that_does_not_follow_the_carriage_is_none(factor: float) -> None:
    made = samples(*CASES[0], np.random.default_rng(4))
    made["laser_2_mm"] = factor * made["laser_2_mm"] + 7.0
    with pytest.raises(DataError, match=r"laser_2_mm shows .* the stage 5 mm: does the head see the carriage\?"):
        fitted_run("1", {"direction": 1, "frequency_hz": CASES[0][0]}, made, {}, {})


HEADS_U = {"laser_1_mm": 3e-4, "laser_2_mm": 3e-4}


def with_heads(scales: dict[str, float]) -> list[Sensitivity]:
    """Runs of all cases, recorded with these heads."""
    runs = []
    for number, (frequency_hz, amplitude_mm, direction) in enumerate(CASES):
        given = {"direction": direction, "frequency_hz": frequency_hz, "mounting": 1}
        made = samples(frequency_hz, amplitude_mm, direction, np.random.default_rng([6, number]))
        read = {name: scale * made[name] for name, scale in scales.items()}
        kept = {name: column for name, column in made.items() if "laser" not in name}
        runs.append(fitted_run(str(number), given, {**kept, **read}, {}, {}))
    return sensitivities(runs)


def test_the_reference_is_as_good_as_the_heads_that_were_recorded() -> None:
    both = reference_of(with_heads({"laser_1_mm": 1.0003, "laser_2_mm": 0.9997}), HEADS_U)
    assert (both.u, both.remarks) == (pytest.approx(3e-4 / math.sqrt(2.0)), ())
    assert reference_of(with_heads({"laser_1_mm": 1.0}), HEADS_U) == Reference(3e-4)


def test_heads_that_disagree_are_said_and_their_scatter_counts() -> None:
    runs = with_heads({"laser_1_mm": 1.04, "laser_2_mm": 1.0})
    found = response_result(recorded(runs, Bench(heads_u=HEADS_U)))
    (remark,) = found.remarks
    assert remark.startswith("laser heads disagree: laser_1_mm reads +2 % against the mean of laser_1_mm, laser_2_mm")
    for each in found.as_json()["sensitivity"]:
        size = each["magnitude"]
        # What the mean is off by is half of what the heads differ by.
        assert each["budget"]["reference"]["magnitude"] == pytest.approx(0.02 / 1.02 * size["value"], rel=0.01)
        assert abs(size["value"] - abs(S)) < size["U"]


def test_a_run_counts_at_the_frequency_that_it_was_driven_at() -> None:
    frequency_hz, amplitude_mm, direction = CASES[1]
    made = [samples(frequency_hz, amplitude_mm, direction, np.random.default_rng([7, each])) for each in range(2)]
    asked_hz = (frequency_hz * 1.002, 1.3 * frequency_hz)
    given = [{"direction": direction, "frequency_hz": each, "mounting": 1} for each in asked_hz]
    runs = sensitivities([fitted_run(str(i), given[i], made[i], {}, {}) for i in range(2)])
    found = response_result(recorded(runs, Bench()))
    # A drive that misses a little what was asked for is called by that.
    assert [each.frequency_hz for each in found.frequencies] == [frequency_hz, asked_hz[0]]
    assert found.remarks == ("run 1 was driven at 2.03 Hz and counts there; its frequency_hz says 2.639: correct it",)


@pytest.mark.parametrize(("larger", "swept"), [(1.002, False), (3.0, True)])
def test_the_linearity_needs_amplitudes_that_were_measured_not_ones_that_are_stated(
    larger: float, swept: bool
) -> None:
    frequency_hz, amplitude_mm, direction = CASES[1]
    given = {"direction": direction, "frequency_hz": frequency_hz, "mounting": 1}
    runs = []
    for number, factor in enumerate((1.0, larger)):
        made = samples(frequency_hz, factor * amplitude_mm, direction, np.random.default_rng([9, number]))
        runs.append(fitted_run(str(number), given, made, {}, {}))
    found = response_result(recorded(sensitivities(runs), Bench())).linearity
    assert (found.kappa_s4_m2 is not None) is swept
    if found.kappa_s4_m2 is not None:
        assert abs(found.kappa_s4_m2) < 4.0 * found.sigma


def test_a_direction_that_all_other_runs_contradict_is_said() -> None:
    frequency_hz, amplitude_mm, direction = CASES[2]
    runs = []
    for number, stated in enumerate((direction, direction, -direction)):
        made = samples(frequency_hz, amplitude_mm, direction, np.random.default_rng([8, number]))
        given = {"direction": stated, "frequency_hz": frequency_hz, "mounting": 1}
        runs.append(fitted_run(str(number), given, made, {}, {}))
    (remark,) = response_result(recorded(sensitivities(runs), Bench())).remarks
    assert remark.startswith("the output of run 2 goes against that of most others at 7 Hz: its direction says -1")


def test_a_run_without_a_signal_is_said_and_does_not_count_for_all_others() -> None:
    """Its sensitivity is next to nothing, and so is what the heads' noise makes of it: that is no weight."""
    frequency_hz, _, _ = CASES[2]
    rng, runs = np.random.default_rng(9), []
    for number, amplitude_mm in enumerate([0.02, 0.02, 0.1, 0.1, 0.4, 0.4]):
        made = samples(frequency_hz, amplitude_mm, 1, rng)
        if number == 5:
            made["accel_v"] = 1e-5 * rng.standard_normal(len(made["t_s"]))
        given = {"direction": 1, "frequency_hz": frequency_hz, "mounting": 1}
        runs.append(fitted_run(str(number), given, made, {}, {}))
    result = response_result(recorded(sensitivities(runs), Bench()))
    (row,) = result.frequencies
    shown = row.as_json()["magnitude"]
    assert row.scattered
    assert abs(shown["value"] - abs(S)) < shown["U"]
    (remark,) = result.remarks
    assert re.match(r"the output of run 5 is \S+e-0\d times that of most others at 7 Hz: ", remark)


@pytest.mark.parametrize("volts", [0.0, 0.3])
def test_a_run_whose_output_never_changes_is_none(volts: float) -> None:
    made = samples(CASES[2][0], 0.1, 1, np.random.default_rng(9))
    made["accel_v"] = np.full_like(made["t_s"], volts)
    with pytest.raises(DataError, match=rf"accel_v is {volts:g} V throughout; was the sensor connected"):
        fitted_run("1", {"direction": 1, "frequency_hz": CASES[2][0], "mounting": 1}, made, {}, {})


def test_the_budget_agrees_with_monte_carlo() -> None:
    bench = Bench(delay_u_s=2e-4, gain_u=3e-4, frequency_u=1e-3, pitch_u_rad_m=6e-5, g_m_s2=9.8)
    measured, inputs = measurement(0.7, 1.3 * np.exp(-0.2j), 2e-3, 200.0, bench, Reference(5e-3))
    first_order = budget(measured, inputs, OUTPUTS)
    drawn = monte_carlo(measured, inputs, OUTPUTS, draws=20_000, seed=1)
    checked = compare(first_order, drawn)
    assert all(checked.validated), checked.reason


def test_a_filter_is_its_response_at_the_drives_frequency() -> None:
    run = trial_run("shaken_output_v")
    tau = 0.01
    passed = run.through(lambda s: 1.0 / (1.0 + s * tau))
    w = run.omega
    # A cosine through a pole: its in-phase part over 1 + (w tau)^2, and w tau of it a quarter later.
    expected = (run.signal + w * tau * np.roll(run.signal, 8, axis=1)) / (1.0 + (w * tau) ** 2)
    np.testing.assert_allclose(passed, expected, rtol=0.0, atol=1e-12 * np.abs(run.signal).max())


def test_runs_to_come_begin_at_the_same_time_whatever_else_is_proposed() -> None:
    runs = [
        replace(run, conditions={**run.conditions, "start_s": 40.0 * place, "temperature_c": 20.0 + 0.1 * place})
        for place, run in enumerate(reduced(0))
    ]
    proposed = options(runs)
    alone = [imagined([each], runs)[0].conditions for each in proposed]
    assert [each.conditions for each in imagined(proposed, runs)] == alone
    (start_s,) = {each["start_s"] for each in alone}
    # On the line on which the room went, so that it is told from a drift by none of them.
    assert all(each["temperature_c"] == pytest.approx(20.0 + 0.1 * start_s / 40.0) for each in alone)


def response(of_run: dict[str, FloatArray], **record: object) -> Recording:
    given = {"direction": 1, "frequency_hz": 0.5, "mounting": 1, "amplitude_mm": 5.0}
    run = RunRecord("7", "7", "test", given, **record)  # type: ignore[arg-type]
    return Recording(Header("frequency-response"), [run], {"7": of_run}, ImportReport(1))


@pytest.mark.parametrize(("factor", "unit", "hz"), [(1e3, "ms", "0.0005"), (1e6, "us", "5e-07")])
def test_time_in_another_unit_than_seconds_is_refused(factor: float, unit: str, hz: str, tmp_path: Path) -> None:
    made = samples(0.5, 5.0, 1, np.random.default_rng(3))
    write_bundle(response(made), tmp_path / "good")
    assert [run.valid for run in read_bundle(tmp_path / "good").runs()] == [True]
    write_bundle(response({**made, "t_s": factor * made["t_s"]}), tmp_path / "bad")
    said = f"the stage moves at {hz} Hz, frequency_hz is 0.5: t_s looks like {unit}; write it in seconds$"
    with pytest.raises(DataError, match=said):
        read_bundle(tmp_path / "bad")


def test_without_a_valid_run_the_first_reason_is_told() -> None:
    made = samples(0.5, 5.0, 1, np.random.default_rng(3))
    invalid = response(made, valid=False, reason="accel_v: 7 of 2400 saturated")
    with pytest.raises(DataError, match=r"^no valid run could be reduced: run 7: accel_v: 7 of 2400 saturated$"):
        ResponseStudy(invalid, ()).data  # noqa: B018
    unnamed = response(made, valid=False)
    with pytest.raises(DataError, match=r"^no valid run could be reduced: run 7: it is marked invalid$"):
        ResponseStudy(unnamed, ()).data  # noqa: B018
    headless = response({name: column for name, column in made.items() if "laser" not in name})
    with pytest.raises(DataError, match=r"^no valid run could be reduced: run 7: no laser head was recorded"):
        ResponseStudy(headless, ()).data  # noqa: B018
