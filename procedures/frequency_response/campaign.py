"""The campaigns of the frequency response: what a campaign file asks for, on the stage of a rig file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from procedures.campaigns import Instruments
from procedures.frequency_response.response import Plan
from procedures.frequency_response.tables import ListedRun, Procedure
from procedures.sensing_axis.wiring import channels
from rigctl.campaign.origin import campaign_of
from rigctl.campaign.store.parts import Part
from rigctl.campaign.store.store import Store
from rigctl.core.errors import ConfigError, LimitError
from rigctl.effects.plugins import Plugin
from rigctl.files.campaign_file import CampaignFile
from rigctl.files.toml_files import validated
from rigctl.workbench.study import Allowed, Proposal

__all__ = ["allowed", "channels", "further", "mounted", "plan"]


def plan(campaign: CampaignFile, part: Part | None = None, plugins: Sequence[Plugin] = ()) -> Plan:
    """The runs a campaign file asks for, after what earlier campaigns have left; `ConfigError`."""
    del plugins
    before = () if part is None else (part.mountings_before, part.mounted)
    asked = validated(Procedure, campaign.procedure, campaign.path, "procedure")
    if not asked.runs and not (asked.frequencies_hz and asked.accelerations_m_s2):
        raise ConfigError(
            f"{campaign.path}: procedure.frequencies_hz and accelerations_m_s2 say what to sweep; give both, "
            "or [[procedure.runs]]"
        )
    return Plan(asked, *before)


def mounted(store: Store) -> Sequence[tuple[str, str, int]]:
    """Axis, direction and number of all mountings, in order."""
    made = [event.data["result"] for event in store.events("once") if event.data["key"].endswith(" mounted")]
    return [(axis, direction, number) for axis, direction, number in made]


def further(store: Store, runs: Sequence[Proposal], campaign: CampaignFile) -> Mapping[str, Any]:
    """These runs, in the mounting that is there as far as they can be."""
    del store
    grid = {"frequencies_hz", "accelerations_m_s2", "directions", "repeats"}
    kept = {name: value for name, value in campaign.procedure.items() if name not in grid}
    return {**kept, "mounting": "kept", "runs": [dict(run.settings) for run in runs]}


def allowed(store: Store, rig: Instruments | None) -> Allowed | None:
    """What the limits of the stage leave."""
    if rig is None:
        return None
    instruments, campaign = rig, campaign_of(store)
    asked = validated(Procedure, campaign.procedure, campaign.path, "procedure")

    def within(proposal: Proposal) -> bool:
        try:
            Plan(asked.model_copy(update={"runs": (ListedRun(**proposal.settings),)})).on(instruments)
        except LimitError:
            return False
        return True

    return within
