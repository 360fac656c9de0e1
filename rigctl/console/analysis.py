"""What the console has worked out from a store, in a process of its own: each is what a command does.

Every function takes and returns what can be sent between processes. Only that process imports this module.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rigctl import results, runner
from rigctl.campaign.bundle.bundle import write_bundle
from rigctl.campaign.store.store import Store
from rigctl.certificate import issue
from rigctl.certificate.content import certificate_of
from rigctl.composition import opened_workbench
from rigctl.core.clock import utc_now
from rigctl.core.errors import ConfigError
from rigctl.files.campaign_file import read_campaign
from rigctl.files.certificate_file import CertificateDetails
from rigctl.files.rig_file import read_rig
from rigctl.report.document import write_report
from rigctl.report.drawn import DrawingForConsole, drawing_of
from rigctl.report.figures.residuals import axis_label, residual_plate
from rigctl.report.picture import Picture
from rigctl.report.tables.result_table import ResultTable
from rigctl.report.verdicts import comparison_sentence
from rigctl.report.watch import Watch, watch
from rigctl.workbench.verdict.covariates import distinct

Plugins = Sequence[Path]
Json = dict[str, Any]


def result(store: Path, plugins: Plugins) -> tuple[Sequence[ResultTable], Sequence[Picture]]:
    """`rigctl result`, and the plots its experiment has for the console."""
    with opened_workbench(store, plugins, readonly=True) as workbench:
        drawing = drawing_of(workbench.store.header.experiment, store)
        tables = drawing.tables(results.of_workbench(workbench), results.reference_of(workbench.store))
        return tables, drawing.pictures(workbench) if isinstance(drawing, DrawingForConsole) else ()


def watched(store: Path, plugins: Plugins) -> Watch:
    """What is looked at while runs come."""
    with opened_workbench(store, plugins, readonly=True) as workbench:
        return watch(workbench)


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
        return workbench.fit(workbench.current).as_json()


def history(store: Path, plugins: Plugins) -> list[Json]:
    """`rigctl model history`."""
    with opened_workbench(store, plugins) as workbench:
        return workbench.history()


def diagnose(store: Path, plugins: Plugins) -> Json:
    """`rigctl diagnose`."""
    with opened_workbench(store, plugins) as workbench:
        return workbench.diagnose().as_json()


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
        # Asked for none, or for one that was remembered from another store.
        followed = [trend.covariate for trend in sorted(comparison.trends, key=lambda trend: trend.p_value_corrected)]
        covariate = next((name for name in [*followed, *covariates] if name in covariates), "")
    rows = residual_plate(covariate, [comparison]).rows if covariate else []
    series: dict[str, list[tuple[float, float]]] = {}
    for row in rows:
        series.setdefault(f"{row.channel} {row.component}".strip(), []).append((row.value, row.residual_sigma))
    return {
        "sentence": comparison_sentence(comparison.as_json()),
        "covariates": covariates,
        "covariate": covariate,
        "label": axis_label(covariate),
        "series": series,
    }


def compare_with(store: Path, other: Path, plugins: Plugins) -> Json:
    """`rigctl compare --with`."""
    with opened_workbench(store, plugins) as here, opened_workbench(other, plugins) as there:
        return {**here.compare_with(there).as_json(), "store": str(other)}


def mark(store: Path, run_id: str, valid: bool, reason: str, plugins: Plugins) -> Json:
    """`rigctl mark`."""
    del plugins
    with Store.open(store) as opened:
        opened.mark(run_id, valid, reason)
    return {"run_id": run_id, "valid": valid, "reason": reason}


def write(store: Path, kind: str, path: Path, plugins: Plugins) -> Json:
    """`rigctl report`, `certificate` or `export`, by one of `rigctl.console.writing.KINDS`."""
    if kind == "bundle":
        with Store.open(store, readonly=True) as opened:
            write_bundle(opened, path)
        return {"written": str(path)}
    if kind == "certificate":
        issue.form_of(path)
    with opened_workbench(store, plugins) as workbench:
        if kind == "certificate":
            made = certificate_of(workbench, CertificateDetails(), utc_now(), unfinished=False, tell=_nobody)
            issue.write(made, path)
        else:
            page, figures = (path, None) if kind == "report" else (None, path)
            write_report(workbench, page, figures, _nobody)
    return {"written": str(path)}


def _nobody(line: str) -> None:
    """Progress of what the console shows as one job."""


def add(store: Path, effects: Sequence[str], plugins: Plugins) -> list[Json]:
    """`rigctl model add`."""
    with opened_workbench(store, plugins) as workbench:
        return [version.as_json() for version in workbench.add(effects)]


def remove(store: Path, effects: Sequence[str], plugins: Plugins) -> list[Json]:
    """`rigctl model remove`."""
    with opened_workbench(store, plugins) as workbench:
        return [version.as_json() for version in workbench.remove(effects)]
