"""What an effect is, and the list of those that are known: a value, made for an experiment and its plug-ins."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from inspect import unwrap
from typing import Any, Literal, get_args

from rigctl.core.additions import effects_for
from rigctl.core.arrays import FloatArray
from rigctl.core.entry_points import resolved
from rigctl.core.errors import ConfigError, DataError, RigError
from rigctl.core.experiments import EXPERIMENTS, Experiment

Scope = Literal["recording", "axis", "axis-configuration", "head", "channel"]
"""How many values a parameter has: one for the recording, one per axis, per axis in a configuration, per head, per
channel of the rotating platform."""

SCOPES: tuple[str, ...] = get_args(Scope)

Need = Literal["temperature", "approach", "time"]
"""A condition without which an effect cannot be asked about."""


# Equal if identical: mappings have no hash, and effects are keys.
@dataclass(frozen=True, eq=False)
class Effect:
    """One piece of physics: what it adds, at which point of the chain, with which parameters.

    `function(run, **parameters)` returns what is added at `on`, in SI, shaped like `run.signal`, and zero when all
    parameters are zero. `parameters` gives the units, `typical` plausible sizes. An effect of scope "head" acts on
    `heads`, on all that it can act on when there are none named. `scans` are values that parameters without a zero (a
    time constant) are tried at before they are fitted, one for the recording. A `scanned` effect is found in the
    samples: it changes none of the reduced data and has no parameters in a fit. What is `never_negative` nature has
    with one sign only: where a fit finds the other, this effect is not what the data show.
    """

    id: str
    on: str
    parameters: Mapping[str, str]
    typical: Mapping[str, float]
    source: str
    scope: Scope
    function: Callable[..., FloatArray]
    needs: tuple[Need, ...] = ()
    scanned: bool = False
    heads: tuple[str, ...] = ()
    scans: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    never_negative: tuple[str, ...] = ()

    @property
    def summary(self) -> str:
        """The physics in a sentence: the function's own docstring."""
        return (self.function.__doc__ or "").strip().partition("\n")[0]

    def __call__(self, run: Any, **parameters: Any) -> FloatArray:
        """What the effect adds to `run.signal`; `DataError` when its function fails on these runs."""
        try:
            return self.function(run, **parameters)
        except RigError:
            raise
        except Exception as error:
            raise DataError(f"effect '{self.id}' fails{line_of(error, self.file)}: {described(error)}") from error

    @property
    def file(self) -> str:
        """Where its function stands; "" when that is not known."""
        # A plug-in's function is wrapped by a guard, whose own file is not the one asked for.
        return str(getattr(getattr(unwrap(self.function), "__code__", None), "co_filename", ""))


def effect(
    id: str,  # noqa: A002 - the word every file, command and recording uses
    *,
    on: str,
    parameters: Mapping[str, str],
    typical: Mapping[str, float],
    source: str = "",
    scope: Scope = "recording",
    needs: Sequence[Need] = (),
    scanned: bool = False,
    scans: Mapping[str, tuple[float, ...]] | None = None,
    never_negative: Sequence[str] = (),
) -> Callable[[Callable[..., Any]], Effect]:
    """Make a function the effect `id`, acting at the point `on` of the chain."""

    def made(function: Callable[..., Any]) -> Effect:
        return Effect(
            id,
            on,
            dict(parameters),
            dict(typical),
            source,
            scope,
            function,
            tuple(needs),
            scanned,
            scans=dict(scans or {}),
            never_negative=tuple(never_negative),
        )

    return made


def catalogue(experiment: str, plugins: Sequence[Effect] = ()) -> dict[str, Effect]:
    """All effects known for an experiment, by id, in the order in which they act at one point; plug-ins' come last.

    Raises `ConfigError` when two share an id.
    """
    points = EXPERIMENTS[experiment].points
    known: dict[str, Effect] = {}
    for each in (*_installed(experiment), *(each for each in plugins if each.on in points)):
        if each.id in known:
            raise ConfigError(f"two effects are called '{each.id}': give the plug-in's another id")
        known[each.id] = each
    return known


def chosen(experiment: str, ids: Sequence[str], plugins: Sequence[Effect] = ()) -> tuple[Effect, ...]:
    """The named effects in the order in which they act; `ConfigError` for an unknown id."""
    known = catalogue(experiment, plugins)
    for name in ids:
        if name not in known:
            raise unknown_effect(name, known)
    return tuple(each for name, each in known.items() if name in ids)


def line_of(error: Exception, file: str) -> str:
    """Where in a file an error came from, the innermost of its lines: ", line 7", or "" from elsewhere."""
    line, traceback = "", error.__traceback__
    while traceback is not None:
        if traceback.tb_frame.f_code.co_filename == file:
            line = f", line {traceback.tb_lineno}"
        traceback = traceback.tb_next
    return line


def described(error: Exception) -> str:
    """An error in one line."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def unknown_effect(name: str, known: Collection[str]) -> ConfigError:
    """Nobody knows it: what it may have been meant to be, and how an effect of one's own becomes known."""
    # However unlike: a list to choose from helps more than none.
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.0)
    nearest = f"the nearest are {', '.join(near)}; " if near else ""
    return ConfigError(f"unknown effect '{name}'; {nearest}`rigctl effects` lists all, --plugin FILE adds your own")


def effects_in(module: Any) -> tuple[Effect, ...]:
    """The effects a module defines, in the order of its text."""
    return tuple(each for each in vars(module).values() if isinstance(each, Effect))


def experiment_of(effect: Effect) -> Experiment:
    """The experiment on whose chain an effect acts; points are named so that there is one."""
    return next(each for each in EXPERIMENTS.values() if effect.on in each.points)


def _installed(experiment: str) -> Iterator[Effect]:
    """Those of the installed modules; `ConfigError` for one that acts elsewhere."""
    points = EXPERIMENTS[experiment].points
    for declared in effects_for(experiment):
        who = f"effects '{declared.name}'"
        for each in effects_in(resolved(declared.module, who)):
            if each.on not in points:
                raise ConfigError(f"{who}: '{each.id}' acts on {each.on!r}; {experiment} has {', '.join(points)}")
            yield each
