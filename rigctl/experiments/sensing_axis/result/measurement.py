"""Axes, angles between them and half-cone deviations as one measurement result, with what they have in common.

Axes are in the host's frame where that was stated, else in the cube's. What is one input for all axes (a laser's
tilt, the cube, the rotation into the host's frame) correlates them; scatter and resonance are each axis' own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from rigctl.analysis.measurement_result import (
    Limits,
    MeasurementResult,
    Quantity,
    Source,
    checked,
    common_sources,
    spread_source,
)
from rigctl.core.arrays import FloatArray
from rigctl.experiments.sensing_axis.result.budget import AxisBudget
from rigctl.experiments.sensing_axis.result.result import SensingAxisResult

METHOD = (
    "Two-phase null search of each mounting, and the plane of total least squares through the null vectors of all "
    "mountings of an axis, whose normal is the sensing axis (Lucente et al. 2022, Planetary and Space Science 211)"
)
SCATTER = "scatter in "
"""So begins the scatter of an axis in a configuration, in all of them by the same estimate."""

OWN = (SCATTER, "resonance in ")
"""Contributions that belong to one axis begin so."""


def axes_measured(result: SensingAxisResult, budgets: Mapping[str, AxisBudget]) -> MeasurementResult:
    """Three components of each axis, angles between axes, half-cone deviations; `ProcedureError` without an axis."""
    axes = {name: result.axes[name].host.matrix @ result.axes[name].plane.normal for name in budgets}
    directions = [
        Quantity(f"axis {name}, {component}", float(value), "1", group=f"axis {name}")
        for name, axis in axes.items()
        for component, value in zip("xyz", axis, strict=True)
    ]
    pairs = list(combinations(axes, 2))
    slopes = np.vstack([np.eye(len(directions)), *(_angle_slopes(axes, pair) for pair in pairs)])
    angles = [
        Quantity(f"angle {a} to {b}", math.degrees(math.acos(float(axes[a] @ axes[b]))), "deg", group="angles")
        for a, b in pairs
    ]
    spreads = [
        Quantity(
            f"half-cone deviation {name}",
            result.axes[name].plane.std_hc_2sigma_arcsec,
            "arcsec",
            "spread",
            f"axis {name}",
            Limits(None, result.axes[name].requirement_arcsec, "requirement_arcsec of the rig file's package")
            if result.axes[name].requirement_is_stated
            else None,
            unbiased=result.axes[name].plane.hc_unbiased,
        )
        for name in axes
    ]
    quantities = (*directions, *angles, *spreads)
    sources = [_widened(each, slopes, len(quantities)) for each in _of_directions(budgets)]
    for place, (name, spread) in enumerate(zip(axes, spreads, strict=True), start=len(directions) + len(angles)):
        estimate, dof = spread.unbiased * spread.value, result.axes[name].plane.dof
        sources.append(spread_source(f"number of null vectors of {name}", place, len(quantities), estimate, dof))
    remarks = [
        "Components of axes are in the host's frame (UOAF)."
        if result.fit.model.package.states_host_frame
        else "Components of axes are in the cube's frame: nobody has stated how it stands in the host's.",
        "The half-cone deviation is twice the standard deviation of n null vectors' angles out of their plane; its "
        "interval is that of a standard deviation with n - 2 degrees of freedom: the plane has two.",
        *(f"Axis {name} has no result: {reason}" for name, reason in result.missing.items()),
        *(f"Budget of axis {name}: {budget.check.reason}." for name, budget in budgets.items()),
    ]
    return checked(MeasurementResult(quantities, tuple(sources), METHOD, tuple(remarks)))


def _angle_slopes(axes: Mapping[str, FloatArray], pair: tuple[str, str]) -> FloatArray:
    """d angle [deg] / d components of all axes, (1, 3 n)."""
    a, b = (axes[name] for name in pair)
    sine = float(np.linalg.norm(np.cross(a, b)))
    row = {name: np.zeros(3) for name in axes}
    row[pair[0]], row[pair[1]] = -b / sine, -a / sine
    return np.asarray(np.degrees(np.concatenate(list(row.values())))[None, :])


def _of_directions(budgets: Mapping[str, AxisBudget]) -> list[Source]:
    """Every contribution over the components of all axes; the scatter of an axis is one source."""
    sources = common_sources(
        3 * len(budgets),
        (
            (f"{each.name} of {axis}" if each.name.startswith(OWN) else each.name, each, place, column)
            for axis, budget, place in zip(budgets, budgets.values(), _places(len(budgets)), strict=True)
            for each, column in zip(budget.budget.contributions, _components(budget).T, strict=True)
        ),
    )
    scatter = [_scatter_of(axis, sources) for axis in budgets]
    return [*scatter, *(each for each in sources if not each.name.startswith(SCATTER))]


def _scatter_of(axis: str, sources: Sequence[Source]) -> Source:
    """Of all configurations together: two sources would have twice the degrees of freedom of their one estimate."""
    own = [each for each in sources if each.name.startswith(SCATTER) and each.name.endswith(f" of {axis}")]
    configurations = [each.name.removeprefix(SCATTER).removesuffix(f" of {axis}") for each in own]
    return replace(
        own[0],
        name=f"scatter of {axis}",
        covariance=np.sum([each.covariance for each in own], axis=0),
        input=", ".join(f"{name} {each.input}" for name, each in zip(configurations, own, strict=True)),
    )


def _components(budget: AxisBudget) -> FloatArray:
    """Signed contributions to the axis' components in the host's frame, (3, contributions)."""
    return np.asarray(budget.host.matrix @ budget.basis.T @ budget.budget.components)


def _places(axes: int) -> list[slice]:
    return [slice(3 * number, 3 * number + 3) for number in range(axes)]


def _widened(source: Source, slopes: FloatArray, count: int) -> Source:
    covariance = np.zeros((count, count))
    rows = len(slopes)
    covariance[:rows, :rows] = slopes @ source.covariance @ slopes.T
    return replace(source, covariance=covariance)
