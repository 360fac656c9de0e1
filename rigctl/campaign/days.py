"""On which days was it measured? A campaign has events; of a bundle the runs tell how long it took."""

from __future__ import annotations

import math
from datetime import datetime, timedelta

from rigctl.campaign.store.entries import RUN_ENDED
from rigctl.campaign.store.store import Store
from rigctl.core.errors import DamagedStore, DataError


def first_day(store: Store) -> str:
    """The day on which it began, ISO 8601; "" where the store does not say."""
    return store.header.started[:10]


def last_day(store: Store, stated: str = "") -> str:
    """The day on which the last run ended, ISO 8601; "" where the store does not say.

    `stated` is somebody's word for it, which counts where no event tells.
    """
    ended = store.last_event(RUN_ENDED)
    return ended.time[:10] if ended is not None else stated or _by_its_runs(store) or first_day(store)


def _by_its_runs(store: Store) -> str:
    """When the last of the valid runs ended, the first having begun with the recording; "" where nothing tells."""
    given = {run.run_id: run.conditions.get("start_s") for run in store.runs(valid_only=True)}
    starts = {name: each for name, each in given.items() if isinstance(each, int | float) and math.isfinite(each)}
    if not starts:
        return ""
    last = max(starts, key=lambda run_id: starts[run_id])
    took_s = starts[last] - min(starts.values()) + _length_s(store, last)
    try:
        return (datetime.fromisoformat(store.header.started) + timedelta(seconds=took_s)).date().isoformat()
    except (ValueError, OverflowError):  # it does not say when it began, or a start_s is no time
        return ""


def _length_s(store: Store, run_id: str) -> float:
    try:
        begun = next(store.sample_chunks(run_id, ["t_s"]), {}).get("t_s")
        ended = store.last_samples(run_id, 1).get("t_s")
    except (DataError, DamagedStore):  # damage is told where samples are asked for
        return 0.0
    if begun is None or ended is None or not len(begun) or not len(ended):
        return 0.0
    length_s = float(ended[-1] - begun[0])
    return length_s if math.isfinite(length_s) else 0.0
