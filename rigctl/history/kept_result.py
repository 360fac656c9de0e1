"""The measurement result of a store as a history needs it, kept in the store: thousands are not fitted anew."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.analysis.kept import Kept, Packed, Recipe
from rigctl.analysis.measurement_result import MeasurementResult, Quantity
from rigctl.campaign.store.store import Store
from rigctl.composition import opened_workbench
from rigctl.core.arrays import FloatArray
from rigctl.experiments.analysis import measurement_result_of
from rigctl.workbench.model import versions

_RECIPE = Recipe("measurement result", 2)
_NAME = "current"


@dataclass(frozen=True)
class SourceParts:
    """What a source adds to the standard uncertainty of each quantity, `parts` (m,); as `Source` otherwise."""

    name: str
    common: bool
    dof: float
    parts: FloatArray


@dataclass(frozen=True)
class KeptResult:
    """m quantities with the sources of their uncertainty, without what correlates them."""

    quantities: tuple[Quantity, ...]
    sources: tuple[SourceParts, ...]

    @classmethod
    def of(cls, result: MeasurementResult) -> KeptResult:
        """What a history needs of a measurement result."""
        quantities = tuple(
            Quantity(each.name, float(each.value), each.unit, each.kind, each.group) for each in result.quantities
        )
        sources = (SourceParts(s.name, s.in_common, float(s.dof), s.standard_uncertainty) for s in result.sources)
        return cls(quantities, tuple(sources))

    @property
    def has_common(self) -> bool:
        """Whether there is a source that other calibrations may share."""
        return any(each.common for each in self.sources)

    def standard_uncertainty(self, place: int) -> float:
        """Combined standard uncertainty of one quantity."""
        return math.hypot(*(each.parts[place] for each in self.sources))

    def independent(self, place: int) -> tuple[float, float]:
        """The part that another calibration does not share, with its degrees of freedom (Welch-Satterthwaite)."""
        own = [(float(each.parts[place]) ** 2, each.dof) for each in self.sources if not each.common]
        total = sum(variance for variance, _ in own)
        over = sum((variance / total) ** 2 / dof for variance, dof in own) if total > 0.0 else 0.0
        return total**0.5, 1.0 / over if over else np.inf

    def common(self, place: int) -> dict[str, float]:
        """What each source that others may share adds to one quantity, by its name."""
        return {each.name: float(each.parts[place]) for each in self.sources if each.common and each.parts[place]}

    def packed(self, key: Mapping[str, Any]) -> Packed:
        """To be kept under a key that says what it was worked out from."""
        head = {
            "key": key,
            "quantities": [[each.name, each.value, each.unit, each.kind, each.group] for each in self.quantities],
            "sources": [[each.name, each.common] for each in self.sources],
        }
        empty = np.zeros((0, len(self.quantities)))
        return Packed(
            head,
            {
                "dof": np.array([each.dof for each in self.sources]),
                "parts": np.vstack([empty, *(each.parts for each in self.sources)]),
            },
        )

    @classmethod
    def unpacked(cls, packed: Packed, key: Mapping[str, Any]) -> KeptResult:
        """What was kept under this very key; `ValueError` where it was another."""
        if packed.head["key"] != key:
            raise ValueError("worked out from other runs, with another model or by another program")
        rows = zip(packed.head["sources"], packed.arrays["dof"], packed.arrays["parts"], strict=True)
        sources = tuple(SourceParts(name, common, float(dof), parts) for (name, common), dof, parts in rows)
        return cls(tuple(Quantity(*each) for each in packed.head["quantities"]), sources)


def kept_result(store: Store) -> KeptResult | None:
    """What a store keeps of its valid runs with its current model and this program; None where there is nothing."""
    key = _key(store)
    return Kept(store, _RECIPE).get(_NAME, lambda packed: KeptResult.unpacked(packed, key))


def worked_out(path: Path, plugins: Sequence[Path]) -> KeptResult:
    """The result of a store by a fit, kept in it where it can be written; `DataError`, `ProcedureError`."""
    with opened_workbench(path, plugins, readonly=None if _is_current(path) else True) as workbench:
        store = workbench.store
        # Before the fit, which may add documents of its own.
        key = _key(store)
        result = KeptResult.of(measurement_result_of(workbench))
        Kept(store, _RECIPE).put(_NAME, result.packed(key))
        return result


def _is_current(path: Path) -> bool:
    """Whether a result may be kept: never where that would bring an archive's file to another schema."""
    with Store.open(path, readonly=True) as store:
        return store.has_checksums


def _key(store: Store) -> dict[str, Any]:
    version = versions.current(store)
    return {"version": version.version, "data": versions.data_key(store, list(version.plugins.values()))}
