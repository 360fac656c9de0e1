"""What the console has worked out from a store, in a process of its own: each is what a command does.

Every function takes and returns what can be sent between processes. Only that process imports this module.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rigctl import planning, results, runner
from rigctl.campaign.bundle.bundle import write_bundle
from rigctl.campaign.store.store import Store
from rigctl.certificate.issue import issue
from rigctl.composition import opened_workbench
from rigctl.core.errors import ConfigError
from rigctl.core.whole_file import writing
from rigctl.effects.plugins import load
from rigctl.files.campaign_file import read_campaign
from rigctl.files.certificate_file import CertificateDetails
from rigctl.files.rig_file import read_rig
from rigctl.report.document import write_report
from rigctl.report.drawn import DrawingForConsole, drawing_of
from rigctl.report.figures.residuals import axis_label, residual_plate
from rigctl.report.picture import Picture
from rigctl.report.recorded_run import recorded_run
from rigctl.report.shown import RecordedRun, Watch
from rigctl.report.tables.result_table import ResultTable
from rigctl.report.verdicts import comparison_sentence
from rigctl.report.watch import watch
from rigctl.workbench.draft import drafted
from rigctl.workbench.verdict.covariates import distinct
from rigctl.workbench.workbench import Workbench

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


def run(store: Path, run_id: str, plugins: Plugins) -> RecordedRun:
    """What a run recorded; nothing of it is changed."""
    with opened_workbench(store, plugins, readonly=True) as workbench:
        return recorded_run(workbench, run_id)


def residuals(store: Path, covariate: str, version: int, plugins: Plugins) -> Json:
    """`rigctl compare` of a model version, 0 for the current one, with the residuals of its figures against a
    covariate: "" is the one they follow most."""
    with opened_workbench(store, plugins) as workbench:
        comparison = workbench.compare(workbench.version(version) if version else None)
    covariates = distinct(comparison.observations.covariates)
    if covariate not in covariates:
        # Asked for none, or for one that was remembered from another store.
        followed = [trend.covariate for trend in sorted(comparison.trends, key=lambda trend: trend.p_value_corrected)]
        covariate = next((name for name in [*followed, *covariates] if name in covariates), "")
    rows = residual_plate(covariate, [comparison]).rows if covariate else []
    series: dict[str, list[tuple[float, float, str]]] = {}
    for row in rows:
        name = f"{row.channel} {row.component}".strip()
        series.setdefault(name, []).append((row.value, row.residual_sigma, row.run_id))
    return {
        "version": comparison.version,
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
    """`rigctl mark`, and how the run stood before."""
    del plugins
    with Store.open(store) as opened:
        runs = {run.run_id: run for run in opened.runs()}
        opened.mark(run_id, valid, reason)
    before = {"valid": runs[run_id].valid, "reason": runs[run_id].reason}
    return {"run_id": run_id, "valid": valid, "reason": reason, "before": before}


def write(store: Path, kind: str, path: Path, plugins: Plugins) -> Json:
    """What a command writes to a file, by one of `rigctl.console.writing.KINDS`."""
    # That a certificate was issued is kept in the store.
    with opened_workbench(store, plugins, readonly=False if kind == "certificate" else None) as workbench:
        _WRITTEN[kind](workbench, path)
    return {"kind": kind, "written": str(path)}


def _write_bundle(workbench: Workbench, path: Path) -> None:
    write_bundle(workbench.store, path)


def _write_certificate(workbench: Workbench, path: Path) -> None:
    issue(workbench, CertificateDetails(), path, tell=_nobody)


def _write_campaign(workbench: Workbench, path: Path) -> None:
    planning.write_next(workbench, path, _nobody)


def _write_draft(workbench: Workbench, path: Path) -> None:
    text = drafted(workbench, workbench.diagnose())
    with writing(path):
        path.write_text(text, encoding="utf-8")


_WRITTEN: Mapping[str, Callable[[Workbench, Path], object]] = {
    "report": lambda workbench, path: write_report(workbench, path, None, _nobody),
    "figures": lambda workbench, path: write_report(workbench, None, path, _nobody),
    "certificate": _write_certificate,
    "bundle": _write_bundle,
    "campaign": _write_campaign,
    "draft": _write_draft,
}


def effects(plugin: Path, plugins: Plugins) -> list[str]:
    """Ids of the effects of a file of one's own; `PluginError` and `ConfigError` when it cannot be used."""
    del plugins
    return list(load(plugin).effects)


def _nobody(line: str) -> None:
    """Progress of what the console shows as one job."""


def add(store: Path, effects: Sequence[str], plugins: Plugins) -> list[Json]:
    """`rigctl model add`."""
    with opened_workbench(store, plugins, readonly=False) as workbench:
        return [version.as_json() for version in workbench.add(effects)]


def remove(store: Path, effects: Sequence[str], plugins: Plugins) -> list[Json]:
    """`rigctl model remove`."""
    with opened_workbench(store, plugins, readonly=False) as workbench:
        return [version.as_json() for version in workbench.remove(effects)]
