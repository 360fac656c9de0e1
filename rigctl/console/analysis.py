"""What the console has worked out from a store, in a process of its own: each is what a command does.

Every function takes and returns what can be sent between processes. Only that process imports this module.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rigctl import results, runner
from rigctl.campaign.store.store import Store
from rigctl.composition import opened_workbench
from rigctl.core.errors import ConfigError
from rigctl.files.campaign_file import read_campaign
from rigctl.files.rig_file import read_rig
from rigctl.report.drawn import DrawingOfNulls, drawing_of
from rigctl.report.figures.residuals import axis_label, residual_plate
from rigctl.report.verdicts import comparison_sentence, inseparable_sentences, transfer_sentence, verdict_sentence
from rigctl.workbench.verdict.covariates import distinct

Plugins = Sequence[Path]
Json = dict[str, Any]


def result(store: Path, plugins: Plugins) -> Json:
    """`rigctl result`, with the null vectors of axes as figures 15 to 17 show them, else with the report's tables."""
    with opened_workbench(store, plugins, readonly=True) as workbench:
        found = {**results.of_workbench(workbench), "reference": results.reference_of(workbench.store)}
        drawing = drawing_of(workbench.store.header.experiment, store)
        if isinstance(drawing, DrawingOfNulls):
            found["planes"] = drawing.null_vectors(workbench)
        else:
            found["tables"] = [asdict(table) for table in drawing.draw(workbench, (), ()).tables]
    return found


def null_search(store: Path, plugins: Plugins) -> Json:
    """The null of the last mounting, while it is searched; empty where none is."""
    del plugins
    with Store.open(store, readonly=True) as opened:
        drawing = drawing_of(opened.header.experiment, store)
        return drawing.null_search(opened) if isinstance(drawing, DrawingOfNulls) else {}


def dry_run(campaign: Path, plugins: Plugins) -> Json:
    """`rigctl run --dry-run`."""
    file = read_campaign(campaign)
    if not file.rig:
        raise ConfigError(f"{campaign}: rig is missing; name the rig file")
    return runner.dry_run(file, read_rig(file.rig_path), plugins)


def model(store: Path, plugins: Plugins) -> Json:
    """`rigctl model show`, with the catalogue beside it."""
    with opened_workbench(store, plugins) as workbench:
        return {**workbench.current.as_json(), "catalogue": dict(workbench.study.effects())}


def fit(store: Path, plugins: Plugins) -> Json:
    """`rigctl fit`."""
    with opened_workbench(store, plugins) as workbench:
        version = workbench.current
        return {"version": version.version, **workbench.fit(version).as_json()}


def history(store: Path, plugins: Plugins) -> list[Json]:
    """`rigctl model history`."""
    with opened_workbench(store, plugins) as workbench:
        return workbench.history()


def diagnose(store: Path, plugins: Plugins) -> Json:
    """`rigctl diagnose`, with its sentences."""
    with opened_workbench(store, plugins) as workbench:
        found = workbench.diagnose().as_json()
    return {**found, "sentence": verdict_sentence(found), "pairs": inseparable_sentences(found["inseparable"])}


def recommend(store: Path, plugins: Plugins) -> Json:
    """`rigctl next`."""
    with opened_workbench(store, plugins) as workbench:
        return workbench.recommend().as_json()


def residuals(store: Path, covariate: str, plugins: Plugins) -> Json:
    """`rigctl compare`, with the residuals of its figures against a covariate: "" is the one they follow most."""
    with opened_workbench(store, plugins) as workbench:
        comparison = workbench.compare()
    covariates = distinct(comparison.observations.covariates)
    if covariate not in covariates:
        followed = [trend.covariate for trend in sorted(comparison.trends, key=lambda trend: trend.p_value_corrected)]
        covariate = next((name for name in [*followed, *covariates] if name in covariates), "")
    rows = residual_plate(covariate, [comparison]).rows if covariate else []
    series: dict[str, list[tuple[float, float]]] = {}
    for row in rows:
        series.setdefault(f"{row.channel} {row.component}".strip(), []).append((row.value, row.residual_sigma))
    numbers = comparison.as_json()
    return {
        **numbers,
        "sentence": comparison_sentence(numbers),
        "covariates": covariates,
        "covariate": covariate,
        "label": axis_label(covariate),
        "series": series,
    }


def compare_with(store: Path, other: Path, plugins: Plugins) -> Json:
    """`rigctl compare --with`."""
    with opened_workbench(store, plugins) as here, opened_workbench(other, plugins) as there:
        found = {**here.compare_with(there).as_json(), "store": str(other)}
    return {**found, "sentence": transfer_sentence(found)}


def add(store: Path, effects: Sequence[str], plugins: Plugins) -> list[Json]:
    """`rigctl model add`."""
    with opened_workbench(store, plugins) as workbench:
        return [version.as_json() for version in workbench.add(effects)]


def remove(store: Path, effects: Sequence[str], plugins: Plugins) -> list[Json]:
    """`rigctl model remove`."""
    with opened_workbench(store, plugins) as workbench:
        return [version.as_json() for version in workbench.remove(effects)]
