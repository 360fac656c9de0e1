"""Anybody's calibration: a table of readings. It has a study and no procedure of ours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rigctl.core.errors import ConfigError
from rigctl.experiments.table.study import TableStudy
from rigctl.kinds import Drawn, Plan
from rigctl.workbench.verdict.fit import fit

if TYPE_CHECKING:
    from rigctl.campaign.recording import ChannelInfo, LaserInfo
    from rigctl.campaign.store.parts import Part
    from rigctl.campaign.store.store import Store
    from rigctl.effects.plugins import Plugin
    from rigctl.files.config import CampaignFile
    from rigctl.kinds import Progress
    from rigctl.rig import Rig
    from rigctl.workbench.bench import Workbench
    from rigctl.workbench.findings import ModelFit
    from rigctl.workbench.next.recommend import Allowed
    from rigctl.workbench.study import Proposal


def plan(campaign: CampaignFile, part: Part | None, plugins: Sequence[Plugin]) -> Plan:
    """No campaign of ours measures a table: `ConfigError`."""
    del part, plugins
    raise ConfigError(f"{campaign.path}: tables are imported, not measured; use `rigctl import`")


def mounted(store: Store) -> Sequence[tuple[str, str, int]]:
    """Nothing is mounted."""
    del store
    return ()


def channels(rig: Rig) -> tuple[Mapping[str, ChannelInfo], Mapping[str, LaserInfo]]:
    """No rig measures a table."""
    del rig
    return {}, {}


def further(store: Store, runs: Sequence[Proposal], campaign: CampaignFile) -> Mapping[str, Any]:
    """No rig of ours takes readings: `ConfigError`."""
    del runs
    raise ConfigError(f"{store.path}: {campaign.path}: tables are imported, not measured")


def allowed(store: Store) -> Allowed | None:
    """No rig of ours takes readings."""
    del store
    return None


def reduced(store: Store, progress: Progress) -> Mapping[str, str]:
    """Readings are taken as they are."""
    del store, progress
    return {}


def study(store: Store, plugins: Sequence[Plugin]) -> TableStudy:
    """A store's readings as the workbench sees them."""
    return TableStudy(store, [effect for plugin in plugins for effect in plugin.effects.values()])


def result(bench: Workbench) -> dict[str, Any]:
    """The fit, with the version of its model."""
    return {"version": bench.current.version, **analyse(bench).as_json()}


def analyse(bench: Workbench) -> ModelFit:
    """The fit is the result."""
    return fit(bench.study, bench.current.terms)


def show(found: Mapping[str, Any], reference: Mapping[str, Any]) -> None:
    """Print the fit."""
    from rigctl.report.terminal_workbench import print_fit

    del reference
    print_fit(found)


def draw(bench: Workbench, lines_hz: Sequence[float], found: Sequence[Any]) -> Drawn:
    """Nothing beyond what every report has."""
    del bench, lines_hz, found
    return Drawn()
