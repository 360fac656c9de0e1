"""Rig files: the instruments of a rig, its package, constants and certificates, and the world of a simulated one.

The settings of an instrument beyond driver, address and role are its driver's own (`drivers.<module>.<...>Settings`).
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping
from datetime import date
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field

from rigctl.core.errors import ConfigError, one_line
from rigctl.core.file_tables import Table
from rigctl.core.toml import TomlFlaw, parsed
from rigctl.core.units import flaw_of_constant
from rigctl.files.certified import misspelt, unread
from rigctl.files.package import HeadSettings, Package
from rigctl.files.toml_files import checked_file, parsed_file, read_text

SIMULATED = "sim:"


class RigTable(Table):
    """What the rig is called and which clock it runs on."""

    name: str
    clock: Literal["virtual", "real"] = "virtual"
    clock_speed: Annotated[float, Field(gt=0)] = 1.0
    wire_log: str = ""


class OperatorTable(Table):
    """Where a served simulated world lets the simulated operator act."""

    address: str = ""


class InstrumentTable(BaseModel, extra="allow", frozen=True):
    """One instrument: what all have in common; further keys belong to its driver."""

    driver: str
    address: str
    role: str
    simulator: dict[str, Any] = {}
    faults: dict[str, Any] = {}

    @property
    def settings(self) -> dict[str, Any]:
        """The keys that belong to the driver."""
        return dict(self.__pydantic_extra__ or {})

    @property
    def simulated(self) -> bool:
        """True when the instrument lives in this process."""
        return self.address.startswith(SIMULATED)


class Constant(Table):
    """A constant of nature or of the place, with its standard uncertainty."""

    value: float
    u: Annotated[float, Field(ge=0)] = 0.0


class Certificate(Table):
    """What a calibration certificate says: standard uncertainties by quantity, units in the names.

    `number` and `laboratory` are the certificate's own, for whoever follows the chain of traceability.
    """

    number: str = ""
    laboratory: str = ""
    serial: str = ""
    calibrated: date | None = None
    expires: date | None = None
    uncertainty: dict[str, Annotated[float, Field(ge=0)]] = {}


class RigFile(Table):
    """A rig file, checked."""

    path: Path
    text: str
    rig: RigTable
    operator: OperatorTable = OperatorTable()
    instruments: dict[str, InstrumentTable]
    lasers: dict[str, HeadSettings] = {}
    package: Package | None = None
    constants: dict[str, Constant] = {}
    certificates: dict[str, Certificate] = {}
    # Not checked here: only the simulators know what a world has.
    world: dict[str, Any] | None = None

    @property
    def text_without_world(self) -> str:
        """The file as it may be stored and exported: nature's secrets stay out."""
        return without_tables(self.text, "world")

    @property
    def world_sha256(self) -> str | None:
        """Hash of the simulated world's text and of the files that it names; None for a real rig.

        `ConfigError` for a file that cannot be read.
        """
        # Of the text, not of its values: the text is what is kept beside the store.
        text = only_tables(self.text, "world")
        if not text:
            return None
        digest = hashlib.sha256(text.encode())
        for file in _files_named(self.world or {}):
            try:
                digest.update(file.read_bytes())
            except OSError as error:
                raise ConfigError(f"{file}, which the world names, cannot be read: {error.strerror}") from error
        return digest.hexdigest()

    def with_wire_log(self, directory: Path | None) -> RigFile:
        """The same rig with its wires logged to `directory`; as it is for None."""
        if directory is None:
            return self
        return self.model_copy(update={"rig": self.rig.model_copy(update={"wire_log": str(directory)})})

    @property
    def heads(self) -> dict[str, HeadSettings]:
        """The displacement heads, each with what its certificate says of its scale."""
        known = {name: each.uncertainty for name, each in self.certificates.items()}
        return {name: head.certified(known.get(name)) for name, head in self.lasers.items()}

    @property
    def certified(self) -> dict[str, dict[str, float]]:
        """Standard uncertainties of the certificates by name and quantity."""
        return {name: dict(each.uncertainty) for name, each in self.certificates.items()}

    @property
    def warnings(self) -> list[str]:
        """What may be, but was perhaps not meant so."""
        return [f"{self.path}: {each}" for each in unread(self.certified, self.lasers)]

    @property
    def uncertainties(self) -> dict[str, dict[str, float]]:
        """Standard uncertainties of the certificates by name and quantity; those of the constants as "constants"."""
        return {**self.certified, "constants": {name: each.u for name, each in self.constants.items()}}

    def constant(self, name: str, default: float) -> float:
        """Value of a constant, or the default."""
        return self.constants[name].value if name in self.constants else default


def _files_named(table: Mapping[str, Any]) -> Iterator[Path]:
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _files_named(value)
        elif key == "file":
            yield Path(value)


def read_rig(path: Path) -> RigFile:
    """Read and check a rig file; `ConfigError`."""
    file = parse_rig(read_text(path), path)
    # Not of a file in a store: what has been measured with it can still be analysed.
    for flaw in misspelt(file.certified, file.lasers):
        raise ConfigError(one_line(f"{path}: {flaw}"))
    return file


def parse_rig(text: str, path: Path) -> RigFile:
    """Check a rig file's text as kept in a store; `ConfigError`."""
    data = parsed_file(text, path)
    _require_separable_world(text, path)
    file = checked_file(RigFile, text, data, path)
    for name, constant in file.constants.items():
        if flaw := flaw_of_constant(name, constant.value):
            raise ConfigError(one_line(f"{path}: constants.{name}.value {flaw}"))
    return file


def without_tables(text: str, name: str) -> str:
    """TOML text without the tables `[name]` and `[name.*]`."""
    return "".join(line for inside, line in _sections(text, name) if not inside)


def only_tables(text: str, name: str) -> str:
    """The tables `[name]` and `[name.*]` of a TOML text."""
    return "".join(line for inside, line in _sections(text, name) if inside)


def _sections(text: str, name: str) -> list[tuple[bool, str]]:
    """The lines, each with whether it belongs to the tables; comments right above a header do as well."""
    header = re.compile(r"\s*\[\[?\s*\"?([A-Za-z0-9_-]+)\"?\s*(?:\.|\])")
    inside = False
    lines: list[tuple[bool, str]] = []
    for line in text.splitlines(keepends=True):
        match = header.match(line)
        # A row of a nested array looks like a header but holds numbers; names begin with a letter here.
        if match and match.group(1)[0].isalpha():
            inside = match.group(1) == name
            lines = _with_comments_above(lines) if inside else lines
        lines.append((inside, line))
    return lines


def _with_comments_above(lines: list[tuple[bool, str]]) -> list[tuple[bool, str]]:
    first = len(lines)
    while first and lines[first - 1][1].lstrip().startswith("#"):
        first -= 1
    return lines[:first] + [(True, line) for _, line in lines[first:]]


def _require_separable_world(text: str, path: Path) -> None:
    """What a store keeps is the text without the world: the text must show where that begins and ends."""
    try:
        # Cutting by lines can fail on unusual layouts, so both halves are parsed and looked at.
        seen, hidden = (parsed(take(text, "world")) for take in (without_tables, only_tables))
    except TomlFlaw:
        seen, hidden = {"world": None}, {}
    if "world" in seen or set(hidden) - {"world"}:
        raise ConfigError(f"{path}: world: write it as tables of its own, [world] and [world.NAME]")
