"""The header of a bundle: recording.toml to a `Header` and back; an error names the line."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, date, datetime, time
from typing import Any

from pydantic import ValidationError

from rigctl.campaign.bundle.csv_table import decode
from rigctl.campaign.bundle.place import Place
from rigctl.campaign.layout import FACES
from rigctl.campaign.recording import OWN_CLOCK, ChannelInfo, Header, LaserInfo, TableSpec
from rigctl.campaign.stated import CONSTANTS_U, StatedFlaw, uncertainties_of
from rigctl.campaign.table_constants import TableConstant, flaw_of_constants
from rigctl.core.errors import DataError, either
from rigctl.core.experiments import EXPERIMENTS, of_readings
from rigctl.core.numbers import MAGNITUDE_MAX
from rigctl.core.toml import TomlFlaw, parsed, to_toml
from rigctl.core.units import TILT_MAX_DEG, contradicts, flaw_of_constant, unit_of_column
from rigctl.files.certified import misspelt
from rigctl.files.item import Item

# tomllib tells no position of a value, so keys are looked for in the text once an error needs its line.
_KEY = r"""(?:[A-Za-z0-9_-]+|"(?:[^"\\]|\\.)*"|'[^']*')"""
_KEY_PATH = rf"{_KEY}(?:\s*\.\s*{_KEY})*"
_SECTION = re.compile(rf"\s*\[\[?\s*({_KEY_PATH})\s*\]")
_PAIR = re.compile(rf"\s*({_KEY_PATH})\s*=")


@dataclass(frozen=True)
class TomlDocument:
    """`data` as tomllib gives it; `error` finds the line of a key."""

    place: Place
    text: str
    data: Mapping[str, Any]

    def error(self, keys: tuple[str, ...], message: str) -> DataError:
        """A `DataError` about the value at `keys`; `message` says what is wrong and the mend."""
        return self.place.error(f"{'.'.join(keys)} {message}", self.line_of(keys))

    def line_of(self, keys: tuple[str, ...]) -> int | None:
        """The line of a key, or of the section in which it is missing; None where that is missing too."""
        best, depth = None, 0
        section: tuple[str, ...] = ()
        for number, line in enumerate(self.text.split("\n"), 1):
            if match := _SECTION.match(line):
                line_keys = section = _names(match[1])
            elif match := _PAIR.match(line):
                line_keys = (*section, *_names(match[1]))
            else:
                continue
            # The deepest line that leads to the key: the key's own, or the section in which it is missing.
            if len(line_keys) > depth and keys[: len(line_keys)] == line_keys:
                best, depth = number, len(line_keys)
        return best


def _names(path: str) -> tuple[str, ...]:
    return tuple(name.strip("\"'") for name in re.findall(_KEY, path))


def parse_toml(place: Place, data: bytes) -> TomlDocument:
    """Parse a TOML file; `DataError` with the line of what is not TOML, or is nested as nobody nests."""
    text = decode(place, data)
    try:
        return TomlDocument(place, text, parsed(text))
    except TomlFlaw as flaw:
        raise place.error(str(flaw), flaw.line) from flaw


FORMAT = 1
_NAMED = {"format", "experiment", "title", "started", "world_sha256", "constants", "channels", "lasers"}
# Has a file of its own, patterns.csv.
_ELSEWHERE = {"patterns"}


def read_header(place: Place, data: bytes) -> Header:
    """Parse recording.toml; `DataError` with line and mend for anything it must not hold."""
    document = parse_toml(place, data)
    _require_format(document)
    experiment = document.data.get("experiment")
    if not isinstance(experiment, str) or experiment not in EXPERIMENTS:
        problem = "is missing" if experiment is None else f"{experiment!r} is unknown"
        raise document.error(("experiment",), f"{problem}; write {either(EXPERIMENTS)}")
    _require_item(document)
    extra = {name: _json(value) for name, value in document.data.items() if name not in _NAMED}
    if of_readings(experiment):
        extra["table"] = _table_spec(document)
    header = Header(
        experiment=experiment,
        title=_text(document, ("title",), document.data.get("title", "")),
        started=_started(document),
        world_sha256=_text(document, ("world_sha256",), document.data.get("world_sha256", "")) or None,
        constants={
            name: _constant(document, name, value) for name, value in _section(document, ("constants",)).items()
        },
        channels={name: _channel(document, name) for name in _section(document, ("channels",))},
        lasers={name: _laser(document, name) for name in _section(document, ("lasers",))},
        extra=extra,
    )
    try:
        stated = uncertainties_of(header)
    except StatedFlaw as flaw:
        raise document.error(flaw.keys, flaw.said) from flaw
    if said := next(misspelt(stated, header.lasers), None):
        raise place.error(said)
    return header


def header_to_toml(header: Header) -> str:
    """The text of recording.toml."""
    named = {
        "format": FORMAT,
        "experiment": header.experiment,
        "title": header.title,
        "started": datetime.fromisoformat(header.started) if header.started else None,
        # Whoever reads it has to know that no item was measured.
        "world_sha256": header.world_sha256,
        "constants": header.constants,
        "channels": {name: _known_first(channel) for name, channel in header.channels.items()},
        "lasers": {name: _known_first(laser) for name, laser in header.lasers.items()},
    }
    extra = {name: value for name, value in header.extra.items() if name not in _NAMED | _ELSEWHERE}
    constants_u = {name: u for name, u in uncertainties_of(header)["constants"].items() if u > 0.0}
    stated = {name: value for name, value in named.items() if value not in (None, "", {})}
    return to_toml({**stated, **extra, **({CONSTANTS_U: constants_u} if constants_u else {})})


def _known_first(info: ChannelInfo | LaserInfo) -> dict[str, Any]:
    values = asdict(info)
    extra = values.pop("extra")
    return {**{name: value for name, value in values.items() if value not in (None, "")}, **extra}


def _require_format(document: TomlDocument) -> None:
    number = document.data.get("format")
    if number is None:
        raise document.error(("format",), f"is missing; write format = {FORMAT} in the first line")
    # True == 1 in Python, but `format = true` is a mistake.
    if number != FORMAT or isinstance(number, bool):
        raise document.error(
            ("format",), f"= {number!r} is not read by this program; write {FORMAT}, or update rigctl"
        )


def _started(document: TomlDocument) -> str:
    value = document.data.get("started")
    if value is None:
        return ""
    try:
        when = value if isinstance(value, datetime) else datetime.fromisoformat(str(value))
        if when.tzinfo is None:
            raise document.error(("started",), f"{value} has no time zone; write UTC with a Z at its end")
        return when.astimezone(UTC).isoformat().replace("+00:00", "Z")
    except (ValueError, OverflowError):
        raise document.error(("started",), f"{value!r} is no time; write e.g. 2026-11-21T01:00:00Z") from None


def _constant(document: TomlDocument, name: str, value: object) -> float:
    number = _number(document, ("constants", name), value)
    if flaw := flaw_of_constant(name, number):
        raise document.error(("constants", name), flaw)
    return number


def _channel(document: TomlDocument, name: str) -> ChannelInfo:
    keys = ("channels", name)
    values = dict(_section(document, keys))
    # The unit that the column's suffix gives; `[channels]` may then leave it out.
    promised = unit_of_column(name)
    unit = _text(document, (*keys, "unit"), values.pop("unit", promised))
    if contradicts(unit, name):
        raise document.error(
            (*keys, "unit"), f"{unit!r} contradicts the column's name; write {promised!r}, or rename the column"
        )
    numbers: dict[str, float | None] = {
        key: _number(document, (*keys, key), values.pop(key)) if key in values else None
        for key in ("noise_rms", "full_scale", "latency_s", "clock_u_s")
    }
    noise_rms, full_scale, latency_s, clock_u_s = numbers.values()
    if full_scale is not None and not full_scale > 0:
        raise document.error((*keys, "full_scale"), "is not positive; write the largest reading, or leave it out")
    if noise_rms is not None and not noise_rms >= 0:
        raise document.error((*keys, "noise_rms"), "is negative; write the rms of one sample, or leave it out")
    if clock_u_s is not None and not clock_u_s > 0:
        raise document.error((*keys, "clock_u_s"), "is not positive; write a standard uncertainty, or leave it out")
    kind = _text(document, (*keys, "kind"), values.pop("kind", ""))
    clock = values.pop("clock", None)
    if clock not in {None, OWN_CLOCK}:
        raise document.error(
            (*keys, "clock"), f'is {clock!r}; write "{OWN_CLOCK}", or leave it out for a channel on the rig\'s clock'
        )
    return ChannelInfo(unit, kind, noise_rms, full_scale, latency_s, clock, clock_u_s, extra=_json(values))


def _laser(document: TomlDocument, name: str) -> LaserInfo:
    keys = ("lasers", name)
    values = dict(_section(document, keys))
    face = values.pop("face", None)
    if face is not None and face not in FACES:
        raise document.error((*keys, "face"), f"{face!r} is no face; write {either(FACES)}")
    tilt = values.pop("tilt_deg", None)
    tilt_deg = None if tilt is None else _number(document, (*keys, "tilt_deg"), tilt)
    if tilt_deg is not None and abs(tilt_deg) >= TILT_MAX_DEG:
        raise document.error(
            (*keys, "tilt_deg"), f"is {tilt_deg:g}, with which the beam misses its face; write less than 90"
        )
    return LaserInfo(face, tilt_deg, _json(values))


def _table_spec(document: TomlDocument) -> dict[str, Any]:
    known = list(TableSpec.__dataclass_fields__)
    values = _section(document, ("table",))
    for name in values:
        if name not in known:
            raise document.error(("table", name), f"is unknown; the keys are {', '.join(known)}")
    for name in ("response", "baseline"):
        if name not in values:
            raise document.error(("table",), f"has no {name}; add it")
    start = _section(document, ("table", "start"))
    others = {"start", "batch", "constants"}
    texts = {k: _text(document, ("table", k), v) for k, v in values.items() if k not in others}
    return {
        **texts,
        **_batch(document, values),
        **_table_constants(document),
        "start": {k: _number(document, ("table", "start", k), v) for k, v in start.items()},
    }


def _batch(document: TomlDocument, values: Mapping[str, Any]) -> dict[str, list[str]]:
    if "batch" not in values:
        return {}
    columns = values["batch"]
    if not isinstance(columns, list) or not all(isinstance(name, str) for name in columns):
        raise document.error(("table", "batch"), f'is {columns!r}; write a list of columns, such as ["lot"]')
    return {"batch": columns}


def _table_constants(document: TomlDocument) -> dict[str, Any]:
    keys = ("table", "constants")
    constants = {name: _table_constant(document, (*keys, name)) for name in _section(document, keys)}
    if flaw := flaw_of_constants(constants):
        raise document.error((*keys, *flaw[0]), flaw[1])
    return {"constants": {name: constant.as_json() for name, constant in constants.items()}} if constants else {}


def _table_constant(document: TomlDocument, keys: tuple[str, ...]) -> TableConstant:
    values = _section(document, keys)
    known = list(TableConstant.__dataclass_fields__)
    for name in values:
        if name not in known:
            raise document.error((*keys, name), f"is unknown; the keys are {', '.join(known)}")
    if "value" not in values:
        raise document.error(keys, "has no value; add it")
    numbers = {
        name: _number(document, (*keys, name), value) for name, value in values.items() if name != "correlation"
    }
    correlation = {
        name: _number(document, (*keys, "correlation", name), value)
        for name, value in _section(document, (*keys, "correlation")).items()
    }
    return TableConstant(**numbers, correlation=correlation)


def _require_item(document: TomlDocument) -> None:
    """Raise unless `[item]` is one where it is there: further keys would be lost to every certificate."""
    for name, value in _section(document, ("item",)).items():
        if name not in Item.model_fields:
            raise document.error(("item", name), f"is unknown; the keys are {', '.join(Item.model_fields)}")
        if name != "received":
            _text(document, ("item", name), value)
    try:
        Item.model_validate(_json(_section(document, ("item",))))
    except ValidationError as error:
        fault = error.errors()[0]
        raise document.error(("item", *map(str, fault["loc"])), f"cannot be read: {fault['msg']}; mend it") from None


def _section(document: TomlDocument, keys: tuple[str, ...]) -> Mapping[str, Any]:
    value: Any = document.data
    for key in keys:
        value = value.get(key, {})
        if not isinstance(value, dict):
            raise document.error(keys, f"is {value!r}; make it a table [{'.'.join(keys)}]")
    return value  # type: ignore[no-any-return]


def _text(document: TomlDocument, keys: tuple[str, ...], value: object) -> str:
    if not isinstance(value, str):
        raise document.error(keys, f"is {value!r}, not a text; put it in quotes")
    return value


def _number(document: TomlDocument, keys: tuple[str, ...], value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise document.error(keys, f"is {value!r}, not a number; write it without quotes or unit")
    # NaN fails this too: TOML can write nan and inf.
    if not abs(value) <= MAGNITUDE_MAX:
        raise document.error(keys, "is no quantity; write a number, or leave it out")
    return float(value)


def _json(value: Any) -> Any:
    """A TOML value as JSON can keep it: times become ISO 8601 text."""
    if isinstance(value, dict):
        return {name: _json(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_json(item) for item in value]
    return value.isoformat() if isinstance(value, datetime | date | time) else value
