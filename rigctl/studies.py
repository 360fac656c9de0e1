"""Which study a recording gets: its experiment decides."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rigctl.campaign.store import Store
from rigctl.errors import DataError
from rigctl.workbench.study import Study

if TYPE_CHECKING:
    from rigctl.effects.plugins import Plugin


def study_of(store: Store, plugins: Sequence[Plugin] = ()) -> Study:
    """A store's runs as the workbench sees them, with what `plugins` add to the catalogue.

    `DataError` for an experiment whose recordings are kept but not analysed.
    """
    experiment = store.header.experiment
    if experiment == "sensing-axis":
        from rigctl.experiments.sensing_axis.study import SensingAxisStudy

        return SensingAxisStudy(store, plugins)
    if experiment == "table":
        from rigctl.experiments.table.study import TableStudy

        return TableStudy(store, [effect for plugin in plugins for effect in plugin.effects.values()])
    raise DataError(f"{store.path}: there is no model for '{experiment}' recordings yet")
