"""Readings taken again at the same settings tell a noise that no model can have spoiled: the pure error.

What a model leaves beyond it is its lack of fit (Draper and Smith, Applied Regression Analysis, 3rd ed., 2.1).
"""

from __future__ import annotations

import numpy as np
from scipy.special import fdtrc

from rigctl.core.arrays import FloatArray, IntArray
from rigctl.workbench.findings import Unexplained
from rigctl.workbench.scatter import LackOfFit
from rigctl.workbench.study import Observations
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.permuted import Tail
from rigctl.workbench.verdict.significance import CONFIRM_FROM

_DRAWS, _AT_ONCE = 2000, 100
_LEAST_FREE = 1e-3
# Of the sum of squares: below, repeats are the same but for rounding.
_ROUNDING = 1e-20


def lack_of_fit(attempt: Attempt) -> LackOfFit | None:
    """The F test of what a fitted model leaves against the scatter among repeats; None where there are too few of
    either, or where readings are not independent, for then repeats share more than their settings.

    A small p-value is held to what the same residuals show with their signs drawn: scatter that differs from setting
    to setting makes F larger by chance than normal noise of one size would (Wu, Annals of Statistics 14 (1986) 1261).
    """
    given, noise = attempt.model.observations, attempt.noise
    of_readings = len(attempt.estimator.rows) > 0 or all(pool.stated for pool in given.pools)
    if not of_readings or noise.factors or len(given.series) != 1:
        return None
    test = _Test(
        _settings(given)[given.run_of], noise.sigma, attempt.projector.basis[: len(given.value)], noise.least
    )
    if test.pure_dof < 1 or test.dof < 1:
        return None
    left = attempt.whitened()
    f, pure = (float(each[0]) for each in test.of(left[None, :]))
    if not np.isfinite(f):
        return None
    scale = float(np.sqrt(np.mean(noise.sigma**2)))
    p_value = float(test.p_of(np.array(f)))
    return LackOfFit(
        f=f,
        dof=test.dof,
        pure_dof=test.pure_dof,
        p_value=test.p_of_signs(left, p_value, attempt.seed) if p_value < CONFIRM_FROM else p_value,
        pure_error=scale * float(np.sqrt(pure)),
        channel=given.series[0].channel,
        unit=given.series[0].unit,
    )


class _Test:
    """The test for data with the settings `setting_of` (n,), of standard deviation `sigma` (n,), of a model whose
    derivatives span `basis` (n, m); residuals are whitened, and `least` of their variance is rounding."""

    def __init__(self, setting_of: IntArray, sigma: FloatArray, basis: FloatArray, least: float = 0.0) -> None:
        self._basis, self._least = basis, least
        self._order = np.argsort(setting_of, kind="stable")
        self._first = np.flatnonzero(np.diff(setting_of[self._order], prepend=-1))
        self._weight = 1.0 / sigma
        self._norm = np.add.reduceat(self._weight[self._order] ** 2, self._first)
        self.pure_dof = len(setting_of) - len(self._first)
        self.dof = len(self._first) - basis.shape[1]

    def of(self, left: FloatArray) -> tuple[FloatArray, FloatArray]:
        """F and the mean square among repeats, of residuals (draws, n); F is NaN where repeats do not scatter."""
        total = np.sum(left**2, axis=1)
        means = np.add.reduceat((left * self._weight)[:, self._order], self._first, axis=1)
        between = np.sum(means**2 / self._norm, axis=1)
        pure = (total - between) / self.pure_dof
        lack = (between - np.sum((left @ self._basis) ** 2, axis=1)) / self.dof
        scatters = pure > _ROUNDING * total
        # Repeats that are equal but for a step do not know their noise better than to that step.
        pure = np.maximum(pure, self._least)
        return np.where(scatters, np.maximum(lack, 0.0) / np.where(scatters, pure, 1.0), np.nan), pure

    def p_of(self, f: FloatArray) -> FloatArray:
        """Of normal noise of one size."""
        return np.asarray(fdtrc(self.dof, self.pure_dof, f))

    def p_of_signs(self, left: FloatArray, p_value: float, seed: int) -> float:
        """No smaller than draws of the residuals' signs let one expect."""
        free = 1.0 - np.sum(self._basis**2, axis=1)
        # A fit leaves less of a reading the more that reading decides of it.
        grown = left / np.sqrt(np.maximum(free, _LEAST_FREE))
        # A stream of its own, see `trials`.
        rng = np.random.default_rng([seed, 6])
        drawn: list[FloatArray] = []
        for count in np.full(_DRAWS // _AT_ONCE, _AT_ONCE):
            signs = rng.choice(np.array([-1.0, 1.0]), (count, len(left)))
            drawn.append(self.p_of(self.of(signs * grown)[0]))
        return max(p_value, Tail(np.sort(np.nan_to_num(np.concatenate(drawn)))).probability(p_value))


def unexplained_between_settings(lack: LackOfFit) -> Unexplained:
    """What is said of a lack of fit that neither an effect nor a plain shape describes."""
    return Unexplained(
        lack.channel,
        "",
        f"{lack.channel} is off by more from setting to setting than readings at one setting scatter "
        f"({lack.pure_error:.3g} {lack.unit}".rstrip()
        + f"), F({lack.dof}, {lack.pure_dof}) = {lack.f:.3g}, as no single column tells",
        lack.p_value,
    )


def unexplained_as_a_whole(attempt: Attempt, p_value: float) -> Unexplained:
    """What is said where chi-square is beyond noise, and no effect or plain shape by itself."""
    given, left = attempt.model.observations, attempt.whitened()
    means = np.bincount(given.series_of, left**2) / np.maximum(np.bincount(given.series_of), 1)
    series = given.series[int(np.argmax(means))]
    return Unexplained(
        series.channel,
        series.component,
        f"chi2/dof = {attempt.result.chi2_per_dof:.3g} is beyond the noise, {series.name.strip()} most of all, "
        "as no single effect or shape tells",
        p_value,
    )


def _settings(given: Observations) -> IntArray:
    """The setting of each run by number: runs share one where they agree in every condition that is recorded."""
    if not given.covariates:
        # Nothing says that anything was set: these are no repeats of a setting.
        return np.arange(len(given.run_ids), dtype=np.intp)
    setting_of = np.zeros(len(given.run_ids), dtype=np.intp)
    for values in given.covariates.values():
        known = np.nan_to_num(values, nan=np.inf)
        value_of = np.unique(known, return_inverse=True)[1].ravel()
        setting_of = np.unique(setting_of * len(known) + value_of, return_inverse=True)[1].ravel()
        if setting_of.max(initial=0) == len(known) - 1:
            # Each is a setting of its own, whatever else was recorded.
            break
    return np.asarray(setting_of, dtype=np.intp)
