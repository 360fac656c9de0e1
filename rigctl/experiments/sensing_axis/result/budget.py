"""Where an axis' uncertainty comes from: a GUM budget of its two components perpendicular to the axis.

Scatter between mountings is measured (type A) and contains what changes from mounting to mounting: the null search's
noise, laser noise and the stage's resolution are listed, not added again. What is common to all mountings is added.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from rigctl.analysis.budget import Budget, Comparison, Contribution, budget, compare, monte_carlo
from rigctl.analysis.plane import ARCSEC, plane_normals
from rigctl.analysis.rotation import FrameRotation
from rigctl.core.arrays import FloatArray
from rigctl.experiments.sensing_axis.model.fit import RecordingFit, residuals_of
from rigctl.experiments.sensing_axis.model.model import RecordingModel
from rigctl.experiments.sensing_axis.observe.observables import Amplitudes, RunObservables
from rigctl.experiments.sensing_axis.observe.reduction import ACCEL
from rigctl.experiments.sensing_axis.result.host_turns import host_turns
from rigctl.experiments.sensing_axis.result.included import Included, included_of
from rigctl.experiments.sensing_axis.result.result import AxisResult, SensingAxisResult

Uncertainties = Mapping[str, Mapping[str, float]]
"""Standard uncertainties of the rig file's certificates: name -> quantity with unit -> value."""

CONSTANTS = "constants"
"""The name under which they have those of the rig file's constants."""

OUTPUTS = ("component 1", "component 2")
# So many know a standard deviation to 1.6 %.
MONTE_CARLO_DRAWS = 2000
MM_PER_M = 1e3


@dataclass(frozen=True)
class AxisBudget:
    """The budget of one axis in the host's frame, into which `host` takes it.

    `basis` (2, 3) are the directions of its two components in the cube's frame, perpendicular to the axis; `common`
    names the contributions that move all axes together.
    """

    axis: str
    host: FrameRotation
    basis: FloatArray
    budget: Budget
    included: tuple[Included, ...]
    check: Comparison
    common: frozenset[str] = frozenset()

    @property
    def basis_uoaf(self) -> FloatArray:
        """The directions of the two components in the host's frame, (2, 3)."""
        return np.asarray(self.basis @ self.host.matrix.T)

    def as_json(self) -> dict[str, Any]:
        """Contributions in arcsec, 1 sigma."""
        first = self.budget
        rows = [
            {
                "name": each.name,
                "type": each.type,
                "input": f"{each.standard_uncertainty:.3g} {each.unit}",
                "source": each.source,
                "arcsec": (np.abs(first.components[:, i]) / ARCSEC).tolist(),
            }
            for i, each in enumerate(first.contributions)
        ]
        return {
            "contributions": rows,
            "included_in_scatter": {each.name: each.rad / ARCSEC for each in self.included},
            "combined_arcsec": (first.standard_uncertainty / ARCSEC).tolist(),
            "expanded_95_arcsec": (first.expanded / ARCSEC).tolist(),
            "basis_coc": self.basis.tolist(),
            "basis_uoaf": self.basis_uoaf.tolist(),
            "monte_carlo": {"validated": all(self.check.validated), "reason": self.check.reason},
        }


@dataclass(frozen=True)
class _Input:
    """A quantity and what one unit of it does to every vector of the axis, shape (vectors, 3).

    Scatter and what is fitted to the axis' own runs is its own; certificates and the guide's roll all axes share.
    """

    contribution: Contribution
    effect: FloatArray
    own: bool = False


def axis_budgets(result: SensingAxisResult, uncertainties: Uncertainties) -> dict[str, AxisBudget]:
    """The budgets of all axes of a result in the host's frame, each checked by Monte Carlo."""
    if not result.axes:
        return {}
    refitted = _Refitted.of(result.fit, uncertainties)
    return {name: _axis_budget(axis, result.fit, uncertainties, refitted) for name, axis in result.axes.items()}


@dataclass(frozen=True)
class _Change:
    """A quantity and what one unit of it does to the parameters of the fit, shape (parameters,)."""

    contribution: Contribution
    moved: FloatArray


@dataclass(frozen=True)
class _Refitted:
    """Changes of the model that the fit follows: the same for all axes."""

    heads: Sequence[_Change]
    timing: Sequence[_Change]
    gravity: Sequence[_Change]

    @classmethod
    def of(cls, fit: RecordingFit, uncertainties: Uncertainties) -> _Refitted:
        return cls(_heads(fit, uncertainties), _timing(fit, uncertainties), _gravity(fit, uncertainties))


def _axis_budget(
    axis: AxisResult, fit: RecordingFit, uncertainties: Uncertainties, refitted: _Refitted
) -> AxisBudget:
    basis = _basis(axis)
    slopes = [fit.vector_slopes(null) for null in axis.nulls]

    def followed(changes: Sequence[_Change]) -> Iterator[_Input]:
        for each in changes:
            effect = np.array([of_null @ each.moved for of_null in slopes])
            yield _Input(each.contribution, effect, own=each.contribution.type == "A")

    inputs = [
        *_scatter(axis),
        *followed(refitted.heads),
        *followed(refitted.timing),
        *_cube(axis, uncertainties),
        *_corrections(axis, fit),
        *_guide(axis, fit, uncertainties),
        *followed(refitted.gravity),
    ]
    turns = host_turns(axis.host)
    of_turn = {each.name: basis @ np.cross(axis.host.matrix.T @ about, axis.plane.normal) for each, about in turns}

    def measurement(values: Mapping[str, Any]) -> FloatArray:
        """Both components, (2,); of values that are arrays (draws,) those of every draw, (draws, 2)."""
        moved = axis.vectors + sum(_times(values[each.contribution.name], each.effect) for each in inputs)
        turned = sum((_times(values[name], effect) for name, effect in of_turn.items()), np.zeros(2))
        return np.asarray(plane_normals(moved, axis.plane.normal) @ basis.T + turned)

    contributions = [*(each.contribution for each in inputs), *(each for each, _ in turns)]
    first = budget(measurement, contributions, OUTPUTS)
    drawn = monte_carlo(measurement, contributions, OUTPUTS, draws=MONTE_CARLO_DRAWS, seed=1, together=True)
    included = included_of(axis, uncertainties)
    common = frozenset([*(each.contribution.name for each in inputs if not each.own), *of_turn])
    return AxisBudget(axis.name, axis.host, basis, first, included, compare(first, drawn), common)


def _times(values: Any, effect: FloatArray) -> FloatArray:
    """An effect as often as there are values."""
    return np.asarray(np.multiply.outer(np.asarray(values), effect))


def _basis(axis: AxisResult) -> FloatArray:
    """Two directions perpendicular to the axis: the motion at the pendulum nulls, and what completes the triad."""
    normal = axis.plane.normal
    # In a campaign pendulum mountings come first: the motion at one of their nulls.
    first = axis.vectors[0] - (axis.vectors[0] @ normal) * normal
    first = first / np.linalg.norm(first)
    return np.stack([first, np.cross(normal, first)])


def _scatter(axis: AxisResult) -> list[_Input]:
    """Scatter about the plane: the mean of each configuration's vectors is that uncertain out of it."""
    normal, dof = axis.plane.normal, axis.plane.dof
    spread = math.sqrt(float(np.sum(axis.plane.half_cone_rad**2)) / dof)
    inputs = []
    for configuration in dict.fromkeys(null.configuration for null in axis.nulls):
        members = np.array([null.configuration == configuration for null in axis.nulls])
        inputs.append(
            _Input(
                Contribution(
                    f"scatter in {configuration}",
                    0.0,
                    spread / math.sqrt(members.sum()),
                    "rad",
                    type="A",
                    distribution="t",
                    dof=dof,
                    source="half-cone deviation of the vectors",
                ),
                # All vectors of a configuration move out of the plane together: their mean is what is uncertain.
                members[:, None] * normal,
                own=True,
            )
        )
    return inputs


def _heads(fit: RecordingFit, uncertainties: Uncertainties) -> list[_Change]:
    """Beam tilt and scale of each head, the same in all mountings; the mounting rotations follow them."""
    changes = []
    for name in fit.model.heads:
        certified = uncertainties.get(name, {})
        for quantity, wording, unit, changed in (
            ("tilt_deg", "beam tilt", "rad", _tilted),
            ("scale", "scale", "1", _scaled),
        ):
            if quantity in certified:
                u = math.radians(certified[quantity]) if unit == "rad" else certified[quantity]
                moved = _response(fit, partial(changed, fit.model, name))
                source = f"certificate of {name}"
                changes.append(_Change(Contribution(f"{wording} of {name}", 0.0, u, unit, source=source), moved))
    return changes


def _response(fit: RecordingFit, changed: Callable[[float], RecordingModel], step: float = 1e-5) -> FloatArray:
    """What one unit of a change of the model does to the parameters, refitted to first order."""
    values = fit.result.values
    slope = (residuals_of(changed(step), values) - residuals_of(changed(-step), values)) / (2.0 * step)
    # The fit follows the change: mounting rotations absorb a part of it.
    return np.asarray(fit.result.covariance @ fit.result.jacobian[: len(slope)].T @ slope)


def _tilted(model: RecordingModel, head: str, by_rad: float) -> RecordingModel:
    settings = model.head_settings[head]
    tilted = settings.model_copy(update={"tilt_deg": settings.tilt_deg + math.degrees(by_rad)})
    return model.with_heads({**model.head_settings, head: tilted})


def _scaled(model: RecordingModel, head: str, by: float) -> RecordingModel:
    def scaled(lasers_m: Mapping[str, Amplitudes]) -> dict[str, Amplitudes]:
        reading = lasers_m.get(head)
        return (
            dict(lasers_m)
            if reading is None
            # A head that reads too much by this saw a smaller motion.
            else {**lasers_m, head: replace(reading, value=reading.value * (1.0 - by))}
        )

    return model.with_runs([replace(run, lasers_m=scaled(run.lasers_m)) for run in model.runs])


def _timing(fit: RecordingFit, uncertainties: Uncertainties) -> list[_Change]:
    """Samples taken at another time than the encoder's: how well a latency is known, or the offset of a clock."""
    changes = []
    for name in (ACCEL, *fit.model.heads):
        contribution = _clock_of(name, fit.model) or _latency_of(name, uncertainties)
        if contribution is not None:
            changes.append(_Change(contribution, _response(fit, partial(_delayed, fit.model, name))))
    return changes


def _clock_of(head: str, model: RecordingModel) -> Contribution | None:
    """The offset that was fitted to the head's own clock in every run: what it is uncertain by, rms over the runs."""
    clocks = [reading.clock for run in model.runs if (reading := run.lasers_m.get(head)) and reading.clock]
    if not clocks:
        return None
    u = math.sqrt(float(np.mean([clock.offset_u_s**2 for clock in clocks])))
    return Contribution(f"clock of {head}", 0.0, u, "s", type="A", source="fitted to the drive, run by run")


def _latency_of(channel: str, uncertainties: Uncertainties) -> Contribution | None:
    certified = uncertainties.get(channel, {})
    if "latency_s" not in certified:
        return None
    return Contribution(f"latency of {channel}", 0.0, certified["latency_s"], "s", source=f"certificate of {channel}")


def _delayed(model: RecordingModel, channel: str, by_s: float) -> RecordingModel:
    """The same runs, the channel's samples taken later by so much."""

    def delayed(reading: Amplitudes, frequency_hz: float) -> Amplitudes:
        turns = np.exp(2j * math.pi * frequency_hz * by_s * np.arange(len(reading.value)))
        return replace(reading, value=reading.value * turns)

    def run_delayed(run: RunObservables) -> RunObservables:
        if channel == ACCEL:
            return replace(run, accel_v=delayed(run.accel_v, run.frequency_hz))
        readings = {
            name: delayed(each, run.frequency_hz) if name == channel else each for name, each in run.lasers_m.items()
        }
        return replace(run, lasers_m=readings)

    return model.with_runs([run_delayed(run) for run in model.runs])


def _cube(axis: AxisResult, uncertainties: Uncertainties) -> list[_Input]:
    """Faces that are not quite orthogonal: a component along one normal carries a part of another's."""
    half_width_arcsec = uncertainties.get("cube", {}).get("orthogonality_arcsec", 0.0)
    inputs = []
    for i, j in ((0, 1), (1, 2), (2, 0)):
        effect = np.zeros_like(axis.vectors)
        # The angle's error is shared between the two faces: which of them is off nobody knows.
        effect[:, i] = 0.5 * axis.vectors[:, j]
        effect[:, j] = 0.5 * axis.vectors[:, i]
        name = f"cube faces {'xyz'[i]}{'xyz'[j]}"
        inputs.append(
            _Input(
                Contribution.from_limits(name, 0.0, half_width_arcsec * ARCSEC, "rad", source="cube's specification"),
                effect,
            )
        )
    return inputs


def _corrections(axis: AxisResult, fit: RecordingFit) -> list[_Input]:
    """Effects in the model whose parameters are common to mountings: what their uncertainty does to the nulls."""
    inputs = []
    for name, wording in (("rho1", "roll correction"), *_resonances(axis, fit)):
        if name not in fit.result.names:
            continue
        index, u = fit.model.index(name), fit.result.sigma(name)
        # How all parameters go along when this one is off by a unit: the regression on it.
        moved = fit.result.covariance[:, index] / u**2
        effect = np.array([fit.vector_slopes(null) @ moved for null in axis.nulls])
        source = "covariance of the fit"
        unit = fit.model.units[index]
        inputs.append(
            _Input(Contribution(wording, 0.0, u, unit, type="A", source=source), effect, own=f"[{axis.name}," in name)
        )
    return inputs


def _resonances(axis: AxisResult, fit: RecordingFit) -> list[tuple[str, str]]:
    return [
        (name, f"resonance in {name.split(',')[1].rstrip(']')}")
        for name in fit.result.names
        if name.startswith(f"inv_w0_squared[{axis.name},")
    ]


def _guide(axis: AxisResult, fit: RecordingFit, uncertainties: Uncertainties) -> list[_Input]:
    """Guide errors that look like a shift of the null: yaw times the sensor's lever, recoil of the bench."""
    stage = uncertainties.get("stage", {})
    shifts = []
    if "yaw_rad_per_m" in stage:
        lever_m = fit.model.package.lever_mm / MM_PER_M
        shifts.append(("guide yaw times lever", stage["yaw_rad_per_m"] * lever_m))
    if "recoil_rad_s2_per_m" in stage:
        shifts.append(("bench recoil", stage["recoil_rad_s2_per_m"] * fit.model.g_m_s2))
    # A shift of the null, the same in all mountings; nothing in the fit follows it.
    effect = np.array([fit.vector_slopes(null)[:, fit.model.index(f"theta0[{null.label}]")] for null in axis.nulls])
    return [
        _Input(Contribution(name, 0.0, u, "rad", source="certificate of the stage"), effect) for name, u in shifts
    ]


def _gravity(fit: RecordingFit, uncertainties: Uncertainties) -> list[_Change]:
    """Local gravity, which the corrections for what tilts the sensor are taken with."""
    u_m_s2 = uncertainties.get(CONSTANTS, {}).get("g_m_s2", 0.0)
    if not u_m_s2:
        return []
    contribution = Contribution("local gravity", 0.0, u_m_s2, "m/s2", source="constant of the rig file")

    def changed(by_m_s2: float) -> RecordingModel:
        return fit.model.with_gravity(fit.model.g_m_s2 + by_m_s2)

    # Exactly linear: the step may be large beside rounding.
    return [_Change(contribution, _response(fit, changed, step=1e-2))]
