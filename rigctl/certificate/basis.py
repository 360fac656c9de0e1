"""What a certificate rests on, as hashes: runs with their samples and marks, files, constants, model.

Fits, diagnoses and further versions of the model may come afterwards; they are worked out from this and change none
of it. Everything is SHA-256: the store's own checksums see damage, these see a change that was made on purpose too.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from rigctl.campaign.recording import RunRecord
from rigctl.campaign.store.header_json import dumps
from rigctl.campaign.store.parts import KIND as CAMPAIGN
from rigctl.campaign.store.parts import parts_of
from rigctl.campaign.store.store import Store
from rigctl.workbench.model import versions
from rigctl.workbench.model.versions import ModelVersion

WORKED_OUT = (versions.VERSION, versions.FIT, versions.COMPARISON, versions.DIAGNOSIS, versions.ACCOUNT)
"""Documents that are worked out from runs; all others, such as draws of a study, are what a result rests on."""

SHOWN = 3
"""Differences told by name; of more their number."""


@dataclass(frozen=True)
class RunBasis:
    """A run: hash of its samples, of its conditions, and how it was marked."""

    samples: str
    conditions: str
    valid: bool
    reason: str


@dataclass(frozen=True)
class Basis:
    """Everything a certificate rests on. `files` are texts and plug-ins by name; `records` are all else by name."""

    store: str
    files: Mapping[str, str]
    records: Mapping[str, str]
    model: Mapping[str, Any]
    runs: Mapping[str, RunBasis]

    @property
    def sha256(self) -> str:
        """One hash over all of it but the name of the store's file, which may be copied under another."""
        return _sha256(_canonical({key: each for key, each in self.as_json().items() if key != "store"}))

    def as_json(self) -> dict[str, Any]:
        """As a certificate carries it, without the hash over it."""
        return {
            "store": self.store,
            "files": dict(self.files),
            "records": dict(self.records),
            "model": dict(self.model),
            "runs": {name: asdict(each) for name, each in self.runs.items()},
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Basis:
        """What `as_json` gave; `KeyError` or `TypeError` for anything else."""
        runs = {name: RunBasis(**each) for name, each in data["runs"].items()}
        return cls(data["store"], dict(data["files"]), dict(data["records"]), dict(data["model"]), runs)


def basis_of(store: Store, version: ModelVersion) -> Basis:
    """What a result of `store` with a version of its model rests on, every sample read; `DamagedStore`."""
    header = store.header
    about = {
        "experiment": header.experiment,
        "title": header.title,
        "started": header.started,
        "channels": header.channels,
        "lasers": header.lasers,
        "extra": {name: each for name, each in header.extra.items() if name != "plugins"},
    }
    records = {
        "recording": _sha256(dumps({name: _plain(each) for name, each in about.items()})),
        "constants": _sha256(dumps(dict(sorted(header.constants.items())))),
        "instruments": _sha256(dumps(store.identities())),
        **{f"document {each.id}": _sha256(dumps(each.data)) for each in _documents(store)},
    }
    runs = {record.run_id: _run(store, record) for record in store.runs()}
    return Basis(store.path.name, files_of(store, version), records, model_of(version), runs)


def files_of(store: Store, version: ModelVersion) -> dict[str, str]:
    """The files a store was made with, as they were, and plug-ins of the model; by name."""
    found = {}
    if store.header.rig_toml is not None:
        found["rig file"] = _sha256(store.header.rig_toml)
    if store.header.campaign_toml is not None:
        for part in parts_of(store):
            found["campaign file" if part.number == 1 else f"campaign file {part.number}"] = _sha256(part.toml)
    if store.header.world_sha256 is not None:
        found["simulated world"] = store.header.world_sha256
    for effect, plugin in sorted(version.plugins.items()):
        found[f"plug-in of {effect}"] = plugin.sha256
    return found


def model_of(version: ModelVersion) -> dict[str, Any]:
    """A version of the model, as it was made."""
    return {"version": version.version, "terms": [term.as_json() for term in version.terms]}


def differences(then: Basis, now: Basis) -> list[str]:
    """What is not as it was when a certificate was issued, in words; empty when all is."""
    found = [
        *_changed("", then.files, now.files, "is another now"),
        *_changed("", then.records, now.records, "changed"),
    ]
    if then.model != now.model:
        found.append(f"model version {then.model.get('version')} has other terms")
    found += _changed("run ", then.runs, now.runs, "")
    return found


def told(found: list[str]) -> str:
    """Differences in one line."""
    more = f" and {len(found) - SHOWN} more" if len(found) > SHOWN else ""
    return "; ".join(found[:SHOWN]) + more


def _changed(kind: str, then: Mapping[str, Any], now: Mapping[str, Any], how: str) -> Iterator[str]:
    for name in dict.fromkeys([*then, *now]):
        before, after = then.get(name), now.get(name)
        if after is None:
            yield f"{kind}{name} is no longer there"
        elif before is None:
            yield f"{kind}{name} has come since"
        elif before != after:
            yield f"{kind}{name} {how or _run_changed(before, after)}"


def _run_changed(before: RunBasis, after: RunBasis) -> str:
    if before.samples != after.samples:
        return "has other samples"
    if before.conditions != after.conditions:
        return "has other conditions"
    if before.valid != after.valid:
        return f"was marked {'valid' if after.valid else 'invalid'} since ({after.reason or 'no reason given'})"
    return f"has another reason since ({after.reason})"


def _run(store: Store, record: RunRecord) -> RunBasis:
    # Column by column as the chunks come: samples of days are not held in memory.
    columns: dict[str, Any] = {}
    for piece in store.sample_chunks(record.run_id):
        for name, values in piece.items():
            columns.setdefault(name, hashlib.sha256()).update(values.astype("<f8", copy=False).tobytes())
    samples = _canonical({name: digest.hexdigest() for name, digest in columns.items()})
    # A missing number is NaN, which JSON text has as such.
    return RunBasis(_sha256(samples), _sha256(dumps(dict(record.conditions))), record.valid, record.reason)


def _documents(store: Store) -> Iterable[Any]:
    return (each for each in store.documents() if each.kind not in (*WORKED_OUT, CAMPAIGN))


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _plain(each) for name, each in sorted(value.items())}
    return asdict(value) if hasattr(value, "__dataclass_fields__") else value


def _canonical(value: Any) -> str:
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=True)


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
