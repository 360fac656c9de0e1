"""Fitting a recording: null angles, gains, mounting rotations and the parameters of the chosen effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.analysis.least_squares import FitResult, least_squares
from rigctl.core.arrays import FloatArray, IntArray
from rigctl.core.errors import ProcedureError
from rigctl.effects.catalogue import Effect
from rigctl.experiments.sensing_axis.model.geometry import motion_in_cube
from rigctl.experiments.sensing_axis.model.model import RecordingModel
from rigctl.experiments.sensing_axis.model.prediction import Observer
from rigctl.experiments.sensing_axis.observe.observables import RunObservables
from rigctl.files.package import HeadSettings, Package

MAX_ITERATIONS = 500
"""At one angle delta_x is known to its prior only: a long curved valley, in which steps stay short."""

VAGUE_RAD = 0.1
"""A null known no better is told by what is of second order in it: roll and null at one frequency, far from both."""


@dataclass(frozen=True)
class NullPoint:
    """The stage angle of a mounting's null and, where lasers looked, the motion's direction in the cube there.

    `vector_coc` has shape (3,), `vector_covariance` (3, 3) in rad^2: the fit's share, without re-seating scatter.
    """

    axis: str
    configuration: str
    mounting: int
    theta0_rad: float
    theta0_sigma_rad: float
    vector_coc: FloatArray | None
    vector_covariance: FloatArray | None

    @property
    def label(self) -> str:
        """What its parameters have in brackets."""
        return f"{self.axis},{self.configuration},{self.mounting}"


@dataclass(frozen=True)
class RecordingFit:
    """A fitted model: the parameters with covariance, and the nulls that follow from them."""

    model: RecordingModel
    result: FitResult

    def null(self, axis: str, configuration: str, mounting: int) -> NullPoint:
        """The null of one mounting."""
        return null_point(self.model, self.result.values, self.result.covariance, (axis, configuration, mounting))

    def vector_slopes(self, null: NullPoint) -> FloatArray:
        """d(vector) / d(parameters of the fit) of one mounting, shape (3, parameters)."""
        where = [self.model.index(f"{base}[{null.label}]") for base in ("theta0", "delta_x", "delta_y", "delta_z")]
        nominal = self.model.package.turntable_from_cube(null.axis, null.configuration)
        slopes = np.zeros((3, len(self.result.values)))
        slopes[:, where] = _slopes(self.result.values[where], nominal)
        return slopes

    def nulls(self) -> list[NullPoint]:
        """The nulls of all mountings, in the order of their runs."""
        return [self.null(*mounting) for mounting in mountings_of(self.model)]


def mountings_of(model: RecordingModel) -> list[tuple[str, str, int]]:
    """Axis, configuration and number of every mounting, in the order of their runs."""
    return list(dict.fromkeys(run.place for run in model.runs))


def null_point(
    model: RecordingModel, values: FloatArray, covariance: FloatArray, mounting: tuple[str, str, int]
) -> NullPoint:
    """The null of one mounting, for all parameters of a model with their covariance."""
    axis, configuration, number = mounting
    label = f"{axis},{configuration},{number}"
    names = [f"theta0[{label}]"]
    if model.heads:
        names += [f"delta_{c}[{label}]" for c in "xyz"]
    where = [model.index(name) for name in names]
    angles_rad, spread = values[where], covariance[np.ix_(where, where)]
    theta0_rad, sigma_rad = angles_rad[0], float(np.sqrt(spread[0, 0]))
    if not model.heads:
        return NullPoint(axis, configuration, number, theta0_rad, sigma_rad, None, None)
    nominal = model.package.turntable_from_cube(axis, configuration)
    slopes = _slopes(angles_rad, nominal)
    vector = motion_in_cube(theta0_rad, angles_rad[1:], nominal)
    return NullPoint(axis, configuration, number, theta0_rad, sigma_rad, vector, slopes @ spread @ slopes.T)


def fit_recording(model: RecordingModel) -> RecordingFit:
    """Fit all parameters to the amplitudes at the drive's frequency and the means.

    Raises `ProcedureError` when the runs do not determine the parameters, naming them.
    """
    return _fitted(model, *_measured(model))


def forecast(model: RecordingModel) -> RecordingFit:
    """The fit that runs like those of `model` would give if nature were as its parameters start: only its
    covariance says something. Raises `ProcedureError` when such runs would not determine the parameters.
    """
    starts = np.array([parameter.start for parameter in model.parameters])
    return _fitted(model, _observe(model.predict(starts)), _measured(model)[1])


def _fitted(model: RecordingModel, measured: FloatArray, sigma: FloatArray) -> RecordingFit:
    # What was not measured has no uncertainty and drops out.
    free = np.isfinite(sigma)

    def residuals(values: FloatArray) -> FloatArray:
        return ((measured - _observe(model.predict(values))) / sigma)[free]

    def jacobian(values: FloatArray) -> FloatArray:
        return np.asarray(model.jacobian(values, _observe, present=free) / sigma[free][:, None])

    result = least_squares(residuals, model.parameters, jacobian=jacobian, max_iterations=MAX_ITERATIONS)
    # A null at a limit or in a valley is no null.
    if result.verdict != "converged":
        raise ProcedureError(f"the runs do not determine the model: {result.reason}")
    nulls = [name for name in result.names if name.startswith("theta0[")]
    if vague := [name for name in nulls if not result.sigma(name) < VAGUE_RAD]:
        worst_deg = np.degrees(max(map(result.sigma, vague)))
        raise ProcedureError(
            f"the runs do not determine the model: {', '.join(vague)} to {worst_deg:.2g} deg only; "
            "measure at another frequency, and at angles farther apart"
        )
    return RecordingFit(model, result)


def residuals_of(model: RecordingModel, values: FloatArray) -> FloatArray:
    """Whitened residuals, data - model, of a model at given values, in the order of `FitResult.residuals`."""
    measured, sigma = _measured(model)
    return ((measured - _observe(model.predict(values))) / sigma)[np.isfinite(sigma)]


def measured_at(model: RecordingModel) -> tuple[IntArray, IntArray]:
    """Run and column of each of `FitResult.residuals`: first `ACCEL_COLUMNS`, then a column for each head."""
    run, column = np.nonzero(np.isfinite(_measured(model)[1]))
    return run, column


ACCEL_COLUMNS = ("nu in-phase", "nu quadrature", "mean")

# In phase is eq. 5; the quadrature tells the resonance's damping; the mean the level. A head reads a share of the
# displacement: its quadrature tells nothing of the cube.
_observe = Observer(
    accel=lambda of: np.stack([of[:, 1].real, of[:, 1].imag, of[:, 0].real], axis=1), laser=lambda of: of[:, 1:2].real
)


def _measured(model: RecordingModel) -> tuple[FloatArray, FloatArray]:
    rows = [_row(run, model.heads) for run in model.runs]
    return np.array([values for values, _ in rows]), np.array([sigmas for _, sigmas in rows])


def _row(run: RunObservables, heads: Sequence[str]) -> tuple[list[float], list[float]]:
    accel = run.accel_v
    values = [accel.value[1].real, accel.value[1].imag, accel.value[0].real]
    sigmas = [accel.sigma[1], accel.sigma[1], accel.sigma[0]]
    for head in heads:
        laser = run.lasers_m.get(head)
        usable = laser is not None and bool(np.isfinite(laser.value[1]))
        values.append(laser.value[1].real if laser is not None and usable else 0.0)
        # Of infinite uncertainty: the datum is left out, and rows stay as long as each other.
        sigmas.append(laser.sigma[1] if laser is not None and usable else np.inf)
    return values, sigmas


def _slopes(values: FloatArray, nominal: FloatArray, step: float = 1e-6) -> FloatArray:
    """d(vector) / d(theta0, delta), shape (3, 4)."""

    def vector(p: FloatArray) -> FloatArray:
        return motion_in_cube(p[0], p[1:], nominal)

    moves = step * np.eye(4)
    return np.stack([(vector(values + move) - vector(values - move)) / (2.0 * step) for move in moves], axis=1)


ROLL = "roll-gravity"


def fit_mounting(
    runs: Sequence[RunObservables],
    package: Package,
    heads: Mapping[str, HeadSettings],
    g_m_s2: float,
    effects: Sequence[Effect],
) -> RecordingFit:
    """Fit the runs of a mounting. At one frequency roll is a shift of the null: it enters with the second one."""
    # Fitted frequencies: the same set-point comes out a little different from run to run.
    one_frequency = len({round(run.frequency_hz, 2) for run in runs}) == 1
    separable = tuple(effect for effect in effects if effect.id != ROLL or not one_frequency)
    return fit_recording(RecordingModel(runs, package, heads, g_m_s2, separable))
