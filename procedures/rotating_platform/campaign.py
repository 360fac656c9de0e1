"""The campaigns of the rotating platform: what a campaign file asks for, on the bench of a rig file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from procedures.campaigns import Instruments, Plan
from procedures.rotating_platform import bias_rejection
from procedures.rotating_platform.bench import PlatformBench
from procedures.rotating_platform.tables import ListedRun, Procedure
from procedures.rotating_platform.wiring import bench_of, channels
from rigctl.campaign.origin import campaign_of
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.parts import Part
from rigctl.campaign.store.store import Store
from rigctl.core.errors import ConfigError, LimitError
from rigctl.effects.plugins import Plugin
from rigctl.files.campaign_file import CampaignFile
from rigctl.files.toml_files import validated
from rigctl.workbench.study import Allowed, Proposal

__all__ = ["allowed", "channels", "further", "mounted", "plan"]


@dataclass(frozen=True)
class _Plan(Plan):
    """A plan of the procedures, waiting for its rig."""

    plan: bias_rejection.Plan

    @property
    def runs(self) -> int:
        return len(self.plan.recordings)

    def on(self, rig: Instruments) -> _Work:
        bench = bench_of(rig, self.plan.procedure)
        self.plan.check(bench)
        return _Work(bench, self.plan)

    def forecast(self, rig: Instruments) -> Mapping[str, Any]:
        del rig
        recordings = self.plan.recordings
        return {
            "recorded_h": round(sum(each.wanted.table.duration_s for each in recordings) / 3600.0, 2),
            "samples": sum(each.wanted.samples for each in recordings),
            "patterns": [
                f"{label}: {sentence}"
                for label, separation in self.plan.separations.items()
                for sentence in separation.says
            ],
        }

    def kept(self) -> Mapping[str, Any]:
        dwells = self.plan.custom_dwells
        return {"patterns": dwells} if dwells else {}

    def require_goes_on(self, store: Store) -> None:
        """A recording's custom patterns are those it began with: a later campaign can only use them again."""
        kept, wanted = (
            set(zip(*columns.values(), strict=True))
            for columns in (store.header.extra.get("patterns", {}), self.plan.custom_dwells)
        )
        if not wanted <= kept:
            raise ConfigError(f"{store.path}: it did not begin with these custom patterns; run them into a new store")


@dataclass(frozen=True)
class _Work:
    """A plan and its bench."""

    bench: PlatformBench
    plan: bias_rejection.Plan

    def run(self, session: Session) -> None:
        bias_rejection.run(session, self.bench, self.plan)

    def rest(self) -> None:
        self.bench.rest()


def plan(campaign: CampaignFile, part: Part | None, plugins: Sequence[Plugin]) -> _Plan:
    """The recordings a campaign file asks for; `ConfigError`, also for a pattern that does not reject enough."""
    del part, plugins
    procedure = validated(Procedure, campaign.procedure, campaign.path, "procedure")
    checked = bias_rejection.Plan(procedure)
    try:
        _ = checked.recordings
    except ConfigError as error:
        raise ConfigError(f"{campaign.path}: {error}") from None
    return _Plan(checked)


def mounted(store: Store) -> Sequence[tuple[str, str, int]]:
    """Nothing is mounted anew."""
    del store
    return ()


def further(store: Store, runs: Sequence[Proposal], campaign: CampaignFile) -> Mapping[str, Any]:
    """These recordings, rotations and guards as in the campaign there was."""
    del store
    return {**campaign.procedure, "runs": [dict(run.settings) for run in runs]}


def allowed(store: Store, rig: Instruments | None) -> Allowed | None:
    """What patterns, the platform's limits and the source's leave."""
    if rig is None:
        return None
    campaign = campaign_of(store)
    procedure = validated(Procedure, campaign.procedure, campaign.path, "procedure")
    return within(bench_of(rig, procedure), procedure)


def within(bench: PlatformBench, procedure: Procedure) -> Allowed:
    """Whether a bench can carry out a proposal; what that does not say is as in `procedure`."""

    def allowed(proposal: Proposal) -> bool:
        run = ListedRun.model_validate(dict(proposal.settings))
        try:
            bias_rejection.Plan(procedure.model_copy(update={"runs": (run,)})).check(bench)
        except (LimitError, ConfigError):
            return False
        return True

    return allowed
