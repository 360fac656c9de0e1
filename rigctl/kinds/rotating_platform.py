"""Two accelerometers on a rotating platform: acceleration told from the accelerometers' own bias."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from procedures.rotating_platform import bias_rejection
from procedures.rotating_platform.bench import TILT_Y, TILT_Z, PlatformBench
from procedures.rotating_platform.tables import Procedure
from rigctl.campaign.bundle.layout import ROTATING_PLATFORM
from rigctl.campaign.origin import rig_file_of
from rigctl.campaign.recording import ChannelInfo, LaserInfo
from rigctl.core.errors import ConfigError, DataError, ProcedureError
from rigctl.core.interfaces import TimedRotationStage
from rigctl.experiments.rotating_platform.observe.bench_runs import flips, noise_records, scans
from rigctl.experiments.rotating_platform.observe.recorded import chains
from rigctl.experiments.rotating_platform.observe.store_reduction import reduction
from rigctl.experiments.rotating_platform.result.alignment import Value
from rigctl.experiments.rotating_platform.result.result import PlatformResult, platform_result
from rigctl.experiments.rotating_platform.study import PlatformStudy
from rigctl.files import config
from rigctl.kinds import Drawn
from rigctl.workbench.verdict.fit import fit

if TYPE_CHECKING:
    from rigctl.campaign.session.session import Session
    from rigctl.campaign.store.parts import Part
    from rigctl.campaign.store.store import Store
    from rigctl.effects.plugins import Plugin
    from rigctl.kinds import Progress
    from rigctl.rig import Rig
    from rigctl.workbench.bench import Workbench
    from rigctl.workbench.next.recommend import Allowed
    from rigctl.workbench.study import Proposal

Q_A, Q_B = "q_a_v", "q_b_v"


@dataclass(frozen=True)
class _Plan:
    """A plan of the procedures, waiting for its rig."""

    plan: bias_rejection.Plan

    @property
    def runs(self) -> int:
        return len(self.plan.recordings)

    def on(self, rig: Rig) -> _Work:
        bench = bench_of(rig, self.plan.procedure)
        self.plan.check(bench)
        return _Work(bench, self.plan)

    def told(self, rig: Rig) -> Mapping[str, Any]:
        del rig
        recordings = self.plan.recordings
        return {
            "recorded_h": round(sum(each.wanted.table.duration_s for each in recordings) / 3600.0, 2),
            "samples": sum(each.wanted.samples for each in recordings),
            "patterns": [f"{label}: {said}" for label, found in self.plan.separations.items() for said in found.says],
        }

    def kept(self) -> Mapping[str, Any]:
        dwells = self.plan.custom_dwells
        return {"patterns": dwells} if dwells else {}


@dataclass(frozen=True)
class _Work:
    """A plan and its bench."""

    bench: PlatformBench
    plan: bias_rejection.Plan

    def run(self, session: Session) -> None:
        self._require_patterns(session.store)
        bias_rejection.run(session, self.bench, self.plan)

    def _require_patterns(self, store: Store) -> None:
        """A recording's custom patterns are those it began with: a later campaign can only use them again."""
        kept, wanted = (
            set(zip(*columns.values(), strict=True))
            for columns in (store.header.extra.get("patterns", {}), self.plan.custom_dwells)
        )
        if not wanted <= kept:
            raise ConfigError(f"{store.path}: it did not begin with these custom patterns; run them into a new store")

    def rest(self) -> None:
        self.bench.rest()


def plan(campaign: config.CampaignFile, part: Part | None, plugins: Sequence[Plugin]) -> _Plan:
    """The recordings a campaign file asks for; `ConfigError`, also for a pattern that does not reject enough."""
    del part, plugins
    procedure = config.validated(Procedure, campaign.procedure, campaign.path, "procedure")
    found = bias_rejection.Plan(procedure)
    try:
        _ = found.recordings
    except ConfigError as error:
        raise ConfigError(f"{campaign.path}: {error}") from None
    return _Plan(found)


def mounted(store: Store) -> Sequence[tuple[str, str, int]]:
    """Nothing is mounted anew."""
    del store
    return ()


def bench_of(rig: Rig, procedure: Procedure) -> PlatformBench:
    """The platform's bench of a rig; `ConfigError` when the rig file lacks a part of it."""
    path, platform, readout = rig.file.path, rig.only("rotation"), rig.only("readout")
    if not isinstance(platform, TimedRotationStage):
        raise ConfigError(f"{path}: {platform.name} cannot be told how long a turn takes; a newport-xps can")
    voltmeter, source = rig.only("voltmeter"), rig.only("source")
    for meter, name in ((readout, Q_A), (voltmeter, Q_B)):
        if (channel := meter.channels()[0].name) != name:
            raise ConfigError(f"{path}: the channel of {meter.name} is '{channel}'; call it {name}")
    if {channel.name for channel in source.channels()} != {TILT_Y, TILT_Z}:
        raise ConfigError(f"{path}: the outputs of {source.name} have to be {TILT_Y} and {TILT_Z}")
    for name in ROTATING_PLATFORM.constants:
        if name not in rig.file.constants:
            raise ConfigError(f"{path}: [constants.{name}] is missing; add it")
    thermometers = rig.by_role("thermometer")
    return PlatformBench(
        platform=platform,
        readout=readout,
        voltmeter=voltmeter,
        source=source,
        thermometer=thermometers[0] if thermometers else None,
        clock=rig.clock,
        gains_v_per_m_s2=(
            rig.file.constants["gain_q_a_v_per_m_s2"].value,
            rig.file.constants["gain_q_b_v_per_m_s2"].value,
        ),
        settle_s=procedure.settle_s,
        temperature_every_s=procedure.temperature_every_s,
    )


def channels(rig: Rig) -> tuple[Mapping[str, ChannelInfo], Mapping[str, LaserInfo]]:
    """The columns that runs will have; there are no laser heads."""
    found = {
        "theta_deg": ChannelInfo("deg", "angle"),
        "moving": ChannelInfo("", "flag"),
        "temperature_c": ChannelInfo("degC", "temperature"),
    }
    for role in ("readout", "voltmeter"):
        for instrument in rig.by_role(role):
            found |= {
                c.name: ChannelInfo(c.unit, "accelerometer", full_scale=c.full_scale, latency_s=c.latency_s)
                for c in instrument.channels()
            }
    # What the source may give at most is no full scale: at its limit it is not saturated.
    commands = (c for instrument in rig.by_role("source") for c in instrument.channels())
    return found | {c.name: ChannelInfo(c.unit, "command", latency_s=c.latency_s) for c in commands}, {}


def further(store: Store, runs: Sequence[Proposal], campaign: config.CampaignFile) -> Mapping[str, Any]:
    """These recordings, rotations and guards as in the campaign there was."""
    del store
    return {**campaign.procedure, "runs": [dict(run.settings) for run in runs]}


def allowed(store: Store) -> Allowed | None:
    """What patterns, the platform's limits and the source's leave."""
    from rigctl.kinds.platform_limits import within

    if store.header.rig_toml is None or store.header.campaign_toml is None:
        return None
    campaign = config.parse_campaign(store.header.campaign_toml, store.path)
    return within(rig_file_of(store), config.validated(Procedure, campaign.procedure, campaign.path, "procedure"))


def reduced(store: Store, progress: Progress) -> Mapping[str, str]:
    """Their cells, run by run."""
    return reduction(store, progress=progress).left_out


def study(store: Store, plugins: Sequence[Plugin]) -> PlatformStudy:
    """A store's modulated runs as the workbench sees them."""
    return PlatformStudy(store, plugins)


def result(bench: Workbench) -> dict[str, Any]:
    """Tilt gain, accelerations, wobbles; of every run means and precision; scans, flips and noise records."""
    store, believed = bench.store, chains(bench.store.header)
    scanned, _ = scans(store, believed)
    noises, _ = noise_records(store)
    turned = flips(store, believed)
    return {
        **analyse(bench).as_json(),
        "scans": [each.as_json() for each in scanned],
        "flips": {channel: flipped.as_json() for channel, flipped in turned.items()},
        "noise": [each.as_json() for each in noises],
    }


def analyse(bench: Workbench) -> PlatformResult:
    """Fit a store's runs with its current model, and go through them one by one; `DataError`, `ProcedureError`."""
    studied = bench.study
    if not isinstance(studied, PlatformStudy):
        raise DataError(f"{bench.store.path}: '{bench.store.header.experiment}' recordings have no platform")
    found = fit(studied, bench.current.terms).parameters
    fitted = {name: Value(each.value, each.sigma) for name, each in found.items()}
    return platform_result(studied.recorded, chains(bench.store.header), fitted, studied.left_out)


def show(found: Mapping[str, Any], reference: Mapping[str, Any]) -> None:
    """Print the recording's numbers and a table of its runs."""
    from rigctl.report.tables.rotating_platform import print_platform

    del reference
    print_platform(found)


def draw(bench: Workbench, lines_hz: Sequence[float], found: Sequence[Any]) -> Drawn:
    """Figures 5, 7, 8, 9 and table 4 as far as the runs allow, the noise, and the tables of the result."""
    from rigctl.report.figures.rotating_platform.figures import plates_of
    from rigctl.report.tables.rotating_platform import tables

    del lines_hz, found
    believed = chains(bench.store.header)
    scanned, why_not = scans(bench.store, believed)
    noises, silent = noise_records(bench.store)
    try:
        told = analyse(bench)
    except (ProcedureError, DataError) as error:
        return Drawn(left_out={"figures of the platform": str(error), **why_not, **silent})
    plates, left_out = plates_of(told, believed, scanned, noises)
    shown = told.as_json()
    return Drawn(shown, tables(shown), plates, left_out={**left_out, **why_not, **silent})
