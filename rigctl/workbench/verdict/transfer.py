"""Does a model fitted to one store hold for another?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rigctl.core.errors import DataError
from rigctl.workbench.findings import Estimate
from rigctl.workbench.study import Model, Study, Term
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.whitened_fit import whitened_least_squares


@dataclass(frozen=True)
class Shared:
    """A parameter that both stores know: its two estimates, and how far they are apart in sigma."""

    name: str
    here: Estimate
    there: Estimate

    @property
    def sigmas_apart(self) -> float:
        """(there - here) over the standard uncertainty of the difference."""
        spread = float(np.hypot(self.here.sigma, self.there.sigma))
        return (self.there.value - self.here.value) / spread if spread > 0.0 else float("nan")


@dataclass(frozen=True)
class Transfer:
    """The same terms on two stores.

    Errors have 1.00 = noise, of the other store's data: `error_own` of the model fitted to them, `error_transferred`
    with the shared parameters as fitted here and only what is local to its mountings fitted there.
    """

    shared: tuple[Shared, ...]
    error_own: float
    error_transferred: float

    def as_json(self) -> dict[str, Any]:
        """Keys of `with` in `rigctl compare --json`."""
        return {
            "error_own": self.error_own,
            "error_transferred": self.error_transferred,
            "parameters": {
                each.name: {
                    "here": each.here.as_json(),
                    "there": each.there.as_json(),
                    "sigmas_apart": each.sigmas_apart,
                }
                for each in self.shared
            },
        }


def transfer(here: Study, there: Study, terms: Sequence[Term]) -> Transfer:
    """Fit `terms` to both, and the one to the other; `DataError` when they are of different experiments."""
    if here.experiment != there.experiment:
        raise DataError(f"a model of '{here.experiment}' recordings says nothing of '{there.experiment}' recordings")
    mine, theirs = Attempt(here, terms), Attempt(there, terms)
    names = [name for name in _lasting(mine.model) if name in theirs.names]
    estimates, others = mine.estimates(), theirs.estimates()
    shared = tuple(Shared(name, estimates[name], others[name]) for name in names)
    return Transfer(shared, theirs.error(), _transferred(shared, theirs))


def _lasting(model: Model) -> list[str]:
    """Parameters that outlast a mounting."""
    return [
        parameter.name
        for parameter, local in zip(model.parameters, model.local, strict=True)
        if not (parameter.fixed or local)
    ]


def _transferred(shared: Sequence[Shared], theirs: Attempt) -> float:
    known = {each.name: each.here.value for each in shared}
    parameters = [
        # Held at what was fitted here; nulls and levels of the other mountings are free, nobody could know them.
        replace(parameter, start=known.get(parameter.name, start), fixed=parameter.fixed or parameter.name in known)
        for parameter, start in zip(theirs.model.parameters, theirs.result.values, strict=True)
    ]
    result = whitened_least_squares(theirs.model, theirs.noise, parameters)
    return float(np.sqrt(result.residuals @ result.residuals / result.dof)) if result.dof > 0 else float("nan")
