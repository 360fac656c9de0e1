"""Stores with a flipped bit, a zeroed block or a cut: every damage is named, or changes nothing.

The store of a small campaign is made anew for each trial, closed, or with its write-ahead log as a killed process
leaves it. What it tells before the damage and after is compared.
"""

from __future__ import annotations

import random
import shutil
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.campaign.bundle.salvage import Salvage
from rigctl.campaign.recording import ChannelInfo, Header
from rigctl.campaign.store.store import Store
from rigctl.core.errors import DataError, RigError

PROMISE = "A store with a flipped bit, a zeroed block or a cut names the damage, or tells just what it told before."

SILENT, HARMLESS, REDUCTIONS = "silent", "harmless", "reductions"
KINDS = ("bit", "zeros", "cut")
RUNS, ROWS = 14, 260
CONDITIONS = {"axis": "X", "configuration": "pendulum", "mounting": 1, "theta_deg": 0.25, "frequency_hz": 0.5}
_BLOCK_BYTES = 4096


def trial(seed: int, work: Path) -> dict[str, Any]:
    """One store, damaged once."""
    path = work / "s.rig.sqlite"
    make(path, seed, unclean=seed % 2 == 0)
    truth = told(path)
    return {"seed": seed, **damage(path, seed), **verdict(path, truth)}


def make(path: Path, seed: int, *, unclean: bool) -> None:
    """A store as a campaign leaves it; `unclean`: as one that was killed leaves it, with its log."""
    live = path.with_name("live.rig.sqlite") if unclean else path
    rng = np.random.default_rng(seed)
    header = Header("sensing-axis", "small", channels={"accel_v": ChannelInfo("V")}, constants={"g_m_s2": 9.81})
    with Store.create(live, header) as store:
        if unclean:
            store._connection.execute("PRAGMA wal_autocheckpoint = 40")
        _fill(store, rng)
        if unclean:
            for suffix in ("", "-wal", "-synced"):
                shutil.copyfile(live.with_name(live.name + suffix), path.with_name(path.name + suffix))
    if unclean:
        live.unlink()


def _fill(store: Store, rng: np.random.Generator) -> None:
    store.set_identity("dmm", {"model": "34465A", "serial": "MY1"})
    store.add_event("once", {"key": "level", "result": float(rng.normal())}, 1.0)
    for number in range(RUNS):
        _record(store, f"X {number}", rng, ROWS if number % 5 else 2500)
        store.keep_reductions("sines 1", {str(number + 1): rng.bytes(200)})
    store.mark("3", valid=False, reason="door")
    store.add_document("fit", {"axes": rng.normal(size=3)})
    with suppress(ZeroDivisionError), store.begin_run("cut off", "phase 2", CONDITIONS) as writer:
        writer.append({"t_s": np.arange(50.0)})
        raise ZeroDivisionError
    store.set_status({"state": "done", "runs_planned": RUNS}, durable=True)


def _record(store: Store, key: str, rng: np.random.Generator, rows: int) -> None:
    with store.begin_run(key, "phase 1", CONDITIONS) as writer:
        columns = np.vstack([np.arange(rows) / 100.0 + rng.random(), rng.normal(size=(2, rows))])
        for part in np.array_split(columns, 2, axis=1):
            writer.append(dict(zip(("t_s", "stage_x_mm", "accel_v"), part, strict=True)))
        writer.finish({"temperature_c": float(rng.normal(22.0))})


def damage(path: Path, seed: int) -> dict[str, Any]:
    """Damage the store, or its log when there is one, in one place."""
    draw = random.Random(seed)
    wal = path.with_name(path.name + "-wal")
    file = wal if wal.exists() and wal.stat().st_size and draw.random() < 0.7 else path
    kind = draw.choice(KINDS)
    data = bytearray(file.read_bytes())
    at = draw.randrange(len(data))
    if kind == "bit":
        data[at] ^= 1 << draw.randrange(8)
    elif kind == "zeros":
        at -= at % _BLOCK_BYTES
        data[at : at + _BLOCK_BYTES] = bytes(len(data[at : at + _BLOCK_BYTES]))
    else:
        del data[at:]
    file.write_bytes(data)
    return {"kind": kind, "where": f"{'log' if file == wal else 'store'} {at} of {len(data)}"}


def verdict(path: Path, truth: Mapping[str, Any]) -> dict[str, Any]:
    """What the damaged store tells, read and then opened for writing, and what can be saved of it."""
    outcomes = [_outcome(path, truth, readonly=readonly) for readonly in (True, False)]
    named = [outcome for outcome in outcomes if outcome not in {SILENT, HARMLESS}]
    outcome = SILENT if SILENT in outcomes else "named" if named else HARMLESS
    saved, wrong = salvaged(path, truth)
    failed = "changed without a word" if outcome == SILENT else wrong
    return {"outcome": outcome, "said": named[:1], "saved": saved, "failed": failed}


def salvaged(path: Path, truth: Mapping[str, Any]) -> tuple[int, str]:
    """How many finished runs are saved as they were, and which is saved as another."""
    there = {run.run_id: (run, samples) for run, samples in zip(truth["runs"], truth["samples"], strict=True)}
    try:
        salvage = Salvage(path)
    except DataError:
        return 0, ""
    runs = [(record, _bytes(samples)) for record, samples in salvage.runs() if record.state == "finished"]
    if any("marks" in line for line in salvage.lost):
        runs = [(replace(record, valid=there[record.run_id][0].valid), samples) for record, samples in runs]
        runs = [(replace(record, reason=there[record.run_id][0].reason), samples) for record, samples in runs]
    others = [record.run_id for record, samples in runs if (record, samples) != there[record.run_id]]
    return len(runs), f"run {others[0]} is saved as another" if others else ""


def _outcome(path: Path, truth: Mapping[str, Any], *, readonly: bool) -> str:
    copy = path.with_name("copy.rig.sqlite")
    for suffix in ("", "-wal", "-shm", "-synced"):
        copy.with_name(copy.name + suffix).unlink(missing_ok=True)
        with suppress(FileNotFoundError):
            shutil.copyfile(path.with_name(path.name + suffix), copy.with_name(copy.name + suffix))
    try:
        found = told(copy, readonly=readonly)
    except RigError as error:
        return str(error)
    kept, now = truth[REDUCTIONS], found.pop(REDUCTIONS)
    same = found == {name: what for name, what in truth.items() if name != REDUCTIONS}
    # What is worked out from samples may be missing, and is then worked out again.
    return HARMLESS if same and all(data in (None, kept.get(name)) for name, data in now.items()) else SILENT


def told(path: Path, *, readonly: bool = True) -> dict[str, Any]:
    """Everything a result can depend on; `DamagedStore`, or another typed error."""
    with Store.open(path, readonly=readonly) as store:
        runs = store.runs()
        return {
            "header": store.header,
            "runs": runs,
            "valid": store.runs(valid_only=True),
            "keys": [store.run_by_key(run.key) for run in runs],
            "counts": store.run_counts(),
            "samples": [_bytes(store.samples(run.run_id)) for run in runs],
            "pieces": [sum(piece["t_s"].size for piece in store.sample_chunks(run.run_id)) for run in runs],
            "events": store.events(),
            "once": store.events("once"),
            "documents": store.documents("fit"),
            "identities": store.identities(),
            "status": store.status(),
            REDUCTIONS: {name: store.reduction("sines 1", name) for name in store.reduced_names("sines 1")},
        }


def _bytes(samples: Mapping[str, Any]) -> list[tuple[str, bytes]]:
    return [(name, column.tobytes()) for name, column in samples.items()]
