"""In-flight calibration of a drag-free differential accelerometer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rigctl.campaign.origin import rig_file_of
from rigctl.core.errors import DataError, ProcedureError
from rigctl.experiments.inflight.observe import recorded
from rigctl.experiments.inflight.result.monte_carlo import DRAW, Draw, tables
from rigctl.experiments.inflight.result.result import calibration
from rigctl.experiments.inflight.study import InflightStudy
from rigctl.files import config
from rigctl.kinds import Drawn, inflight_campaign

if TYPE_CHECKING:
    from rigctl.campaign.recording import ChannelInfo, LaserInfo
    from rigctl.campaign.store.parts import Part
    from rigctl.campaign.store.store import Store
    from rigctl.effects.plugins import Plugin
    from rigctl.files.config import CampaignFile
    from rigctl.kinds import Plan, Progress
    from rigctl.report.figures.data import Plate
    from rigctl.rig import Rig
    from rigctl.workbench.bench import Workbench
    from rigctl.workbench.findings import ModelFit
    from rigctl.workbench.next.recommend import Allowed
    from rigctl.workbench.study import Proposal


def plan(campaign: CampaignFile, part: Part | None, plugins: Sequence[Plugin]) -> Plan:
    """The sessions a campaign file asks for; `ConfigError`."""
    del part, plugins
    return inflight_campaign.plan_of(campaign)


def mounted(store: Store) -> Sequence[tuple[str, str, int]]:
    """Nothing is mounted in orbit."""
    del store
    return ()


def channels(rig: Rig) -> tuple[Mapping[str, ChannelInfo], Mapping[str, LaserInfo]]:
    """The columns of telemetry."""
    return inflight_campaign.channels(rig), {}


def further(store: Store, runs: Sequence[Proposal], campaign: CampaignFile) -> Mapping[str, Any]:
    """These sessions once more; of sessions that share a stimulus the strongest that is asked for."""
    del store
    asked: dict[str, float] = {}
    for run in runs:
        if key := inflight_campaign.STRENGTH.get(str(run.settings["session"])):
            asked[key] = max(asked.get(key, 0.0), float(run.settings.get("amplitude", 0.0)))
    strengths = {key: amplitude for key, amplitude in asked.items() if amplitude}
    sessions = list(dict.fromkeys(str(run.settings["session"]) for run in runs))
    return {**campaign.procedure, **strengths, "sessions": sessions}


def allowed(store: Store) -> Allowed | None:
    """What the satellite's limits leave; of a satellite that is not known what was flown already."""
    if store.header.rig_toml is None or store.header.campaign_toml is None:
        flown = {run.conditions.get("amplitude") for run in store.runs()}
        return lambda proposal: proposal.settings.get("amplitude") in {None, *flown}
    campaign = config.parse_campaign(store.header.campaign_toml, store.path)
    return inflight_campaign.within(rig_file_of(store), inflight_campaign.procedure_of(campaign))


def reduced(store: Store, progress: Progress) -> Mapping[str, str]:
    """Their lines, run by run."""
    return recorded.reduction(store, progress=progress).left_out


def study(store: Store, plugins: Sequence[Plugin]) -> InflightStudy:
    """A store's runs as the workbench sees them."""
    return InflightStudy(store, plugins)


@dataclass(frozen=True)
class InflightResult:
    """`numbers` as `rigctl result --json` has them; `fit` is None for a Monte Carlo study."""

    numbers: Mapping[str, Any]
    fit: ModelFit | None = None

    def as_json(self) -> dict[str, Any]:
        """Keys of `rigctl result --json`."""
        return dict(self.numbers)


def result(bench: Workbench) -> dict[str, Any]:
    """The ten parameters of one calibration; of a Monte Carlo study the paper's tables 2 and 3."""
    return analyse(bench).as_json()


def analyse(bench: Workbench) -> InflightResult:
    """A calibration fitted with its current model, or all draws of a Monte Carlo study; `DataError`."""
    from rigctl.workbench.verdict.fit import fit

    draws = [Draw.from_json(document.data) for document in bench.store.documents(DRAW)]
    if draws:
        return InflightResult(tables(draws))
    studied = bench.study
    assert isinstance(studied, InflightStudy)
    version = bench.current
    fitted = fit(studied, version.terms)
    numbers = calibration(studied, fitted.as_json()["parameters"])
    return InflightResult({"version": version.version, **numbers}, fitted)


def show(found: Mapping[str, Any], reference: Mapping[str, Any]) -> None:
    """Print the tables, and what is to be said of runs."""
    from rigctl.report.tables.inflight import result_tables
    from rigctl.report.tables.terminal import print_tables

    del reference
    print_tables(result_tables(found), found.get("remarks", ()))


def draw(bench: Workbench, lines_hz: Sequence[float], found: Sequence[Any]) -> Drawn:
    """The tables of the result with their figures."""
    from rigctl.report.figures.inflight.figures import contributions_plate, errors_plate, estimates_plate
    from rigctl.report.tables.inflight import result_tables

    del lines_hz, found
    try:
        told = result(bench)
    except (ProcedureError, DataError) as error:
        return Drawn(left_out={"result of the calibration": str(error)})
    study_plates: list[Plate[Any]] = [errors_plate(told), contributions_plate(told)] if "table2" in told else []
    return Drawn(told, result_tables(told), study_plates or [estimates_plate(told)])
