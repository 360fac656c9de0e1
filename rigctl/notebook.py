"""Campaigns from Python: what the commands do, as objects that feel at home in a notebook."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rigctl import config, results, runner
from rigctl.campaign.status import status_of
from rigctl.campaign.store import Store
from rigctl.experiments.sensing_axis.result import SensingAxisResult


class Campaign:
    """A campaign file with its rig; `rig` replaces the rig file it names. `ConfigError` when a file is wrong."""

    def __init__(self, path: Path | str, rig: Path | str | None = None) -> None:
        self.file = config.read_campaign(Path(path))
        self.rig_file = config.read_rig(Path(rig) if rig else self.file.rig_path)

    def dry_run(self) -> dict[str, Any]:
        """What would be done, checked against the rig's limits."""
        return runner.dry_run(self.file, self.rig_file)

    def run(self, store: Path | str, *, unattended: bool = False, seed: int | None = None) -> SensingAxisResult:
        """Run into a new store and return the result; blocks until the campaign ends.

        `unattended`: the simulated operator answers. Raises what the command would report.
        """
        runner.start(self.file, self.rig_file, Path(store), runner.Options(unattended=unattended, seed=seed))
        return self.result(store)

    @staticmethod
    def resume(store: Path | str, *, unattended: bool = False) -> SensingAxisResult:
        """Go on with an interrupted campaign; what is recorded is not measured again."""
        runner.resume(Path(store), runner.Options(unattended=unattended))
        return Campaign.result(store)

    @staticmethod
    def status(store: Path | str) -> dict[str, Any]:
        """How far the campaign in a store is."""
        return status_of(Path(store))

    @staticmethod
    def result(store: Path | str) -> SensingAxisResult:
        """The sensing axes found in a store, with everything they were made from."""
        with Store.open(Path(store), readonly=True) as opened:
            return results.analyse(opened)
