"""The baseline: how the amplitudes of all series of a session hang together when nothing unknown acts.

With y_k the linearised x output of mass k, G = T - In, D the off-centring and a = a'_d11,

    (1 - a) y_1 - (1 + a) y_2
        = sum_jl a_c1j G_jl D_l + 2 a_d12 (m_cy - K_y m_cy^2) + 2 a_d13 (m_cz - K_z m_cz^2) + moved

in every session. Left side less right side is linear in the amplitudes of the series, with coefficients that the
parameters give: `coefficients`. It keeps what the published first-order equation leaves out, and holds at every line.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.least_squares import Parameter, Prior
from rigctl.core.arrays import ComplexArray, FloatArray
from rigctl.experiments.inflight.model.parameters import NAMES, UNITS, of_masses
from rigctl.experiments.inflight.observe.series import INDEX, SERIES, Amplitudes, straightened
from rigctl.experiments.inflight.observe.sessions import QUADRATIC, STIMULUS, Line, Session, moved_axis

_PRIORS = {
    "ac11": (1.0, 6e-3),
    "theta_cx": (0.0, 1.5e-3),
    "k_y": (0.0, 8e3),
    "k_z": (0.0, 8e3),
    "ad22": (0.0, 6e-3),
    "ad33": (0.0, 6e-3),
}
NUISANCES = tuple(_PRIORS)
_NUISANCE_UNITS = ("1", "rad", "s2/m", "s2/m", "1", "1")
GAIN = (1.0, 1e-2)
"""What is known beforehand of a sensor's gain, and so of its inverse, in which the model is linear whatever acts."""

_GAIN_RATIO = 1e-4
"""Of a_d22 and a_d33, once seen: they are wanted to a hundredth of their bounds."""

_LOOSE = (1e-3, 1e-3, 1e-3, 0.1, 0.1, 0.3, 0.1, 0.1, 1e6, 1e6)
"""Priors of the parameters themselves, hundreds of times their bounds: without its session one is not determined."""

_STEP = 1e-40
SHARED = len(NAMES) + len(NUISANCES)

AnyArray = NDArray[Any]


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


def coefficients(session: Session, found: Amplitudes, p: AnyArray) -> AnyArray:
    """Of each series in left side less right side, for parameters (shared, k), complex or not; shape (series, k).

    Of `found` only the levels count that its amplitudes are about.
    """
    dx, dy, dz, ac12, ac13, ad11, ad12, ad13, k2d, k2c, ac11, theta_cx, k_y, k_z, ad22, ad33 = p
    c = np.zeros((len(SERIES), p.shape[1]), dtype=p.dtype)

    def put(name: str, value: AnyArray) -> None:
        c[INDEX[name]] = value

    k_1, k_2 = of_masses(k2d, k2c, ad11)
    level = 0.5 * (k_1 - k_2) * found.mean_square
    if session.name in QUADRATIC:
        level = np.zeros_like(dx)
        k_1, k_2 = (held_elsewhere(k, session, found) for k in (k_1, k_2))
    for name, factor, curve, mu in (("m1", 1.0 - ad11, k_1, level), ("m2", -(1.0 + ad11), k_2, -level)):
        put(name, factor * (1.0 - 2.0 * curve * mu + 6.0 * curve**2 * mu**2))
        put(f"{name}^2", factor * (6.0 * curve**2 * mu - curve))
        put(f"{name}^3", factor * 2.0 * curve**2)
    x, y, z = dx / ac11, dy / ac11, dz / ac11
    put("t_xx", -dx)
    put("t_xy", -(dy + ac12 * x))
    put("t_xz", -(dz + ac13 * x))
    put("t_yy", -ac12 * y)
    put("t_yz", -(ac12 * z + ac13 * y))
    put("t_zz", -ac13 * z)
    put("dw_x", ac13 * y - ac12 * z)
    put("dw_y", dz - ac13 * x)
    put("dw_z", ac12 * x - dy)
    put("y", -2.0 * ad12)
    put("y^2", 2.0 * ad12 * k_y)
    put("z", -2.0 * ad13)
    put("z^2", 2.0 * ad13 * k_z)
    for axis, value in zip("xyz", (ac11, ac12, ac13), strict=True):
        put(f"force {axis}", -value)
    _put_moved(session.name, put, (ac11, ac12, ac13), theta_cx, (ad22 * ad12, ad33 * ad13))
    return c


def held_elsewhere(k: Any, session: Session, found: Amplitudes) -> Any:
    """A mass' quadratic factor k = K2 / J^2 in a session whose loop holds one mass at nil, not the mean of both.

    The output is higher there by half the masses' distance, m_dx, for which the slope J is larger by 2 k m_dx.
    """
    higher = found.apart if session.name == "k2c_1" else -found.apart
    return k / (1.0 + 2.0 * k * higher) ** 2


def _put_moved(
    name: str, put: Any, ac1: tuple[AnyArray, ...], theta_cx: AnyArray, beyond: tuple[AnyArray, AnyArray]
) -> None:
    """The gradient on what was moved, along the masses' own axes, theta_c^T e: (-theta_cz, 1, theta_cx) for Y,
    (theta_cy, -theta_cx, 1) for Z; a_c11 theta_cz = a_c12 + a_d22 a_d12, -a_c11 theta_cy = a_c13 + a_d33 a_d13."""
    ac11, ac12, ac13 = ac1
    if name == "ac12":
        put("moved g_xx", ac12 + beyond[0])
        put("moved g_xy", -ac11)
        put("moved g_xz", -ac11 * theta_cx)
        put("moved g_yy", -ac12)
        put("moved g_zz", -ac13 * theta_cx)
    elif name == "ac13":
        put("moved g_xx", ac13 + beyond[1])
        put("moved g_xy", ac11 * theta_cx)
        put("moved g_xz", -ac11)
        put("moved g_zz", -ac13)
    elif name in QUADRATIC:
        put("moved g_xx", ac11 if name == "k2c_1" else -ac11)


def gain_ratio(apart: complex, common: complex) -> float:
    """a_d22 or a_d33 from amplitudes of m_1 - m_2 and m_c along that axis, where control shakes the satellite."""
    return float(0.5 * np.real(np.conj(common) * apart) / np.abs(common) ** 2)


def own_channel(session: Session) -> AnyArray:
    """Coefficients of the series that make the moved masses' own channel, m_1 - m_2 along the motion; (series,)."""
    c = np.zeros(len(SERIES))
    c[INDEX[f"own {'xyz'[moved_axis(session)]}"]] = 1.0
    return c


def own_force(session: Session) -> AnyArray:
    """Coefficients of the series that make the force in that channel, before the sensor's gain; (series,).

    An oscillation's acceleration is -(2 pi f)^2 of the displacement, of mass 1 less that of mass 2.
    """
    c = np.zeros(len(SERIES))
    square = (2.0 * math.pi * session.frequency_hz) ** 2
    c[INDEX["moved"]] = -square if session.name == "k2c_1" else square
    c[INDEX[f"force {'xyz'[moved_axis(session)]}"]] = 1.0
    return c


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
        self.units = (*UNITS, *_NUISANCE_UNITS, *("1" for _ in gains))
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
