"""What an experiment declares of itself: everything is named by text and imported when it is used."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from rigctl.core.entry_points import resolved

CONTRACT = 1
"""The version of what follows; an experiment written for another is refused."""


@dataclass(frozen=True)
class Experiment:
    """An experiment, found by the entry points of `rigctl.experiments`; references are `package.module:object`.

    `application` is a module with the functions of `rigctl.kinds.Kind`: plan, study, result, figures and so on.
    `tables` are the pydantic models of a campaign file's `[procedure]` and `[targets]`, `procedures` those of
    `[procedure]` by its `name` where one has another; without any, no campaign measures it. `columns` is the
    `rigctl.campaign.bundle_layout.Layout` of its runs; without one a recording is a table of readings.

    Effects act at `points` of its chain, in the order in which a signal passes, and have one value per each of
    `scopes`; `effects` is the module of those it knows. `trial_run(point)` makes runs to try a foreign effect on, and
    `signature(effect)` draws one; without it there is no such figure. `rank` is its place in lists.
    """

    id: str
    application: str
    points: tuple[str, ...]
    trial_run: str
    scopes: tuple[str, ...] = ("recording",)
    tables: Mapping[str, str] = field(default_factory=dict)
    procedures: Mapping[str, str] = field(default_factory=dict)
    columns: str = ""
    effects: str = ""
    signature: str = ""
    rank: int = 100
    contract: int = CONTRACT

    def load(self, reference: str) -> Any:
        """What one of these references names, imported now; `ConfigError` when that fails."""
        return resolved(reference, f"experiment '{self.id}'")
