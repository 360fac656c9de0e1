"""The campaigns of the in-flight calibration: what a campaign file asks for, on the satellite of a rig file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from procedures.campaigns import Instruments, Plan, Work
from procedures.inflight.bench import Flight, flight_of
from procedures.inflight.calibration import calibrate, check
from procedures.inflight.tables import Calibration, SessionStimulus
from rigctl.campaign.origin import campaign_of
from rigctl.campaign.recording import ChannelInfo, LaserInfo
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.parts import Part
from rigctl.campaign.store.store import Store
from rigctl.core.errors import ConfigError, LimitError
from rigctl.effects.plugins import Plugin
from rigctl.experiments.inflight.observe.sessions import fewest_orbits
from rigctl.files.campaign_file import CampaignFile, settings_of
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

    def forecast(self, rig: Instruments) -> Mapping[str, Any]:
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


_STIMULUS = {"amplitude": "amplitude", "frequency_hz": "calibration_frequency_hz", "phase_rad": "phase_rad"}
"""Keys of a campaign file's stimulus, and the names of proposals and runs."""


def within(flight: Flight, calibration: Calibration) -> Allowed:
    """Whether a satellite can fly a proposal; what that does not say is as in `calibration`."""

    def allowed(proposal: Proposal) -> bool:
        asked = _asked([proposal])
        try:
            stimuli = {name: SessionStimulus(**each) for name, each in asked["stimuli"].items()}
            check(flight, calibration.model_copy(update={**asked, "stimuli": stimuli}))
        except (LimitError, ConfigError, ValidationError):
            return False
        return True

    return allowed


def plan(campaign: CampaignFile, part: Part | None, plugins: Sequence[Plugin]) -> CalibrationPlan:
    """The sessions a campaign file asks for; `ConfigError`."""
    del part, plugins
    calibration = procedure_of(campaign)
    _require_long_enough(calibration, campaign)
    return CalibrationPlan(calibration)


def _require_long_enough(calibration: Calibration, campaign: CampaignFile) -> None:
    """`ConfigError` for sessions whose runs would all be left out of the result."""
    for name in calibration.sessions:
        orbits, least = calibration.orbits_of(name), fewest_orbits(name)
        if orbits < least:
            raise ConfigError(
                f"{campaign.path}: procedure.{calibration.orbits_key(name)}: {orbits:g} orbits of session {name} are "
                f"too few to tell its lines apart; take at least {least:g}"
            )


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
        # Of gravity only sessions of the test have columns.
        if channel.name != "t_s" and channel.kind != "gravity"
    }, {}


def further(store: Store, runs: Sequence[Proposal], campaign: CampaignFile) -> Mapping[str, Any]:
    """These sessions once more, each once: of several stimuli of one session, the one that is proposed most often."""
    del store
    return {**campaign.procedure, **_asked(runs)}


def _asked(runs: Sequence[Proposal]) -> dict[str, Any]:
    """`sessions` and `stimuli` of a procedure that flies what is proposed."""
    by_session: dict[str, Counter[tuple[tuple[str, float], ...]]] = {}
    for run in runs:
        stimulus = {key: float(run.settings[name]) for key, name in _STIMULUS.items() if name in run.settings}
        by_session.setdefault(str(run.settings["session"]), Counter())[tuple(stimulus.items())] += 1
    # A campaign flies each session once; the stimulus that is proposed most often tells most.
    chosen = {name: dict(stimuli.most_common(1)[0][0]) for name, stimuli in by_session.items()}
    return {"sessions": list(chosen), "stimuli": {name: stimulus for name, stimulus in chosen.items() if stimulus}}


def allowed(store: Store, rig: Instruments | None) -> Allowed | None:
    """What the satellite's limits leave; of a satellite that is not known what was flown already."""
    if rig is None:
        # Limits that are not known are at least as wide as what was flown.
        flown = [_settings(run.conditions) for run in store.runs()]
        return lambda proposal: _settings(proposal.settings) in flown
    return within(flight_of(rig), procedure_of(campaign_of(store)))


def _settings(settings: Mapping[str, Any]) -> dict[str, Any]:
    """A session and its stimulus; what is not given is zero."""
    return {"session": settings["session"], **{name: settings.get(name) or 0.0 for name in _STIMULUS.values()}}
