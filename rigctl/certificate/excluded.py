"""Runs and readings that were left out, why, and what the result would be with them (ISO/IEC 17025, 7.8.2.1 n)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from rigctl.analysis.measurement_result import MeasurementResult
from rigctl.campaign.recording import RunRecord
from rigctl.campaign.store.entries import Document
from rigctl.campaign.store.store import Store
from rigctl.composition import workbench_of
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import UNFIT
from rigctl.core.experiments import of_readings
from rigctl.core.readings import VALID
from rigctl.experiments.analysis import measurement_result_of
from rigctl.workbench.model.versions import VERSION
from rigctl.workbench.workbench import Workbench


class AllRunsValid(Store):
    """A store in which no run, and no reading of a table, is marked invalid; it is read only, so that nothing is kept
    of it."""

    def runs(self, *, valid_only: bool = False, skip: int = 0) -> list[RunRecord]:
        """All finished runs, as if they were valid."""
        del valid_only
        return [replace(run, valid=True) for run in super().runs(skip=skip)]

    def run(self, run_id: str) -> RunRecord | None:
        """One of them, likewise."""
        run = super().run(run_id)
        return None if run is None else replace(run, valid=True)

    def samples(self, run_id: str) -> dict[str, FloatArray]:
        """The columns of a run; of a table's readings without the one that says which of them count."""
        columns = super().samples(run_id)
        if self.header.table is not None:
            columns.pop(VALID, None)
        return columns

    def documents(self, kind: str | None = None) -> list[Document]:
        """The versions of the model; nothing that was worked out of the valid ones."""
        return [each for each in super().documents(kind) if each.kind == VERSION]


@dataclass(frozen=True)
class Change:
    """A quantity without the excluded runs, as it is certified, and with them."""

    name: str
    unit: str
    without: float
    with_them: float
    expanded_uncertainty: float


@dataclass(frozen=True)
class Excluded:
    """Excluded runs by run_id, or readings ("row 7"), with the reason; `changes` of the result with them, or
    `not_worked_out`, why not."""

    runs: Mapping[str, str]
    changes: Sequence[Change] = ()
    not_worked_out: str = ""

    @property
    def worst_shift(self) -> float | None:
        """The largest change over its expanded uncertainty; None where nothing is known of it."""
        shifts = [
            abs(each.with_them - each.without) / each.expanded_uncertainty
            for each in self.changes
            if each.expanded_uncertainty > 0.0
        ]
        return max(shifts, default=None)

    def as_json(self) -> dict[str, Any]:
        """As a certificate carries it."""
        return {
            "runs": dict(self.runs),
            "changes": [asdict(each) for each in self.changes],
            "not_worked_out": self.not_worked_out,
        }


def excluded_of(bench: Workbench, result: MeasurementResult, tell: Callable[[str], None]) -> Excluded:
    """The runs, or readings of a table, that are marked invalid, and the result as if none were."""
    store = bench.store
    runs = {run.run_id: run.reason or "no reason given" for run in store.runs() if not run.valid}
    if of_readings(store.header.experiment):
        runs |= bench.fitted().excluded
    if not runs:
        return Excluded({})
    tell(f"working out the result with {len(runs)} excluded")
    try:
        with AllRunsValid.open(store.path, readonly=True) as every:
            other = measurement_result_of(workbench_of(every, [Path(each.path) for each in bench.plugin_files]))
    # Runs are often left out because nothing can be had of them.
    except UNFIT as error:
        return Excluded(runs, not_worked_out=str(error).removeprefix(f"{store.path}: "))
    there = {each.name: each.value for each in other.quantities}
    half = result.coverage_factor * result.standard_uncertainty
    changes = [
        Change(each.name, each.unit, each.value, there[each.name], float(half[place]))
        for place, each in enumerate(result.quantities)
        if each.name in there
    ]
    return Excluded(runs, changes)
