"""Where the uncertainty of the ten parameters comes from: a budget after the GUM, checked by Monte Carlo.

Noise is told apart by session (type A). What is believed beforehand of the nuisances, and what no session sees, is
type B. A session's noise has as many independent directions as it has lines: they are contributions of their own in
the arithmetic, and one row of the table.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from rigctl.analysis.budget import Budget, Comparison, Contribution, MonteCarlo, compare
from rigctl.core.arrays import FloatArray
from rigctl.experiments.inflight.model.parameters import NAMES
from rigctl.experiments.inflight.result.unseen import Unseen, unseen
from rigctl.experiments.inflight.study import InflightStudy
from rigctl.experiments.inflight.study_model import InflightModel
from rigctl.workbench.study_base import own_model
from rigctl.workbench.verdict.attempt import Attempt

_DRAWS = 2000
_STEPS = 3
"""Of the fit of a draw: parameters move by their sigma, where the model is as good as linear."""

_NEGLIGIBLE = 1e-12
"""Share of a variance below which a direction of noise is rounding."""


@dataclass(frozen=True)
class Group:
    """A row of the table: what a contribution's directions have in common."""

    name: str
    type: Literal["A", "B"]
    source: str


@dataclass(frozen=True)
class CalibrationBudget:
    """`first` is over all directions; `groups` says by direction to which row it belongs."""

    first: Budget
    groups: tuple[Group, ...]
    check: Comparison

    @property
    def covariance(self) -> FloatArray:
        """Of the ten parameters."""
        return np.asarray(self.first.components @ self.first.components.T)

    def rows(self) -> dict[Group, FloatArray]:
        """By group its standard uncertainty of each parameter, (10,)."""
        squares: dict[Group, FloatArray] = {}
        for group, components in zip(self.groups, self.first.components.T, strict=True):
            squares[group] = squares.get(group, np.zeros(len(NAMES))) + components**2
        return {group: np.sqrt(square) for group, square in squares.items()}

    def as_json(self) -> dict[str, Any]:
        """Within `rigctl result --json`."""
        return {
            "outputs": list(NAMES),
            "values": self.first.values.tolist(),
            "contributions": [
                {"name": group.name, "type": group.type, "source": group.source, "u": u.tolist()}
                for group, u in self.rows().items()
            ],
            "combined": self.first.standard_uncertainty.tolist(),
            "expanded_95": self.first.expanded.tolist(),
            "covariance": self.covariance.tolist(),
            "monte_carlo": {"validated": all(self.check.validated), "reason": self.check.reason},
        }


def calibration_budget(study: InflightStudy, attempt: Attempt) -> CalibrationBudget:
    """Of a fitted model of the study."""
    model = own_model(attempt.model, InflightModel)
    values, covariance = attempt.result.values, attempt.uncertainty.covariance
    rows = _groups_of_rows(model)
    # What a datum, or a belief, moves the parameters by when it is off by its sigma.
    gain = covariance @ attempt.jacobian.T
    directions: list[tuple[Contribution, Group, FloatArray]] = []
    for group in dict.fromkeys(rows):
        members = [place for place, each in enumerate(rows) if each == group]
        directions += _directions(group, gain[: len(NAMES), members])
    constants = study.source.header.constants
    for each in unseen(values[: len(NAMES)], covariance[: len(NAMES), : len(NAMES)], constants):
        group = Group(each.angle.name, "B", each.angle.source)
        directions.append((each.angle, group, each.effect))
    first = Budget(
        NAMES,
        tuple(contribution for contribution, _, _ in directions),
        values[: len(NAMES)],
        np.stack([effect for _, _, effect in directions], axis=1),
    )
    drawn = _monte_carlo(model, attempt, gain, constants)
    return CalibrationBudget(first, tuple(group for _, group, _ in directions), compare(first, drawn))


def _groups_of_rows(model: InflightModel) -> list[Group]:
    """Of all data by session, then of the priors by parameter."""
    data = [Group(f"noise of {name}", "A", "samples beside the lines") for name in model.data.baseline.sessions]
    believed = [each.name for each in model.parameters if each.prior is not None and not each.fixed]
    return [*data, *(_belief(name) for name in believed)]


def _belief(name: str) -> Group:
    if name in NAMES:
        return Group("bounds of the parameters", "B", "hundreds of times what is expected")
    if name.startswith("inverse_gain["):
        return Group("gains of the moved masses", "B", "bound")
    return Group(f"bound of {name}", "B", "bound, or what the sessions' own channels say")


def _directions(group: Group, gain: FloatArray) -> list[tuple[Contribution, Group, FloatArray]]:
    """Independent unit contributions with the covariance gain gain^T, (10, n)."""
    size = np.sqrt(np.sum(gain**2, axis=1))
    size[size == 0.0] = 1.0
    left, singular, _ = np.linalg.svd(gain / size[:, None], full_matrices=False)
    kept = singular**2 > _NEGLIGIBLE * np.sum(singular**2)
    return [
        (Contribution(f"{group.name} {place}", 0.0, 1.0, "sigma", group.type), group, size * column)
        for place, column in enumerate((left * singular)[:, kept].T, start=1)
    ]


def refitted(model: InflightModel, attempt: Attempt, gain: FloatArray, drawn: FloatArray) -> FloatArray:
    """Parameters (m, draws) when data and beliefs are off by `drawn` (n + priors, draws), in sigma.

    The equation is as it is; the fit of a draw goes along the derivative at the recording's own, `gain`
    (m, n + priors).
    """
    fitted, data = attempt.result.values[:, None], len(attempt.result.residuals)
    sigma = attempt.noise.sigma[:, None]
    at_fit = model.residuals(fitted) / sigma
    values = np.repeat(fitted, drawn.shape[1], axis=1)
    for _ in range(_STEPS):
        left = model.residuals(values) / sigma - at_fit
        values = values + gain @ (np.vstack([left, -attempt.jacobian[data:] @ (values - fitted)]) + drawn)
    return values


def _monte_carlo(
    model: InflightModel, attempt: Attempt, gain: FloatArray, constants: Mapping[str, float]
) -> MonteCarlo:
    """Data and beliefs drawn anew and fitted again, and what no session sees added."""
    rng = np.random.default_rng(1)
    found = refitted(model, attempt, gain, rng.standard_normal((gain.shape[1], _DRAWS)))[: len(NAMES)]
    by_noise = attempt.uncertainty.covariance[: len(NAMES), : len(NAMES)]
    angles = {each.angle.name: each.angle.draw(rng, _DRAWS) for each in unseen(found[:, 0], by_noise, constants)}
    beyond = [_moved_by(unseen(column, by_noise, constants), angles, draw) for draw, column in enumerate(found.T)]
    return MonteCarlo(found.T + np.array(beyond))


def _moved_by(each_unseen: tuple[Unseen, ...], angles: Mapping[str, FloatArray], draw: int) -> FloatArray:
    return np.asarray(sum(angles[each.angle.name][draw] * each.effect for each in each_unseen))
