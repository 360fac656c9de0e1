"""Campaigns from Python: what the commands do, as objects that feel at home in a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigctl import runner
from rigctl.campaign.status import status_of
from rigctl.campaign.store.store import Store
from rigctl.composition import opened_workbench
from rigctl.effects.plugins import Files, paths_of
from rigctl.exchange.frames import run_dataset, runs_frame
from rigctl.experiments.analysis import Result, analysis_of, measurement_result_of
from rigctl.files.campaign_file import read_campaign
from rigctl.files.rig_file import read_rig
from rigctl.report import html
from rigctl.report.notebook import (
    Ladder,
    ShownComparison,
    ShownDiagnosis,
    ShownFit,
    ShownMeasurement,
    ShownResult,
    shown_comparison,
    shown_diagnosis,
    shown_fit,
    shown_measurement,
    shown_result,
)
from rigctl.report.tables.result_table import ResultTable
from rigctl.workbench.model.versions import ModelVersion
from rigctl.workbench.workbench import ALPHA

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset


class Campaign:
    """A campaign file with its rig; `rig` replaces the rig file it names. `ConfigError` when a file is wrong."""

    def __init__(self, path: Path | str, rig: Path | str | None = None) -> None:
        self.file = read_campaign(Path(path))
        self.rig_file = read_rig(Path(rig) if rig else self.file.rig_path)

    def _repr_html_(self) -> str:
        rows = [[self.file.title, self.file.experiment, str(self.file.path), str(self.rig_file.path)]]
        return html.table(ResultTable("Campaign", ["title", "experiment", "campaign file", "rig file"], rows))

    def dry_run(self, plugins: Files = ()) -> dict[str, Any]:
        """What would be done, checked against the rig's limits."""
        return runner.dry_run(self.file, self.rig_file, paths_of(plugins))

    def run(
        self,
        store: Path | str,
        *,
        unattended: bool = False,
        seed: int | None = None,
        plugins: Files = (),
        unchecked: bool = False,
    ) -> Result:
        """Run into a new store and return the result; blocks until the campaign ends.

        `unattended`: the simulated operator answers; `unchecked`: also with real instruments that `rigctl check` has
        not passed. Raises what the command would report.
        """
        options = runner.Options(unattended=unattended, seed=seed, plugins=paths_of(plugins), unchecked=unchecked)
        runner.start(self.file, self.rig_file, Path(store), options)
        return self.result(store, plugins)

    @staticmethod
    def resume(store: Path | str, *, unattended: bool = False, plugins: Files = ()) -> Result:
        """Go on with an interrupted campaign; what is recorded is not measured again."""
        runner.resume(Path(store), runner.Options(unattended=unattended, plugins=paths_of(plugins)))
        return Campaign.result(store, plugins)

    @staticmethod
    def status(store: Path | str) -> dict[str, Any]:
        """How far the campaign in a store is."""
        return status_of(Path(store))

    @staticmethod
    def result(store: Path | str, plugins: Files = ()) -> Result:
        """What a store amounts to by its experiment: sensing axes, a platform's accelerations, ten parameters.

        `DataError` or `ProcedureError` when the runs do not yet give it.
        """
        with opened_workbench(store, plugins) as workbench:
            return analysis_of(workbench.store.header.experiment, workbench.store.path).analyse(workbench)

    @staticmethod
    def measured(store: Path | str, plugins: Files = ()) -> ShownMeasurement:
        """What a certificate of a store certifies: quantities, and every source of their uncertainty.

        `rigctl.exchange.uncertain_numbers` makes numbers of `uncertainties` or `GTC` of it.
        """
        with opened_workbench(store, plugins) as workbench:
            return shown_measurement(measurement_result_of(workbench))

    @staticmethod
    def show(store: Path | str, plugins: Files = ()) -> ShownResult:
        """The tables and figures of a store's result, as a report has them, in a notebook."""
        with opened_workbench(store, plugins) as workbench:
            return shown_result(workbench)

    @staticmethod
    def runs(store: Path | str) -> DataFrame:
        """A row of pandas for each run of a store; `ConfigError` without the extra `notebook`."""
        with Store.open(Path(store), readonly=True) as opened:
            return runs_frame(opened)

    @staticmethod
    def samples(store: Path | str, run_id: str) -> Dataset:
        """The samples of a run as a dataset of xarray; `ConfigError` without the extra `notebook`."""
        with Store.open(Path(store), readonly=True) as opened:
            return run_dataset(opened, run_id)

    @staticmethod
    def compare(store: Path | str, plugins: Files = ()) -> ShownComparison:
        """A store's current model beside its data: where does it fail?"""
        with opened_workbench(store, plugins) as workbench:
            return shown_comparison(workbench.compare())

    @staticmethod
    def diagnose(store: Path | str, *, alpha: float = ALPHA, plugins: Files = ()) -> ShownDiagnosis:
        """Which physical effect is missing? Adds nothing."""
        with opened_workbench(store, plugins) as workbench:
            return shown_diagnosis(workbench.diagnose(alpha))

    @staticmethod
    def add(store: Path | str, *effects: str | Sequence[str], plugins: Files = ()) -> list[ModelVersion]:
        """Add effects to a store's model, one new version each."""
        with opened_workbench(store, plugins, readonly=False) as workbench:
            return workbench.add(_names(effects))

    @staticmethod
    def remove(store: Path | str, *effects: str | Sequence[str]) -> list[ModelVersion]:
        """Take effects out of a store's model, one new version each."""
        with opened_workbench(store, readonly=False) as workbench:
            return workbench.remove(_names(effects))

    @staticmethod
    def fit(store: Path | str, plugins: Files = ()) -> ShownFit:
        """A store's current model, fitted."""
        with opened_workbench(store, plugins) as workbench:
            return shown_fit(workbench.fit())

    @staticmethod
    def history(store: Path | str, plugins: Files = ()) -> Ladder:
        """The error ladder, as `rigctl model history --json` gives it."""
        with opened_workbench(store, plugins) as workbench:
            return Ladder(workbench.history())


def _names(effects: Sequence[str | Sequence[str]]) -> list[str]:
    """Of effects that were given one by one, or together."""
    return [name for each in effects for name in ([each] if isinstance(each, str) else each)]
