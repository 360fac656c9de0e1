"""The uncertainty budget against what its inputs do when they are really changed."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rigctl.analysis.clock_fit import ClockFit
from rigctl.analysis.plane import ARCSEC, fit_plane
from rigctl.analysis.rotation import FrameRotation
from rigctl.effects.catalogue import chosen
from rigctl.experiments.sensing_axis.model.fit import fit_recording
from rigctl.experiments.sensing_axis.model.model import RecordingModel
from rigctl.experiments.sensing_axis.observe.observables import RunObservables
from rigctl.experiments.sensing_axis.observe.reduction import observables
from rigctl.experiments.sensing_axis.result.budget import AxisBudget, axis_budgets
from rigctl.experiments.sensing_axis.result.measurement import axes_measured
from rigctl.experiments.sensing_axis.result.result import AxisResult, SensingAxisResult

TRUE_AXIS = np.array([1.0, 0.002, 0.008])
CERTIFIED = {
    "accel_v": {"latency_s": 1e-3},
    "laser_2_mm": {"tilt_deg": 0.05, "scale": 1e-4},
    "cube": {"orthogonality_arcsec": 1.0},
    "stage": {"yaw_rad_per_m": 5.6e-5, "recoil_rad_s2_per_m": 1e-7},
    "rotation": {"resolution_arcsec": 0.36},
}
SCATTER_ARCSEC = 12.5
HOST = FrameRotation(np.eye(3), np.zeros((3, 3)))


@pytest.fixture
def result(make_run: Any, package: Any, heads: Any) -> SensingAxisResult:
    rng = np.random.default_rng(4)
    runs, mounting = [], 0
    for configuration in ("pendulum", "flag"):
        for _ in range(4):
            mounting += 1
            tilt = np.concatenate([[0.0], SCATTER_ARCSEC * ARCSEC * rng.standard_normal(2)])
            delta = 2e-3 * rng.standard_normal(3)
            for theta_deg, frequency_hz in ((0.0, 0.6), (0.4, 0.6), (0.4, 0.3)):
                runs.append(
                    make_run(
                        rng,
                        configuration=configuration,
                        mounting=mounting,
                        true_axis=TRUE_AXIS + tilt,
                        delta=delta,
                        theta_deg=theta_deg,
                        frequency_hz=frequency_hz,
                        duration_s=20.0,
                        run_id=str(len(runs) + 1),
                    )
                )
    model = RecordingModel(
        observables(runs), package, heads, 9.803, chosen("sensing-axis", ["roll-gravity", "resonance"])
    )
    fit = fit_recording(model)
    nulls = tuple(fit.nulls())
    vectors = np.array([null.vector_coc for null in nulls])
    plane = fit_plane(vectors, np.array([1.0, 0.0, 0.0]))
    return SensingAxisResult({"X": AxisResult("X", plane, nulls, vectors, HOST, 100.0)}, {}, fit)


@pytest.fixture
def axis_budget(result: SensingAxisResult) -> AxisBudget:
    return axis_budgets(result, CERTIFIED)["X"]


def component(budget: AxisBudget, name: str) -> np.ndarray:
    names = [each.name for each in budget.budget.contributions]
    return budget.budget.components[:, names.index(name)]


def test_the_scatter_is_that_of_the_plane(result: SensingAxisResult, axis_budget: AxisBudget) -> None:
    parts = np.stack([component(axis_budget, f"scatter in {c}") for c in ("pendulum", "flag")])
    stated = np.diag(axis_budget.basis @ result.axes["X"].plane.covariance @ axis_budget.basis.T)
    # The plane's covariance pools the same scatter over both configurations, which are equally many here.
    np.testing.assert_allclose(np.sum(parts**2, axis=0), stated, rtol=0.02)


def test_scatter_is_one_estimate_in_whatever_frame(result: SensingAxisResult) -> None:
    """Turned by 35 deg a component has scatter of both configurations: from one standard deviation all the same."""
    turned = FrameRotation(Rotation.from_euler("z", 35.0, degrees=True).as_matrix(), np.zeros((3, 3)))
    there = replace(result, axes={"X": replace(result.axes["X"], host=turned)})
    measured = axes_measured(there, axis_budgets(there, {}))
    parts = {each.name: each.standard_uncertainty[:3] for each in measured.sources}
    assert np.all(parts["scatter of X"] > 0.99 * measured.standard_uncertainty[:3])
    # What else there is has more of them.
    assert np.all((measured.effective_dof[:3] >= 6.0) & (measured.effective_dof[:3] < 6.3))


@pytest.mark.parametrize(("quantity", "name"), [("tilt_deg", "beam tilt"), ("scale", "scale")])
def test_a_heads_error_does_to_the_axis_what_the_budget_says(
    result: SensingAxisResult, axis_budget: AxisBudget, package: Any, heads: Any, quantity: str, name: str
) -> None:
    """The whole recording is fitted again with the head changed by its standard uncertainty."""
    model = result.fit.model
    u = CERTIFIED["laser_2_mm"][quantity]
    if quantity == "tilt_deg":
        head = heads["laser_2_mm"]
        changed = model.with_heads({**heads, "laser_2_mm": head.model_copy(update={"tilt_deg": head.tilt_deg + u})})
    else:
        runs = []
        for run in model.runs:
            laser = run.lasers_m["laser_2_mm"]
            scaled = replace(laser, value=laser.value * (1.0 - u))
            runs.append(replace(run, lasers_m={**run.lasers_m, "laser_2_mm": scaled}))
        changed = model.with_runs(runs)
    vectors = np.array([null.vector_coc for null in fit_recording(changed).nulls()])
    moved = axis_budget.basis @ (fit_plane(vectors, TRUE_AXIS).normal - result.axes["X"].plane.normal)
    stated = component(axis_budget, f"{name} of laser_2_mm")
    assert np.linalg.norm(moved - stated) < 0.05 * np.linalg.norm(stated) + 0.002 * ARCSEC


def test_yaw_and_recoil_shift_the_null_and_so_the_axis(axis_budget: AxisBudget) -> None:
    # A common shift of theta0 turns both configurations' vectors by the same angle about the vertical.
    shift_rad = 5.6e-5 * 0.072
    np.testing.assert_allclose(np.abs(component(axis_budget, "guide yaw times lever")), shift_rad, rtol=0.02)
    np.testing.assert_allclose(np.abs(component(axis_budget, "bench recoil")), 1e-7 * 9.803, rtol=0.02)


def test_the_roll_correction_is_no_larger_than_its_displacement_of_the_null(
    result: SensingAxisResult, axis_budget: AxisBudget
) -> None:
    displacement = result.fit.result.sigma("rho1") * 9.803 / (2 * math.pi * 0.3) ** 2
    assert 0.0 < np.abs(component(axis_budget, "roll correction")).max() < displacement


def test_monte_carlo_agrees_and_the_parts_add_up(axis_budget: AxisBudget) -> None:
    assert all(axis_budget.check.validated), axis_budget.check.reason
    total = np.sqrt(np.sum(axis_budget.budget.components**2, axis=1))
    np.testing.assert_allclose(axis_budget.budget.standard_uncertainty, total)
    shown = axis_budget.as_json()
    assert shown["combined_arcsec"] == pytest.approx((total / ARCSEC).tolist())
    assert {row["type"] for row in shown["contributions"]} == {"A", "B"}
    assert shown["included_in_scatter"]["resolution of the rotation stage"] == pytest.approx(0.36 / math.sqrt(12))


def test_certificates_that_are_not_there_contribute_nothing(result: SensingAxisResult) -> None:
    names = {each.name for each in axis_budgets(result, {})["X"].budget.contributions}
    assert not any(name.startswith(("beam tilt", "scale", "guide", "bench")) for name in names)


def test_a_latency_of_the_accelerometer_does_to_the_axis_what_the_budget_says(
    result: SensingAxisResult, axis_budget: AxisBudget
) -> None:
    """The whole recording is fitted again with its samples taken later by the standard uncertainty."""
    model = result.fit.model
    runs = []
    for run in model.runs:
        turns = np.exp(2j * np.pi * run.frequency_hz * 1e-3 * np.arange(4))
        runs.append(replace(run, accel_v=replace(run.accel_v, value=run.accel_v.value * turns)))
    vectors = np.array([null.vector_coc for null in fit_recording(model.with_runs(runs)).nulls()])
    moved = axis_budget.basis @ (fit_plane(vectors, TRUE_AXIS).normal - result.axes["X"].plane.normal)
    stated = component(axis_budget, "latency of accel_v")
    assert np.linalg.norm(moved - stated) < 0.05 * np.linalg.norm(stated) + 0.002 * ARCSEC


def test_offsets_of_the_heads_clocks_are_in_the_budget(result: SensingAxisResult) -> None:
    def on_its_own_clock(run: RunObservables) -> RunObservables:
        clocked = {name: replace(each, clock=ClockFit(0.0, 2e-6, 0.0, 1e-9)) for name, each in run.lasers_m.items()}
        return replace(run, lasers_m=clocked)

    model = result.fit.model
    fit = fit_recording(model.with_runs([on_its_own_clock(run) for run in model.runs]))
    found = axis_budgets(replace(result, fit=fit), CERTIFIED)["X"]
    row = next(each for each in found.budget.contributions if each.name == "clock of laser_2_mm")
    assert (row.standard_uncertainty, row.unit, row.type) == (pytest.approx(2e-6), "s", "A")
    # In-phase parts do not depend on it in first order.
    assert np.abs(component(found, "clock of laser_2_mm")).max() < 1e-3 * ARCSEC


def test_the_rotation_into_the_hosts_frame_turns_the_axis_and_adds_its_uncertainty(result: SensingAxisResult) -> None:
    turn = Rotation.from_rotvec([0.0, math.radians(35.0), 0.0]).as_matrix()
    # Turns about two directions go together, and the one about the axis itself moves it by nothing.
    mixing = np.array([[2.0, 0.5, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 4.0]]) * (5.0 * ARCSEC) ** 2
    axis = replace(result.axes["X"], host=FrameRotation(turn, mixing, 1.0, 3))
    found = axis_budgets(replace(result, axes={"X": axis}), CERTIFIED)["X"]
    plain = axis_budgets(result, CERTIFIED)["X"].budget
    there = turn @ axis.plane.normal
    drawn = np.random.default_rng(3).multivariate_normal(np.zeros(3), mixing, 100_000)
    moved = np.cross(drawn, there) @ (found.basis @ turn.T).T
    added = found.budget.standard_uncertainty**2 - plain.standard_uncertainty**2
    np.testing.assert_allclose(added, moved.var(axis=0), rtol=0.02)
    assert sum(each.name.startswith("host frame about") for each in found.budget.contributions) == 3
    uoaf, covariance = axis.host.carried(axis.plane.normal, np.zeros((3, 3)))
    np.testing.assert_allclose(uoaf, there)
    np.testing.assert_allclose(covariance, np.cov(np.cross(drawn, there).T), atol=0.02 * np.trace(covariance))
    np.testing.assert_allclose(np.array(found.as_json()["basis_uoaf"]) @ there, 0.0, atol=1e-12)


def test_local_gravity_is_in_the_budget_and_follows_the_fitted_roll(result: SensingAxisResult) -> None:
    stated = component(axis_budgets(result, {"constants": {"g_m_s2": 0.05}})["X"], "local gravity")
    changed = fit_recording(result.fit.model.with_gravity(9.853))
    vectors = np.array([null.vector_coc for null in changed.nulls()])
    basis = axis_budgets(result, {})["X"].basis
    moved = basis @ (fit_plane(vectors, TRUE_AXIS).normal - result.axes["X"].plane.normal)
    np.testing.assert_allclose(moved, stated, atol=2e-3 * ARCSEC)
    # What gravity has too much the fitted roll has too little: their product displaces the null.
    rho1 = [
        fit.values[result.fit.model.index("rho1")] * g
        for fit, g in ((changed.result, 9.853), (result.fit.result, 9.803))
    ]
    assert rho1[0] == pytest.approx(rho1[1], rel=1e-4)
