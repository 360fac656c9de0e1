"""How a campaign stands, seen from another process."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rigctl.campaign.session.heartbeat import beat_age_s
from rigctl.campaign.session.locks import is_held, store_lock
from rigctl.campaign.session.questions import open_question
from rigctl.campaign.store.entries import IMPORTED, RUN_REPEATED
from rigctl.campaign.store.store import Store

REMARKS_MAX = 3
"""So many of the latest remarks are told."""


def status_of(path: Path) -> dict[str, Any]:
    """The status of the campaign in a store; one whose process is gone is `interrupted`. `DataError`."""
    with Store.open(path, readonly=True) as store:
        return status_in(store)


def status_in(store: Store) -> dict[str, Any]:
    """As `status_of`, of a store that is open; cheap, however many runs there are."""
    status = store.status()
    finished, invalid = store.run_counts()
    if not status:
        # Either there never was a campaign here, or it was killed before it could say anything.
        state = "done" if store.last_event(IMPORTED) else "running"
        status = {"state": state, "step": "", "runs_planned": finished, "eta_s": 0.0}
    alive = status["state"] in {"running", "paused"} and is_held(store_lock(store.path))
    # A process that was killed cannot write that it ended, but its lock ended with it.
    killed = status["state"] in {"running", "paused"} and not alive
    if killed:
        status["state"] = "interrupted"
    asked = open_question(store) if alive else None
    # Of a table rows are marked in the file: there, it is one run.
    imported = None if store.header.table is None else store.last_event(IMPORTED)
    of_table = {} if imported is None else {"readings_invalid": len(imported.data["invalid"])}
    repeat = store.last_event(RUN_REPEATED)
    # A study has runs whose samples nobody keeps.
    done = max(int(status.get("runs_done", 0)), finished)
    planned = max(int(status["runs_planned"]), done)
    return {
        **status,
        "runs_done": done,
        "runs_planned": planned,
        "runs_invalid": invalid,
        **of_table,
        "runs_repeated": repeats_in(store),
        "last_repeat": None if repeat is None else {key: repeat.data.get(key, "") for key in ("key", "reason")},
        "remarks": [
            {"run_id": run.run_id, "valid": run.valid, "reason": run.reason}
            for run in store.remarked_runs(REMARKS_MAX)
        ],
        "killed": killed,
        "heartbeat_age_s": beat_age_s(store.path) if alive else None,
        # Of a campaign that has ended nobody waits for the answer.
        "question": asdict(asked) | {"choices": asked.choices} if asked is not None else None,
    }


def repeats_in(store: Store) -> dict[str, int]:
    """How often a run was measured again after a fault, by the kind of error."""
    return dict(Counter(event.data["error"] for event in store.events(RUN_REPEATED)))
