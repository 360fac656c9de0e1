"""Results from a store, whatever made it: `rigctl result`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rigctl.campaign.store.store import Store
from rigctl.files import config
from rigctl.kinds import kind_of
from rigctl.workbench.bench import Workbench


def of(path: Path, plugins: Sequence[Path] = ()) -> dict[str, Any]:
    """The keys of `rigctl result --json`; `DataError`, `ProcedureError`."""
    with Store.open(path, readonly=True) as store:
        return kind_of(store.header.experiment, path).result(Workbench(store, plugins))


def show(path: Path, found: Mapping[str, Any]) -> None:
    """Print a result, beside the campaign file's reference values."""
    with Store.open(path, readonly=True) as store:
        text, experiment = store.header.campaign_toml, store.header.experiment
    reference = config.parse_campaign(text, path).reference.model_dump() if text else {}
    kind_of(experiment, path).show(found, reference)
