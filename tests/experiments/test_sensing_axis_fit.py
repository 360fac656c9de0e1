"""The measurement model against recordings made without it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from rigctl.core.errors import ConfigError, DataError, ProcedureError
from rigctl.effects.catalogue import Effect, chosen, effect
from rigctl.experiments.sensing_axis.model.fit import RecordingFit, fit_recording, residuals_of
from rigctl.experiments.sensing_axis.model.model import RecordingModel
from rigctl.experiments.sensing_axis.model.prediction import Observer
from rigctl.experiments.sensing_axis.observe.reduction import ReducedRun, observables
from rigctl.experiments.sensing_axis.result.misfit import misfit

EFFECTS = ("roll-gravity", "resonance")
MOUNTINGS = [(axis, configuration) for axis in "XYZ" for configuration in ("pendulum", "flag")]
AXES = {"X": (1.0, 0.002, 0.008), "Y": (-0.006, 1.0, -0.002), "Z": (-0.012, 0.0024, 1.0)}


def runs_of_a_search(make_run: Callable[..., ReducedRun], seed: int, **nature: Any) -> list[ReducedRun]:
    rng = np.random.default_rng(seed)
    settings = [(0.0, 0.6, 10.0), (0.45, 0.6, 50.0), (0.45, 0.3, 50.0)]
    return [
        make_run(rng, theta_deg=theta, frequency_hz=f, duration_s=T, run_id=str(i), **nature)
        for i, (theta, f, T) in enumerate(settings)
    ]


def fitted(runs: list[ReducedRun], package: Any, heads: Any, effects: tuple[str, ...] = EFFECTS) -> RecordingFit:
    return fit_recording(RecordingModel(observables(runs), package, heads, 9.803, chosen("sensing-axis", effects)))


@pytest.mark.parametrize(("axis", "configuration"), MOUNTINGS)
def test_null_and_vector_are_natures(
    make_run: Any, null_of: Any, package: Any, heads: Any, axis: str, configuration: str
) -> None:
    delta = (4e-3, -1.5e-3, 2e-3)
    nature = {"axis": axis, "configuration": configuration, "true_axis": AXES[axis], "delta": delta}
    quiet = {"noise_m_s2_rthz": 1e-9, "laser_noise_m": 1e-10}
    fit = fitted(runs_of_a_search(make_run, 1, **nature, **quiet), package, heads)
    null = fit.null(axis, configuration, 1)
    # Four sigma of these quiet records, which are a hundredth of an arcsecond and less.
    assert null.theta0_sigma_rad < 5e-7
    truth = null_of(axis, configuration, AXES[axis], delta)
    assert null.theta0_rad == pytest.approx(truth, abs=4 * null.theta0_sigma_rad)
    assert fit.result.value("rho1") == pytest.approx(9.7e-5, abs=4 * fit.result.sigma("rho1"))
    for component, value in zip("xyz", delta, strict=True):
        name = f"delta_{component}[{axis},{configuration},1]"
        assert fit.result.value(name) == pytest.approx(value, abs=4 * fit.result.sigma(name))
    assert null.vector_coc is not None
    assert null.vector_covariance is not None
    # At the null the motion is perpendicular to the sensing axis, by definition.
    unit = np.asarray(AXES[axis]) / np.linalg.norm(AXES[axis])
    sigma = math.sqrt(unit @ null.vector_covariance @ unit)
    assert null.vector_coc @ unit == pytest.approx(0.0, abs=4 * sigma)


def test_errors_over_their_sigma_are_standard_normal(make_run: Any, null_of: Any, package: Any, heads: Any) -> None:
    delta, true_axis = (4e-3, -1.5e-3, 2e-3), AXES["X"]
    truth = null_of("X", "pendulum", true_axis, delta)
    pulls = []
    for seed in range(60):
        runs = runs_of_a_search(make_run, 100 + seed, true_axis=true_axis, delta=delta, gain_error=0.006)
        null = fitted(runs, package, heads).null("X", "pendulum", 1)
        pulls.append((null.theta0_rad - truth) / null.theta0_sigma_rad)
    # The noise is estimated: with its forty degrees of freedom t is as good as normal at this number of seeds.
    assert stats.kstest(pulls, "norm").pvalue > 1e-3
    assert 0.75 < np.std(pulls, ddof=1) < 1.3  # 99.9 % of the standard deviation of 60 normal numbers


def test_without_roll_in_the_model_the_null_is_displaced(
    make_run: Any, null_of: Any, package: Any, heads: Any
) -> None:
    runs = [run for run in runs_of_a_search(make_run, 3) if abs(run.frequency_hz - 0.6) < 0.01]
    null = fitted(runs, package, heads, ("resonance",)).null("X", "pendulum", 1)
    truth = null_of("X", "pendulum", AXES["X"], (5e-3, 2e-3, -1e-3))
    expected = -9.7e-5 * 9.803 / (2 * math.pi * 0.6) ** 2
    assert null.theta0_rad - truth == pytest.approx(expected, abs=4 * null.theta0_sigma_rad)
    assert abs(expected) > 10 * null.theta0_sigma_rad


@pytest.mark.parametrize("seed", range(3, 9))
def test_roll_and_null_are_not_told_apart_at_one_frequency(
    make_run: Any, package: Any, heads: Any, seed: int
) -> None:
    runs = [run for run in runs_of_a_search(make_run, seed) if abs(run.frequency_hz - 0.6) < 0.01]
    with pytest.raises(ProcedureError, match="do not determine the model"):
        fitted(runs, package, heads)


def test_the_jacobian_is_the_slope_of_the_model(make_run: Any, package: Any, heads: Any) -> None:
    fit = fitted(runs_of_a_search(make_run, 5), package, heads)
    model, values = fit.model, fit.result.values
    # The last digits of what is differenced, which processors round each their own way.
    rounding = 4.0 * np.finfo(float).eps * np.abs(residuals_of(model, np.zeros(len(values)))).max()
    for i, parameter in enumerate(model.parameters):
        step = np.zeros(len(values))
        step[i] = parameter.step or 1e-6
        slope = (residuals_of(model, values + step) - residuals_of(model, values - step)) / (2 * step[i])
        np.testing.assert_allclose(
            fit.result.jacobian[: len(slope), i], -slope, rtol=1e-6, atol=1e-9 + rounding / step[i]
        )


def test_a_recording_without_lasers_has_nulls_and_no_vectors(make_run: Any, package: Any) -> None:
    fit = fitted(runs_of_a_search(make_run, 7), package, {})
    null = fit.null("X", "pendulum", 1)
    assert null.vector_coc is None
    assert not any(name.startswith("delta") for name in fit.result.names)


def test_mountings_share_gain_and_roll_but_not_nulls(make_run: Any, package: Any, heads: Any) -> None:
    rng = np.random.default_rng(11)
    runs = [
        make_run(
            rng, mounting=m, theta_deg=theta, frequency_hz=f, run_id=f"{m} {theta} {f}", delta=(0.0, 0.0, 1e-3 * m)
        )
        for m in (1, 2)
        for theta, f in ((0.0, 0.6), (0.4, 0.6), (0.4, 0.3))
    ]
    names = fitted(runs, package, heads).result.names
    assert sorted(n for n in names if n.startswith(("theta0", "gain", "rho1"))) == [
        "gain[X,pendulum]",
        "rho1",
        "theta0[X,pendulum,1]",
        "theta0[X,pendulum,2]",
    ]


def test_lost_targets_are_left_out(make_run: Any, package: Any, heads: Any) -> None:
    from rigctl.experiments.sensing_axis.observe.reduction import reduce_run

    t = np.arange(2000) / 100.0
    x = 5.0 * np.sin(2 * np.pi * 0.6 * t)
    half_blind = np.where(np.arange(2000) % 10 == 0, np.nan, 0.1 * x)
    samples = {"t_s": t, "stage_x_mm": x, "accel_v": 0.01 * x, "laser_2_mm": half_blind, "laser_3_mm": np.nan * x}
    conditions = {"axis": "X", "configuration": "flag", "mounting": 1, "theta_deg": 0.0, "frequency_hz": 0.6}
    run = reduce_run("7", conditions, samples)
    assert set(run.channels) == {"accel_v", "laser_2_mm"}
    assert run.channels["laser_2_mm"].value[1] == pytest.approx(0.1 * 5e-3, rel=1e-9)


def test_a_record_at_another_frequency_names_the_run() -> None:
    from rigctl.experiments.sensing_axis.observe.reduction import reduce_run

    t = np.arange(2000) / 100.0
    samples = {"t_s": t, "stage_x_mm": np.random.default_rng(1).standard_normal(2000), "accel_v": 0 * t}
    conditions = {"axis": "X", "configuration": "flag", "mounting": 1, "theta_deg": 0.0, "frequency_hz": 0.6}
    with pytest.raises(DataError, match="run 12"):
        reduce_run(
            "12", conditions, {**samples, "t_s": t[:50], "stage_x_mm": samples["stage_x_mm"][:50], "accel_v": t[:50]}
        )


def test_unknown_effects_are_named_with_the_nearest_that_are_known() -> None:
    with pytest.raises(ConfigError, match=r"unknown effect 'rol-gravity'; the nearest are roll-gravity, .*--plugin"):
        chosen("sensing-axis", ["rol-gravity"])


def test_a_scale_error_within_its_certificate_does_not_pass_for_a_rotation(
    make_run: Any, package: Any, heads: Any
) -> None:
    """The main head's noise allows 1e-7; a certified 1e-4 believed to that would tip the mounting rotation."""
    certified = {name: head.model_copy(update={"u_scale": 1e-4}) for name, head in heads.items()}
    runs = observables(runs_of_a_search(make_run, 21))
    wrong = [
        replace(
            run,
            lasers_m={
                name: replace(laser, value=laser.value * (1.0001 if name == "laser_1_mm" else 1.0))
                for name, laser in run.lasers_m.items()
            },
        )
        for run in runs
    ]

    def vector(recording: Any, chosen_heads: Any) -> Any:
        model = RecordingModel(recording, package, chosen_heads, 9.803, chosen("sensing-axis", EFFECTS))
        return fit_recording(model).null("X", "pendulum", 1).vector_coc

    axis = np.array(AXES["X"])
    believed = abs((vector(wrong, heads) - vector(runs, heads)) @ axis)
    allowed_for = abs((vector(wrong, certified) - vector(runs, certified)) @ axis)
    assert allowed_for < 0.05 * believed
    assert allowed_for < 1e-7


@pytest.mark.parametrize("seed", [0, 1, 125])
def test_a_single_coarse_run_is_always_fitted(make_run: Any, package: Any, heads: Any, seed: int) -> None:
    """At one angle delta_x is known to its prior only: a long curved valley, in which a night must not end."""
    rng = np.random.default_rng(seed)
    delta = (*(12e-3 * rng.standard_normal(1)), *(5e-3 * rng.standard_normal(2)))
    run = make_run(rng, theta_deg=0.0, duration_s=6.67, delta=delta, configuration="flag")
    null = fitted([run], package, heads, ("resonance",)).null("X", "flag", 1)
    assert np.isfinite(null.theta0_rad)
    assert null.theta0_sigma_rad < math.radians(0.05)


@effect("since-before", on="sensor_output_v", parameters={"k": "V/s"}, typical={"k": 1e-6})
def since_before(run: Any, *, k: Any) -> Any:
    """Follows the time since the run before."""
    return k * np.diff(run.start, axis=0, prepend=run.start[:1]) * np.ones_like(run.signal)


@effect("beside-the-others", on="sensor_output_v", parameters={"k": "1"}, typical={"k": 1e-3})
def beside_the_others(run: Any, *, k: Any) -> Any:
    """Follows how far the signal is from that of all runs."""
    return k * (run.signal - run.signal.mean())


@effect("of-three-runs", on="sensor_output_v", parameters={"k": "V"}, typical={"k": 1e-6})
def of_three_runs(run: Any, *, k: Any) -> Any:
    """Has a number for each of three runs."""
    return k * np.array([[1.0], [2.0], [3.0]]) * np.ones_like(run.signal)


OWN = {"none": (), **{each.id: (each,) for each in (since_before, beside_the_others, of_three_runs)}}


@pytest.mark.parametrize("own", OWN.values(), ids=OWN)
def test_slopes_are_the_differences_of_predictions(
    make_run: Any, package: Any, heads: Any, own: tuple[Effect, ...]
) -> None:
    runs = [replace(run, start_s=100.0 * i**2) for i, run in enumerate(observables(runs_of_a_search(make_run, 5)))]
    model = RecordingModel(runs, package, heads, 9.803, (*chosen("sensing-axis", EFFECTS), *own))
    values = np.array([each.start for each in model.parameters])
    if own:
        values[model.index("k")] = own[0].typical["k"]

    observe = Observer(lambda accel: accel[:, 1::-1].real, lambda laser: laser[:, 1:2].real)
    slopes = model.jacobian(values, observe)
    # The last digits of what is differenced: a subset of the data may be rounded otherwise than all of them.
    rounding = 4.0 * np.finfo(float).eps * np.abs(observe(model.predict(values))).max()
    for place, parameter in enumerate(model.parameters):
        above, below = values.copy(), values.copy()
        above[place] += parameter.step
        below[place] -= parameter.step
        # All runs are of one mounting, and every parameter is one of all of them.
        expected = (observe(model.predict(above)) - observe(model.predict(below))) / (2.0 * parameter.step)
        np.testing.assert_allclose(
            slopes[:, place], expected.ravel(), rtol=0.0, atol=rounding / parameter.step, err_msg=parameter.name
        )


def test_a_model_that_lacks_the_roll_is_warned_of_and_a_right_one_is_not(
    make_run: Any, package: Any, heads: Any
) -> None:
    warned, without = 0, []
    for seed in range(100):
        runs = runs_of_a_search(make_run, 300 + seed)
        warned += bool(misfit(fitted(runs, package, heads), 1))
        if seed < 5:
            without += misfit(fitted(runs, package, heads, ("resonance",)), 2)
    # At a level of 1 %: more than 5 of a hundred come once in two thousand times.
    assert warned <= 5
    assert len(without) == 5
    said = "the model, version 2, does not describe these data, and no sigma holds: chi2/dof at nu alone is "
    assert all(each.startswith(said) for each in without)
    assert all(", accel_v, nu in-phase is " in each for each in without)
