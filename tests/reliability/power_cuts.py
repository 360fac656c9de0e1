"""Power cuts: what a disk may hold after one, at any step of a campaign's writing.

A campaign is recorded once for each seed. A cut keeps what was synced; each later write is there, lost, or there in
part, in sectors, whatever came after it.
"""

from __future__ import annotations

import os
import random
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from rigctl.campaign.recording import Header
from rigctl.campaign.store import synced
from rigctl.campaign.store.store import Store
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import RigError
from tests.reliability.file_layer import FileLayer, Step, watched_files

PROMISE = "After a power cut at any step of its writing a store opens, with all its finished runs, and goes on."

NAME = "s.rig.sqlite"
CUTS, RUNS = 20, 12
_SECTOR_BYTES = 512


def trial(seed: int, work: Path) -> dict[str, Any]:
    """One campaign, cut at `CUTS` steps drawn at random."""
    draw = random.Random(seed)
    made, steps, samples = recorded(work / NAME, seed)
    broken = []
    for number in range(CUTS):
        at = draw.randrange(len(steps))
        path = work / f"cut {number}" / NAME
        path.parent.mkdir()
        cut(made, steps[:at], path, draw)
        if why := flaw(path, steps[:at], samples):
            broken.append(f"step {at} of {len(steps)}: {why}")
    return {"seed": seed, "tried": CUTS, "failures": len(broken), "failed": broken[0] if broken else ""}


def recorded(path: Path, seed: int) -> tuple[bytes, list[Step], list[bytes]]:
    """A store as it was made, the steps of a campaign that writes it, and the samples of its runs."""
    Store.create(path, Header("sensing-axis")).close()
    made, layer, rng = path.read_bytes(), FileLayer(), np.random.default_rng(seed)
    columns = [rng.normal(size=(2, rng.integers(1, 3000))) for _ in range(RUNS)]
    with watched_files(layer), watched_note(layer), Store.open(path) as store:
        store._connection.execute("PRAGMA wal_autocheckpoint = 30")
        for number, run in enumerate(columns):
            store.add_event("once", {"key": f"mount {number}", "result": number}, float(number))
            layer.say(f"mount {number}")
            record(store, number, run)
            layer.say(f"key {number}")
            store.set_status({"state": "running", "runs_done": number})
    return made, layer.steps, [run.tobytes() for run in columns]


def record(store: Store, number: int, run: FloatArray) -> None:
    """One run, in three chunks."""
    with store.begin_run(f"key {number}", "s", {"number": number}) as writer:
        for part in np.array_split(run, 3, axis=1):
            writer.append({"t_s": part[0], "accel_v": part[1]})
        writer.finish()


@contextmanager
def watched_note(layer: FileLayer) -> Iterator[None]:
    """The note beside the store, of which SQLite knows nothing, passes through `layer` too."""

    def pwrite(file: int, data: bytes, at: int) -> int:
        layer.steps.append(Step("note", NAME + synced.SUFFIX, at, data))
        return os.pwrite(file, data, at)

    with patch.object(synced, "pwrite", pwrite):
        yield


def cut(made: bytes, steps: Sequence[Step], path: Path, draw: random.Random) -> None:
    """Write the files at and beside `path` as a disk may hold them when the power fails after `steps`."""
    for name in (NAME, f"{NAME}-wal", NAME + synced.SUFFIX):
        own = [step for step in steps if step.file == name]
        last = max((place for place, step in enumerate(own) if step.kind == "sync"), default=-1)
        data = bytearray(made if name == NAME else b"")
        for step in own[: last + 1]:
            _apply(data, step)
        for step in own[last + 1 :]:
            for part in _survivors(step, draw):
                _apply(data, part)
        path.with_name(name).write_bytes(data)


def _survivors(step: Step, draw: random.Random) -> list[Step]:
    """What is left of a step that was not synced: all, nothing, or some of its sectors."""
    fate = draw.choice(("all", "all", "nothing", "sectors"))
    if fate == "sectors" and step.kind == "write":
        places = range(0, len(step.data), _SECTOR_BYTES)
        return [
            replace(step, at=step.at + place, data=step.data[place : place + _SECTOR_BYTES])
            for place in places
            if draw.random() < 0.5
        ]
    return [] if fate == "nothing" else [step]


def _apply(data: bytearray, step: Step) -> None:
    if step.kind == "truncate":
        del data[step.at :]
        data.extend(bytes(step.at - len(data)))
    elif step.kind in {"write", "note"}:
        data.extend(bytes(max(0, step.at - len(data))))
        data[step.at : step.at + len(step.data)] = step.data


def flaw(path: Path, steps: Sequence[Step], samples: Sequence[bytes]) -> str:
    """What is wrong after the cut; "" when all that was said to be there is, nothing else is, and it goes on."""
    said = {step.file for step in steps if step.kind == "said"}
    try:
        with Store.open(path) as store:
            runs = {run.key: np.array(list(store.samples(run.run_id).values())).tobytes() for run in store.runs()}
            mounted = {event.data["key"] for event in store.events("once")}
            again = next(number for number in range(RUNS + 1) if f"key {number}" not in runs)
            record(store, again, np.zeros((2, 5)))
            goes_on = store.run_by_key(f"key {again}") is not None
    except RigError as error:
        return str(error)
    lost = said - runs.keys() - mounted
    other = [key for key, data in runs.items() if data != samples[int(key.split()[1])]]
    return f"lost {sorted(lost)}, altered {other}" if lost or other or not goes_on else ""
