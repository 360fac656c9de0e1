"""The baseline as a model: residuals of reduced runs and their derivatives, from the equation of all series."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.analysis.least_squares import Parameter, Prior
from rigctl.core.arrays import ComplexArray, FloatArray
from rigctl.experiments.inflight.model.equation import AnyArray, coefficients, gain_ratio, own_channel, own_force
from rigctl.experiments.inflight.model.parameters import NAMES, NUISANCE_UNITS, NUISANCES, SHARED, UNITS
from rigctl.experiments.inflight.observe.series import INDEX, Amplitudes, straightened
from rigctl.experiments.inflight.observe.sessions import STIMULUS, Line, Session

_PRIORS = dict(
    zip(NUISANCES, ((1.0, 6e-3), (0.0, 1.5e-3), (0.0, 8e3), (0.0, 8e3), (0.0, 6e-3), (0.0, 6e-3)), strict=True)
)
GAIN = (1.0, 1e-2)
"""What is known beforehand of a sensor's gain, and so of its inverse, in which the model is linear whatever acts."""

_GAIN_RATIO = 1e-4
"""Of a_d22 and a_d33, once seen: they are wanted to a hundredth of their bounds."""

_LOOSE = (1e-3, 1e-3, 1e-3, 0.1, 0.1, 0.3, 0.1, 0.1, 1e6, 1e6)
"""Priors of the parameters themselves, hundreds of times their bounds: without its session one is not determined."""

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
        own = self.session.moves_masses
        return [place for place, line in enumerate(self.lines) if not (own and line == STIMULUS)]

    @property
    def has_own(self) -> bool:
        """Whether it has a moved mass's own channel."""
        return self.session.moves_masses and STIMULUS in self.lines


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
            straightened(each.session, each.lines, each.amplitudes).table[each.compared] for each in self.stretches
        ]

    def _priors(self) -> dict[str, Prior]:
        """Of the nuisances; the gains across the sensitive axis are measured where control shakes the satellite."""
        found = {name: Prior(*prior) for name, prior in _PRIORS.items()}
        for name, session, series in (("ad22", "ad12", "y"), ("ad33", "ad13", "z")):
            seen = [
                gain_ratio(table.of(f"own {series}")[place], table.of(series)[place])
                for table, place in (
                    (each.amplitudes, each.lines.index(STIMULUS))
                    for each in self.stretches
                    if each.session.name == session and STIMULUS in each.lines
                )
            ]
            if seen:
                found[name] = Prior(float(np.mean(seen)), _GAIN_RATIO)
        return found

    def observed(self) -> FloatArray:
        """What was measured, shape (data,)."""
        found = []
        for each, table in zip(self.stretches, self._tables, strict=True):
            found.append(_parts(table[:, INDEX["m1"]] - table[:, INDEX["m2"]]))
            if each.has_own:
                found.append(_parts(_unturned(each, self._own(each) @ own_channel(each.session))))
        return np.concatenate(found)

    def sigma(self) -> FloatArray:
        """Standard uncertainties, shape (data,)."""
        found = []
        for each in self.stretches:
            found.append(np.repeat(each.sigma[each.compared], 2))
            if each.has_own:
                found.append(np.array(each.own_sigma))
        return np.concatenate(found)

    def residual(self, values: FloatArray, changes: Sequence[ComplexArray] | None = None) -> FloatArray:
        """Left side less right side, and own channel less its prediction; (data,).

        `changes`, amplitudes (lines, series) per stretch, are taken out of the measured ones first: what effects do.
        """
        found = []
        shared = values[:SHARED, None]
        for place, (each, table) in enumerate(zip(self.stretches, self._tables, strict=True)):
            c = coefficients(each.session, each.amplitudes, shared)[:, 0]
            at = table if changes is None else table - changes[place][each.compared]
            found.append(_parts(at @ c))
            if each.has_own:
                own = self._own(each) if changes is None else self._own(each) - changes[place][self._stimulus(each)]
                inverse = values[self._gain_of[each.run_id]]
                left = inverse * (own @ own_channel(each.session)) - own @ own_force(each.session)
                found.append(_parts(_unturned(each, left)))
        return np.concatenate(found)

    def jacobian(self, values: FloatArray, changes: Sequence[ComplexArray] | None = None) -> FloatArray:
        """d residual / d values, shape (data, parameters)."""
        stepped = values[:SHARED, None] + 1j * _STEP * np.eye(SHARED)
        blocks = []
        for place, (each, table) in enumerate(zip(self.stretches, self._tables, strict=True)):
            c = np.imag(coefficients(each.session, each.amplitudes, stepped)) / _STEP
            at = table if changes is None else table - changes[place][each.compared]
            block = np.zeros((2 * len(at), len(values)))
            block[:, :SHARED] = _parts(at @ c)
            blocks.append(block)
            if each.has_own:
                own = self._own(each) if changes is None else self._own(each) - changes[place][self._stimulus(each)]
                block = np.zeros((2, len(values)))
                block[:, self._gain_of[each.run_id]] = _parts(_unturned(each, own @ own_channel(each.session)))
                blocks.append(block)
        return np.vstack(blocks)

    def shift(self, values: FloatArray, changes: Sequence[ComplexArray]) -> FloatArray:
        """What changes of the measured amplitudes do to `residual`, shape (data,)."""
        found = []
        for each, change in zip(self.stretches, changes, strict=True):
            c = coefficients(each.session, each.amplitudes, values[:SHARED, None])[:, 0]
            found.append(_parts(change[each.compared] @ c))
            if each.has_own:
                own = change[self._stimulus(each)]
                inverse = values[self._gain_of[each.run_id]]
                left = inverse * (own @ own_channel(each.session)) - own @ own_force(each.session)
                found.append(_parts(_unturned(each, left)))
        return np.concatenate(found)

    @staticmethod
    def _stimulus(each: Stretch) -> list[int]:
        return [each.lines.index(STIMULUS)]

    def _own(self, each: Stretch) -> ComplexArray:
        return np.asarray(each.amplitudes.table[self._stimulus(each)])


def _unturned(each: Stretch, amplitude: AnyArray) -> AnyArray:
    """With the stimulus as reference: real in phase with it."""
    return np.asarray(amplitude * np.exp(-1j * each.session.phase_rad))


def _parts(amplitudes: AnyArray) -> FloatArray:
    """c and s of amplitudes c - i s in turn along the first axis; shape (2 lines, ...)."""
    made = np.empty((2 * len(amplitudes), *amplitudes.shape[1:]))
    made[0::2], made[1::2] = amplitudes.real, -amplitudes.imag
    return made
