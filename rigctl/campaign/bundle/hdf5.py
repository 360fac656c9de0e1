"""A campaign as one HDF5 file: everything the store holds, for other programs.

/                       attributes: format, experiment, title, started; dataset `header` (JSON, all of it)
/constants              attributes
/channels/NAME, /lasers/NAME   attributes
/runs/RUN_ID            attributes: key, step, valid, reason, state and the conditions; a dataset per column
/interrupted_runs/RUN_ID       the same, of runs that were cut off
/events, /documents, /identities, /status   JSON text
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import h5py

from rigctl.campaign.bundle.whole_hdf5 import Check, whole_hdf5
from rigctl.campaign.recording import RunRecord
from rigctl.campaign.store.header_json import dumps, header_to_json
from rigctl.campaign.store.store import Store

FORMAT = "rigctl campaign 1"
_TEXT = h5py.string_dtype()


def write_hdf5(store: Store, path: Path) -> None:
    """Write all of `store` to a new file; `DataError` if `path` exists or cannot be made, then nothing is left."""
    with whole_hdf5(path) as (file, check):
        _write(store, file, check)


def _write(store: Store, file: h5py.File, check: Check) -> None:
    header = store.header
    _attributes(
        file,
        {
            "format": FORMAT,
            "experiment": header.experiment,
            "title": header.title,
            "started": header.started,
        },
    )
    _text(file, "header", header_to_json(header))
    _attributes(file.create_group("constants"), header.constants)
    for kind, infos in (("channels", header.channels), ("lasers", header.lasers)):
        group = file.create_group(kind)
        for name, info in infos.items():
            _attributes(group.create_group(_member(name)), asdict(info))
    _runs(file.create_group("runs", track_order=True), store, store.runs(), check)
    _runs(file.create_group("interrupted_runs", track_order=True), store, store.interrupted_runs(), check)
    _texts(file, "events", (asdict(event) for event in store.events()))
    _texts(file, "documents", (asdict(document) for document in store.documents()))
    _text(file, "identities", dumps(store.identities()))
    _text(file, "status", dumps(store.status()))


def _runs(group: h5py.Group, store: Store, records: Iterable[RunRecord], check: Check) -> None:
    for record in records:
        check()
        run = group.create_group(record.run_id, track_order=True)
        known = asdict(record)
        conditions = known.pop("conditions")
        _attributes(run, {**conditions, **known})
        for name, column in store.samples(record.run_id).items():
            data = run.create_dataset(_member(name), data=column)
            if channel := store.header.channels.get(name):
                data.attrs["unit"] = channel.unit


def _attributes(group: h5py.Group, values: Mapping[str, Any]) -> None:
    """Numbers and short texts as they are, anything else as JSON text; what is None is left out."""
    for name, value in values.items():
        if value is None or value == {}:
            continue
        # HDF5 attributes hold 64-bit integers; a larger one goes as text rather than being cut.
        if isinstance(value, bool | float) or (isinstance(value, int) and abs(value) < 2**63):
            group.attrs[name] = value
        else:
            # HDF5 ends a variable-length string at the first zero byte.
            plain = isinstance(value, str) and "\0" not in value
            group.attrs.create(name, value if plain else dumps(value), dtype=_TEXT)


def _member(name: str) -> str:
    """HDF5 reads a slash in a name as a path; a column may have one."""
    # U+2215 looks like a slash and is none.
    return name.replace("/", "∕")


def _text(file: h5py.File, name: str, text: str) -> None:
    file.create_dataset(name, data=text, dtype=_TEXT)


def _texts(file: h5py.File, name: str, items: Iterable[Mapping[str, Any]]) -> None:
    texts = [dumps(item) for item in items]
    file.create_dataset(name, shape=(len(texts),), dtype=_TEXT, data=texts or None)
