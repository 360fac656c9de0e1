"""What an experiment's campaigns are to the program that runs them: a plan, its instruments, its store.

`campaigns_of` gives the module that the experiment's declaration names; `Campaigns` says which functions it has.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from rigctl.campaign.recording import ChannelInfo, LaserInfo
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.parts import Part
from rigctl.campaign.store.store import Store
from rigctl.core.additions import procedure_for
from rigctl.core.clock import Clock
from rigctl.core.entry_points import resolved
from rigctl.core.errors import ConfigError
from rigctl.core.experiments import part_of
from rigctl.core.workers import Workers
from rigctl.effects.plugins import Plugin
from rigctl.files.campaign_file import CampaignFile
from rigctl.files.rig_file import RigFile
from rigctl.workbench.study import Allowed, Proposal


class Simulation(Protocol):
    """The world of a rig whose instruments are simulated."""

    @property
    def world(self) -> Any:
        """Nature itself."""
        ...

    def operate(self, action: Mapping[str, Any]) -> float:
        """What the operator's hands do; how long it takes [s]."""
        ...


class Instruments(Protocol):
    """What a plan may ask of a rig."""

    @property
    def file(self) -> RigFile:
        """Its rig file."""
        ...

    @property
    def clock(self) -> Clock:
        """Rig time."""
        ...

    @property
    def simulation(self) -> Simulation | None:
        """The world of simulated instruments; None for real ones."""
        ...

    def by_role(self, role: str) -> list[Any]:
        """The instruments with this role, in the order of the file."""
        ...

    def only(self, role: str) -> Any:
        """The one instrument with this role; `ConfigError` when there is none, or more."""
        ...


class Work(Protocol):
    """A plan on its instruments, checked against what they can do."""

    def run(self, session: Session) -> None:
        """Carry it out; everything it finds is in the session's store. May be called for a half-done one."""
        ...

    def rest(self) -> None:
        """Bring what moves to rest, at a pause; nothing where nothing moves."""
        return


class Plan(Protocol):
    """What a campaign file asks for; needs no instrument."""

    @property
    def runs(self) -> int:
        """How many runs are expected."""
        ...

    def on(self, rig: Instruments) -> Work:
        """With the instruments of `rig`, opened or not; `ConfigError` or `LimitError` for what it cannot do."""
        ...

    def forecast(self, rig: Instruments) -> Mapping[str, Any]:
        """What it would do with a rig: keys of `rigctl run --dry-run --json` beyond those of every plan.

        `warnings`, if there are any: what can be carried out, but not everything may come of it that is hoped for.
        """
        ...

    def kept(self) -> Mapping[str, Any]:
        """What the recording's header keeps of it beside the campaign file: keys of `Header.extra`."""
        return {}

    def require_goes_on(self, store: Store) -> None:
        """`ConfigError` for a finished store that this cannot be a further campaign of."""
        del store

    def by(self, workers: Workers) -> Plan:
        """The same work, done by others: what is found is the same. `ConfigError` where instruments do it."""
        del workers
        raise ConfigError("instruments do the work of this campaign; leave out --workers and --scheduler")


@dataclass(frozen=True)
class SetPoints:
    """What an investigation of a campaign chooses from: its full scan, and the same set-points with longer runs.

    All are in one `place`, conditions that hold for every run, such as an axis; `seed` is that of random orders.
    """

    place: Mapping[str, Any]
    full_scan: tuple[Proposal, ...]
    options: tuple[Proposal, ...]
    seed: int

    def run_price_s(self, most: int) -> float:
        """Rig time that a run is worth when there may be `most`: both budgets are to last equally long."""
        return sum(each.takes_s for each in self.full_scan) / most


Planning = Callable[[CampaignFile, Part | None, Sequence[Plugin]], Plan]
"""A function like `Campaigns.plan`."""


class Campaigns(Protocol):
    """The campaigns of an experiment. The module that its declaration names as `campaign` has these functions."""

    def plan(self, campaign: CampaignFile, part: Part | None, plugins: Sequence[Plugin]) -> Plan:
        """The procedure of a campaign; `part` is what earlier campaigns of its store have left. `ConfigError`."""
        ...

    def mounted(self, store: Store) -> Sequence[tuple[str, str, int]]:
        """Axis, configuration and number of all mountings a store's campaigns made, in order; () without any."""
        ...

    def channels(self, rig: Instruments) -> tuple[Mapping[str, ChannelInfo], Mapping[str, LaserInfo]]:
        """The columns that runs will have, and what is known of laser heads."""
        ...

    def further(self, store: Store, runs: Sequence[Proposal], campaign: CampaignFile) -> Mapping[str, Any]:
        """The `[procedure]` table of a campaign that makes proposed runs, otherwise like the store's own."""
        ...

    def allowed(self, store: Store, rig: Instruments | None) -> Allowed | None:
        """Which proposals a store's rig can carry out, which is not open; None where nothing is known of that.

        An imported recording has no rig.
        """
        ...


@runtime_checkable
class Investigable(Protocol):
    """What the module of `Campaigns` has besides when `rigctl investigate` can choose among its runs."""

    def set_points(self, campaign: CampaignFile) -> SetPoints:
        """What a campaign allows; `ConfigError` for one among whose runs nothing can be chosen."""
        ...

    def chosen_runs(self, campaign: CampaignFile, runs: Sequence[Proposal]) -> Mapping[str, Any]:
        """The `[procedure]` table of a campaign that makes these of its set-points."""
        ...


def plan_of(campaign: CampaignFile, part: Part | None, plugins: Sequence[Plugin]) -> Plan:
    """What a campaign file asks for, of its experiment or of a procedure that was added to it; `ConfigError`."""
    added = procedure_for(campaign.experiment, campaign.procedure.get("name"))
    if added is None:
        return campaigns_of(campaign.experiment, campaign.path).plan(campaign, part, plugins)
    plan: Planning = resolved(added.plan, f"procedure '{added.id}'")
    return plan(campaign, part, plugins)


def campaigns_of(experiment: str, path: Path | str = "") -> Campaigns:
    """The campaigns of an experiment, named in a store, a bundle or a campaign file (`path`).

    `DataError` for an experiment that is not installed, `ConfigError` for one that no campaign measures.
    """
    campaigns: Campaigns | None = part_of(experiment, "campaign", path)
    if campaigns is None:
        raise ConfigError(f"{path}: a '{experiment}' is imported, not measured; use `rigctl import`")
    return campaigns


def investigable(campaign: CampaignFile) -> Investigable:
    """The same, where an investigation can choose among the runs of a campaign; `ConfigError` elsewhere."""
    campaigns = campaigns_of(campaign.experiment, campaign.path)
    if not isinstance(campaigns, Investigable):
        raise ConfigError(f"{campaign.path}: an investigation cannot choose among the runs of {campaign.experiment}")
    return campaigns
