"""Effects that a sensing-axis model lacks, with their derivatives: one candidate per effect, or per head."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.effects.catalogue import Effect
from rigctl.experiments.sensing_axis.model.model import RecordingModel
from rigctl.experiments.sensing_axis.model.parameters import family_of
from rigctl.experiments.sensing_axis.study_model import SensingAxisModel
from rigctl.workbench.study import Candidate, Term


def free_heads(effect: Effect, model: RecordingModel) -> list[str]:
    """Heads on which an effect might act and in the model does not."""
    taken = {head for each in model.effects if each.id == effect.id for head in model.reach(each)}
    return [head for head in model.reach(effect) if head not in taken]


def candidates_of(
    effects: Sequence[Effect], catalogue: Mapping[str, Effect], model: SensingAxisModel, values: FloatArray
) -> list[list[Candidate]]:
    """For each effect its candidates at the fitted `values`; one model with all of them gives the derivatives."""
    inner = model.inner
    whole = inner.with_effects(_in_order([*inner.effects, *effects], catalogue))
    slopes = model.slopes(whole, _with_zeros(inner, whole, model.si(values)), [each.id for each in effects])
    return [
        [
            _candidate(effect, head, inner, whole, slopes)
            for head in (free_heads(effect, inner) if effect.scope == "head" else ("",))
        ]
        for effect in effects
    ]


def _in_order(effects: Sequence[Effect], catalogue: Mapping[str, Effect]) -> list[Effect]:
    """One of each id, in the order in which they act; of two the later, which acts on all heads."""
    last = {effect.id: effect for effect in effects}
    return [last[name] for name in catalogue if name in last]


def _with_zeros(model: RecordingModel, whole: RecordingModel, values: FloatArray) -> FloatArray:
    """Values of a model as those of `whole`, which has more effects: these are absent."""
    known = {family.base: family for family in model.families}
    extended = np.zeros(len(whole.parameters))
    for family in whole.families:
        if family.base in known:
            first = known[family.base].first
            extended[family.first : family.first + family.count] = values[first : first + known[family.base].count]
    return extended


def _candidate(
    effect: Effect, head: str, model: RecordingModel, whole: RecordingModel, slopes: FloatArray
) -> Candidate:
    taken = {name for each in model.effects if each.id != effect.id for name in each.parameters}
    columns: list[int] = []
    names: list[str] = []
    typical: list[float] = []
    for name in effect.parameters:
        family = next(each for each in whole.families if each.base == family_of(effect, name, head))
        shown = f"{effect.id}.{name}" if name in taken else name
        for column in range(family.first, family.first + family.count):
            label = whole.parameters[column].name.partition("[")[2]
            columns.append(column)
            names.append(f"{shown}[{label}" if label else shown)
            typical.append(effect.typical[name])
    return Candidate(
        term=Term(effect.id, {"head": head} if head else {}),
        names=tuple(names),
        units=tuple(whole.units[column] for column in columns),
        columns=slopes[:, columns],
        typical=np.array(typical),
    )
