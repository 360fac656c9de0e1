"""Rig and campaign files: TOML an operator writes, checked whole before anything moves.

Every complaint is one line that names file, key and mend. The settings of an instrument beyond driver, address and
role are its driver's own (`drivers.<module>.<...>Settings`), those of a procedure the procedure's.
"""

from __future__ import annotations

import hashlib
import math
import re
import tomllib
from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, Field, ValidationError, field_validator

from rigctl.core.bounds import TOML_BYTES, amount
from rigctl.core.errors import ConfigError
from rigctl.core.experiments import REGISTRY, measured
from rigctl.core.file_tables import Table
from rigctl.core.messages import either, one_line
from rigctl.core.numbers import MAGNITUDE_MAX
from rigctl.core.plausible import flaw_of_constant
from rigctl.core.reading import TooLarge, read_regular
from rigctl.core.toml import TomlFlaw, parsed
from rigctl.files.package import HeadSettings, Package

SIMULATED = "sim:"

Model = TypeVar("Model", bound=BaseModel)


class RigTable(Table):
    """What the rig is called and which clock it runs on."""

    name: str
    clock: Literal["virtual", "real"] = "virtual"
    clock_speed: Annotated[float, Field(gt=0)] = 1.0


class OperatorTable(Table):
    """Where a served simulated world lets the simulated operator act."""

    address: str = ""


class Instrument(BaseModel, extra="allow", frozen=True):
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
    """What a calibration certificate says: standard uncertainties by quantity, units in the names."""

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
    instruments: dict[str, Instrument]
    lasers: dict[str, HeadSettings] = {}
    package: Package | None = None
    constants: dict[str, Constant] = {}
    certificates: dict[str, Certificate] = {}
    world: dict[str, Any] | None = None

    @property
    def text_without_world(self) -> str:
        """The file as it may be stored and exported: nature's secrets stay out."""
        return without_tables(self.text, "world")

    @property
    def world_sha256(self) -> str | None:
        """Hash of the simulated world's text; None for a real rig."""
        text = only_tables(self.text, "world")
        return hashlib.sha256(text.encode()).hexdigest() if text else None

    @property
    def heads(self) -> dict[str, HeadSettings]:
        """The displacement heads, each with what its certificate says of its scale."""
        return {name: self._certified(name, head) for name, head in self.lasers.items()}

    def _certified(self, name: str, head: HeadSettings) -> HeadSettings:
        if name not in self.certificates:
            return head
        known = self.certificates[name].uncertainty
        # A tilt error changes the reading as the scale does, by tan(tilt) times the error.
        from_tilt = math.tan(head.tilt_rad) * math.radians(known.get("tilt_deg", 0.0))
        return head.model_copy(update={"u_scale": math.hypot(known.get("scale", 0.0), from_tilt)})

    def constant(self, name: str, default: float) -> float:
        """Value of a constant, or the default."""
        return self.constants[name].value if name in self.constants else default


class ModelTable(Table):
    """Which effects the model has beyond its baseline."""

    effects: tuple[str, ...] = ()


class ReferenceTable(Table):
    """Values to print a result beside."""

    source: str = ""
    axes: dict[str, tuple[float, float, float]] = {}
    std_hc_2sigma_arcsec: dict[str, float] = {}
    offset_deg: dict[str, float] = {}


class CampaignFile(Table):
    """A campaign file, checked as far as it does not depend on the procedure."""

    path: Path
    text: str
    experiment: str
    title: str = ""
    rig: str = ""
    procedure: dict[str, Any]
    targets: dict[str, Any] = {}
    model: ModelTable = ModelTable()
    on_terminal_lost: Literal["continue", "stop"] = "continue"
    reference: ReferenceTable = ReferenceTable()

    @field_validator("experiment")
    @classmethod
    def _known(cls, experiment: str) -> str:
        if experiment in REGISTRY.names():
            REGISTRY.get(experiment)  # says why it cannot be used
        if experiment not in measured():
            raise ValueError(f"input should be {either(map(repr, measured()))}")
        return experiment

    @property
    def rig_path(self) -> Path:
        """The rig file it names, relative to itself."""
        return self.path.parent / self.rig

    @property
    def goes_on(self) -> bool:
        """Whether it measures in the mounting of a store that is there, if there is one."""
        return self.procedure.get("mounting") in {"same", "kept"}


def read_rig(path: Path) -> RigFile:
    """Read and check a rig file; `ConfigError`."""
    return parse_rig(_read(path), path)


def parse_rig(text: str, path: Path) -> RigFile:
    """Check a rig file's text as kept in a store; `ConfigError`."""
    data = _parse(text, path)
    _require_separable_world(text, path)
    file = _file(RigFile, text, data, path)
    for name, constant in file.constants.items():
        if flaw := flaw_of_constant(name, constant.value):
            raise ConfigError(one_line(f"{path}: constants.{name}.value {flaw}"))
    return file


def read_campaign(path: Path) -> CampaignFile:
    """Read and check a campaign file; `ConfigError`."""
    return parse_campaign(_read(path), path)


def parse_campaign(text: str, path: Path) -> CampaignFile:
    """Check a campaign file's text as kept in a store; `ConfigError`."""
    return _file(CampaignFile, text, _parse(text, path), path)


def validated(model: type[Model], data: Mapping[str, Any], path: Path, prefix: str = "") -> Model:
    """Check data against a model, types as TOML has them; `ConfigError` with the first fault as file, key, mend."""
    try:
        return model.model_validate(_with_tuples(data), strict=True)
    except ValidationError as error:
        raise ConfigError(one_line(f"{path}: {explain(model, error, prefix)}")) from None


def explain(model: type[BaseModel], error: ValidationError, prefix: str = "") -> str:
    """The first fault of a validation in one line: key, what is wrong, what is allowed."""
    fault = error.errors()[0]
    where = ".".join(str(part) for part in fault["loc"])
    key = ".".join(part for part in (prefix, where) if part)
    more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
    if fault["type"] == "extra_forbidden":
        known = ", ".join(_known_keys(model, [str(part) for part in fault["loc"][:-1]]))
        return f"unknown key {key}{f'; known there: {known}' if known else '; remove it'}{more}"
    if fault["type"] == "missing":
        return f"{key} is missing; add it{more}"
    message = fault["msg"].removeprefix("Value error, ")
    message = message[0].lower() + message[1:]
    given = fault.get("input")
    shown = f", not {given!r}" if isinstance(given, str | int | float | bool) else ""
    return f"{key or 'file'}: {message}{shown}{more}"


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
        found = header.match(line)
        # A row of a nested array looks like a header but holds numbers; names begin with a letter here.
        if found and found.group(1)[0].isalpha():
            inside = found.group(1) == name
            lines = _with_comments_above(lines) if inside else lines
        lines.append((inside, line))
    return lines


def _with_comments_above(lines: list[tuple[bool, str]]) -> list[tuple[bool, str]]:
    first = len(lines)
    while first and lines[first - 1][1].lstrip().startswith("#"):
        first -= 1
    return lines[:first] + [(True, line) for _, line in lines[first:]]


def _file(model: type[Model], text: str, data: Mapping[str, Any], path: Path) -> Model:
    for key in sorted(_OURS & set(data)):
        raise ConfigError(f"{path}: unknown key {key}; known there: {', '.join(_known_keys(model, []))}")
    return validated(model, {**data, "path": path, "text": text}, path)


def _require_separable_world(text: str, path: Path) -> None:
    """What a store keeps is the text without the world: the text must show where that begins and ends."""
    try:
        seen, hidden = (tomllib.loads(take(text, "world")) for take in (without_tables, only_tables))
    except tomllib.TOMLDecodeError:
        seen, hidden = {"world": None}, {}
    if "world" in seen or set(hidden) - {"world"}:
        raise ConfigError(f"{path}: world: write it as tables of its own, [world] and [world.NAME]")


def _require_measurable(value: Any, path: Path, key: str = "") -> None:
    if isinstance(value, Mapping):
        for name, each in value.items():
            _require_measurable(each, path, f"{key}.{name}" if key else name)
    elif isinstance(value, list):
        for index, each in enumerate(value):
            _require_measurable(each, path, f"{key}.{index}")
    elif isinstance(value, int | float) and not abs(value) <= MAGNITUDE_MAX:
        raise ConfigError(one_line(f"{path}: {key}: {value} is no quantity; write a number"))


def _with_tuples(value: Any) -> Any:
    """TOML's arrays as tuples: what never changes, and what strict validation takes for one."""
    if isinstance(value, Mapping):
        return {key: _with_tuples(each) for key, each in value.items()}
    return tuple(map(_with_tuples, value)) if isinstance(value, list) else value


def _known_keys(model: type[BaseModel], path: list[str]) -> list[str]:
    current: Any = model
    for part in path:
        fields = getattr(current, "model_fields", {})
        annotation = fields[part].annotation if part in fields else None
        candidates = [annotation, *getattr(annotation, "__args__", ())]
        current = next((c for c in candidates if isinstance(c, type) and issubclass(c, BaseModel)), current)
    return [name for name in getattr(current, "model_fields", {}) if name not in _OURS]


_OURS = {"path", "text"}
"""Fields of a file that do not come from its text."""


def _read(path: Path) -> str:
    try:
        return read_regular(path, TOML_BYTES).decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file; check the name") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: not UTF-8 text (byte {error.start}); save it as UTF-8") from None
    except TooLarge:
        raise ConfigError(
            f"{path}: larger than {amount(TOML_BYTES)}, which no such file is; check the name"
        ) from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}") from None


def _parse(text: str, path: Path) -> dict[str, Any]:
    try:
        data = parsed(text)
    except TomlFlaw as flaw:
        line = "" if flaw.line is None else f"line {flaw.line}: "
        raise ConfigError(f"{path}: {line}{flaw}") from None
    _require_measurable(data, path)
    return data
