"""Experiments declare themselves; `EXPERIMENTS` has them all and imports what a declaration names when it is used."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from rigctl.core.entry_points import Registry, resolved
from rigctl.core.errors import ConfigError, DataError

CONTRACT = 1
"""The version of what follows; an experiment written for another is refused."""


@dataclass(frozen=True)
class Experiment:
    """An experiment, found by the entry points of `rigctl.experiments`; references are `package.module:object`.

    Three of its modules are each the functions of a protocol: `campaign` those of `procedures.campaigns.Campaigns`,
    "" when no campaign measures it; `analysis` those of `rigctl.experiments.analysis.Analysis`; `report` those of
    `rigctl.report.drawn.Drawing`.

    `tables` are the pydantic models of a campaign file's `[procedure]` and `[targets]`. `columns` is the
    `rigctl.campaign.layout.Layout` of its runs; without one a recording is a table of readings. Of a table `question`
    is the function `(source) -> Sequence[str]` that refuses a recording whose question cannot be answered, and gives
    a line for whatever else there is to say of one that is imported. Effects, and
    procedures beside those of `campaign`, are declared by themselves: `rigctl.core.additions`.

    Effects act at `points` of its chain, in the order in which a signal passes, and have one value per each of
    `scopes`. `trial_run(point)` makes runs to try a foreign effect on, and
    `signature(effect)` draws one; without it there is no such figure. `rank` is its place in lists.
    """

    id: str
    analysis: str
    report: str
    points: tuple[str, ...]
    trial_run: str
    scopes: tuple[str, ...] = ("recording",)
    campaign: str = ""
    tables: Mapping[str, str] = field(default_factory=dict)
    columns: str = ""
    question: str = ""
    signature: str = ""
    rank: int = 100
    contract: int = CONTRACT

    def load(self, reference: str) -> Any:
        """What one of these references names, imported now; `ConfigError` when that fails."""
        return resolved(reference, f"experiment '{self.id}'")


REGISTRY = Registry("rigctl.experiments", Experiment, CONTRACT, lambda each: each.id)


class Experiments(Mapping[str, Experiment]):
    """The experiments that can be used, by id, in the order of their ranks."""

    def __getitem__(self, name: str) -> Experiment:
        return self._by_id[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._by_id)

    def __len__(self) -> int:
        return len(self._by_id)

    # Not before somebody asks: it imports the modules of all experiments.
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


def part_of(experiment: str, part: Literal["campaign", "analysis", "report"], path: Path | str) -> Any:
    """A module of the experiment that `path` names, imported now, None where the experiment has none; `DataError`."""
    try:
        declared = experiment_named(experiment)
        reference = getattr(declared, part)
        return declared.load(reference) if reference else None
    except (ConfigError, DataError) as error:
        raise DataError(f"{path}: {error}") from None


def measured() -> list[str]:
    """The experiments that campaigns measure."""
    return [name for name, each in EXPERIMENTS.items() if each.campaign]


def of_readings(name: str) -> bool:
    """Whether recordings of an experiment are tables of readings and have no runs; `DataError`."""
    return not experiment_named(name).columns
