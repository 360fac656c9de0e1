"""The candidates beside a fitted model, effect by effect, made when they are asked for: a fit needs none."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import cached_property

from rigctl.core.arrays import FloatArray
from rigctl.workbench.study import AsksOneByOne, Candidate, Model, NotTestable, Study

Groups = dict[str, list[list[Candidate]]]
"""Candidates effect by effect, choices with as many parameters together."""


class Questions:
    """What a study asks beside a model at its fitted `values`."""

    def __init__(self, study: Study, model: Model, values: FloatArray) -> None:
        self._study, self._model, self._values = study, model, values
        self._one_by_one: Groups = {}

    @property
    def candidates(self) -> list[Candidate]:
        """Every effect that the model lacks, one per choice."""
        return self._asked[0]

    @property
    def not_testable(self) -> list[NotTestable]:
        """Effects that these data cannot be asked about."""
        return self._asked[1]

    @cached_property
    def groups(self) -> Groups:
        """All candidates."""
        return _grouped(self.candidates)

    def of(self, effect: str) -> list[list[Candidate]]:
        """Those of one effect; none where it is no candidate. Often no other is asked about."""
        if "_asked" in self.__dict__ or not isinstance(self._study, AsksOneByOne):
            return self.groups.get(effect, [])
        if effect not in self._one_by_one:
            candidates = self._study.candidates_of(self._model, self._values, effect)
            self._one_by_one[effect] = _grouped(candidates).get(effect, [])
        return self._one_by_one[effect]

    @cached_property
    def _asked(self) -> tuple[list[Candidate], list[NotTestable]]:
        return self._study.candidates(self._model, self._values)


def _grouped(candidates: Sequence[Candidate]) -> Groups:
    groups: Groups = {}
    for (effect, _), group in itertools.groupby(candidates, lambda each: (each.term.effect, len(each.names))):
        groups.setdefault(effect, []).append(list(group))
    return groups
