"""Effects from a file of one's own: loaded, tried out on made-up runs, and refused with one line when wrong."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from rigctl.effects.catalogue import POINTS, Effect, catalogue, effects_in, line_of, said
from rigctl.effects.declaration import flaw_of_declaration
from rigctl.effects.trial import flaw_of_function
from rigctl.errors import ConfigError


@dataclass(frozen=True)
class Plugin:
    """A file's effects by id, in the order of its text, and what the file held."""

    path: Path
    sha256: str
    effects: Mapping[str, Effect]


def load(path: Path) -> Plugin:
    """Read and try out a file of effects; nothing of it stays behind but what is returned.

    Such a file is Python of a few lines, run as it stands: `from rigctl.effects import effect` and decorated
    functions. Raises `ConfigError`, one line with the file and where it applies the line, for all that is wrong.
    """
    try:
        source = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}; check --plugin") from None
    sha256 = hashlib.sha256(source).hexdigest()
    found = effects_in(_executed(path, source, f"rigctl_plugin_{sha256[:12]}"))
    if not found:
        raise ConfigError(f"{path}: no effect in it: decorate a function with @effect(...) of rigctl.effects")
    effects: dict[str, Effect] = {}
    for each in found:
        flaw = _flaw_of_id(each, effects) or flaw_of_declaration(each) or _flaw_of_trial(each, path)
        if flaw:
            raise ConfigError(f"{path}: effect '{each.id}': {flaw}")
        effects[each.id] = each
    return Plugin(path, sha256, effects)


def _executed(path: Path, source: bytes, name: str) -> ModuleType:
    module = ModuleType(name)
    module.__file__ = str(path)
    try:
        code = compile(source, str(path), "exec", dont_inherit=True)
    except SyntaxError as error:
        raise ConfigError(f"{path}, line {error.lineno}: {error.msg}") from None
    except ValueError as error:
        raise ConfigError(f"{path}: no text of Python: {error}") from None
    # Dataclasses and the like look their module up while it is being executed.
    sys.modules[name] = module
    try:
        exec(code, vars(module))  # noqa: S102 - a plug-in is code that its user hands over to be run
    except Exception as error:  # noqa: BLE001 - whatever a user's file may raise
        raise ConfigError(f"{path}{line_of(error, str(path))}: {said(error)}") from None
    finally:
        del sys.modules[name]
    return module


def _flaw_of_id(effect: Effect, before: Mapping[str, Effect]) -> str | None:
    if effect.id in before:
        return "there are two of this id in the file; rename one"
    if any(effect.id in catalogue(name) for name, points in POINTS.items() if effect.on in points):
        return "rigctl has an effect of this id; choose another"
    return None


def _flaw_of_trial(effect: Effect, path: Path) -> str | None:
    try:
        return flaw_of_function(effect)
    except Exception as error:  # noqa: BLE001 - whatever a user's function may raise
        return f"its function fails{line_of(error, str(path))}: {said(error)}"
