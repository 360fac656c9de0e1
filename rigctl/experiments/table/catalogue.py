"""The generic catalogue: what the columns of a table could be doing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ConfigError
from rigctl.effects.catalogue import unknown_effect
from rigctl.experiments.table.model.form import TableEffect
from rigctl.experiments.table.model.forms import Drift, Interaction, Offset, Power, Turning
from rigctl.experiments.table.model.functions import KINDS, Function
from rigctl.experiments.table.model.scanned import Exponential, Periodic, Scanned, Step
from rigctl.experiments.table.model.words import Group, Level, Slope
from rigctl.experiments.table.observe.readings import Column, Readings
from rigctl.experiments.table.spanned import Spanned

_PARALLEL = 1e-12


def generic(readings: Readings, slopes: FloatArray) -> dict[str, TableEffect]:
    """Every effect by its id, simple ones first, whether or not it can be tested.

    `slopes` (n, m) are the derivatives of the baseline where it is fitted alone.
    """
    columns, words = list(readings.columns.values()), list(readings.categories.values())
    # The order counts: of effects that the readings cannot tell apart the first is named.
    effects: list[TableEffect] = []
    if not _has_constant(slopes):
        effects.append(Offset(readings.response))
    effects.append(Drift(readings.order))
    effects += [Power(column, exponent) for exponent in (1, 2, 3) for column in columns]
    effects += [Turning(column) for column in columns]
    effects += [Function(column, kind) for kind in KINDS for column in columns]
    # Called as in the file, whatever the order in which they are asked about.
    pairs = [sorted(pair, key=lambda column: column.place) for pair in combinations(columns, 2)]
    effects += [Interaction(one, other) for one, other in pairs]
    effects += [Level(category) for category in words]
    effects += [Slope(column, category) for column in columns for category in words]
    effects += [
        Group(name, place, category)
        for place, name in enumerate(readings.expression.parameters)
        if _is_own(slopes[:, place], columns)
        for category in words
    ]
    effects += [kind(column) for kind in (Step, Exponential, Periodic) for column in columns]
    return {effect.id: effect for effect in effects}


def _has_constant(slopes: FloatArray) -> bool:
    """Whether a baseline with these derivatives, (n, m), adds a constant already."""
    # Squares of large values would overflow.
    largest = np.abs(slopes).max(axis=0)
    return Spanned(slopes / np.where(largest > 0.0, largest, 1.0)).holds(np.ones((len(slopes), 1)))


def _is_own(slope: FloatArray, columns: Sequence[Column]) -> bool:
    """Whether what a parameter of the baseline does is neither a level nor a slope, which have their own names."""
    others = [np.ones(slope.size), *(column.values for column in columns)]
    return not any(_parallel(slope, other) for other in others)


def _parallel(one: FloatArray, other: FloatArray) -> bool:
    # Squares of large values would overflow.
    one, other = (each / (float(np.abs(each).max()) or 1.0) for each in (one, other))
    lengths = float(np.linalg.norm(one) * np.linalg.norm(other))
    return bool(abs(one @ other) >= (1.0 - _PARALLEL) * lengths)


def why_not(effect: TableEffect, readings: Readings) -> str:
    """Why these readings cannot be asked about an effect; "" when they can."""
    for column in effect.columns:
        missing = np.flatnonzero(~np.isfinite(column.values))
        if missing.size:
            shown = ", ".join(readings.labels[i] for i in missing[:3])
            more = f" and {missing.size - 3} more" if missing.size > 3 else ""
            return f"{column.name} has no value in {shown}{more}"
        if column.distinct.size == 1:
            return f"{column.name} is constant"
    return effect.untestable()


def base_of(effect: str, known: Mapping[str, TableEffect]) -> str:
    """The catalogue's id behind `effect`, of which there may be several: periodic[t_s] for periodic[t_s]#2."""
    if effect in known:
        return effect
    base, mark, number = effect.rpartition("#")
    if mark and base in known and number.isdecimal() and int(number) >= 2:
        if isinstance(known[base], Scanned):
            return base
        raise ConfigError(f"effect '{effect}': there can be one {base} only; leave out #{number}")
    raise unknown_effect(effect, known)


def next_id(base: str, taken: set[str]) -> str:
    """The id of one more of a kind."""
    number = 1
    while (name := base if number == 1 else f"{base}#{number}") in taken:
        number += 1
    return name
