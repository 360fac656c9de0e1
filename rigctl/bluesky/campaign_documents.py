"""A campaign as a stream of documents, by the event model: what is in its store, and what comes while it runs.

    start       the campaign: title, experiment, its files as run
    `runs`      an event for each finished run: set-points, conditions, whether it is valid and why not
    `samples`   pages with the samples of each run, `run_id` beside each
    `marks`     an event for each run that is declared valid or not after its own event has gone out
    stop        how the campaign ended

A stream has one set of keys: further ones are `runs_2`, `samples_2` and so on; a channel with a clock of its own has
`samples_CHANNEL`. Every uid follows from the store's header: a store read again gives the same documents.
"""

from __future__ import annotations

import json
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from itertools import chain
from pathlib import Path
from typing import Any

from rigctl.campaign.recording import RunRecord, on_rig_time, own_clocks, time_column
from rigctl.campaign.session.requests import is_running
from rigctl.campaign.session.rig_time import began_at
from rigctl.campaign.status import status_in
from rigctl.campaign.store.entries import RUN_ENDED, Event
from rigctl.campaign.store.header_json import header_to_json
from rigctl.campaign.store.store import Store
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import RigError
from rigctl.core.units import unit_of_column

Document = tuple[str, dict[str, Any]]

NAMESPACE = uuid.UUID("7d1c5a52-5d0f-5e39-9a51-1b2b6f0e8c11")
"""Of the uids of campaigns; drawn once."""

PAGE_ROWS = 5000
"""At most so many samples are in a page: a page is what a reader holds in memory."""

_EXIT = {"done": "success", "aborted": "abort"}
"""Exit status by a campaign's state; any other is `fail`."""


def documents(store_path: Path | str, follow: bool = False, *, look_s: float = 0.25) -> Iterator[Document]:
    """The documents of a campaign, each with its name, in the order of its runs.

    `follow`: goes on while the campaign runs, looking every `look_s`, and ends with it. To be read in one thread.
    Nothing is opened before the first is asked for: `DataError` for no store, `RigError` for a campaign that runs and
    is not to be followed; `DamagedStore` at the run that is not as it was written.
    """
    path = Path(store_path)
    with Store.open(path, readonly=True) as store:
        if not follow and is_running(path):
            raise RigError(f"{path}: a campaign is running on it; follow it, or wait until it has ended")
        stream = _Stream(store)
        yield stream.start()
        while True:
            # Asked before the store is read: what is written in between comes with the next look.
            running = is_running(path)
            yield from stream.fresh()
            if not running:
                break
            time.sleep(look_s)
        yield stream.stop()


class _Stream:
    """The documents of an open store, and how far they have gone out."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._start_uid = str(uuid.uuid5(NAMESPACE, header_to_json(store.header)))
        self._descriptors: dict[tuple[str, tuple[tuple[str, str], ...]], str] = {}
        self._counts: dict[str, int] = {}
        self._validity: dict[str, tuple[bool, str]] = {}
        self._ends: dict[str, Event] = {}
        self._last_event: Event | None = None
        self._latest = _unix_s(store.header.started) if store.header.started else 0.0

    def start(self) -> Document:
        header = self._store.header
        told = {
            "title": header.title,
            "experiment": header.experiment,
            "started": header.started,
            "campaign_toml": header.campaign_toml,
            "rig_toml": header.rig_toml,
            "world_sha256": header.world_sha256,
            "seed": header.seed,
            "versions": header.versions,
            "constants": header.constants,
        }
        known = {key: _keyed(value) for key, value in told.items() if value is not None}
        return "start", {**known, "uid": self._start_uid, "time": self._latest}

    def fresh(self) -> Iterator[Document]:
        """What has been added to the store since the last call."""
        # First the runs, then the events: a run is there together with the event of its end.
        runs = self._store.runs(skip=len(self._validity))
        events = self._store.events(after=self._last_event.id if self._last_event else 0)
        if events:
            self._last_event, self._latest = events[-1], _unix_s(events[-1].time)
        self._ends |= {event.data["key"]: event for event in events if event.kind == RUN_ENDED}
        for run in runs:
            self._validity[run.run_id] = run.valid, run.reason
            yield from self._run(run)
        # A run that is read with its mark needs no other word.
        marks = {event.data["run_id"]: event for event in events if event.kind == "mark"}
        for run_id, event in marks.items():
            validity = bool(event.data["valid"]), str(event.data["reason"])
            if self._validity.get(run_id, validity) != validity:
                self._validity[run_id] = validity
                yield from self._event("marks", {"run_id": run_id, **_valid(*validity)}, _unix_s(event.time))

    def stop(self) -> Document:
        state = str(status_in(self._store)["state"])
        # A campaign that was aborted or failed says why in its last event.
        last = self._last_event.data if self._last_event else {}
        why = last.get("error") or last.get("reason") if state != "done" else None
        return "stop", {
            "uid": self._uid("stop"),
            "run_start": self._start_uid,
            "time": self._latest,
            "exit_status": _EXIT.get(state, "fail"),
            "reason": f"{state}: {why}" if why else state,
            "num_events": dict(self._counts),
        }

    def _run(self, run: RunRecord) -> Iterator[Document]:
        end = self._ends.pop(run.key, None)
        end_s = _unix_s(end.time) if end else self._latest
        conditions = {name: _value(value) for name, value in run.conditions.items()}
        fields = {"run_id": run.run_id, "step": run.step, **_valid(run.valid, run.reason), **conditions}
        yield from self._event("runs", fields, end_s)
        began = began_at(end, run.conditions.get("start_s")) if end else None
        began_s = began.timestamp() if began else end_s
        yield from self._samples(run.run_id, began_s)

    def _event(self, stream: str, fields: Mapping[str, Any], time_s: float) -> Iterator[Document]:
        columns = {name: [value] for name, value in fields.items()}
        for name, page in self._page(stream, columns, [time_s], {}):
            yield (name, page) if name == "descriptor" else ("event", _only_row(page))

    def _samples(self, run_id: str, began_s: float) -> Iterator[Document]:
        channels = self._store.header.channels
        units = {name: channel.unit for name, channel in channels.items() if channel.unit}
        for stream, columns, time_name in self._pieces(run_id):
            count = len(next(iter(columns.values())))
            for first in range(0, count, PAGE_ROWS):
                rows = {name: column[first : first + PAGE_ROWS].tolist() for name, column in columns.items()}
                many = len(next(iter(rows.values())))
                times_s = [began_s + t_s for t_s in rows[time_name]] if time_name in rows else [began_s] * many
                yield from self._page(stream, {"run_id": [run_id] * many, **rows}, times_s, units)

    def _pieces(self, run_id: str) -> Iterator[tuple[str, Mapping[str, FloatArray], str]]:
        """The samples of a run by stream, with the column of times, piece by piece."""
        own = own_clocks(self._store.header)
        if not own:
            yield from (("samples", piece, "t_s") for piece in self._store.sample_chunks(run_id))
            return
        # Columns on other clocks differ in length: pieces of one length in all would leave the rest out.
        columns = self._store.samples(run_id)
        yield "samples", on_rig_time(columns), "t_s"
        for channel in own:
            if channel in columns:
                times = time_column(channel)
                yield f"samples_{_key(channel)}", {channel: columns[channel], times: columns[times]}, times

    def _page(
        self, stream: str, columns: Mapping[str, Sequence[Any]], times_s: Sequence[float], units: Mapping[str, str]
    ) -> Iterator[Document]:
        """An event page of these columns, and before the first of its kind its descriptor."""
        keys = _keys(columns)
        data_keys = {keys[name]: self._data_key(name, rows[0], units) for name, rows in columns.items()}
        kind = stream, tuple((key, each["dtype"]) for key, each in data_keys.items())
        if kind not in self._descriptors:
            number = 1 + sum(each == stream for each, _ in self._descriptors)
            self._descriptors[kind] = stream if number == 1 else f"{stream}_{number}"
            yield "descriptor", self._descriptor(self._descriptors[kind], data_keys, times_s[0])
        name = self._descriptors[kind]
        first = self._counts.get(name, 0) + 1
        self._counts[name] = first + len(times_s) - 1
        numbers = list(range(first, first + len(times_s)))
        descriptor = self._uid(name)
        yield (
            "event_page",
            {
                "descriptor": descriptor,
                "uid": [f"{descriptor}-{number}" for number in numbers],
                "seq_num": numbers,
                "time": list(times_s),
                "data": {keys[name]: list(rows) for name, rows in columns.items()},
                "timestamps": {key: list(times_s) for key in keys.values()},
            },
        )

    def _descriptor(self, stream: str, data_keys: Mapping[str, Any], time_s: float) -> dict[str, Any]:
        return {
            "uid": self._uid(stream),
            "run_start": self._start_uid,
            "time": time_s,
            "name": stream,
            "data_keys": {key: {**each, "object_name": "rigctl"} for key, each in data_keys.items()},
            "object_keys": {"rigctl": list(data_keys)},
            "hints": {"rigctl": {"fields": [key for key, each in data_keys.items() if each["dtype"] == "number"]}},
            "configuration": {"rigctl": self._instruments(time_s)},
        }

    def _instruments(self, time_s: float) -> dict[str, Any]:
        """Who answered: the words of every instrument."""
        data = {
            _key(f"{name}_{what}"): _value(text)
            for name, identity in self._store.identities().items()
            for what, text in identity.items()
        }
        data_keys = {key: self._data_key(key, value, {}) for key, value in data.items()}
        return {"data": data, "data_keys": data_keys, "timestamps": dict.fromkeys(data, time_s)}

    def _data_key(self, name: str, value: Any, units: Mapping[str, str]) -> dict[str, Any]:
        key: dict[str, Any] = {"source": f"{self._store.path.name} {name}", **_type_of(value)}
        unit = units.get(name) or unit_of_column(name)
        return {**key, "units": unit} if unit and key["dtype"] != "string" else key

    def _uid(self, of: str) -> str:
        return str(uuid.uuid5(uuid.UUID(self._start_uid), of))


def _valid(valid: bool, reason: str) -> dict[str, Any]:
    return {"valid": valid, "reason": reason}


def _only_row(page: Mapping[str, Any]) -> dict[str, Any]:
    """The event that is a page by itself."""
    nested = {part: {key: rows[0] for key, rows in page[part].items()} for part in ("data", "timestamps")}
    single = {part: page[part][0] for part in ("uid", "seq_num", "time")}
    return {"descriptor": page["descriptor"], **single, **nested}


def _type_of(value: Any) -> dict[str, Any]:
    match value:
        case bool():
            return {"dtype": "boolean", "shape": [], "dtype_numpy": "|b1"}
        case int() | float():
            # A condition may be 1 in one run and 0.5 in the next.
            return {"dtype": "number", "shape": [], "dtype_numpy": "<f8"}
        case list():
            return {"dtype": "array", "shape": [None]}
    return {"dtype": "string", "shape": []}


def _value(value: Any) -> Any:
    """A condition as events hold it."""
    if value is None:
        return ""
    return json.dumps(value) if isinstance(value, Mapping) else value


def _keyed(value: Any) -> Any:
    """Mappings with keys as documents may have them."""
    return {_key(name): _keyed(each) for name, each in value.items()} if isinstance(value, Mapping) else value


def _key(name: str) -> str:
    """A name without the two characters that keys of documents must not have."""
    return name.replace(".", "_").replace("/", "_")


def _keys(names: Mapping[str, Any]) -> dict[str, str]:
    """The key of each name, no two the same."""
    keys: dict[str, str] = {}
    for name in names:
        free = chain([_key(name)], (f"{_key(name)}_{number}" for number in range(2, len(names) + 2)))
        keys[name] = next(key for key in free if key not in keys.values())
    return keys


def _unix_s(utc: str) -> float:
    """UNIX time of an ISO 8601 time of day."""
    return datetime.fromisoformat(utc).timestamp()
