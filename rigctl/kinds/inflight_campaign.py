"""The campaigns of the in-flight calibration: what a campaign file asks for, on the satellite of a rig file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from procedures.inflight.calibration import Calibration, Flight, MonteCarlo, calibrate, check
from rigctl.campaign.recording import ChannelInfo
from rigctl.core.errors import ConfigError, LimitError
from rigctl.files import config
from rigctl.kinds.inflight_monte_carlo import MonteCarloPlan
from rigctl.rig import Rig

if TYPE_CHECKING:
    from rigctl.campaign.session.session import Session
    from rigctl.workbench.next.recommend import Allowed
    from rigctl.workbench.study import Proposal

ORBIT = ("orbit_period_s", "eccentricity")


@dataclass(frozen=True)
class CalibrationPlan:
    """One calibration, waiting for its satellite."""

    calibration: Calibration

    @property
    def runs(self) -> int:
        """One per session."""
        return len(self.calibration.sessions)

    def on(self, rig: Rig) -> CalibrationWork:
        """With the satellite of a rig."""
        flight = flight_of(rig)
        check(flight, self.calibration)
        return CalibrationWork(flight, self.calibration)

    def told(self, rig: Rig) -> Mapping[str, Any]:
        """Sessions, and how long they are together."""
        del rig
        sessions = self.calibration.sessions
        return {"sessions": list(sessions), "orbits": sum(self.calibration.orbits_of(name) for name in sessions)}

    def kept(self) -> Mapping[str, Any]:
        """Nothing beside the campaign file."""
        return {}


@dataclass(frozen=True)
class CalibrationWork:
    """One calibration on its satellite."""

    flight: Flight
    calibration: Calibration

    def run(self, session: Session) -> None:
        """Carry it out."""
        session.plan(len(self.calibration.sessions))
        calibrate(session, self.flight, self.calibration)

    def rest(self) -> None:
        """Nothing moves that could rest."""


STRENGTH = {
    **dict.fromkeys(("ad11", "ad12", "ad13", "k2d"), "common_m_s2"),
    "dy": "turn_rad",
    **dict.fromkeys(("ac12", "ac13"), "displacement_m"),
    **dict.fromkeys(("k2c_1", "k2c_2"), "quadratic_m"),
}
"""Where a campaign file says how strong a session's stimulus is."""


_SOME_WORLD = {"kind": "drag-free-satellite", "seed": 0}


def within(rig_file: config.RigFile, calibration: Calibration) -> Allowed:
    """Whether a rig's satellite can fly a proposal; what that does not say is as in `calibration`."""
    # Any world will do for the limits; a store's is nobody's business.
    flight = flight_of(Rig(rig_file.model_copy(update={"world": _SOME_WORLD})))

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


def plan_of(campaign: config.CampaignFile) -> CalibrationPlan | MonteCarloPlan:
    """What a campaign file asks for; `ConfigError`."""
    procedure = procedure_of(campaign)
    return MonteCarloPlan(procedure) if isinstance(procedure, MonteCarlo) else CalibrationPlan(procedure)


def procedure_of(campaign: config.CampaignFile) -> Calibration:
    """The `[procedure]` table of a campaign file; `ConfigError`."""
    model: type[Calibration] = MonteCarlo if campaign.procedure.get("name") == "monte-carlo" else Calibration
    return config.validated(model, campaign.procedure, campaign.path, "procedure")


def flight_of(rig: Rig) -> Flight:
    """The satellite of a rig and its orbit; `ConfigError` when the rig file lacks one."""
    for name in ORBIT:
        if name not in rig.file.constants:
            raise ConfigError(f"{rig.file.path}: [constants.{name}] is missing; add what is believed of the orbit")
    period_s, eccentricity = (rig.file.constants[name].value for name in ORBIT)
    if not (1.0 <= period_s <= 1e9 and 0.0 <= eccentricity < 1.0):
        raise ConfigError(
            f"{rig.file.path}: constants: no orbit has a period of {period_s:g} s and e = {eccentricity:g}"
        )
    return Flight(rig.only("satellite"), period_s, eccentricity)


def channels(rig: Rig) -> Mapping[str, ChannelInfo]:
    """The columns of telemetry but for the time."""
    return {
        channel.name: ChannelInfo(channel.unit, channel.kind, full_scale=channel.full_scale)
        for channel in flight_of(rig).satellite.channels()
        if channel.name != "t_s"
    }
