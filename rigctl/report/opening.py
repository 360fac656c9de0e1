"""What a report opens with: which item was calibrated, when, on what, and how far the campaign came."""

from __future__ import annotations

from collections.abc import Iterator

from rigctl.campaign.days import first_day, last_day
from rigctl.campaign.item import item_of
from rigctl.campaign.status import status_in
from rigctl.campaign.store.store import Store
from rigctl.report.quantities import counted

NO_ITEM = "The store does not say which item this is: [item] in the campaign file does."


def calibrated(store: Store) -> Iterator[str]:
    """Sentences on the item, the days and the campaign; `DataError` where the store's item cannot be read."""
    item = item_of(store)
    made_by = " ".join(filter(None, [item.manufacturer, item.model]))
    serial = f"serial number {item.serial}" if item.serial else ""
    named = ", ".join(filter(None, [item.name, made_by, serial, item.condition]))
    yield f"Calibrated: {named}." if named else NO_ITEM
    yield " ".join(filter(None, [_days(store), _simulated(store)]))
    yield _unfinished(store)


def _days(store: Store) -> str:
    began, last = first_day(store), last_day(store)
    if not began:
        return "The recording does not say when it was measured."
    return f"Measured on {began}." if last == began else f"Measured from {began} to {last}."


def _simulated(store: Store) -> str:
    simulated = store.header.world_sha256 is not None
    return "The instruments were simulated: no item was calibrated." if simulated else ""


def _unfinished(store: Store) -> str:
    """How a campaign stands that is not over; "" for one that is."""
    status = status_in(store)
    if status["state"] == "done":
        return ""
    planned = counted(status["runs_planned"], "run")
    return f"The campaign is {status['state']} after {status['runs_done']} of {planned}: what follows is preliminary."
