"""Campaign files: what a campaign does, on which rig, and with which model.

The keys of `[procedure]` and `[targets]` are those of the experiment's procedure.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, field_validator

from rigctl.core.additions import procedure_for
from rigctl.core.errors import either
from rigctl.core.experiments import EXPERIMENTS, REGISTRY, measured
from rigctl.core.file_tables import Table
from rigctl.files.item import Item
from rigctl.files.toml_files import checked_file, parsed_file, read_text


class ModelTable(Table):
    """Which effects the model has beyond its baseline."""

    effects: tuple[str, ...] = ()

    @field_validator("effects")
    @classmethod
    def _no_repeats(cls, values: tuple[str, ...]) -> tuple[str, ...]:
        for place, name in enumerate(values):
            if name in values[:place]:
                raise ValueError(f"has {name} twice; name each effect once")
        return values


class ReferenceTable(Table):
    """Values to print a result beside."""

    source: str = ""
    axes: dict[str, tuple[float, float, float]] = {}
    std_hc_2sigma_arcsec: dict[str, float] = {}
    theta_m_arcsec: dict[str, float] = {}
    offset_deg: dict[str, float] = {}


class CampaignFile(Table):
    """A campaign file, checked as far as it does not depend on the procedure."""

    path: Path
    text: str
    experiment: str
    title: str = ""
    rig: str = ""
    procedure: dict[str, Any]
    targets: dict[str, Any] = {}
    model: ModelTable = ModelTable()
    item: Item = Item()
    on_terminal_lost: Literal["continue", "stop"] = "continue"
    reference: ReferenceTable = ReferenceTable()

    @field_validator("experiment")
    @classmethod
    def _known(cls, experiment: str) -> str:
        if experiment in REGISTRY.names():
            REGISTRY.get(experiment)  # says why it cannot be used
        if experiment not in measured():
            raise ValueError(f"input should be {either(map(repr, measured()))}")
        return experiment

    @property
    def rig_path(self) -> Path:
        """The rig file it names, relative to itself."""
        return self.path.parent / self.rig

    @property
    def goes_on(self) -> bool:
        """Whether it measures in the mounting of a store that is there, if there is one."""
        return self.procedure.get("mounting") in {"same", "kept"}


def read_campaign(path: Path) -> CampaignFile:
    """Read and check a campaign file; `ConfigError`."""
    return parse_campaign(read_text(path), path)


def parse_campaign(text: str, path: Path) -> CampaignFile:
    """Check a campaign file's text as kept in a store; `ConfigError`."""
    return checked_file(CampaignFile, text, parsed_file(text, path), path)


def settings_of(experiment: str, procedure: Mapping[str, Any]) -> Mapping[str, type[BaseModel]]:
    """The models of `[procedure]` and further tables, by name; nothing that runs or analyses is imported.

    `procedure` is that table as far as it is written; an experiment nobody knows has none.
    """
    if experiment not in EXPERIMENTS:
        return {}
    declared = EXPERIMENTS[experiment]
    other = procedure_for(experiment, procedure.get("name"))
    references = {**declared.tables, "procedure": other.table} if other else declared.tables
    return {table: declared.load(reference) for table, reference in references.items()}
