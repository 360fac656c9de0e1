"""The baseline as a model: residuals of reduced runs and their derivatives, from the equation of all series."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rigctl.analysis.least_squares import FitResult, Parameter, Prior, least_squares
from rigctl.core.arrays import ComplexArray, FloatArray
from rigctl.experiments.inflight.model.equation import (
    AnyArray,
    coefficients,
    common_series,
    gain_ratio,
    own_channel,
    own_force,
    own_series,
)
from rigctl.experiments.inflight.model.parameters import NAMES, NUISANCE_UNITS, NUISANCES, SHARED, UNITS
from rigctl.experiments.inflight.observe.series import INDEX, Amplitudes, with_true_attitude
from rigctl.experiments.inflight.observe.sessions import STIMULUS, Line, Session, moved_axis

# Bounds of the paper (K1 1e-2, theta_c 2.5e-3 rad, K2 14000 s2/m) over root 3: uniform within them.
PRIORS = dict(
    zip(NUISANCES, ((1.0, 6e-3), (0.0, 1.5e-3), (0.0, 8e3), (0.0, 8e3), (0.0, 6e-3), (0.0, 6e-3)), strict=True)
)
GAIN = (1.0, 1e-2)
"""What is known beforehand of a sensor's gain, and so of its inverse, in which the model is linear whatever acts."""

_GAIN_RATIO = 1e-4
"""Uncertainty of a_d22 and a_d33 where they are measured: they are needed to a hundredth of their bounds."""

_LOOSE = (1e-3, 1e-3, 1e-3, 0.1, 0.1, 0.3, 0.1, 0.1, 1e6, 1e6)
"""Priors of the parameters themselves, hundreds of times their bounds: without its session one is not determined."""

# A complex step: the imaginary part is the derivative, no difference is taken and nothing is rounded off.
_STEP = 1e-40


@dataclass(frozen=True)
class Stretch:
    """A run or a part of it, reduced: amplitudes at `lines`, `sigma` of one component of the differential channel
    there, (lines,), and `own_sigma` of the moved mass's own channel at the stimulus, in phase and in quadrature."""

    run_id: str
    session: Session
    lines: tuple[Line, ...]
    amplitudes: Amplitudes
    sigma: FloatArray
    own_sigma: tuple[float, float] = (math.nan, math.nan)

    @property
    def compared(self) -> list[int]:
        """Places of the lines at which the differential channel is compared: not where masses are moved."""
        return [k for k, line in enumerate(self.lines) if not (self.session.moves_masses and line == STIMULUS)]

    @property
    def has_own(self) -> bool:
        """Whether it has a moved mass's own channel."""
        return self.session.moves_masses and STIMULUS in self.lines

    def parts(self, differential: AnyArray, own: AnyArray | None = None) -> FloatArray:
        """Data of the differential channel at the compared lines and, with the stimulus as phase reference, of the
        own channel: cosine and sine parts in turn along the first axis; shape (data, ...)."""
        if own is not None:
            differential = np.concatenate([differential, own * np.exp(-1j * self.session.phase_rad)])
        made = np.empty((2 * len(differential), *differential.shape[1:]))
        made[0::2], made[1::2] = differential.real, -differential.imag
        return made


class Baseline:
    """Prediction of stretches from parameters: twice the differential channel at the compared lines of each, its
    cosine and sine parts in turn, then the own channel's in phase with the motion and in quadrature.

    `parameters` are the ten, the nuisances with their priors, and one gain per run that moves a mass.
    """

    def __init__(self, stretches: Sequence[Stretch]) -> None:
        self.stretches = tuple(stretches)
        gains = dict.fromkeys(each.run_id for each in self.stretches if each.has_own)
        self._gain_of = {run_id: SHARED + place for place, run_id in enumerate(gains)}
        self.parameters = (
            *(Parameter(name, 0.0, prior=Prior(0.0, loose)) for name, loose in zip(NAMES, _LOOSE, strict=True)),
            *(Parameter(name, prior.mean, prior=prior) for name, prior in self._priors().items()),
            *(Parameter(f"inverse_gain[{run_id}]", GAIN[0], prior=Prior(*GAIN)) for run_id in gains),
        )
        self.units = (*UNITS, *NUISANCE_UNITS, *("1" for _ in gains))
        self._tables = [
            with_true_attitude(each.session, each.lines, each.amplitudes).table for each in self.stretches
        ]
        self._latest: tuple[bytes, list[ComplexArray]] | None = None

    def _priors(self) -> dict[str, Prior]:
        """Of the nuisances; the gains across the sensitive axis are measured where control shakes the satellite."""
        priors = {name: Prior(*prior) for name, prior in PRIORS.items()}
        for name, axis in (("ad22", "y"), ("ad33", "z")):
            if axis in self._gain_ratios:
                priors[name] = Prior(self._gain_ratios[axis], _GAIN_RATIO)
        return priors

    @cached_property
    def _gain_ratios(self) -> dict[str, float]:
        """a_d11, a_d22, a_d33 by axis, where a session shakes the satellite along it."""
        found = {}
        for axis, session in (("x", "ad11"), ("y", "ad12"), ("z", "ad13")):
            # The thrusters' noise and the stimulus shake both masses alike: the ratio of outputs is that of gains.
            measured = [
                gain_ratio(row @ own_series(axis), row @ common_series(axis))
                for each in self.stretches
                if each.session.name == session and STIMULUS in each.lines
                for row in (each.amplitudes.table[each.lines.index(STIMULUS)],)
            ]
            if measured:
                found[axis] = float(np.mean(measured))
        return found

    def _own_measured(self, each: Stretch, table: ComplexArray) -> ComplexArray:
        """The moved mass's own channel, (1,), without what unequal gains let in of the satellite's motion out of
        phase with it: that motion, which a moved mass brings about, lags as the loop does, like a spring's loss."""
        own, axis = _own(each, table), "xyz"[moved_axis(each.session)]
        turn = np.exp(1j * each.session.phase_rad)
        lagging = 1j * turn * np.imag((own @ common_series(axis)) / turn)
        return np.asarray(own @ own_channel(each.session) - 2.0 * self._gain_ratios.get(axis, 0.0) * lagging)

    def observed(self) -> FloatArray:
        """What was measured, shape (data,)."""
        return np.concatenate(
            [
                each.parts(
                    table[each.compared, INDEX["m1"]] - table[each.compared, INDEX["m2"]],
                    self._own_measured(each, table) if each.has_own else None,
                )
                for each, table in zip(self.stretches, self._tables, strict=True)
            ]
        )

    def sigma(self) -> FloatArray:
        """Standard uncertainties, shape (data,)."""
        own = [each.own_sigma if each.has_own else () for each in self.stretches]
        compared = [np.repeat(each.sigma[each.compared], 2) for each in self.stretches]
        return np.concatenate([part for both in zip(compared, own, strict=True) for part in both])

    def residual(self, values: FloatArray, changes: Sequence[ComplexArray] | None = None) -> FloatArray:
        """Left side less right side, and own channel less its prediction; (data,).

        `changes`, amplitudes (lines, series) per stretch, are taken out of the measured ones first: what effects do.
        """
        return self.shift(values, self._unchanged(changes))

    def residuals(self, values: FloatArray, changes: Sequence[ComplexArray] | None = None) -> FloatArray:
        """`residual` for many sets of values, (parameters, sets); shape (data, sets)."""
        made = []
        for each, table in zip(self.stretches, self._unchanged(changes), strict=True):
            equation = table[each.compared] @ coefficients(each.session, each.amplitudes, values[:SHARED])
            if not each.has_own:
                made.append(each.parts(equation))
                continue
            force = _own(each, table) @ own_force(each.session)
            inverse = values[self._gain_of[each.run_id]]
            made.append(each.parts(equation, self._own_measured(each, table)[:, None] * inverse - force[:, None]))
        return np.vstack(made)

    @property
    def sessions(self) -> list[str]:
        """The session of each datum."""
        counts = [2 * len(each.compared) + 2 * each.has_own for each in self.stretches]
        return [each.session.name for each, count in zip(self.stretches, counts, strict=True) for _ in range(count)]

    def shift(self, values: FloatArray, changes: Sequence[ComplexArray]) -> FloatArray:
        """What changes of the measured amplitudes, (lines, series) per stretch, do to `residual`; shape (data,)."""
        return np.concatenate(
            [
                self._sides(each, table, c, values)
                for each, table, c in zip(self.stretches, changes, self._coefficients(values), strict=True)
            ]
        )

    def _coefficients(self, values: FloatArray) -> list[ComplexArray]:
        """Of each stretch, (series,); kept until other values come, for every effect is shifted at the same ones."""
        shared = values[:SHARED]
        latest = self._latest
        if latest is None or latest[0] != shared.tobytes():
            made = [coefficients(each.session, each.amplitudes, shared[:, None])[:, 0] for each in self.stretches]
            self._latest = latest = (shared.tobytes(), made)
        return latest[1]

    def _sides(self, each: Stretch, table: ComplexArray, c: ComplexArray, values: FloatArray) -> FloatArray:
        if not each.has_own:
            return each.parts(table[each.compared] @ c)
        own, inverse = _own(each, table), values[self._gain_of[each.run_id]]
        force = own @ own_force(each.session)
        # With the gain's inverse on the measured side the equation is linear in it.
        return each.parts(table[each.compared] @ c, inverse * self._own_measured(each, table) - force)

    def jacobian(self, values: FloatArray, changes: Sequence[ComplexArray] | None = None) -> FloatArray:
        """d residual / d values, shape (data, parameters)."""
        stepped = values[:SHARED, None] + 1j * _STEP * np.eye(SHARED)
        blocks = []
        for each, table in zip(self.stretches, self._unchanged(changes), strict=True):
            c = np.imag(coefficients(each.session, each.amplitudes, stepped)) / _STEP
            shared = each.parts(table[each.compared] @ c)
            block = np.zeros((len(shared) + 2 * each.has_own, len(values)))
            block[: len(shared), :SHARED] = shared
            if each.has_own:
                gain = self._gain_of[each.run_id]
                block[:, gain] = each.parts(0.0 * table[each.compared, 0], self._own_measured(each, table))
            blocks.append(block)
        return np.vstack(blocks)

    def _unchanged(self, changes: Sequence[ComplexArray] | None) -> list[ComplexArray]:
        """The measured amplitudes without what effects did to them."""
        if changes is None:
            return self._tables
        return [table - change for table, change in zip(self._tables, changes, strict=True)]


def _own(each: Stretch, table: ComplexArray) -> ComplexArray:
    """The row of the stimulus, (1, series)."""
    return np.asarray(table[[each.lines.index(STIMULUS)]])


def joint_estimate(stretches: Sequence[Stretch]) -> FitResult:
    """The baseline fitted to all lines of all sessions at once, weighted by their noise; the first parameters are
    `parameters.NAMES`. `ProcedureError` when residuals are not finite."""
    baseline = Baseline(stretches)
    sigma = baseline.sigma()
    return least_squares(
        lambda p: baseline.residual(p) / sigma,
        baseline.parameters,
        jacobian=lambda p: -baseline.jacobian(p) / sigma[:, None],
        # The loose priors are meant to determine what no session does, far below the usual limit.
        rcond=1e-12,
    )
