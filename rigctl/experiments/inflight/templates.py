"""What follows a laboratory's own column from sample to sample, as all lines see it: a bias, and a gain.

A gain that goes with a battery's voltage is seen at every line of every session, a little at each. Asked about one by
one, none of them need stand out; and what is in no catalogue has no other way to be told.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.effects.catalogue import Effect
from rigctl.experiments.inflight.effect_changes import EffectChanges
from rigctl.experiments.inflight.model.baseline import Baseline
from rigctl.experiments.inflight.model.flight import MEASURED_POINT, FlightRun
from rigctl.experiments.inflight.observe.reduction import ReducedRun
from rigctl.experiments.inflight.observe.series import NEEDED
from rigctl.workbench.study import OF_SIGNAL

POWERS = (1, 2, 3)
"""Of a column that a bias follows: what dies away with a time is no straight line of it."""

_FORMATS = ("command_", "att_", "temperature_")


def by_own_columns(
    runs: Sequence[ReducedRun], effects: EffectChanges, baseline: Baseline, values: FloatArray, series: int = 0
) -> dict[tuple[int, str], FloatArray]:
    """`Observations.templates` of a series: columns for one standard deviation of each own column of the samples."""
    found: dict[tuple[int, str], FloatArray] = {}
    usual = _usual_m_s2(runs)
    for name in own_columns(runs):
        away = np.concatenate([run.coarse.columns[name][run.coarse.present] for run in runs])
        mean, scale = float(np.mean(away)), float(np.std(away))
        if not np.isfinite(away).all() or not scale > 0.0:
            continue
        for power in POWERS:
            shown = name if power == 1 else f"{name}^{power}"
            found[series, shown] = _column(effects, baseline, values, _bias(name, mean, scale, power))
        found[series, OF_SIGNAL + name] = _column(effects, baseline, values, _gain(name, mean, scale, usual))
    return {key: column for key, column in found.items() if column.any()}


def own_columns(runs: Sequence[ReducedRun]) -> list[str]:
    """Columns of the samples of all runs that the format does not have."""
    names = [name for name in runs[0].coarse.columns if name not in NEEDED and not name.startswith(_FORMATS)]
    return [name for name in names if all(name in run.coarse.columns for run in runs)]


def _column(effects: EffectChanges, baseline: Baseline, values: FloatArray, one: Effect) -> FloatArray:
    (change,) = effects.derivatives(one, np.zeros(1))
    return baseline.shift(values, change)


def _bias(name: str, mean: float, scale: float, power: int) -> Effect:
    def biased(run: FlightRun, size: float) -> FloatArray:
        shape = size * ((run.column(name) - mean) / scale) ** power
        return run.along_x(0.5 * shape, -0.5 * shape)

    return _effect(f"bias by {name}^{power}", biased)


def _gain(name: str, mean: float, scale: float, usual_m_s2: float) -> Effect:
    def scaled(run: FlightRun, size: float) -> FloatArray:
        shape = size * (run.column(name) - mean) / (scale * usual_m_s2)
        first, second = run.measured[:, 0] - run.measured[:, 0, run.present].mean(axis=1, keepdims=True)
        return run.along_x(0.5 * shape * first, -0.5 * shape * second)

    return _effect(f"gain by {name}", scaled)


def _effect(name: str, function: Callable[[FlightRun, float], FloatArray]) -> Effect:
    return Effect(name, MEASURED_POINT, {"size": "m/s2"}, {"size": 1e-12}, "", "recording", function)


def _usual_m_s2(runs: Sequence[ReducedRun]) -> float:
    """Of a signal: the rms about its level of what a mass reads."""
    varying = [run.coarse.columns["m1_x"][run.coarse.present] for run in runs]
    return float(np.sqrt(np.mean(np.concatenate([each - each.mean() for each in varying]) ** 2)))
