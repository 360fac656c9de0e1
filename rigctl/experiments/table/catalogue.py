"""The generic catalogue: what the columns of a table could be doing."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from rigctl.core.errors import ConfigError
from rigctl.effects.catalogue import unknown_effect
from rigctl.experiments.table.model.form import Form
from rigctl.experiments.table.model.forms import Drift, Interaction, Level, Power
from rigctl.experiments.table.model.scanned import Exponential, Periodic, Scanned, Step
from rigctl.experiments.table.observe.readings import Readings


def generic(readings: Readings) -> dict[str, Form]:
    """Every form by its id, simple ones first, whether or not it can be tested."""
    columns = list(readings.columns.values())
    forms: list[Form] = [Drift(readings.order)]
    forms += [Power(column, exponent) for exponent in (1, 2, 3, -1) for column in columns]
    forms += [Interaction(one, other) for one, other in combinations(columns, 2)]
    forms += [Level(category) for category in readings.categories.values()]
    forms += [kind(column) for kind in (Step, Exponential, Periodic) for column in columns]
    return {form.id: form for form in forms}


def why_not(form: Form, readings: Readings) -> str:
    """Why these readings cannot be asked about a form; "" when they can."""
    for column in form.columns:
        missing = np.flatnonzero(~np.isfinite(column.values))
        if missing.size:
            shown = ", ".join(readings.labels[i] for i in missing[:3])
            more = f" and {missing.size - 3} more" if missing.size > 3 else ""
            return f"{column.name} has no value in {shown}{more}"
        if column.distinct.size == 1:
            return f"{column.name} is constant"
    return form.untestable()


def base_of(effect: str, known: dict[str, Form]) -> str:
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
