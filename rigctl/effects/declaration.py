"""What a plug-in says of its effect: point, scope, parameters, units, sizes."""

from __future__ import annotations

import difflib
import inspect
import math
from collections.abc import Collection

from rigctl.core.experiments import EXPERIMENTS
from rigctl.core.units import known_unit
from rigctl.effects.catalogue import SCOPES, Effect, experiment_of


def flaw_of_declaration(effect: Effect) -> str | None:
    """What is wrong with it, with the mend; None when nothing is."""
    points = [point for each in EXPERIMENTS.values() for point in each.points]
    if effect.on not in points:
        return f"on = {effect.on!r} is no point of the chain; use one of: {', '.join(points)}"
    if effect.scope not in SCOPES:
        return f"scope = {effect.scope!r} is none; use one of: {', '.join(SCOPES)}"
    if effect.scope == "head" and effect.on != "laser_m":
        return f"scope 'head' goes with on = 'laser_m', not '{effect.on}'"
    experiment = experiment_of(effect)
    if effect.scope not in experiment.scopes:
        scopes = ", ".join(experiment.scopes)
        return f"scope '{effect.scope}' does not go with on = '{effect.on}': {experiment.id} has {scopes}"
    if effect.scanned or effect.needs:
        return "scanned and needs are for the catalogue's own effects; leave them out"
    return _flaw_of_parameters(effect)


def _flaw_of_parameters(effect: Effect) -> str | None:
    if not effect.parameters:
        return 'it has no parameters; name each with its unit, such as parameters={"size": "V"}'
    for name, unit in effect.parameters.items():
        if not name.isidentifier():
            return f"parameter {name!r} cannot be a name in Python"
        size = effect.typical.get(name)
        if size is None:
            return f'typical has no size for {name}; give one, such as typical={{"{name}": 1e-3}}'
        if not isinstance(size, int | float) or not math.isfinite(size) or size == 0.0:
            return f"typical size {size!r} of {name} is no finite number other than zero"
        if not known_unit(unit):
            return f"unit {unit!r} of {name} is not known; write it like V/K, 1/s, rad s2/m, or 1 for a plain number"
    unknown = sorted(set(effect.typical) - set(effect.parameters))
    if unknown:
        return f"typical names {unknown[0]}, which is no parameter{_near(unknown[0], effect.parameters)}"
    return _flaw_of_signature(effect)


def _flaw_of_signature(effect: Effect) -> str | None:
    example = f"def {effect.function.__name__}(run, {', '.join(effect.parameters)})"
    try:
        inspect.signature(effect.function).bind(None, **dict.fromkeys(effect.parameters))
    except TypeError as error:
        return f"its function does not take run and its parameters ({error}); write {example}"
    if not effect.summary:
        return "its function has no docstring; say the physics in a sentence"
    return None


def _near(name: str, names: Collection[str]) -> str:
    nearest = difflib.get_close_matches(name, names, n=1)
    return f"; is it {nearest[0]}?" if nearest else ""
