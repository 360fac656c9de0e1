"""The campaigns of the sensing-axis experiment: what a campaign file asks for, on the bench of a rig file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from procedures.campaigns import Instruments
from procedures.sensing_axis import scan, sensing_axes
from procedures.sensing_axis.mounting import Mounting, Seated, mounted_in
from procedures.sensing_axis.runs import chosen_runs, procedure_of, scan_of, set_points, settings_of_run
from procedures.sensing_axis.tables import ListedRun, Targets
from procedures.sensing_axis.wiring import bench_of, channels
from rigctl.campaign.origin import campaign_of
from rigctl.campaign.store.parts import Part
from rigctl.campaign.store.store import Store
from rigctl.core.errors import ConfigError, DataError, LimitError
from rigctl.effects.catalogue import chosen
from rigctl.effects.plugins import Plugin
from rigctl.files.campaign_file import CampaignFile
from rigctl.files.toml_files import validated
from rigctl.workbench.study import Allowed, Proposal

__all__ = ["allowed", "channels", "chosen_runs", "further", "mounted", "plan", "set_points"]


def plan(campaign: CampaignFile, part: Part | None = None, plugins: Sequence[Plugin] = ()) -> sensing_axes.Plan:
    """The procedure a campaign file asks for, after what earlier campaigns have left; `ConfigError`."""
    procedure = procedure_of(campaign)
    targets = validated(Targets, campaign.targets, campaign.path, "targets")
    try:
        brought = [effect for plugin in plugins for effect in plugin.effects.values()]
        effects = chosen(campaign.experiment, campaign.model.effects, brought)
    except ConfigError as error:
        raise ConfigError(f"{campaign.path}: model.effects: {error}") from None
    return sensing_axes.Plan(procedure, targets, effects, Seated() if part is None else _seated(part))


def _seated(part: Part) -> Seated:
    return Seated(part.mountings_before, None if part.mounted is None else Mounting(*part.mounted))


def mounted(store: Store) -> Sequence[tuple[str, str, int]]:
    """Axis, configuration and number of all mountings a store's campaigns made, in order."""
    return [(mounting.axis, mounting.configuration, mounting.number) for mounting in mounted_in(store)]


def further(store: Store, runs: Sequence[Proposal], campaign: CampaignFile) -> Mapping[str, Any]:
    """A scan of these set-points in the mounting that is there."""
    return scan_of(*place_of(store), runs, procedure_of(campaign))


def place_of(store: Store) -> tuple[str, str]:
    """Axis and configuration that are mounted; `DataError` before any run."""
    runs = store.runs()
    if not runs:
        raise DataError(f"{store.path} has no runs yet; nothing can be said of the next one")
    return str(runs[-1].conditions["axis"]), str(runs[-1].conditions["configuration"])


def allowed(store: Store, rig: Instruments | None) -> Allowed | None:
    """What the stages' limits, the recorders' memories and the sensor's range leave."""
    if rig is None:
        return None
    # No number: whether the bench can do it does not depend on which mounting it is.
    bench, procedure, mounting = bench_of(rig), procedure_of(campaign_of(store)), Mounting(*place_of(store), 0)

    def possible(proposal: Proposal) -> bool:
        point = scan.set_point(procedure, mounting, ListedRun.model_validate(settings_of_run(proposal)))
        try:
            # A run whose spots leave the cube is possible, without lasers.
            bench.check(point, lasers=bench.spots_stay(point))
            bench.check_level(point)
        except (LimitError, ConfigError):
            return False
        return True

    return possible
