"""The sensing axes of accelerometers on a turntable."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from procedures.sensing_axis import sensing_axes
from procedures.sensing_axis.bench import Bench, SetPoint
from procedures.sensing_axis.mounting import Mounting, Seated, mounted_in
from procedures.sensing_axis.tables import Procedure, Targets
from rigctl.analysis.plane import ARCSEC
from rigctl.campaign.origin import rig_file_of
from rigctl.campaign.recording import ChannelInfo, LaserInfo
from rigctl.core.errors import ConfigError, DataError, ProcedureError
from rigctl.effects.catalogue import chosen
from rigctl.experiments.sensing_axis.imagined import imagined
from rigctl.experiments.sensing_axis.model.fit import forecast
from rigctl.experiments.sensing_axis.model.model import RecordingModel
from rigctl.experiments.sensing_axis.observe.recorded import recorded_faces, recorded_heads, recorded_package
from rigctl.experiments.sensing_axis.observe.reduction import ACCEL, LASER_PREFIX
from rigctl.experiments.sensing_axis.observe.set_points import OVERHEAD_S, Limits
from rigctl.experiments.sensing_axis.observe.store_reduction import reduction
from rigctl.experiments.sensing_axis.result.budget import axis_budgets
from rigctl.experiments.sensing_axis.result.result import SensingAxisResult
from rigctl.experiments.sensing_axis.result.result import sensing_axes as axes_of
from rigctl.experiments.sensing_axis.study import STANDARD_G, SensingAxisStudy
from rigctl.files import config
from rigctl.kinds import Drawn
from rigctl.workbench.study import Proposal

if TYPE_CHECKING:
    from rigctl.campaign.session.session import Session
    from rigctl.campaign.store.parts import Part
    from rigctl.campaign.store.store import Store
    from rigctl.effects.plugins import Plugin
    from rigctl.kinds import Progress
    from rigctl.report.tables.result_table import ResultTable
    from rigctl.rig import Rig
    from rigctl.workbench.bench import Workbench
    from rigctl.workbench.next.recommend import Allowed

KINDS = {"readout": "accelerometer"}
"""What a channel measures where the instrument only knows what it reads."""


@dataclass(frozen=True)
class _Plan:
    """A plan of the procedures, waiting for its rig."""

    plan: sensing_axes.Plan

    @property
    def runs(self) -> int:
        return self.plan.runs

    def on(self, rig: Rig) -> _Work:
        bench = bench_of(rig)
        self.plan.check(bench)
        return _Work(bench, self.plan)

    def told(self, rig: Rig) -> Mapping[str, Any]:
        bench, points = bench_of(rig), self.plan.points
        procedure = self.plan.procedure
        noise_check_s = procedure.noise_check_s if procedure.name in sensing_axes.NULL_SEARCHES else 0.0
        return {
            "mountings": [mounting.key for mounting in self.plan.mountings],
            "theta0_sigma_arcsec": self._theta0_sigma_arcsec(bench),
            "rig_time_s": round(noise_check_s + sum(point.duration_s + OVERHEAD_S for point in points)),
        }

    def _theta0_sigma_arcsec(self, bench: Bench) -> float | None:
        """What a null search goes on to; of other procedures the worst of all mountings; None: not determined."""
        if self.plan.procedure.name in sensing_axes.NULL_SEARCHES:
            return self.plan.targets.theta0_sigma_arcsec
        return theta0_sigma_arcsec(bench, self.plan)

    def kept(self) -> Mapping[str, Any]:
        return {}


@dataclass(frozen=True)
class _Work:
    """A plan and its bench."""

    bench: Bench
    plan: sensing_axes.Plan

    def run(self, session: Session) -> None:
        sensing_axes.run(session, self.bench, self.plan)

    def rest(self) -> None:
        self.bench.rest()


def theta0_sigma_arcsec(bench: Bench, plan: sensing_axes.Plan) -> float | None:
    """What the runs of a plan would tell of the nulls, the worst of all mountings; None: not determined.

    In noise as it is assumed before anything is measured.
    """
    limits = Limits(bench.package, bench.heads, bench.readout.channels()[0].full_scale, known=True)
    runs = imagined([Proposal(_settings(point)) for point in plan.points], (), limits)
    try:
        fit = forecast(RecordingModel(runs, bench.package, bench.heads, bench.g_m_s2, plan.effects))
    except (ProcedureError, DataError):
        return None
    return float(f"{max(null.theta0_sigma_rad for null in fit.nulls()) / ARCSEC:.3g}")


def _settings(point: SetPoint) -> dict[str, Any]:
    """A set-point as a proposal says it."""
    return {
        "axis": point.axis,
        "configuration": point.configuration,
        "mounting": point.mounting,
        "angle_deg": point.theta_deg,
        "frequency_hz": point.frequency_hz,
        "amplitude_mm": point.amplitude_mm,
        "dwell_s": point.duration_s,
        "approach": point.approach,
    }


def plan(campaign: config.CampaignFile, part: Part | None, plugins: Sequence[Plugin]) -> _Plan:
    """The procedure a campaign file asks for, after what earlier campaigns have left; `ConfigError`."""
    return _Plan(plan_of(campaign, part, plugins))


def plan_of(
    campaign: config.CampaignFile, part: Part | None = None, plugins: Sequence[Plugin] = ()
) -> sensing_axes.Plan:
    """As `plan`, as the procedures know it."""
    procedure = config.validated(Procedure, campaign.procedure, campaign.path, "procedure")
    targets = config.validated(Targets, campaign.targets, campaign.path, "targets")
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


def bench_of(rig: Rig) -> Bench:
    """The sensing-axis bench of a rig; `ConfigError` when the rig file lacks a part of it."""
    if rig.file.package is None:
        raise ConfigError(f"{rig.file.path}: [package] is missing; add what is to be calibrated")
    lasers = tuple(rig.by_role("displacement"))
    columns = {channel.name for meter in lasers for channel in meter.channels()}
    readout = rig.only("readout")
    _require_names(rig.file, columns, readout.channels()[0].name)
    thermometers = rig.by_role("thermometer")
    return Bench(
        rotation=rig.only("rotation"),
        linear=rig.only("linear"),
        lasers=lasers,
        readout=readout,
        thermometer=thermometers[0] if thermometers else None,
        package=rig.file.package,
        heads={name: head for name, head in rig.file.heads.items() if name in columns},
        g_m_s2=rig.file.constant("g_m_s2", STANDARD_G),
        clock=rig.clock,
    )


def _require_names(file: config.RigFile, heads: set[str], channel: str) -> None:
    """Columns are known by their names wherever a recording goes: the rig file has to use those."""
    for name in sorted(heads):
        if not (name.startswith(LASER_PREFIX) and name.endswith("_mm")):
            raise ConfigError(f"{file.path}: heads: '{name}' is no head's name; call it {LASER_PREFIX}1_mm or alike")
        if name not in file.lasers:
            raise ConfigError(f"{file.path}: [lasers.{name}] is missing; say where the head stands")
    if channel != ACCEL:
        raise ConfigError(f"{file.path}: the readout's channel is '{channel}'; call it {ACCEL}")


def channels(rig: Rig) -> tuple[Mapping[str, ChannelInfo], Mapping[str, LaserInfo]]:
    """The columns that runs will have, and where the laser heads look."""
    found = {"stage_x_mm": ChannelInfo("mm", "position")}
    for role in ("linear", "displacement", "readout"):
        for instrument in rig.by_role(role):
            found |= {
                c.name: ChannelInfo(c.unit, KINDS.get(role, c.kind), full_scale=c.full_scale, latency_s=c.latency_s)
                for c in instrument.channels()
            }
    return found, {name: LaserInfo(tilt_deg=head.tilt_deg) for name, head in rig.file.lasers.items()}


def further(store: Store, runs: Sequence[Proposal], campaign: config.CampaignFile) -> Mapping[str, Any]:
    """A scan of these set-points in the mounting that is there."""
    like = config.validated(Procedure, campaign.procedure, campaign.path, "procedure")
    return scan_of(*place_of(store), runs, like)


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
        "runs": [{key: run.settings[key] for key in run.settings if key in _OF_A_RUN} for run in runs],
    }


_OF_A_RUN = ("angle_deg", "frequency_hz", "amplitude_mm", "approach", "dwell_s", "temperature_c")


def place_of(store: Store) -> tuple[str, str]:
    """Axis and configuration that are mounted; `DataError` before any run."""
    runs = store.runs()
    if not runs:
        raise DataError(f"{store.path} has no runs yet; nothing can be said of the next one")
    return str(runs[-1].conditions["axis"]), str(runs[-1].conditions["configuration"])


def allowed(store: Store) -> Allowed | None:
    """What the stages' limits, the recorders' memories and the sensor's range leave."""
    from rigctl.kinds.scan_limits import within

    if store.header.rig_toml is None or store.header.campaign_toml is None:
        return None
    campaign = config.parse_campaign(store.header.campaign_toml, store.path)
    procedure = config.validated(Procedure, campaign.procedure, campaign.path, "procedure")
    return within(rig_file_of(store), procedure, *place_of(store))


def reduced(store: Store, progress: Progress) -> Mapping[str, str]:
    """Their harmonics, run by run."""
    return reduction(store, progress=progress).left_out


def study(store: Store, plugins: Sequence[Plugin]) -> SensingAxisStudy:
    """A store's runs as the workbench sees them."""
    return SensingAxisStudy(store, plugins)


def result(bench: Workbench) -> dict[str, Any]:
    """Axes, angles, nulls and the uncertainty budget; after a quick check what it said."""
    store = bench.store
    quick = [event.data["result"] for event in store.events("once") if event.data["key"] == "quick check"]
    found = analyse(bench)
    budgets = axis_budgets(found, uncertainties_of(store))
    told = {**found.as_json(), "budget": {name: each.as_json() for name, each in budgets.items()}}
    return {**told, "quick_check": quick[-1]} if quick else told


def analyse(bench: Workbench) -> SensingAxisResult:
    """Fit a store's runs with its current model and find the axes; `DataError` where there are none to find."""
    store, studied = bench.store, bench.study
    if not isinstance(studied, SensingAxisStudy):
        raise DataError(f"{store.path}: '{store.header.experiment}' recordings have no sensing axes")
    effects = studied.chosen(bench.current.terms)
    header = store.header
    if header.rig_toml is None:
        heads, g_m_s2 = recorded_heads(header), float(header.constants.get("g_m_s2", STANDARD_G))
        return axes_of(store, recorded_package(header), heads, g_m_s2, effects, faces=recorded_faces(header))
    rig_file = rig_file_of(store)
    if rig_file.package is None:
        raise DataError(f"{store.path}: its rig file has no [package]")
    return axes_of(store, rig_file.package, rig_file.heads, rig_file.constant("g_m_s2", STANDARD_G), effects)


def uncertainties_of(store: Store) -> dict[str, dict[str, float]]:
    """Standard uncertainties from the rig file's certificates, by name."""
    if store.header.rig_toml is None:
        return {}
    return {name: dict(c.uncertainty) for name, c in rig_file_of(store).certificates.items()}


def null_vectors(bench: Workbench) -> dict[str, list[dict[str, Any]]]:
    """The null vectors about their planes as figures 15 to 17 show them, by axis."""
    from rigctl.report.figures.sensing_axis.plane import plane_plate

    found = analyse(bench)
    settings = found.fit.model.package.axes
    return {
        name: [asdict(row) for row in plane_plate(name, axis, settings[name]).rows]
        for name, axis in found.axes.items()
    }


def show(found: Mapping[str, Any], reference: Mapping[str, Any]) -> None:
    """Print axes, angles and budget."""
    from rigctl.report.terminal import print_result

    print_result(found, reference)


def draw(bench: Workbench, lines_hz: Sequence[float], found: Sequence[Any]) -> Drawn:
    """The axes with their figures, and the spectrum of what is left in the samples."""
    from rigctl.report.figures.sensing_axis.figures import plates_of
    from rigctl.report.figures.spectrum import spectrum_plates

    spectra = list(spectrum_plates(bench.store, lines_hz, found))
    try:
        axes = analyse(bench)
        plates, left_out = plates_of(axes, uncertainties_of(bench.store))
    except (ProcedureError, DataError) as error:
        return Drawn(spectra=spectra, left_out={"figures of the sensing axes": str(error)})
    told = axes.as_json()
    return Drawn(told, _tables(told), plates, spectra, left_out)


def _tables(told: Mapping[str, Any]) -> list[ResultTable]:
    """Sensing axes and the angles between them, as far as there are any."""
    from rigctl.report.quantities import number, quantity
    from rigctl.report.tables.result_table import ResultTable

    axes, angles = told["axes"], told["angles"]
    tables = []
    if axes:
        rows = [
            [
                name,
                *(f"{component:+.6f}" for component in axis["coc"]),
                f"{axis['std_hc_2sigma_arcsec']:.2f}",
                number(axis["requirement_arcsec"]),
                str(axis["vectors"]),
                "pass" if axis["pass"] else "fail",
            ]
            for name, axis in axes.items()
        ]
        columns = ["axis", "#x", "#y", "#z", "#half-cone / arcsec", "#required / arcsec", "#vectors", "verdict"]
        sentence = "Sensing axes in the cube's frame, with their half-cone deviation at 2 sigma."
        tables.append(ResultTable(sentence, columns, rows, [not axis["pass"] for axis in axes.values()]))
    if angles:
        rows = [[pair, quantity(angle["deg"], angle["sigma_deg"], "deg")] for pair, angle in angles.items()]
        tables.append(ResultTable("Angles between the axes.", ["axes", "#angle between them"], rows))
    return tables
