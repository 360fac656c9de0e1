"""What the application asks of an experiment, one module each: its campaigns, its study, its result, its figures.

The commands, the console and the report know experiments by `kind_of` alone. A module here joins what lies below:
procedures, which know no analysis of a whole recording, and analysis, which knows no instrument.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from rigctl.core.errors import ConfigError, DataError
from rigctl.core.experiments import EXPERIMENTS, experiment_named

if TYPE_CHECKING:
    from pydantic import BaseModel

    from rigctl.campaign.recording import ChannelInfo, LaserInfo
    from rigctl.campaign.session.session import Session
    from rigctl.campaign.store.parts import Part
    from rigctl.campaign.store.store import Store
    from rigctl.effects.plugins import Plugin
    from rigctl.files.config import CampaignFile
    from rigctl.report.figures.data import Plate
    from rigctl.report.tables.result_table import ResultTable
    from rigctl.rig import Rig
    from rigctl.workbench.bench import Workbench
    from rigctl.workbench.next.recommend import Allowed
    from rigctl.workbench.study import Proposal, Study

Progress = Callable[[int, int], None]
"""Called with how many runs are done, and of how many."""


class Work(Protocol):
    """A plan on its instruments, checked against what they can do."""

    def run(self, session: Session) -> None:
        """Carry it out; everything it finds is in the session's store. May be called for a half-done one."""
        ...

    def rest(self) -> None:
        """Bring what moves to rest, at a pause; nothing where nothing moves."""
        ...


class Plan(Protocol):
    """What a campaign file asks for; needs no instrument."""

    @property
    def runs(self) -> int:
        """How many runs are expected."""
        ...

    def on(self, rig: Rig) -> Work:
        """With the instruments of `rig`, opened or not; `ConfigError` or `LimitError` for what it cannot do."""
        ...

    def told(self, rig: Rig) -> Mapping[str, Any]:
        """What it would do with a rig: keys of `rigctl run --dry-run --json` beyond those of every plan."""
        ...

    def kept(self) -> Mapping[str, Any]:
        """What the recording's header keeps of it beside the campaign file: keys of `Header.extra`."""
        ...


class Result(Protocol):
    """What an experiment finds, with everything it was made from; its further attributes are its own."""

    def as_json(self) -> dict[str, Any]:
        """Its numbers, as `rigctl result --json` gives them."""
        ...


@dataclass(frozen=True)
class Drawn:
    """What an experiment adds to a report: its result, tables and figures, and why one is not there."""

    result: Mapping[str, Any] = field(default_factory=dict)
    tables: Sequence[ResultTable] = ()
    plates: Sequence[Plate[Any]] = ()
    spectra: Sequence[Plate[Any]] = ()
    left_out: Mapping[str, str] = field(default_factory=dict)


class Kind(Protocol):
    """An experiment. Its module is one: these are its functions."""

    def plan(self, campaign: CampaignFile, part: Part | None, plugins: Sequence[Plugin]) -> Plan:
        """The procedure of a campaign; `part` is what earlier campaigns of its store have left. `ConfigError`."""
        ...

    def mounted(self, store: Store) -> Sequence[tuple[str, str, int]]:
        """Axis, configuration and number of all mountings a store's campaigns made, in order; () without any."""
        ...

    def channels(self, rig: Rig) -> tuple[Mapping[str, ChannelInfo], Mapping[str, LaserInfo]]:
        """The columns that runs will have, and what is known of laser heads."""
        ...

    def further(self, store: Store, runs: Sequence[Proposal], campaign: CampaignFile) -> Mapping[str, Any]:
        """The `[procedure]` table of a campaign that makes proposed runs, otherwise like the store's own."""
        ...

    def allowed(self, store: Store) -> Allowed | None:
        """Which proposals the rig of a store can carry out; None where there is no rig to ask, or none is needed."""
        ...

    def reduced(self, store: Store, progress: Progress) -> Mapping[str, str]:
        """Reduce the valid runs once and for all; which were left out, and why."""
        ...

    def study(self, store: Store, plugins: Sequence[Plugin]) -> Study:
        """A store's runs as the workbench sees them."""
        ...

    def analyse(self, bench: Workbench) -> Result:
        """What a store amounts to, for a notebook. `DataError`, `ProcedureError`."""
        ...

    def result(self, bench: Workbench) -> dict[str, Any]:
        """What a store amounts to: keys of `rigctl result --json`. `DataError`, `ProcedureError`."""
        ...

    def show(self, found: Mapping[str, Any], reference: Mapping[str, Any]) -> None:
        """Print a result, beside a campaign file's reference values."""
        ...

    def draw(self, bench: Workbench, lines_hz: Sequence[float], found: Sequence[Any]) -> Drawn:
        """What a report shows; `lines_hz` are lines the model has, `found` those it has not (study.Line)."""
        ...


def kind_of(experiment: str, path: Path | str = "") -> Kind:
    """The experiment named in a store, a bundle or a campaign file (`path`); `DataError` for one nobody knows."""
    try:
        declared = experiment_named(experiment)
        kind: Kind = declared.load(declared.application)
    except (ConfigError, DataError) as error:
        raise DataError(f"{path}: {error}") from None
    return kind


def settings_of(experiment: str, procedure: Mapping[str, Any]) -> Mapping[str, type[BaseModel]]:
    """The tables of a campaign file that are an experiment's own, by name, without loading what analyses it.

    `procedure` is that table as far as it is written; an experiment nobody knows has none.
    """
    if experiment not in EXPERIMENTS:
        return {}
    declared = EXPERIMENTS[experiment]
    other = declared.procedures.get(str(procedure.get("name")))
    references = {**declared.tables, "procedure": other} if other else declared.tables
    return {table: declared.load(reference) for table, reference in references.items()}
