"""Days of rig time with faults as rare as in a laboratory: nothing grows, and every run is accounted for."""

from __future__ import annotations

import json
import os
import sqlite3
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tests.reliability.campaigns import SHIPPED
from tests.reliability.commands import Outcome, here
from tests.reliability.random_faults import Plans, as_toml, kinds_of, random_faults
from tests.reliability.truth import wrong_number

PROMISE = (
    "Over a day of rig time with rare faults memory, open files and the time a run takes stay, and no run is lost"
)
DEADLINE_S = 600.0

DAY_S = 86_400.0
FAULTS_A_DAY = 8
NEED_A_PERSON = ("emergency_stop", "limit_hit")
"""After these nothing moves again unattended, and a simulated instrument meets them again at the same rig time."""
RESUMED_AT_MOST = 10
DRAWS_AT_MOST = 5
NEXT_DRAW = 1_000_000
"""From the seed of one draw of faults to that of the next: beyond the seeds of all days."""
LOOK_EVERY_S = 0.2
GROWTH_MB = 40.0
MORE_FILES = 4
SLOWER = 2.5

PLATFORM = """\
experiment = "rotating-platform"
rig = "rig.toml"

[procedure]
name = "bias-rejection"

[[procedure.runs]]
pattern = "c"
modulation_period_s = 300.0
periods = 12
v_z_v = [{levels}]
"""

SCAN = """\
experiment = "sensing-axis"
rig = "rig.toml"

[procedure]
name = "scan"
axes = ["X"]
configurations = ["flag", "pendulum"]
angles_deg = [-30.0, -10.0, -1.6, -0.8, 0.8, 1.6, 10.0, 30.0]
frequencies_hz = [0.3, 0.5, 0.6]
approaches = [1, -1]
amplitude_mm = 5.0
dwell_s = 60.0
sample_rate_hz = 10.0
repeats = 5

[model]
effects = ["roll-gravity", "resonance"]
"""

PLATFORM_RIG = "bias-rejection-rig.toml"
HANDS_S = 25_000.0
"""For each of two mountings: what a day of scans has beside its runs."""

DAYS = (
    (PLATFORM_RIG, PLATFORM.format(levels=", ".join(f"{0.05 * level:.2f}" for level in range(23)))),
    ("hidden-effect-rig.toml", SCAN),
)


@dataclass
class Watch:
    """What this process holds, and how many runs the store has, a few times a second."""

    store: Path
    seen: list[tuple[float, float, int, int]] = field(default_factory=list)
    """Wall time [s], resident memory [MB], open files, finished runs."""

    def grown(self) -> str:
        """What grew from the first half of the runs to the last third; "" when nothing did."""
        rows = np.array(self.seen)
        if len(rows) < 10:
            return ""
        runs = rows[:, 3]
        early = rows[(runs >= 0.2 * runs[-1]) & (runs < 0.5 * runs[-1])]
        late = rows[(runs >= 0.7 * runs[-1]) & (runs < runs[-1])]
        if not len(early) or not len(late):
            return ""
        if (growth_mb := np.median(late[:, 1]) - np.median(early[:, 1])) > GROWTH_MB:
            return f"memory grew by {growth_mb:.0f} MB"
        if (more := late[:, 2].max() - early[:, 2].max()) > MORE_FILES:
            return f"{more:.0f} more files were open"
        if (slower := _seconds_per_run(late) / _seconds_per_run(early)) > SLOWER:
            return f"a run took {slower:.1f} times as long"
        return ""

    def look(self) -> None:
        """One more row."""
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        resident_mb = pages * os.sysconf("SC_PAGE_SIZE") / 1e6
        self.seen.append((time.monotonic(), resident_mb, _open_files(), _finished(self.store)))


def trial(seed: int, work: Path) -> dict[str, Any]:
    """One day of one experiment, resumed by its operator whenever it ends before its time."""
    rig, campaign = DAYS[seed % len(DAYS)]
    (work / "campaign.toml").write_text(campaign, encoding="utf-8")
    store = work / "x.rig.sqlite"
    with _watched(store) as watch:
        refused, faults = begun(seed, rig, work)
        outcomes = list(refused)
        while outcomes[-1].status and store.exists() and len(outcomes) - len(refused) < RESUMED_AT_MOST:
            outcomes.append(here(work, "resume", store, "--yes"))
    broken = next((broken for outcome in outcomes if (broken := outcome.broken())), "")
    told = {
        "rig": rig,
        "faults": kinds_of(faults),
        "refused": len(refused) - 1,
        "resumed": len(outcomes) - len(refused),
        "messages": [outcome.message for outcome in outcomes if outcome.status],
        "runs": _finished(store),
        "resident_mb": round(max((row[1] for row in watch.seen), default=0.0), 1),
    }
    failed = broken or watch.grown() or _unaccounted(work, store) or wrong_number(store, work / "measured.jsonl")
    return {**told, "failed": failed}


def begun(seed: int, rig: str, work: Path) -> tuple[list[Outcome], Plans]:
    """Start the day's campaign; how each attempt ended, and the faults of the last one.

    A fault in the first exchanges ends the command before there is a store: such a day has not begun, and is begun
    again with the faults drawn next.
    """
    store, measured = work / "x.rig.sqlite", work / "measured.jsonl"
    outcomes: list[Outcome] = []
    faults: Plans = {}
    for draw in range(DRAWS_AT_MOST):
        measured.unlink(missing_ok=True)
        faults = _with_faults(seed + draw * NEXT_DRAW, rig, work)
        outcomes.append(here(work, "run", "campaign.toml", "--store", store, "--yes", "--seed", seed))
        if store.exists() or outcomes[-1].broken():
            break
    return outcomes, faults


def _with_faults(draw: int, rig: str, work: Path) -> Plans:
    """The rig file of a day with the faults of this draw."""
    text, file = (SHIPPED / rig).read_text(encoding="utf-8"), work / "rig.toml"
    file.write_text(text, encoding="utf-8")
    faults = random_faults(draw, file, length_s=DAY_S, replies=40_000, faults=FAULTS_A_DAY, never=NEED_A_PERSON)
    world = '[world]\nmeasured = "measured.jsonl"\n' + ("" if rig == PLATFORM_RIG else f"remount_s = {HANDS_S}\n")
    file.write_text(text.replace("[world]\n", world, 1) + as_toml(faults), encoding="utf-8")
    return faults


@contextmanager
def _watched(store: Path) -> Iterator[Watch]:
    watch, over = Watch(store), threading.Event()

    def look() -> None:
        while not over.wait(LOOK_EVERY_S):
            watch.look()

    thread = threading.Thread(target=look, name="watch")
    thread.start()
    try:
        yield watch
    finally:
        over.set()
        thread.join()


def _open_files() -> int:
    return sum(1 for _ in Path("/proc/self/fd").iterdir())


def _seconds_per_run(rows: Any) -> float:
    return float((rows[-1, 0] - rows[0, 0]) / max(rows[-1, 3] - rows[0, 3], 1.0))


def _finished(store: Path) -> int:
    try:
        with closing(sqlite3.connect(f"file:{store}?mode=ro", uri=True, timeout=5.0)) as reading:
            return int(reading.execute("SELECT count(*) FROM runs WHERE state = 'finished'").fetchone()[0])
    except sqlite3.Error:
        return 0


def _unaccounted(work: Path, store: Path) -> str:
    """Runs that were planned and are neither there nor said to be missing."""
    if not store.exists():
        return f"the day had not begun after {DRAWS_AT_MOST} draws of faults"
    status = here(work, "status", store, "--json")
    if status.status:
        return f"status: {status.message}"
    told = json.loads(status.out)
    if told["state"] != "done":
        return f"the day ended {told['state']} after it was resumed {RESUMED_AT_MOST} times"
    if told["runs_done"] < told["runs_planned"]:
        return f"{told['runs_done']} of {told['runs_planned']} runs are there"
    return ""
