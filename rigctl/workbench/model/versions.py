"""Versions of a store's model, and what was worked out with each: documents in the store.

Version 1 is what the store began with: the effects its campaign file names, nothing for an imported recording. Every
later one is a document that says all its terms, so that no version depends on another's; documents are durable and
are never changed.
"""

from __future__ import annotations

import functools
import hashlib
import itertools
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rigctl.campaign.store.entries import Document
from rigctl.campaign.store.parts import parts_of
from rigctl.campaign.store.store import Store
from rigctl.core.errors import ConfigError, StorageError
from rigctl.files.campaign_file import parse_campaign
from rigctl.workbench.study import Term

VERSION, FIT, COMPARISON = "model-version", "model-fit", "comparison"
DIAGNOSIS, ACCOUNT = "diagnosis", "noise-account"
"""Kinds of documents."""

CODE = ("analysis", "effects", "experiments", "workbench")
"""Packages of rigctl that a fit depends on: another program gives another fit."""


@dataclass(frozen=True)
class PluginFile:
    """A file with effects, by where it was and what it held."""

    path: str
    sha256: str

    @classmethod
    def of(cls, path: Path) -> PluginFile:
        """A file as it is now; `ConfigError` when it cannot be read."""
        try:
            return cls(str(path.resolve()), hashlib.sha256(path.read_bytes()).hexdigest())
        except OSError as error:
            raise ConfigError(f"{path}: cannot be read: {error.strerror or error}; check --plugin") from error


@dataclass(frozen=True)
class ModelVersion:
    """A model as it once was: `added` and `removed` are what it differs in from version `parent`.

    `plugins` are the files that brought a term, by its effect. `start` are the parameters by name where a diagnosis
    had fitted these very terms, if one had, and `held` those that it held at zero with the runs of the key `runs`.
    `places` are, by effect, the values of what was scanned for where its fit ended when it was last fitted for a
    version: a term's choice is where a scan has found it.
    """

    version: int
    parent: int | None
    time: str
    terms: tuple[Term, ...]
    added: str | None = None
    removed: str | None = None
    plugins: Mapping[str, PluginFile] = field(default_factory=dict)
    start: Mapping[str, float] | None = None
    held: tuple[str, ...] = ()
    runs: str = ""
    places: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @property
    def effects(self) -> tuple[str, ...]:
        """Ids of the terms."""
        return tuple(term.effect for term in self.terms)

    def as_json(self) -> dict[str, Any]:
        """Keys of `rigctl model show --json`."""
        return {
            "version": self.version,
            "parent": self.parent,
            "time": self.time,
            "effects": list(self.effects),
            "terms": [term.as_json() for term in self.terms],
            "added": self.added,
            "removed": self.removed,
            "plugins": {effect: vars(plugin) for effect, plugin in self.plugins.items()},
            "places": {effect: dict(places) for effect, places in self.places.items()},
        }

    def can_be_used_with(self, given: Sequence[PluginFile]) -> bool:
        """Whether every file this version was made with is among those given, unchanged."""
        return {plugin.sha256 for plugin in self.plugins.values()} <= {plugin.sha256 for plugin in given}

    def require(self, given: Sequence[PluginFile]) -> None:
        """`ConfigError` unless every file this version was made with is among those given, unchanged."""
        otherwise = ", or `rigctl model remove` its effects and add them again"
        require_files(f"model version {self.version} was made", self.plugins.values(), given, otherwise)


def require_files(made: str, needed: Iterable[PluginFile], given: Sequence[PluginFile], otherwise: str = "") -> None:
    """`ConfigError` unless every file that something was `made` with is among those given, unchanged."""
    hashes = {plugin.sha256 for plugin in given}
    for plugin in needed:
        if plugin.sha256 in hashes:
            continue
        made_with = f"{made} with {plugin.path} (SHA-256 {plugin.sha256[:12]})"
        if not given:
            raise ConfigError(f"{made_with}; pass --plugin {plugin.path}")
        others = ", ".join(f"{other.path} ({other.sha256[:12]})" for other in given)
        raise ConfigError(f"{made_with}, not with {others}; give the file as it was{otherwise}")


def versions(store: Store) -> list[ModelVersion]:
    """All versions, the current one last."""
    later = (_version(number, document) for number, document in enumerate(store.documents(VERSION), 2))
    return [_first(store), *later]


def current(store: Store) -> ModelVersion:
    """The model a store has now."""
    return versions(store)[-1]


def _first(store: Store) -> ModelVersion:
    if store.header.campaign_toml is None:
        return ModelVersion(1, None, store.header.started, ())
    campaign = parts_of(store)[0]
    terms = tuple(Term(effect) for effect in parse_campaign(campaign.toml, store.path).model.effects)
    plugins = {effect: PluginFile(**plugin) for effect, plugin in campaign.plugins.items()}
    return ModelVersion(1, None, store.header.started, terms, plugins=plugins)


def _version(number: int, document: Document) -> ModelVersion:
    data = document.data
    return ModelVersion(
        number,
        data["parent"],
        document.time,
        tuple(Term(each["effect"], each["choice"]) for each in data["terms"]),
        data["added"],
        data["removed"],
        {effect: PluginFile(**plugin) for effect, plugin in data["plugins"].items()},
        data.get("start"),
        tuple(data.get("held", ())),
        data.get("runs", ""),
        data.get("places", {}),
    )


def extend(
    store: Store,
    term: Term,
    plugin: PluginFile | None = None,
    fitted: tuple[Mapping[str, float], Sequence[str]] | None = None,
    places: Mapping[str, Mapping[str, float]] | None = None,
) -> ModelVersion:
    """A new version with one more term, which `plugin` brought; `ConfigError` when the term is there already.

    `fitted` are the parameters where its fit starts, and those of them that are held, `places` those of its effects.
    """
    last = current(store)
    if term in last.terms:
        raise there_already(term.effect)
    plugins = {**last.plugins, term.effect: plugin} if plugin else last.plugins
    return _keep(store, last, (*last.terms, term), plugins, added=term.effect, fitted=fitted, places=places)


def remove(store: Store, effect: str) -> ModelVersion:
    """A new version without a term; `ConfigError` when it is not there."""
    last = current(store)
    require_present(last, [effect])
    terms = tuple(term for term in last.terms if term.effect != effect)
    plugins = {name: plugin for name, plugin in last.plugins.items() if name != effect}
    return _keep(store, last, terms, plugins, removed=effect)


def remove_all(store: Store, effects: Sequence[str]) -> list[ModelVersion]:
    """One new version per effect, all of them or none."""
    require_present(current(store), effects)
    return [remove(store, effect) for effect in effects]


def _keep(
    store: Store,
    last: ModelVersion,
    terms: Sequence[Term],
    plugins: Mapping[str, PluginFile],
    added: str | None = None,
    removed: str | None = None,
    fitted: tuple[Mapping[str, float], Sequence[str]] | None = None,
    places: Mapping[str, Mapping[str, float]] | None = None,
) -> ModelVersion:
    places = {**last.places, **(places or {})}
    known = {} if fitted is None else {"start": dict(fitted[0]), "held": list(fitted[1]), "runs": runs_key(store)}
    store.add_document(
        VERSION,
        {
            "parent": last.version,
            "terms": [term.as_json() for term in terms],
            "added": added,
            "removed": removed,
            "plugins": {effect: vars(plugin) for effect, plugin in plugins.items()},
            "places": {term.effect: dict(places[term.effect]) for term in terms if term.effect in places},
            **known,
        },
    )
    return current(store)


def there_already(effect: str) -> ConfigError:
    """What is in the model is not added again."""
    return ConfigError(f"'{effect}' is in the model already; `rigctl model show` tells what is")


def require_present(version: ModelVersion, effects: Sequence[str]) -> None:
    """`ConfigError` when one of `effects` is not in the model, or named twice."""
    for number, effect in enumerate(effects):
        if effect not in version.effects or effect in effects[:number]:
            there = ", ".join(version.effects) or "the baseline alone"
            raise ConfigError(f"'{effect}' is not in the model, which is {there}")


# What was worked out


def data_key(store: Store, plugins: Sequence[PluginFile]) -> str:
    """Names the data, the program, the files with effects beside its own, and the terms of all versions, which tell
    the noise together: what was worked out under another key is out of date."""
    return _data_key(store, plugins, [version.terms for version in versions(store)])


def _data_key(store: Store, plugins: Sequence[PluginFile], models: Sequence[Sequence[Term]]) -> str:
    # Sets: neither the order of versions or files nor terms that several of them have make other noise.
    terms = {term.key for terms in models for term in terms}
    files = {plugin.sha256 for plugin in plugins}
    key = [_code(), runs_key(store), sorted(terms), sorted(files)]
    return hashlib.sha256(json.dumps(key).encode()).hexdigest()


def runs_key(store: Store) -> str:
    """Names the runs that are valid now."""
    runs = [record.run_id for record in store.runs(valid_only=True)]
    return hashlib.sha256(json.dumps(runs).encode()).hexdigest()


def still_held(store: Store, version: ModelVersion) -> frozenset[str]:
    """Parameters that a version holds at zero; with other runs it is asked anew which these are."""
    # What one set of runs cannot determine, another may.
    return frozenset(version.held) if version.held and version.runs == runs_key(store) else frozenset()


@functools.cache
def _code() -> str:
    # The text of the program itself: nobody has to remember to count up a version.
    root = Path(__file__).parents[2]
    digest = hashlib.sha256()
    folders = itertools.chain.from_iterable(os.walk(root / package) for package in CODE)
    for path in sorted(Path(folder, name) for folder, _, names in folders for name in names if name.endswith(".py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _keep_if_possible(store: Store, kind: str, data: Mapping[str, Any]) -> None:
    """Keep what can be worked out again: a store that is only read, or a disk that is full, takes nothing from it."""
    if not store.readonly:
        with suppress(StorageError):
            store.add_document(kind, data)


def keep_fit(store: Store, plugins: Sequence[PluginFile], version: ModelVersion, fit: Mapping[str, Any]) -> None:
    """Keep a version's fit to the runs that are valid now."""
    _keep_if_possible(store, FIT, {"version": version.version, "data": data_key(store, plugins), "fit": fit})


def kept_fit(store: Store, plugins: Sequence[PluginFile], version: ModelVersion) -> dict[str, Any] | None:
    """The fit of a version to the runs that are valid now; None when there is none yet."""
    return _kept(store, FIT, "fit", version=version.version, data=data_key(store, plugins))


def keep_comparison(
    store: Store, plugins: Sequence[PluginFile], version: ModelVersion, comparison: Mapping[str, Any]
) -> None:
    """Keep how a version stands beside the runs that are valid now."""
    key = {"version": version.version, "data": data_key(store, plugins)}
    _keep_if_possible(store, COMPARISON, {**key, "comparison": comparison})


def kept_comparison(store: Store, plugins: Sequence[PluginFile], version: ModelVersion) -> dict[str, Any] | None:
    """How a version stands beside the runs that are valid now; None when it has not been asked yet."""
    return _kept(store, COMPARISON, "comparison", version=version.version, data=data_key(store, plugins))


def keep_account(
    store: Store, plugins: Sequence[PluginFile], models: Sequence[Sequence[Term]], account: Mapping[str, Any]
) -> None:
    """Keep what the noise of the runs that are valid now was estimated with, given these models."""
    _keep_if_possible(store, ACCOUNT, {"data": _data_key(store, plugins, models), "account": account})


def kept_account(
    store: Store, plugins: Sequence[PluginFile], models: Sequence[Sequence[Term]]
) -> dict[str, Any] | None:
    """What the noise of the runs that are valid now was estimated with, given these models; None when it has not been
    yet."""
    return _kept(store, ACCOUNT, "account", data=_data_key(store, plugins, models))


def keep_diagnosis(
    store: Store, plugins: Sequence[PluginFile], version: ModelVersion, alpha: float, diagnosis: Mapping[str, Any]
) -> None:
    """Keep a diagnosis of the runs that are valid now, which has asked the effects of these files too."""
    key = {"version": version.version, "data": data_key(store, plugins), "alpha": alpha}
    _keep_if_possible(store, DIAGNOSIS, {**key, "diagnosis": diagnosis})


def kept_diagnosis(
    store: Store, plugins: Sequence[PluginFile], version: ModelVersion, alpha: float
) -> dict[str, Any] | None:
    """The diagnosis of a version with the runs that are valid now; None when there is none yet."""
    data = data_key(store, plugins)
    return _kept(store, DIAGNOSIS, "diagnosis", version=version.version, data=data, alpha=alpha)


def last_diagnosis(store: Store) -> dict[str, Any] | None:
    """Whatever was diagnosed last, of whichever version and runs; None when nothing was."""
    return _kept(store, DIAGNOSIS, "diagnosis")


def _kept(store: Store, kind: str, what: str, **key: Any) -> dict[str, Any] | None:
    matching = [each.data[what] for each in store.documents(kind) if key.items() <= each.data.items()]
    # Documents are never changed: of several for the same question the last counts.
    return dict(matching[-1]) if matching else None
