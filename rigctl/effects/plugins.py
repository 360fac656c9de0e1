"""Effects from a file of one's own: loaded, tried out on made-up runs, and refused with one line when wrong."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import wraps
from pathlib import Path
from types import ModuleType
from typing import Any

from rigctl.core.arrays import FloatArray
from rigctl.core.bounds import PLUGIN_BYTES
from rigctl.core.errors import ConfigError, PluginError
from rigctl.core.experiments import EXPERIMENTS
from rigctl.core.messages import one_line
from rigctl.core.reading import read_regular
from rigctl.effects.catalogue import Effect, catalogue, effects_in, line_of, said
from rigctl.effects.declaration import flaw_of_declaration
from rigctl.effects.rehearsal import rehearse
from rigctl.effects.trial import flaw_of_function
from rigctl.effects.watch import CALL_PATIENCE_S, WATCH, Overdue


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


def effects_of(module: ModuleType) -> list[Effect]:
    """What a file defines, each guarded so that it can neither end the program nor keep it waiting."""
    path = module.__file__
    found = [replace(each, function=_guarded(each, str(path))) for each in effects_in(module)]
    if not found:
        raise ConfigError(f"{path}: no effect in it: decorate a function with @effect(...) of rigctl.effects")
    return found


def _guarded(effect: Effect, path: str) -> Callable[..., FloatArray]:
    @wraps(effect.function)
    def called(run: Any, **parameters: Any) -> FloatArray:
        with _civil(f"{path}: effect '{effect.id}'"):
            return effect.function(run, **parameters)

    return called


@contextmanager
def _civil(who: str) -> Iterator[None]:
    """`PluginError` for what is no `Exception` and would end the program, and for what does not return."""
    try:
        with WATCH.over(CALL_PATIENCE_S):
            yield
    except Overdue:
        raise PluginError(f"{who} does not return within {CALL_PATIENCE_S:g} s; mend it, or leave it out") from None
    except (Exception, KeyboardInterrupt):
        raise
    except BaseException as error:
        raise PluginError(f"{who} raises {type(error).__name__}, which would end the program; mend it") from error


def executed(path: Path, source: bytes) -> ModuleType:
    """The module that a file's text makes; `ConfigError` for what fails in it."""
    name = f"rigctl_plugin_{hashlib.sha256(source).hexdigest()[:12]}"
    module = ModuleType(name)
    module.__file__ = str(path)
    try:
        code = compile(source, str(path), "exec", dont_inherit=True)
    except SyntaxError as error:
        raise ConfigError(one_line(f"{path}, line {error.lineno}: {error.msg}")) from None
    except (ValueError, RecursionError, MemoryError, OverflowError) as error:
        raise ConfigError(f"{path}: no text of Python: {error}") from None
    # Dataclasses and the like look their module up while it is being executed.
    sys.modules[name] = module
    try:
        with _civil(str(path)):
            exec(code, vars(module))  # noqa: S102 - a plug-in is code that its user hands over to be run
    except PluginError:
        raise
    except Exception as error:  # noqa: BLE001 - whatever a user's file may raise
        raise ConfigError(one_line(f"{path}{line_of(error, str(path))}: {said(error)}")) from None
    finally:
        sys.modules.pop(name, None)
    return module


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
        return f"its function fails{line_of(error, str(path))}: {said(error)}"
