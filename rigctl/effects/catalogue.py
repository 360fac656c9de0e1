"""What an effect is, and the list of those that are known."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import ConfigError

FloatArray = NDArray[np.float64]

Scope = Literal["recording", "axis", "axis-configuration", "head"]
"""How many values a parameter has: one for the recording, one per axis, per axis in a configuration, per head."""

_MODULES = {"sensing-axis": "rigctl.effects.sensing_axis"}


@dataclass(frozen=True)
class Effect:
    """One piece of physics: what it adds, at which point of the chain, with which parameters.

    `function(run, **parameters)` returns what is added at `on`, in SI, shaped like `run.signal`, and zero when all
    parameters are zero. `parameters` gives the units, `typical` plausible sizes.
    """

    id: str
    on: str
    parameters: Mapping[str, str]
    typical: Mapping[str, float]
    source: str
    scope: Scope
    function: Callable[..., FloatArray]

    @property
    def summary(self) -> str:
        """The physics in a sentence: the function's own docstring."""
        return (self.function.__doc__ or "").strip().splitlines()[0]


_registered: dict[str, Effect] = {}


def effect(
    id: str,  # noqa: A002 - the word every file, command and recording uses
    *,
    on: str,
    parameters: Mapping[str, str],
    typical: Mapping[str, float],
    source: str,
    scope: Scope = "recording",
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Enter a function in the catalogue as the effect `id` acting at the point `on` of the chain."""

    def enter(function: Callable[..., Any]) -> Callable[..., Any]:
        _registered[id] = Effect(id, on, dict(parameters), dict(typical), source, scope, function)
        return function

    return enter


def catalogue(experiment: str) -> dict[str, Effect]:
    """All effects known for an experiment, by id."""
    importlib.import_module(_MODULES[experiment])
    return dict(_registered)


def chosen(experiment: str, ids: list[str] | tuple[str, ...]) -> tuple[Effect, ...]:
    """The named effects in the order given; `ConfigError` for an unknown id."""
    known = catalogue(experiment)
    for name in ids:
        if name not in known:
            raise ConfigError(f"unknown effect '{name}'; known for {experiment}: {', '.join(sorted(known))}")
    return tuple(known[name] for name in ids)
