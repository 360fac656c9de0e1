"""What the console has worked out from a store, in a process of its own: each is what a command does.

Every function takes and returns what can be sent between processes; imports are inside, the console has none of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rigctl.campaign.recording import RunRecord
    from rigctl.campaign.store.store import Store

Plugins = Sequence[Path]
Found = dict[str, Any]

FEW = 8
"""Of so many runs it is also said what was known of the null after each."""


def result(store: Path, plugins: Plugins) -> Found:
    """`rigctl result`, with the null vectors of axes as figures 15 to 17 show them, else with the report's tables."""
    from rigctl.campaign.store.store import Store
    from rigctl.composition import workbench_of
    from rigctl.experiments.analysis import analysis_of
    from rigctl.files.campaign_file import parse_campaign
    from rigctl.report.drawn import drawing_of

    with Store.open(store, readonly=True) as opened:
        text, bench = opened.header.campaign_toml, workbench_of(opened, plugins)
        experiment = opened.header.experiment
        found = analysis_of(experiment, store).result(bench)
        if "axes" in found:
            from rigctl.report.experiments.sensing_axis import null_vectors

            found["planes"] = null_vectors(bench)
        else:
            found["tables"] = [asdict(table) for table in drawing_of(experiment, store).draw(bench, (), ()).tables]
    return {**found, "reference": parse_campaign(text, store).reference.model_dump() if text else {}}


def null_search(store: Path, plugins: Plugins) -> Found:
    """The signed response of the last mounting against angle, and its null, as figure 12 shows them."""
    from rigctl.analysis.plane import ARCSEC
    from rigctl.campaign.origin import campaign_of, rig_file_of
    from rigctl.campaign.store.store import Store
    from rigctl.effects.catalogue import chosen
    from rigctl.experiments.sensing_axis.model.fit import NullPoint, RecordingFit, fit_recording
    from rigctl.experiments.sensing_axis.model.model import RecordingModel
    from rigctl.experiments.sensing_axis.observe.reduction import observables, reduce_run
    from rigctl.report.figures.sensing_axis.null_search import by_frequency, response_plate

    del plugins
    with Store.open(store, readonly=True) as opened:
        records = _last_mounting(opened)
        if not records:
            return {"runs": 0}
        rig_file, campaign = rig_file_of(opened), campaign_of(opened)
        reduced = [reduce_run(r.run_id, r.conditions, opened.samples(r.run_id)) for r in records]
    if rig_file.package is None:
        return {"runs": 0}
    package, g_m_s2 = rig_file.package, rig_file.constant("g_m_s2", 9.80665)
    runs = observables(reduced, harmonics=1)
    first = runs[0]

    def fitted(count: int) -> tuple[RecordingFit, NullPoint]:
        some = runs[:count]
        one_frequency = len(by_frequency(some)) == 1
        # At one frequency roll is a shift of the null.
        wanted = [name for name in campaign.model.effects if not (one_frequency and name == "roll-gravity")]
        model = RecordingModel(some, package, rig_file.heads, g_m_s2, chosen(campaign.experiment, wanted))
        fit = fit_recording(model)
        return fit, fit.null(first.axis, first.configuration, first.mounting)

    fit, null = fitted(len(runs))
    counts = range(1, len(runs)) if len(runs) <= FEW else ()
    return {
        "sigmas": [fitted(count)[1].theta0_sigma_rad / ARCSEC for count in counts],
        "axis": first.axis,
        "configuration": first.configuration,
        "mounting": first.mounting,
        "runs": len(runs),
        "sigma_arcsec": null.theta0_sigma_rad / ARCSEC,
        "rows": [asdict(row) for row in response_plate("null", fit, runs).rows],
    }


def _last_mounting(store: Store) -> list[RunRecord]:
    records = store.runs(valid_only=True)
    if not records:
        return []
    where = ("axis", "configuration", "mounting")
    last = [records[-1].conditions.get(key) for key in where]
    return [run for run in records if [run.conditions.get(key) for key in where] == last]


def dry_run(campaign: Path, rig: Path | None, plugins: Plugins) -> Found:
    """`rigctl run --dry-run`."""
    from rigctl import runner
    from rigctl.core.errors import ConfigError
    from rigctl.files.campaign_file import read_campaign
    from rigctl.files.rig_file import read_rig

    file = read_campaign(campaign)
    if rig is None and not file.rig:
        raise ConfigError(f"{campaign}: rig is missing; name the rig file")
    return runner.dry_run(file, read_rig(rig or file.rig_path), plugins)


def model(store: Path, plugins: Plugins) -> Found:
    """`rigctl model show`, with the catalogue beside it."""
    from rigctl.campaign.store.store import Store
    from rigctl.composition import workbench_of

    with Store.open(store) as opened:
        bench = workbench_of(opened, plugins)
        return {**bench.current.as_json(), "catalogue": dict(bench.study.effects())}


def fit(store: Path, plugins: Plugins) -> Found:
    """`rigctl fit`."""
    from rigctl.campaign.store.store import Store
    from rigctl.composition import workbench_of

    with Store.open(store) as opened:
        bench = workbench_of(opened, plugins)
        version = bench.current
        return {"version": version.version, **bench.fit(version).as_json()}


def history(store: Path, plugins: Plugins) -> list[Found]:
    """`rigctl model history`."""
    from rigctl.campaign.store.store import Store
    from rigctl.composition import workbench_of

    with Store.open(store) as opened:
        return workbench_of(opened, plugins).history()


def diagnose(store: Path, plugins: Plugins) -> Found:
    """`rigctl diagnose`, with its sentences."""
    from rigctl.campaign.store.store import Store
    from rigctl.composition import workbench_of
    from rigctl.report.verdicts import inseparable_sentences, verdict_sentence

    with Store.open(store) as opened:
        found = workbench_of(opened, plugins).diagnose().as_json()
    return {**found, "sentence": verdict_sentence(found), "pairs": inseparable_sentences(found["inseparable"])}


def recommend(store: Path, plugins: Plugins) -> Found:
    """`rigctl next`."""
    from rigctl.campaign.store.store import Store
    from rigctl.composition import workbench_of

    with Store.open(store) as opened:
        return workbench_of(opened, plugins).recommend().as_json()


def residuals(store: Path, covariate: str, plugins: Plugins) -> Found:
    """`rigctl compare`, with the residuals of its figures against a covariate: "" is the one they follow most."""
    from rigctl.campaign.store.store import Store
    from rigctl.composition import workbench_of
    from rigctl.report.figures.residuals import axis_label, residual_plate
    from rigctl.report.verdicts import comparison_sentence
    from rigctl.workbench.verdict.covariates import distinct

    with Store.open(store) as opened:
        found = workbench_of(opened, plugins).compare()
    known = distinct(found.observations.covariates)
    if covariate not in known:
        followed = [trend.covariate for trend in sorted(found.trends, key=lambda trend: trend.p_value_corrected)]
        covariate = next((name for name in [*followed, *known] if name in known), "")
    rows = residual_plate(covariate, [found]).rows if covariate else []
    series: dict[str, list[tuple[float, float]]] = {}
    for row in rows:
        series.setdefault(f"{row.channel} {row.component}".strip(), []).append((row.value, row.residual_sigma))
    told = found.as_json()
    return {
        **told,
        "sentence": comparison_sentence(told),
        "covariates": known,
        "covariate": covariate,
        "label": axis_label(covariate),
        "series": series,
    }


def compare_with(store: Path, other: Path, plugins: Plugins) -> Found:
    """`rigctl compare --with`."""
    from rigctl.campaign.store.store import Store
    from rigctl.composition import workbench_of
    from rigctl.report.verdicts import transfer_sentence

    with Store.open(store) as here, Store.open(other) as there:
        found = workbench_of(here, plugins).compare_with(workbench_of(there, plugins)).as_json()
    told = {**found, "store": str(other)}
    return {**told, "sentence": transfer_sentence(told)}


def add(store: Path, effects: Sequence[str], plugins: Plugins) -> list[Found]:
    """`rigctl model add`."""
    from rigctl.campaign.store.store import Store
    from rigctl.composition import workbench_of

    with Store.open(store) as opened:
        return [version.as_json() for version in workbench_of(opened, plugins).add(effects)]


def remove(store: Path, effects: Sequence[str], plugins: Plugins) -> list[Found]:
    """`rigctl model remove`."""
    from rigctl.campaign.store.store import Store
    from rigctl.composition import workbench_of

    with Store.open(store) as opened:
        return [version.as_json() for version in workbench_of(opened, plugins).remove(effects)]
