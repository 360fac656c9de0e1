"""Which item a store is the calibration of."""

from __future__ import annotations

from pydantic import ValidationError

from rigctl.campaign.store.entries import CERTIFIED
from rigctl.campaign.store.store import Store
from rigctl.core.errors import DataError
from rigctl.files.item import Item

ITEM = "item"
"""Key of a header's `extra` and of a `CERTIFIED` event."""


def item_of(store: Store) -> Item:
    """What the campaign file or the bundle said of it; where they said no serial number, the last certificate.

    `DataError` where that is no item.
    """
    given = store.header.extra.get(ITEM) or {}
    certified = [event.data.get(ITEM) or {} for event in store.events(CERTIFIED)]
    try:
        known = [Item.model_validate(each) for each in (given, *reversed(certified))]
    except ValidationError as error:
        raise DataError(
            f"{store.path}: what it says of the calibrated item cannot be read ({error.errors()[0]['msg']}); "
            "export it, mend [item] in recording.toml and import it again"
        ) from error
    return next((item for item in known if item.serial), known[0])
