"""The record of a check: in the user's data directory, one file for each `[instruments]` of a rig file."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

import platformdirs
from pydantic import BaseModel, ConfigDict, ValidationError

from rigctl.core.errors import DataError
from rigctl.core.findings import Finding, Outcome, Step
from rigctl.core.interfaces import Identity
from rigctl.files.rig_file import RigFile

FORMAT = 1


class _Kept(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Line(_Kept):
    """A finding of one instrument ("" for the rig as a whole), and when (UTC, ISO 8601) it was found."""

    instrument: str
    step: Step
    item: str
    outcome: Outcome
    found: str
    mend: str = ""
    rig_file: dict[str, Any] = {}
    checked: str

    @classmethod
    def of(cls, instrument: str, finding: Finding, checked: str = "") -> Line:
        """A finding made now, unless `checked` says when."""
        return cls(instrument=instrument, **asdict(finding), checked=checked or utc_now())


class Who(_Kept):
    """Which instrument answered; of its text only what stays the same from day to day."""

    model: str
    serial: str
    firmware: str

    @classmethod
    def of(cls, identity: Identity) -> Who:
        """As it said."""
        return cls(model=identity.model, serial=identity.serial, firmware=identity.firmware)

    def __str__(self) -> str:
        return ", ".join(filter(None, (self.model, self.serial, self.firmware)))


class CheckRecord(_Kept):
    """What a check has found; `learned` are keys of the rig file that only motion tells, by instrument."""

    format: int = FORMAT
    rig: str
    instruments_sha256: str
    checked: str
    identities: dict[str, Who]
    lines: list[Line]
    learned: dict[str, dict[str, str]] = {}

    @property
    def differing(self) -> list[Line]:
        """What is not as it has to be."""
        return [line for line in self.lines if line.outcome == "differs"]

    def going_on(self, earlier: CheckRecord | None, done: Collection[Step]) -> CheckRecord:
        """With what an earlier check of the same instruments found in steps that were not `done` now."""
        if earlier is None or earlier.identities != self.identities:
            return self
        kept = [
            line
            for line in earlier.lines
            if line.step in ASKED_FOR and line.step not in done and line.outcome != "unknown"
        ]
        replaced = {line.step for line in kept}
        lines = [line for line in self.lines if line.step not in replaced]
        return self.model_copy(update={"lines": [*lines, *kept], "learned": {**earlier.learned, **self.learned}})


ASKED_FOR: tuple[Step, ...] = ("trigger", "interlock", "motion")
"""Steps of a check that are done only when asked for."""


def utc_now() -> str:
    """To the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def instruments_sha256(file: RigFile) -> str:
    """Of what `[instruments]` says: remarks and the order of keys do not count."""
    tables = {name: table.model_dump(mode="json") for name, table in file.instruments.items()}
    return hashlib.sha256(json.dumps(tables, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def record_path(sha256: str) -> Path:
    """Where the record of a check of these instruments is."""
    return platformdirs.user_data_path("rigctl") / "checks" / f"{sha256[:16]}.json"


def kept_record(file: RigFile) -> CheckRecord | None:
    """The record of the last check of these instruments; None when there is none. `DataError` when it is damaged."""
    sha256 = instruments_sha256(file)
    path = record_path(sha256)
    try:
        record = CheckRecord.model_validate_json(path.read_bytes())
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, ValidationError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is no record of a check, or of another version"
        raise DataError(f"{path}: {why}; delete it and run `rigctl check {file.path}` again") from None
    # The name has only the beginning of it.
    return record if record.instruments_sha256 == sha256 else None


def keep(record: CheckRecord) -> Path:
    """Write it, whole or not at all; `DataError`."""
    path = record_path(record.instruments_sha256)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with NamedTemporaryFile("w", dir=path.parent, delete=False, encoding="utf-8") as file:
            file.write(record.model_dump_json(indent=1))
        Path(file.name).replace(path)
    except OSError as error:
        raise DataError(
            f"{path}: the record of this check cannot be written ({error.strerror}); "
            "set XDG_DATA_HOME to a directory of yours"
        ) from None
    return path


def with_learned(file: RigFile, learned: Mapping[str, Mapping[str, str]]) -> RigFile:
    """The rig file with what only motion told, where it says nothing itself; its text stays as it is."""
    tables = dict(file.instruments)
    for name, keys in learned.items():
        said = tables[name].settings if name in tables else {}
        new = {key: value for key, value in keys.items() if said.get(key, "unknown") == "unknown"}
        if name in tables and new:
            tables[name] = tables[name].model_validate({**tables[name].model_dump(), **new})
    return file.model_copy(update={"instruments": tables})
