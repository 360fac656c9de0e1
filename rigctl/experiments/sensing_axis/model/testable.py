"""Whether a recording can be asked about an effect at all, and if not, why, in a sentence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigctl.core.errors import RigError
from rigctl.effects.catalogue import Effect
from rigctl.experiments.sensing_axis.model.chain import Runs
from rigctl.experiments.sensing_axis.model.model import RecordingModel
from rigctl.experiments.sensing_axis.observe.observables import RunObservables

_SAME = 1e-9


def untestable(effect: Effect, model: RecordingModel) -> str | None:
    """Why `model`'s runs lack what the effect acts by; None when they can be asked.

    `model` need not have the effect. Runs that differ in too little for the parameters to be told apart are not the
    matter here: that is for the fit to say.
    """
    for need in effect.needs:
        reason = _NEEDS[need](model.runs)
        if reason:
            return reason
    if effect.on == "laser_m" and not model.heads:
        return "no displacement head was recorded"
    if effect.scope == "head" and not model.reach(effect):
        return "no head that was recorded looks across the motion"
    return _flaw(effect, model)


def _flaw(effect: Effect, model: RecordingModel) -> str | None:
    """What a column that is missing, or a number that is, makes of the effect."""
    for run in _asked(effect, model):
        try:
            with np.errstate(all="ignore"):
                added = effect(run, **effect.typical)
        except RigError as error:
            return str(error)
        if not np.isfinite(added).all():
            unknown = [name for name, column in _conditions(run).items() if not np.isfinite(column).all()]
            return "it is not a number in every run" + (f": {', '.join(unknown)} unknown" if unknown else "")
    return None


def _asked(effect: Effect, model: RecordingModel) -> list[Runs]:
    if effect.on == "laser_m":
        return [model.at_head(head) for head in (model.reach(effect) or model.heads)]
    return [model.conditions.at(signal=model.conditions.x)]


def _conditions(run: Runs) -> dict[str, np.ndarray]:
    recorded = {"temperature_c": run.temperature, "approach": run.approach, "start_s": run.start}
    return {**recorded, **run.columns}


def _temperature(runs: Sequence[RunObservables]) -> str | None:
    return _flat([run.temperature_c for run in runs], "temperature_c", "the temperature was the same in all runs")


def _time(runs: Sequence[RunObservables]) -> str | None:
    return _flat([run.start_s for run in runs], "start_s", "all runs began at the same time")


def _approach(runs: Sequence[RunObservables]) -> str | None:
    directions = [run.approach if run.approach else np.nan for run in runs]
    same = "every angle was reached from the same side, so that the shift is part of theta0"
    return _flat(directions, "approach", same)


def _flat(values: Sequence[float], column: str, same: str) -> str | None:
    known = np.array(values, dtype=np.float64)
    missing = int(np.sum(~np.isfinite(known)))
    if missing == len(known):
        return f"{column} was not recorded"
    if missing:
        return f"{column} is missing in {missing} of {len(known)} runs"
    return same if np.ptp(known) <= _SAME else None


_NEEDS = {"temperature": _temperature, "time": _time, "approach": _approach}
