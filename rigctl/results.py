"""Results from a store, whatever made it: `rigctl result`, and the figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rigctl import config
from rigctl.campaign.store import Store
from rigctl.effects.catalogue import chosen
from rigctl.errors import DataError
from rigctl.experiments.sensing_axis.budget import axis_budgets
from rigctl.experiments.sensing_axis.recorded import recorded_faces, recorded_heads, recorded_package
from rigctl.experiments.sensing_axis.result import SensingAxisResult, sensing_axes
from rigctl.runner import campaign_of, rig_file_of

STANDARD_G = 9.80665
"""Where nobody has given the local one."""


def of(path: Path) -> dict[str, Any]:
    """The keys of `rigctl result --json`; `DataError`, `ProcedureError`."""
    with Store.open(path, readonly=True) as store:
        quick = [event.data["result"] for event in store.events("once") if event.data["key"] == "quick check"]
        result = analyse(store)
        budgets = axis_budgets(result, uncertainties_of(store))
    found = {**result.as_json(), "budget": {name: each.as_json() for name, each in budgets.items()}}
    return {**found, "quick_check": quick[-1]} if quick else found


def uncertainties_of(store: Store) -> dict[str, dict[str, float]]:
    """Standard uncertainties from the rig file's certificates, by name."""
    if store.header.rig_toml is None:
        return {}
    return {name: dict(c.uncertainty) for name, c in rig_file_of(store).certificates.items()}


def analyse(store: Store) -> SensingAxisResult:
    """Fit a store's runs and find the axes."""
    if store.header.experiment != "sensing-axis":
        raise DataError(f"{store.path}: no result for '{store.header.experiment}' recordings yet")
    if store.header.rig_toml is None:
        return _analyse_recorded(store)
    rig_file = rig_file_of(store)
    if rig_file.package is None:
        raise DataError(f"{store.path}: its rig file has no [package]")
    effects = chosen("sensing-axis", campaign_of(store).model.effects)
    return sensing_axes(store, rig_file.package, rig_file.heads, rig_file.constant("g_m_s2", STANDARD_G), effects)


def _analyse_recorded(store: Store) -> SensingAxisResult:
    """A recording without rig file: nominal mountings, the baseline model."""
    header = store.header
    return sensing_axes(
        store,
        recorded_package(header),
        recorded_heads(header),
        float(header.constants.get("g_m_s2", STANDARD_G)),
        (),
        faces=recorded_faces(header),
    )


def show(path: Path, found: dict[str, Any]) -> None:
    """Print a result, beside the campaign file's reference values."""
    from rigctl.report.terminal import print_result

    with Store.open(path, readonly=True) as store:
        text = store.header.campaign_toml
        reference = config.parse_campaign(text, path).reference.model_dump() if text else {}
    print_result(found, reference)


def figures(path: Path, directory: Path) -> list[Path]:
    """Write the figures of a store, with the budget its rig file's certificates allow; returns what was written."""
    from rigctl.report.figures import write_figures

    with Store.open(path, readonly=True) as store:
        return write_figures(analyse(store), directory, uncertainties_of(store))
