"""The tables of a campaign file that are an experiment's own: its declaration names their pydantic models."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from rigctl.core.additions import procedure_for
from rigctl.core.experiments import EXPERIMENTS


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
