"""Axes in the host's frame: covariance between them, angles, and twins whose natures are drawn from the budget."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from rigctl.analysis.plane import ARCSEC
from rigctl.analysis.rotation import FrameRotation, rotation_between
from rigctl.effects.catalogue import chosen
from rigctl.experiments.sensing_axis.model.model import RecordingModel
from rigctl.experiments.sensing_axis.observe.reduction import observables
from rigctl.experiments.sensing_axis.result.budget import axis_budgets
from rigctl.experiments.sensing_axis.result.host_axes import HostAxes, host_axes
from rigctl.experiments.sensing_axis.result.result import SensingAxisResult, sensing_axes

TRUE_AXIS = np.array([1.0, 0.002, 0.008])
HOST = Rotation.from_rotvec([0.0, math.radians(35.0), 0.0])
YAW_SHIFT_RAD, LEVER_M = 2e-5, 0.072
CERTIFIED = {"stage": {"yaw_rad_per_m": YAW_SHIFT_RAD / LEVER_M}}
READ_RAD, SCATTER_RAD = 5.0 * ARCSEC, 4.0 * ARCSEC


def twin(seed: int, make_run: Any, package: Any, heads: Any) -> SensingAxisResult:
    """Axis X: all nulls are off alike because the guide yaws, and the host's frame was read with errors."""
    rng = np.random.default_rng([16, seed])
    shift_rad, runs = YAW_SHIFT_RAD * rng.standard_normal(), []
    for mounting, configuration in enumerate(["pendulum", "flag"] * 3):
        strain = np.concatenate([[0.0], SCATTER_RAD * rng.standard_normal(2)])
        delta = 2e-3 * rng.standard_normal(3)
        runs += [
            make_run(
                rng,
                configuration=configuration,
                mounting=mounting,
                true_axis=TRUE_AXIS + strain,
                delta=delta,
                theta_deg=theta_deg,
                frequency_hz=frequency_hz,
                duration_s=20.0,
                null_shift_rad=shift_rad,
                run_id=f"{mounting} {theta_deg} {frequency_hz}",
            )
            for theta_deg, frequency_hz in ((0.0, 0.6), (0.4, 0.6), (0.4, 0.3))
        ]
    model = RecordingModel(
        observables(runs), package, heads, 9.803, chosen("sensing-axis", ["roll-gravity", "resonance"])
    )
    result = sensing_axes(model)
    read = HOST.apply(np.eye(3)) + READ_RAD * rng.standard_normal((3, 3))
    host = rotation_between(np.eye(3), read, np.full(3, READ_RAD))
    return replace(result, axes={"X": replace(result.axes["X"], host=host)})


TWINS = 6


def test_twins_drawn_from_the_budget_are_off_by_what_it_says(make_run: Any, package: Any, heads: Any) -> None:
    """A hundred of the whole campaign: benchmarks/axis_twins.py."""
    truth = HOST.apply(TRUE_AXIS / np.linalg.norm(TRUE_AXIS))
    chi2 = []
    for seed in range(TWINS):
        result = twin(seed, make_run, package, heads)
        budgets = axis_budgets(result, CERTIFIED)
        host = host_axes(result, budgets)
        components = budgets["X"].basis_uoaf @ (host.units[0] - truth)
        u = budgets["X"].budget.standard_uncertainty
        chi2.append(components @ np.linalg.solve(host.correlation * np.outer(u, u), components))
    # Shift and readings, which do not scatter within a twin, make nine tenths of the variance: nearly a chi-square.
    low, high = stats.chi2(2 * TWINS).ppf([5e-4, 1.0 - 5e-4])
    assert low < sum(chi2) < high, chi2


@pytest.fixture
def one(make_run: Any, package: Any, heads: Any) -> SensingAxisResult:
    return twin(1, make_run, package, heads)


def test_what_all_axes_share_correlates_them_and_scatter_does_not(one: SensingAxisResult) -> None:
    """The same axis twice, as if measured in mountings of its own each time."""
    axis = one.axes["X"]
    both = replace(one, axes={"X": axis, "again": replace(axis, name="again")})
    budgets = axis_budgets(both, CERTIFIED)
    host = host_axes(both, budgets)
    first = budgets["X"].budget
    own = [each.name not in budgets["X"].common for each in first.contributions]
    assert {each.name for each in first.contributions} - budgets["X"].common >= {
        "scatter in pendulum",
        "scatter in flag",
    }
    assert {"guide yaw times lever", "roll correction"} <= budgets["X"].common
    turned = budgets["X"].basis_uoaf.T @ first.components
    np.testing.assert_allclose(host.block(0, 0), turned @ turned.T, atol=1e-24)
    shared = turned[:, np.logical_not(own)]
    np.testing.assert_allclose(host.block(0, 1), shared @ shared.T, atol=1e-24)
    assert np.trace(host.block(0, 1)) > 0.5 * np.trace(host.block(0, 0))


def test_what_turns_two_axes_alike_is_not_in_the_angle_between_them() -> None:
    rng = np.random.default_rng(4)
    units = np.array([[1.0, 0.0, 0.01], [0.2, 0.95, 0.1]])
    units /= np.linalg.norm(units, axis=1)[:, None]
    draws = 20_000
    own = 3e-5 * rng.standard_normal((draws, 2, 3))
    own -= np.einsum("dai,ai->da", own, units)[:, :, None] * units
    turn = 2e-4 * rng.standard_normal((draws, 1, 3))
    moved = (own + np.cross(turn, units)).reshape(draws, 6)
    host = HostAxes(("X", "Y"), units, np.cov(moved.T), np.eye(4))
    drawn = units + own
    angles = np.arccos(
        np.einsum("di,di->d", drawn[:, 0], drawn[:, 1]) / np.prod(np.linalg.norm(drawn, axis=2), axis=1)
    )
    # A standard deviation of so many draws is known to 0.5 %.
    assert host.angle_sigma_rad(0, 1) == pytest.approx(angles.std(), rel=0.02)


def test_a_rotation_that_is_known_adds_nothing(one: SensingAxisResult) -> None:
    axis = replace(one.axes["X"], host=FrameRotation(HOST.as_matrix(), np.zeros((3, 3))))
    exact = replace(one, axes={"X": axis})
    plain = host_axes(exact, axis_budgets(exact, {}))
    added = host_axes(one, axis_budgets(one, {}))
    extra = np.trace(added.covariance) - np.trace(plain.covariance)
    # Two turns across the axis; three normals give each half the variance of one reading.
    assert extra == pytest.approx(READ_RAD**2, rel=1e-3)
