"""`analyse` and `result` of an experiment whose result is the fit of its model."""

from __future__ import annotations

from typing import Any

from rigctl.workbench.findings import ModelFit
from rigctl.workbench.workbench import Workbench


def analyse(workbench: Workbench) -> ModelFit:
    """A store's data fitted with its current model; `DataError`, `ProcedureError`."""
    return workbench.fitted()


def result(workbench: Workbench) -> dict[str, Any]:
    """The fit, with the version of its model."""
    return {"version": workbench.current.version, **analyse(workbench).as_json()}
