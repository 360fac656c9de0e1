"""The five screens together."""

from __future__ import annotations

from dataclasses import dataclass

from rigctl.console.screens.campaign import CampaignPane
from rigctl.console.screens.log import LogPane
from rigctl.console.screens.results import ResultsPane
from rigctl.console.screens.rig import RigPane
from rigctl.console.screens.workbench import WorkbenchPane
from rigctl.console.state import ConsoleState


@dataclass(frozen=True)
class Panes:
    """One of each; the names are those of `widgets.bars.SCREENS`."""

    rig: RigPane
    campaign: CampaignPane
    results: ResultsPane
    workbench: WorkbenchPane
    log: LogPane


def panes_as_left(kept: ConsoleState) -> Panes:
    """As the operator left them."""
    return Panes(RigPane(kept.jog_step), CampaignPane(), ResultsPane(), WorkbenchPane(kept.covariate), LogPane())
