"""The equivalence principle's test: delta of each session, before and after correction with what was calibrated."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.experiments.inflight.model.equation import AnyArray, coefficients
from rigctl.experiments.inflight.model.parameters import NAMES, SHARED
from rigctl.experiments.inflight.observe.equivalence import TestRun
from rigctl.experiments.inflight.observe.series import INDEX, Amplitudes

GRAVITY_M_S2 = 7.9
"""What Table 1's accelerations are over, to the accuracy of a bound."""

ALIKE = np.eye(SHARED)[len(NAMES)]
"""Parameters of an instrument of which nothing is known: two masses alike, a_c11 = 1."""

DOUBTED_P = 0.01
"""Controls that chance makes more rarely, over all sessions together, speak against delta."""

_STEP = 1e-40


@dataclass(frozen=True)
class Calibrated:
    """Parameters of the baseline that all sessions share and, after them, of the effects that act in the test, (m,),
    their covariance, and what no session sees of each, as standard uncertainties (m,)."""

    values: FloatArray
    covariance: FloatArray
    systematic: FloatArray


def equivalence(runs: Sequence[TestRun], calibrated: Calibrated) -> dict[str, Any]:
    """The `ep` key of `rigctl result --json`: every session, and all together."""
    each = {run.run_id: _session(run, calibrated) for run in runs}
    return {**each, "combined": _combined(runs, calibrated)}


def _session(run: TestRun, calibrated: Calibrated) -> dict[str, Any]:
    values, noise = _estimate(run, calibrated.values[:, None])[:, 0], _density(run, calibrated.values)
    slopes = sensitivities(run, calibrated.values)
    sigma_noise = math.sqrt(noise) * run.spread
    sigma_calibration = np.sqrt(np.diag(slopes @ calibrated.covariance @ slopes.T))
    sigma = np.hypot(sigma_noise, sigma_calibration)
    before = _estimate(run, _alike(run)[:, None])[:, 0]
    sigma_before = math.sqrt(_density(run, _alike(run))) * run.spread
    return {
        "session": run.session.name,
        "f_ep_hz": run.test_hz,
        "orbits": run.orbits,
        "missing": run.missing,
        "pulses": run.pulses,
        "noise_dof": run.dof,
        "delta": {
            "value": float(values[0]),
            "sigma": float(sigma[0]),
            "sigma_noise": float(sigma_noise[0]),
            "sigma_calibration": float(sigma_calibration[0]),
            "systematic": float(np.linalg.norm(slopes[0] * calibrated.systematic)),
        },
        "quadrature": {"value": float(values[1]), "sigma": float(sigma[1])},
        "uncorrected": {"value": float(before[0]), "sigma": float(sigma_before[0])},
        "rows": rows(run, calibrated),
        "spectrum": _spectrum(run, calibrated),
    }


def _spectrum(run: TestRun, calibrated: Calibrated) -> dict[str, list[float]]:
    """Amplitudes, m/s2, at the test's frequency and beside it, before correction and after."""
    made: dict[str, list[float]] = {}
    for name, values in (("before_m_s2", _alike(run)), ("after_m_s2", calibrated.values)):
        # Beside the line they are scaled to a density; at the line they are per gravity.
        beside = run.spread[0] * _made(run, values[:, None])[1][:, 0]
        at_line = _estimate(run, values[:, None])[:, 0]
        pairs = np.vstack([at_line, beside.reshape(-1, 2)])
        made[name] = [GRAVITY_M_S2 * float(np.hypot(*pair)) for pair in pairs]
    order = np.argsort([run.test_hz, *run.beside_hz])
    f_hz = [float(each) for each in np.array([run.test_hz, *run.beside_hz])[order]]
    return {"f_hz": f_hz, **{name: [values[place] for place in order] for name, values in made.items()}}


def rows(run: TestRun, calibrated: Calibrated) -> dict[str, dict[str, float]]:
    """By parameter what it does at the test's frequency, whatever its phase (table 1): `before` as it is, `after` by
    its standard uncertainty; and the part of `before` that is in phase with gravity, with its sign."""
    slopes = sensitivities(run, calibrated.values)
    sigma = np.sqrt(np.diag(calibrated.covariance))
    return {
        name: {
            "before_m_s2": GRAVITY_M_S2 * float(np.linalg.norm(slopes[:, place] * calibrated.values[place])),
            "in_phase_m_s2": GRAVITY_M_S2 * float(slopes[0, place] * calibrated.values[place]),
            "after_m_s2": GRAVITY_M_S2 * float(np.linalg.norm(slopes[:, place] * sigma[place])),
        }
        for place, name in enumerate(NAMES)
    }


def doubts(runs: Sequence[TestRun], calibrated: Calibrated, effects: Sequence[str]) -> list[str]:
    """What speaks against delta, a line each: something in quadrature with gravity, sessions that differ, and
    `effects` of the model that are not taken out of them."""
    said = [
        f"run {run.run_id}: {found['value']:.2g} ± {found['sigma']:.2g} is in quadrature with gravity, where no "
        "violation is: something else acts at the frequency of the test, and may shift delta by as much; find what "
        "it is, or mark the run invalid"
        for run in runs
        if (found := _session(run, calibrated)["quadrature"])
        and _in_quadrature_p(run, calibrated, found) < DOUBTED_P / len(runs)
    ]
    if _contradiction_p(runs, calibrated) < DOUBTED_P:
        said.append(
            "the sessions of the test contradict each other, and delta of all together is between them: they differ "
            "by more than their sigmas allow; mark invalid the runs in which something else acts"
        )
    if effects:
        said.append(
            f"what {', '.join(effects)} does at the frequency of the test is still in delta: the calibration is "
            "corrected for it, sessions of the test cannot be"
        )
    return said


def _in_quadrature_p(run: TestRun, calibrated: Calibrated, found: Mapping[str, float]) -> float:
    """Whether chance and what no session sees make what is in quadrature: Student's t."""
    from scipy.special import stdtr  # which neither calibrations nor studies of many wait for

    unseen = float(np.linalg.norm(sensitivities(run, calibrated.values)[1] * calibrated.systematic))
    return 2.0 * float(stdtr(run.dof, -abs(found["value"]) / math.hypot(found["sigma"], unseen)))


def _contradiction_p(runs: Sequence[TestRun], calibrated: Calibrated) -> float:
    """Whether chance makes the sessions differ as they do; 1 for a single one."""
    from scipy.special import fdtrc  # as above

    more = len(runs) - 1
    if not more:
        return 1.0
    values, noise, slopes = _together(runs, calibrated)
    off = values - _combined(runs, calibrated)["delta"]["value"]
    chi2 = off @ np.linalg.solve(np.diag(noise) + slopes @ calibrated.covariance @ slopes.T, off)
    return float(fdtrc(more, sum(run.dof for run in runs), chi2 / more))


def _together(runs: Sequence[TestRun], calibrated: Calibrated) -> tuple[FloatArray, FloatArray, FloatArray]:
    """delta of the sessions, its variance by their noise, and d delta / d parameters."""
    values = np.array([_estimate(run, calibrated.values[:, None])[0, 0] for run in runs])
    noise = np.array([_density(run, calibrated.values) * run.spread[0] ** 2 for run in runs])
    return values, noise, np.array([sensitivity(run, calibrated.values) for run in runs])


def _combined(runs: Sequence[TestRun], calibrated: Calibrated) -> dict[str, Any]:
    """Weighted by noise and by the calibration's covariance, which all sessions share."""
    values, noise, slopes = _together(runs, calibrated)
    weight = np.linalg.solve(np.diag(noise) + slopes @ calibrated.covariance @ slopes.T, np.ones(len(runs)))
    weight /= weight.sum()
    parts = {
        "sigma_noise": float(np.sqrt(weight**2 @ noise)),
        "sigma_calibration": math.sqrt(float(weight @ slopes @ calibrated.covariance @ slopes.T @ weight)),
    }
    return {"delta": {"value": float(weight @ values), "sigma": math.hypot(*parts.values()), **parts}}


def _made(run: TestRun, values: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Left side less right side for parameters (m, k), complex or not: at gravity's line (2, k), and beside it."""
    # The level of the calibration is in the series already, and no stimulus makes another.
    shown = Amplitudes(np.zeros((1, len(INDEX)), dtype=np.complex128), 0.0, 0.0)
    equation = coefficients(run.session, shown, values[:SHARED])
    at_line, beside = run.amplitudes @ equation, run.beside @ equation
    for value, unit in zip(values[SHARED:], run.acting, strict=True):
        at_line, beside = at_line - value * (unit.amplitudes @ equation), beside - value * (unit.beside @ equation)
    return at_line, beside


def _alike(run: TestRun) -> FloatArray:
    """An instrument of which nothing is known, and no effects."""
    return np.concatenate([ALIKE, np.zeros(len(run.acting))])


def _estimate(run: TestRun, values: AnyArray) -> AnyArray:
    """delta and its quadrature for parameters (m, k), (2, k)."""
    made, _ = _made(run, values)
    ac11, ac13 = values[len(NAMES)], values[NAMES.index("ac13_rad")]
    # 2 m_dx has delta (a_c11 g_x + a_c13 g_z): a_c11 is known to a hundredth, and so is delta.
    delta = made[0] / ac11
    return np.stack([delta, made[1] / ac11 - delta * ac13 / ac11])


def sensitivity(run: TestRun, values: FloatArray) -> FloatArray:
    """d delta / d parameters, (m,)."""
    return np.asarray(sensitivities(run, values)[0])


def sensitivities(run: TestRun, values: FloatArray) -> FloatArray:
    """d / d parameters of delta and of what is in quadrature, (2, m)."""
    stepped = values[:, None] + 1j * _STEP * np.eye(len(values))
    return np.asarray(np.imag(_estimate(run, stepped)) / _STEP)


def _density(run: TestRun, values: FloatArray) -> float:
    """One-sided density of what is left beside the test's frequency, (m/s2)^2/Hz."""
    return float(np.mean(_made(run, values[:, None])[1] ** 2))


def calibrated_of(
    values: FloatArray, covariance: FloatArray, systematic: Mapping[str, float], effects: Sequence[int] = ()
) -> Calibrated:
    """From a fit of the baseline, whose first parameters all sessions share; `effects` are the places of those of
    effects that act in the test."""
    places = [*range(SHARED), *effects]
    beyond = np.zeros(len(places))
    for name, value in systematic.items():
        beyond[NAMES.index(name)] = value
    return Calibrated(values[places], covariance[np.ix_(places, places)], beyond)
