"""Campaigns that are lists of runs: the scan of proposed set-points, and what an investigation may choose from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from procedures.campaigns import SetPoints
from procedures.sensing_axis import scan
from procedures.sensing_axis.tables import Procedure
from rigctl.core.errors import ConfigError
from rigctl.experiments.sensing_axis.observe.set_points import OVERHEAD_S
from rigctl.files.campaign_file import CampaignFile
from rigctl.files.toml_files import validated
from rigctl.workbench.study import Proposal

LONGER = 3.0
LONGEST_S = 60.0


def procedure_of(campaign: CampaignFile) -> Procedure:
    """The `[procedure]` table of a campaign file; `ConfigError`."""
    return validated(Procedure, campaign.procedure, campaign.path, "procedure")


def set_points(campaign: CampaignFile) -> SetPoints:
    """The set-points of a scan campaign; `ConfigError` for any other, or for several axes or configurations."""
    procedure = procedure_of(campaign)
    if procedure.name != "scan":
        raise ConfigError(
            f"{campaign.path}: procedure.name: an investigation chooses among the set-points of a scan, "
            f"not of {procedure.name}; give angles_deg, frequencies_hz and approaches"
        )
    if len(procedure.axes) > 1 or len(procedure.configurations) > 1:
        raise ConfigError(
            f"{campaign.path}: procedure: an investigation stays in one mounting; "
            "name one axis in axes and one configuration in configurations"
        )
    settings = [
        {
            "theta_deg": run.theta_deg,
            "frequency_hz": run.frequency_hz,
            "amplitude_mm": run.amplitude_mm or procedure.amplitude_mm,
            "approach": run.approach,
            "dwell_s": run.dwell_s or procedure.dwell_s,
        }
        for run in scan.listed(procedure)
    ]
    full = tuple(Proposal(each, each["dwell_s"] + OVERHEAD_S) for each in settings)
    # Repetitions are one option: whoever chooses may take it several times.
    distinct = list({tuple(each.items()): each for each in settings}.values())
    # Longer runs at the same set-points: fewer turns and settlings for the same information.
    longer = [
        {**each, "dwell_s": long_s}
        for each in distinct
        if (long_s := min(LONGER * each["dwell_s"], LONGEST_S)) > each["dwell_s"]
    ]
    options = tuple(Proposal(each, each["dwell_s"] + OVERHEAD_S) for each in (*distinct, *longer))
    place = {"axis": procedure.axes[0], "configuration": procedure.configurations[0], "mounting": 1}
    return SetPoints(place, full, options, procedure.order_seed)


def chosen_runs(campaign: CampaignFile, runs: Sequence[Proposal]) -> Mapping[str, Any]:
    """A scan of these set-points in the campaign's one mounting."""
    procedure = procedure_of(campaign)
    return scan_of(procedure.axes[0], procedure.configurations[0], runs, procedure)


def scan_of(axis: str, configuration: str, runs: Sequence[Proposal], like: Procedure) -> dict[str, Any]:
    """The `[procedure]` table of a scan given as a list of runs, in its order."""
    return {
        "name": "scan",
        "axes": [axis],
        "configurations": [configuration],
        "mounting": "kept",
        "order": "as-listed",
        "amplitude_mm": like.amplitude_mm,
        "sample_rate_hz": like.sample_rate_hz,
        "runs": [settings_of_run(run) for run in runs],
    }


def settings_of_run(proposal: Proposal) -> dict[str, Any]:
    """The `[[procedure.runs]]` table of a proposed run."""
    of_a_run = ("theta_deg", "frequency_hz", "amplitude_mm", "approach", "dwell_s", "temperature_c", "wait_s")
    return {key: value for key, value in proposal.settings.items() if key in of_a_run}
