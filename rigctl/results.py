"""Results from a store, whatever made it: `rigctl result`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from rigctl.campaign.store.store import Store
from rigctl.composition import opened_workbench
from rigctl.core.errors import UNFIT
from rigctl.experiments.analysis import analysis_of
from rigctl.files.campaign_file import parse_campaign
from rigctl.report.drawn import drawing_of
from rigctl.report.tables.result_table import print_tables
from rigctl.workbench.study import SearchesSamples
from rigctl.workbench.workbench import Workbench


def of(path: Path, plugins: Sequence[Path] = (), *, keep: bool = False) -> dict[str, Any]:
    """The keys of `rigctl result --json`; `keep` what samples are reduced to and searched for, which is asked next.
    `DataError`, `ProcedureError`."""
    with opened_workbench(path, plugins, readonly=None if keep else True) as workbench:
        document = of_workbench(workbench)
        if keep and workbench.store.runs(valid_only=True) and isinstance(workbench.study, SearchesSamples):
            with suppress(*UNFIT):  # the result stands; whoever asks for more is told why not
                workbench.study.search_samples()
        return document


def of_workbench(workbench: Workbench) -> dict[str, Any]:
    """As `of`, of a store that is open."""
    store = workbench.store
    return analysis_of(store.header.experiment, store.path).result(workbench)


def show(path: Path, document: Mapping[str, Any]) -> None:
    """Print a result, beside the campaign file's reference values."""
    with Store.open(path, readonly=True) as store:
        tables = drawing_of(store.header.experiment, path).tables(document, reference_of(store))
        print_tables(table for table in tables if table.printed)


def reference_of(store: Store) -> dict[str, Any]:
    """The reference values of the campaign file a store was made with; none in an imported recording."""
    text = store.header.campaign_toml
    return parse_campaign(text, store.path).reference.model_dump() if text else {}
