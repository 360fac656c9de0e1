"""The campaigns of the sensing-axis experiment: what a campaign file asks for, on the bench of a rig file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from procedures.campaigns import Instruments, Plan
from procedures.sensing_axis import sensing_axes
from procedures.sensing_axis.bench import Bench
from procedures.sensing_axis.forecast import theta0_sigma_arcsec
from procedures.sensing_axis.limits import within
from procedures.sensing_axis.mounting import Mounting, Seated, mounted_in
from procedures.sensing_axis.runs import chosen_runs, procedure_of, scan_of, set_points
from procedures.sensing_axis.tables import Targets
from procedures.sensing_axis.wiring import bench_of, channels
from rigctl.campaign.origin import campaign_of
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.parts import Part
from rigctl.campaign.store.store import Store
from rigctl.core.errors import ConfigError, DataError
from rigctl.effects.catalogue import chosen
from rigctl.effects.plugins import Plugin
from rigctl.experiments.sensing_axis.observe.set_points import OVERHEAD_S
from rigctl.files.campaign_file import CampaignFile
from rigctl.files.toml_files import validated
from rigctl.workbench.study import Allowed, Proposal

__all__ = ["allowed", "channels", "chosen_runs", "further", "mounted", "plan", "set_points"]


@dataclass(frozen=True)
class _Plan(Plan):
    """A plan of the procedures, waiting for its rig."""

    plan: sensing_axes.Plan

    @property
    def runs(self) -> int:
        return self.plan.runs

    def on(self, rig: Instruments) -> _Work:
        bench = bench_of(rig)
        self.plan.check(bench)
        return _Work(bench, self.plan)

    def told(self, rig: Instruments) -> Mapping[str, Any]:
        bench, points = bench_of(rig), self.plan.points
        procedure = self.plan.procedure
        noise_check_s = procedure.noise_check_s if procedure.name in sensing_axes.NULL_SEARCHES else 0.0
        return {
            "mountings": [mounting.key for mounting in self.plan.mountings],
            "theta0_sigma_arcsec": self._theta0_sigma_arcsec(bench),
            "rig_time_s": round(noise_check_s + sum(point.dwell_s + OVERHEAD_S for point in points)),
        }

    def _theta0_sigma_arcsec(self, bench: Bench) -> float | None:
        """What a null search goes on to; of other procedures the worst of all mountings; None: not determined."""
        if self.plan.procedure.name in sensing_axes.NULL_SEARCHES:
            return self.plan.targets.theta0_sigma_arcsec
        return theta0_sigma_arcsec(bench, self.plan)


@dataclass(frozen=True)
class _Work:
    """A plan and its bench."""

    bench: Bench
    plan: sensing_axes.Plan

    def run(self, session: Session) -> None:
        sensing_axes.run(session, self.bench, self.plan)

    def rest(self) -> None:
        self.bench.rest()


def plan(campaign: CampaignFile, part: Part | None, plugins: Sequence[Plugin]) -> _Plan:
    """The procedure a campaign file asks for, after what earlier campaigns have left; `ConfigError`."""
    return _Plan(plan_of(campaign, part, plugins))


def plan_of(campaign: CampaignFile, part: Part | None = None, plugins: Sequence[Plugin] = ()) -> sensing_axes.Plan:
    """As `plan`, as the procedures know it."""
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
    return within(bench_of(rig), procedure_of(campaign_of(store)), *place_of(store))
