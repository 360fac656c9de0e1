"""The candidates beside a fitted model, effect by effect, made when they are asked for: a fit needs none."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.workbench.groups import AsksOneByOne, Groups
from rigctl.workbench.study import Candidate, Model, NotTestable, Study

# Of values: fits that differ by less differ by their rounding.
_SAME = 1e-9


class Questions:
    """What a study asks beside a model at its fitted `values`."""

    def __init__(self, study: Study, model: Model, values: FloatArray) -> None:
        self._study, self._model, self._values = study, model, values
        # Asked for each candidate, and a protocol is slow to recognise.
        self._effectwise = study if isinstance(study, AsksOneByOne) else None
        self._one_by_one: Groups = {}

    def at(self, values: FloatArray) -> Questions:
        """The same beside a later fit of the model.

        Derivatives at other values do not lie in the span of that fit's own: what a parameter by words explains would
        depend, by a few ten-thousandths, on the word that the others are counted from.
        """
        # Only tables have words, and elsewhere asking costs more than fitting.
        if self._effectwise is None or np.allclose(values, self._values, rtol=_SAME, atol=0.0):
            return self
        return Questions(self._study, self._model, values)

    def let_go(self) -> None:
        """Keep no candidate; those that are asked for again are made again, the same."""
        self.__dict__.pop("_asked", None)
        self._one_by_one = {}

    @property
    def candidates(self) -> list[Candidate]:
        """Every effect that the model lacks, one per choice."""
        return [each for groups in self.groups.values() for group in groups for each in group]

    @property
    def not_testable(self) -> list[NotTestable]:
        """Effects that these data cannot be asked about."""
        return self._asked[1]

    @property
    def groups(self) -> Groups:
        """All candidates."""
        return self._asked[0]

    def of(self, effect: str) -> list[Sequence[Candidate]]:
        """Those of one effect; none where it is no candidate. Often no other is asked about."""
        if "_asked" in self.__dict__ or self._effectwise is None:
            return self.groups.get(effect, [])
        if effect not in self._one_by_one:
            self._one_by_one[effect] = self._effectwise.groups_of(self._model, self._values, effect)
        return self._one_by_one[effect]

    @cached_property
    def _asked(self) -> tuple[Groups, list[NotTestable]]:
        if self._effectwise is not None:
            return self._effectwise.candidate_groups(self._model, self._values)
        candidates, not_testable = self._study.candidates(self._model, self._values)
        return _grouped(candidates), not_testable


def _grouped(candidates: Sequence[Candidate]) -> Groups:
    groups: Groups = {}
    for (effect, _), group in itertools.groupby(candidates, lambda each: (each.term.effect, len(each.names))):
        groups.setdefault(effect, []).append(list(group))
    return groups
