"""Effects from a file of one's own: loaded, tried out on made-up runs, and refused with one line when wrong."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rigctl.core.bounds import PLUGIN_BYTES
from rigctl.core.errors import ConfigError, PluginError
from rigctl.core.experiments import EXPERIMENTS
from rigctl.core.messages import one_line
from rigctl.core.reading import read_regular
from rigctl.effects.catalogue import Effect, catalogue, described, line_of
from rigctl.effects.declaration import flaw_of_declaration
from rigctl.effects.plugin_code import effects_of, executed
from rigctl.effects.rehearsal import rehearse
from rigctl.effects.trial import flaw_of_function


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
