"""A store as one calibration of an item: when, of which item, with which equipment."""

from __future__ import annotations

import hashlib
import json
import re
import sqlite3
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rigctl.campaign.item import item_of
from rigctl.campaign.recording import Header
from rigctl.campaign.status import status_in
from rigctl.campaign.store.store import Store
from rigctl.core.errors import RigError, one_line
from rigctl.core.units import unit_of_column
from rigctl.experiments.analysis import Measuring, analysis_of
from rigctl.files.item import Item
from rigctl.history.kept_result import KeptResult, kept_result
from rigctl.workbench.model import versions

UNREADABLE = (RigError, OSError, sqlite3.Error, ArithmeticError, LookupError, TypeError, ValueError)
"""What a file of whatever contents raises: one that cannot be read does not keep the others from being read."""

NO_SERIAL = (
    "says no serial number of its item; write [item] serial in the campaign file or the bundle, or issue a "
    "certificate whose details have it"
)
NO_DATE = "does not say when it was measured; write `started` in its recording.toml and import it again"


@dataclass(frozen=True)
class NotListed:
    """A store that is no calibration in a history, and why, in one line."""

    store: Path
    reason: str


@dataclass(frozen=True)
class Kind:
    """What calibrations have to have in common to be compared.

    `model` is what gives quantities their meaning where they are parameters of a fit: the formula and its effects.
    """

    serial: str
    experiment: str
    model: str
    simulated: bool


@dataclass(frozen=True)
class Calibration:
    """One finished calibration; `result` None where it has to be worked out.

    `equipment` is the same for calibrations with the same instruments and certificates, whose errors are the same;
    None where nothing is known of them.
    """

    store: Path
    kind: Kind
    item: Item
    started: datetime
    equipment: str | None
    effects: tuple[str, ...]
    result: KeptResult | None

    @property
    def date(self) -> str:
        """The day on which it began, UTC, ISO 8601."""
        return self.started.date().isoformat()


def read_calibration(path: Path, wanted: Callable[[str], bool]) -> Calibration | NotListed | None:
    """What a store says, without fitting anything; None for an item with a serial number that is not `wanted`."""
    try:
        with Store.open(path, readonly=True) as store:
            return _read(store, wanted)
    except UNREADABLE as error:
        return NotListed(path, reason_of(error, path))


def reason_of(error: Exception, path: Path) -> str:
    """An error as the reason why a store is not listed, without the name that stands beside it."""
    text = str(error) if isinstance(error, RigError) else f"cannot be read ({type(error).__name__}: {error})"
    return one_line(text.removeprefix(f"{path}: "))


def _read(store: Store, wanted: Callable[[str], bool]) -> Calibration | NotListed | None:
    path, header = store.path, store.header
    item = item_of(store)
    if item.serial and not wanted(item.serial):
        return None
    status = status_in(store)
    if status["state"] != "done":
        return NotListed(path, f"{status['state']}: {status['runs_done']} of {status['runs_planned']} runs")
    if not item.serial:
        return NotListed(path, NO_SERIAL)
    if not header.started:
        return NotListed(path, NO_DATE)
    started = datetime.fromisoformat(header.started)
    effects = versions.current(store).effects
    kind = Kind(item.serial, header.experiment, _model(store, effects), header.world_sha256 is not None)
    utc = started.replace(tzinfo=UTC) if started.tzinfo is None else started.astimezone(UTC)
    return Calibration(path, kind, item, utc, _equipment(store), effects, kept_result(store))


def _model(store: Store, effects: tuple[str, ...]) -> str:
    header = store.header
    if isinstance(analysis_of(header.experiment, store.path), Measuring):
        return ""
    formula = "" if header.table is None else f"{header.table.response} = {header.table.baseline}"
    said = [formula, *sorted(effects)]
    return ", ".join(filter(None, [*said, *_units(header, " ".join(said))]))


def _units(header: Header, said: str) -> list[str]:
    """Of columns that a model names and whose names do not tell it: a parameter's unit follows from them."""
    named = re.findall(r"\w+", said)
    units = {name: channel.unit for name, channel in sorted(header.channels.items()) if name in named}
    return [f"{name} in {unit}" for name, unit in units.items() if unit and unit != unit_of_column(name)]


def _equipment(store: Store) -> str | None:
    """A hash of who answered and of what is certified of it."""
    instruments = {name: [each.get("model"), each.get("serial")] for name, each in store.identities().items()}
    known: list[Any] = [instruments, store.header.extra.get("certificates") or {}]
    if not any(known):
        return None
    return hashlib.sha256(json.dumps(known, sort_keys=True, default=str).encode()).hexdigest()[:12]
