"""Effects from a file of one's own: loaded, tried out on made-up runs, and refused with one line when wrong."""

from __future__ import annotations

import difflib
import hashlib
import inspect
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rigctl.core.bounds import PLUGIN_BYTES, read_regular
from rigctl.core.errors import ConfigError, PluginError, one_line
from rigctl.core.experiments import EXPERIMENTS
from rigctl.core.units import known_unit
from rigctl.effects.catalogue import SCOPES, Effect, catalogue, described, experiment_of, line_of
from rigctl.effects.plugin_code import effects_of, executed
from rigctl.effects.rehearsal import rehearse
from rigctl.effects.trial import flaw_of_function

Files = Path | str | Sequence[Path | str]
"""One file of effects, or several."""


def paths_of(files: Files) -> tuple[Path, ...]:
    """Of these, the paths."""
    return (Path(files),) if isinstance(files, Path | str) else tuple(map(Path, files))


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


@dataclass(frozen=True)
class Plugin:
    """A file's effects by id, in the order of its text, and what the file held."""

    path: Path
    sha256: str
    effects: Mapping[str, Effect]


def load(path: Path) -> Plugin:
    """Read and try out a file of effects; nothing of it stays behind but what is returned.

    Such a file is Python of a few lines, run as it stands: `from rigctl.effects import effect` and decorated
    functions. Raises `ConfigError`, one line with the file and where it applies the line, for all that is wrong, and
    `PluginError` for what would end this program, keep it waiting or change it: `rehearsal` tries that elsewhere.
    """
    try:
        source = read_regular(path, PLUGIN_BYTES)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}; check --plugin") from None
    # First, and in another process: from here on its code runs in this one.
    rehearse(path, source)
    effects: dict[str, Effect] = {}
    for each in effects_of(executed(path, source)):
        flaw = _flaw_of_id(each, effects) or flaw_of_declaration(each) or _flaw_of_trial(each, path)
        if flaw:
            raise ConfigError(one_line(f"{path}: effect '{each.id}': {flaw}"))
        effects[each.id] = each
    return Plugin(path, hashlib.sha256(source).hexdigest(), effects)


def _flaw_of_id(effect: Effect, before: Mapping[str, Effect]) -> str | None:
    if effect.id in before:
        return "there are two of this id in the file; rename one"
    # Ids stand in files and recordings: a plug-in must not change what a known one means.
    if any(effect.id in catalogue(name) for name, each in EXPERIMENTS.items() if effect.on in each.points):
        return "rigctl has an effect of this id; choose another"
    return None


def _flaw_of_trial(effect: Effect, path: Path) -> str | None:
    try:
        return flaw_of_function(effect)
    except PluginError:
        raise
    except Exception as error:  # noqa: BLE001 - whatever a user's function may raise
        return f"its function fails{line_of(error, str(path))}: {described(error)}"
