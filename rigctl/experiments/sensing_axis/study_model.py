"""A recording's model with its parameters as files and commands give them: theta0 in degrees, the rest in SI."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rigctl.analysis.least_squares import Parameter, Prior
from rigctl.core.arrays import FloatArray
from rigctl.experiments.sensing_axis.model.components import Stacked, observed
from rigctl.experiments.sensing_axis.model.model import RecordingModel
from rigctl.workbench.study import Observations, Term

OF_A_MOUNTING = ("theta0", "dc", "delta_x", "delta_y", "delta_z")

_DEGREES = 180.0 / np.pi


class SensingAxisModel:
    """A `rigctl.workbench.study.Model`; `inner` is the same in SI and radians."""

    def __init__(self, inner: RecordingModel, data: Stacked, terms: Sequence[Term]) -> None:
        self.inner = inner
        self.terms = tuple(terms)
        self._data = data
        in_degrees = [parameter.name.startswith("theta0[") for parameter in inner.parameters]
        self._shown = np.where(in_degrees, _DEGREES, 1.0)
        self.parameters: Sequence[Parameter] = tuple(
            _scaled(parameter, float(factor)) for parameter, factor in zip(inner.parameters, self._shown, strict=True)
        )
        self.units: Sequence[str] = tuple(
            "deg" if shown else unit for shown, unit in zip(in_degrees, inner.units, strict=True)
        )
        self.owners: Sequence[str] = tuple(inner.owners)
        self.local: Sequence[bool] = tuple(
            parameter.name.partition("[")[0] in OF_A_MOUNTING for parameter in inner.parameters
        )

    @property
    def observations(self) -> Observations:
        """The data, in the order of predictions."""
        return self._data.observations

    def predict(self, values: FloatArray) -> FloatArray:
        """The data for parameter values of shape (m,); shape (n,)."""
        return observed(self.inner.predict(self.si(values)))[self._data.present]

    def jacobian(self, values: FloatArray) -> FloatArray:
        """d predict / d values, shape (n, m)."""
        return self.slopes(self.inner, self.si(values)) / self._shown

    def slopes(self, model: RecordingModel, values: FloatArray, owners: Sequence[str] | None = None) -> FloatArray:
        """Derivatives of these data for any model of these runs, in SI; shape (n, its parameters)."""
        derivatives = model.jacobian(values, observed, owners=owners)
        return derivatives.reshape(*self._data.present.shape, -1)[self._data.present]

    def si(self, values: FloatArray) -> FloatArray:
        """Parameter values in SI and radians."""
        return np.asarray(values, dtype=np.float64) / self._shown

    def si_covariance(self, covariance: FloatArray) -> FloatArray:
        """Their covariance in SI and radians."""
        return np.asarray(covariance / np.outer(self._shown, self._shown))


def _scaled(parameter: Parameter, factor: float) -> Parameter:
    prior = parameter.prior
    return replace(
        parameter,
        start=parameter.start * factor,
        step=None if parameter.step is None else parameter.step * factor,
        prior=None if prior is None else Prior(prior.mean * factor, prior.sigma * factor),
    )
