"""Candidates effect by effect; those of a scan made when they are asked for, for most are only scored together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, overload, runtime_checkable

from rigctl.core.arrays import FloatArray, IntArray
from rigctl.workbench.study import Candidate, Made, Model, NotTestable, Study, Term

Groups = dict[str, list[Sequence[Candidate]]]
"""Candidates effect by effect, choices with as many parameters together."""


@runtime_checkable
class AsksOneByOne(Study, Protocol):
    """A study that makes candidates effect by effect, choices with as many parameters together."""

    def candidate_groups(self, model: Model, values: FloatArray) -> tuple[Groups, list[NotTestable]]:
        """The same as `candidates`, by effect."""

    def groups_of(self, model: Model, values: FloatArray, effect: str) -> list[Sequence[Candidate]]:
        """Those of one effect, by id, made without all others."""


@dataclass(frozen=True)
class ScanChoices(Sequence[Candidate]):
    """An effect with each of its choices that are asked about.

    `columns` are those of all `choices`, of which the ones at `places` are candidates; `typical` (choices, d).
    """

    effect: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    columns: Made
    choices: Sequence[Mapping[str, Any]]
    typical: FloatArray
    places: IntArray
    _made: dict[int, Candidate] = field(default_factory=dict, repr=False, compare=False)

    def __len__(self) -> int:
        """How many there are."""
        return len(self.places)

    @overload
    def __getitem__(self, number: int) -> Candidate: ...

    @overload
    def __getitem__(self, number: slice) -> Sequence[Candidate]: ...

    def __getitem__(self, number: int | slice) -> Candidate | Sequence[Candidate]:
        """One, always the same; or some of them."""
        if isinstance(number, slice):
            return [self[each] for each in range(len(self))[number]]
        place = int(self.places[number])
        if place not in self._made:
            term, typical = Term(self.effect, self.choices[place]), self.typical[place]
            self._made[place] = Candidate(term, self.names, self.units, self.columns, typical, place, scanned=1)
        return self._made[place]
