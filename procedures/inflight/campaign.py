"""The campaigns of the in-flight calibration: what a campaign file asks for, on the satellite of a rig file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from procedures.campaigns import Instruments, Plan, Work
from procedures.inflight.bench import Flight, flight_of
from procedures.inflight.calibration import calibrate, check
from procedures.inflight.tables import Calibration
from rigctl.campaign.origin import campaign_of
from rigctl.campaign.recording import ChannelInfo, LaserInfo
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.parts import Part
from rigctl.campaign.store.store import Store
from rigctl.core.errors import ConfigError, LimitError
from rigctl.effects.plugins import Plugin
from rigctl.experiments.inflight.observe.sessions import LINEAR, MASS_MOTION, QUADRATIC
from rigctl.files.campaign_file import CampaignFile
from rigctl.files.campaign_tables import settings_of
from rigctl.files.toml_files import validated
from rigctl.workbench.study import Allowed, Proposal


@dataclass(frozen=True)
class CalibrationPlan(Plan):
    """One calibration, waiting for its satellite."""

    calibration: Calibration

    @property
    def runs(self) -> int:
        """One per session."""
        return len(self.calibration.sessions)

    def on(self, rig: Instruments) -> CalibrationWork:
        """With the satellite of a rig."""
        flight = flight_of(rig)
        check(flight, self.calibration)
        return CalibrationWork(flight, self.calibration)

    def told(self, rig: Instruments) -> Mapping[str, Any]:
        """Sessions, and how long they are together."""
        del rig
        sessions = self.calibration.sessions
        return {"sessions": list(sessions), "orbits": sum(self.calibration.orbits_of(name) for name in sessions)}


@dataclass(frozen=True)
class CalibrationWork(Work):
    """One calibration on its satellite."""

    flight: Flight
    calibration: Calibration

    def run(self, session: Session) -> None:
        """Carry it out."""
        session.plan(len(self.calibration.sessions))
        calibrate(session, self.flight, self.calibration)


STRENGTH = {
    **dict.fromkeys(LINEAR, "common_m_s2"),
    "dy": "turn_rad",
    **dict.fromkeys(MASS_MOTION, "displacement_m"),
    **dict.fromkeys(QUADRATIC, "quadratic_m"),
}
"""Where a campaign file says how strong a session's stimulus is."""


def within(flight: Flight, calibration: Calibration) -> Allowed:
    """Whether a satellite can fly a proposal; what that does not say is as in `calibration`."""

    def allowed(proposal: Proposal) -> bool:
        name = str(proposal.settings["session"])
        update: dict[str, Any] = {"sessions": (name,)}
        if name in STRENGTH and "amplitude" in proposal.settings:
            update[STRENGTH[name]] = float(proposal.settings["amplitude"])
        try:
            check(flight, calibration.model_copy(update=update))
        except (LimitError, ConfigError):
            return False
        return True

    return allowed


def plan(campaign: CampaignFile, part: Part | None, plugins: Sequence[Plugin]) -> CalibrationPlan:
    """The sessions a campaign file asks for; `ConfigError`."""
    del part, plugins
    return CalibrationPlan(procedure_of(campaign))


def procedure_of(campaign: CampaignFile) -> Calibration:
    """The `[procedure]` table of a campaign file; `ConfigError`."""
    model = settings_of(campaign.experiment, campaign.procedure)["procedure"]
    calibration = validated(model, campaign.procedure, campaign.path, "procedure")
    assert isinstance(calibration, Calibration)
    return calibration


def mounted(store: Store) -> Sequence[tuple[str, str, int]]:
    """Nothing is mounted in orbit."""
    del store
    return ()


def channels(rig: Instruments) -> tuple[Mapping[str, ChannelInfo], Mapping[str, LaserInfo]]:
    """The columns of telemetry but for the time."""
    return {
        channel.name: ChannelInfo(channel.unit, channel.kind, full_scale=channel.full_scale)
        for channel in flight_of(rig).satellite.channels()
        if channel.name != "t_s"
    }, {}


def further(store: Store, runs: Sequence[Proposal], campaign: CampaignFile) -> Mapping[str, Any]:
    """These sessions once more; of sessions that share a stimulus the strongest that is asked for."""
    del store
    asked: dict[str, float] = {}
    for run in runs:
        if key := STRENGTH.get(str(run.settings["session"])):
            asked[key] = max(asked.get(key, 0.0), float(run.settings.get("amplitude", 0.0)))
    strengths = {key: amplitude for key, amplitude in asked.items() if amplitude}
    sessions = list(dict.fromkeys(str(run.settings["session"]) for run in runs))
    return {**campaign.procedure, **strengths, "sessions": sessions}


def allowed(store: Store, rig: Instruments | None) -> Allowed | None:
    """What the satellite's limits leave; of a satellite that is not known what was flown already."""
    if rig is None:
        flown = {run.conditions.get("amplitude") for run in store.runs()}
        return lambda proposal: proposal.settings.get("amplitude") in {None, *flown}
    return within(flight_of(rig), procedure_of(campaign_of(store)))
