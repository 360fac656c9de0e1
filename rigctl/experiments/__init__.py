"""One package each: its declaration, conditions, observables, baseline model, result; `EXPERIMENTS` has them all."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property

from rigctl.core.entry_points import Registry
from rigctl.errors import ConfigError, DataError
from rigctl.experiments.declaration import CONTRACT, Experiment

REGISTRY = Registry("rigctl.experiments", Experiment, CONTRACT, lambda each: each.id)


class Experiments(Mapping[str, Experiment]):
    """The experiments that can be used, by id, in the order of their ranks."""

    def __getitem__(self, name: str) -> Experiment:
        return self._by_id[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._by_id)

    def __len__(self) -> int:
        return len(self._by_id)

    @cached_property
    def _by_id(self) -> dict[str, Experiment]:
        return {each.id: each for each in sorted(REGISTRY.sound(), key=lambda each: (each.rank, each.id))}


EXPERIMENTS = Experiments()
"""Those of this tree and those that other packages install, in the same way."""


def experiment_named(name: str) -> Experiment:
    """The experiment of this id; `DataError` for one that is not installed, or that cannot be used."""
    try:
        return REGISTRY.get(name)
    except ConfigError as error:
        raise DataError(str(error)) from None


def measured() -> list[str]:
    """The experiments that campaigns measure."""
    return [name for name, each in EXPERIMENTS.items() if each.tables]


def of_readings(name: str) -> bool:
    """Whether recordings of an experiment are tables of readings and have no runs; `DataError`."""
    return not experiment_named(name).columns
