"""Results from a store, whatever made it: `rigctl result`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rigctl.campaign.store.store import Store
from rigctl.composition import workbench_of
from rigctl.experiments.analysis import analysis_of
from rigctl.files.campaign_file import parse_campaign
from rigctl.report.drawn import drawing_of


def of(path: Path, plugins: Sequence[Path] = ()) -> dict[str, Any]:
    """The keys of `rigctl result --json`; `DataError`, `ProcedureError`."""
    with Store.open(path, readonly=True) as store:
        return analysis_of(store.header.experiment, path).result(workbench_of(store, plugins))


def show(path: Path, found: Mapping[str, Any]) -> None:
    """Print a result, beside the campaign file's reference values."""
    with Store.open(path, readonly=True) as store:
        text, experiment = store.header.campaign_toml, store.header.experiment
    reference = parse_campaign(text, path).reference.model_dump() if text else {}
    drawing_of(experiment, path).show(found, reference)
