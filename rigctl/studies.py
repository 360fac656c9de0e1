"""Which study a recording gets: its experiment decides."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rigctl.campaign.store.store import Store
from rigctl.kinds import kind_of
from rigctl.workbench.study import Study

if TYPE_CHECKING:
    from rigctl.effects.plugins import Plugin


def study_of(store: Store, plugins: Sequence[Plugin] = ()) -> Study:
    """A store's runs as the workbench sees them, with what `plugins` add to the catalogue; `DataError`."""
    return kind_of(store.header.experiment, store.path).study(store, plugins)
