"""Results from a store, whatever made it: `rigctl result`, and the figures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rigctl import config
from rigctl.campaign.store import Store
from rigctl.errors import DataError
from rigctl.experiments.sensing_axis.budget import axis_budgets
from rigctl.experiments.sensing_axis.recorded import recorded_faces, recorded_heads, recorded_package
from rigctl.experiments.sensing_axis.result import SensingAxisResult, sensing_axes
from rigctl.experiments.sensing_axis.study import STANDARD_G, SensingAxisStudy
from rigctl.runner import rig_file_of
from rigctl.workbench.bench import Workbench
from rigctl.workbench.fit import fit


def of(path: Path, plugins: Sequence[Path] = ()) -> dict[str, Any]:
    """The keys of `rigctl result --json`, of a table those of `rigctl fit --json`; `DataError`, `ProcedureError`."""
    with Store.open(path, readonly=True) as store:
        bench = Workbench(store, plugins)
        if store.header.experiment == "table":
            version = bench.current
            return {"version": version.version, **fit(bench.study, version.terms).as_json()}
        quick = [event.data["result"] for event in store.events("once") if event.data["key"] == "quick check"]
        result = analyse(bench)
        budgets = axis_budgets(result, uncertainties_of(store))
    found = {**result.as_json(), "budget": {name: each.as_json() for name, each in budgets.items()}}
    return {**found, "quick_check": quick[-1]} if quick else found


def uncertainties_of(store: Store) -> dict[str, dict[str, float]]:
    """Standard uncertainties from the rig file's certificates, by name."""
    if store.header.rig_toml is None:
        return {}
    return {name: dict(c.uncertainty) for name, c in rig_file_of(store).certificates.items()}


def analyse(bench: Workbench) -> SensingAxisResult:
    """Fit a store's runs with its current model and find the axes; `DataError` where there are none to find."""
    store, study = bench.store, bench.study
    if not isinstance(study, SensingAxisStudy):
        raise DataError(f"{store.path}: '{store.header.experiment}' recordings have no sensing axes")
    effects = study.chosen(bench.current.terms)
    header = store.header
    if header.rig_toml is None:
        heads, g_m_s2 = recorded_heads(header), float(header.constants.get("g_m_s2", STANDARD_G))
        return sensing_axes(store, recorded_package(header), heads, g_m_s2, effects, faces=recorded_faces(header))
    rig_file = rig_file_of(store)
    if rig_file.package is None:
        raise DataError(f"{store.path}: its rig file has no [package]")
    return sensing_axes(store, rig_file.package, rig_file.heads, rig_file.constant("g_m_s2", STANDARD_G), effects)


def show(path: Path, found: dict[str, Any]) -> None:
    """Print a result, beside the campaign file's reference values."""
    if "axes" not in found:
        from rigctl.report.terminal_workbench import print_fit

        print_fit(found)
        return
    from rigctl.report.terminal import print_result

    with Store.open(path, readonly=True) as store:
        text = store.header.campaign_toml
        reference = config.parse_campaign(text, path).reference.model_dump() if text else {}
    print_result(found, reference)
