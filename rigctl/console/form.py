"""A campaign file as a form: its keys one by one, each checked while it is typed; comments and the rest stay."""

from __future__ import annotations

import json
import re
import tomllib
import types
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin

LISTED = {"runs"}
"""Keys that are tables of their own: an editor is better for them."""


@dataclass(frozen=True)
class Entry:
    """One key: `text` as the form shows it, "" when the file leaves it to its `default`."""

    table: str
    key: str
    text: str
    default: str
    choices: tuple[str, ...] = ()
    words: bool = False
    listed: bool = False

    @property
    def name(self) -> str:
        """As faults name it."""
        return f"{self.table}.{self.key}" if self.table else self.key


def entries(text: str) -> list[Entry]:
    """The keys a campaign file may have, with what it says; `ConfigError` for text that is not TOML."""
    from procedures.tables import Procedure, Targets
    from rigctl.config import CampaignFile, ModelTable

    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        data = {}
    models: dict[str, Any] = {"": CampaignFile, "procedure": Procedure, "targets": Targets, "model": ModelTable}
    found = []
    for table, model in models.items():
        said = data.get(table, {}) if table else data
        for key, field in model.model_fields.items():
            choices, words, listed = _kind(field.annotation)
            if key in LISTED or key in {"path", "text", *models, "reference"}:
                continue
            default = "" if field.is_required() else _shown(field.default)
            found.append(Entry(table, key, _shown(said[key]) if key in said else "", default, choices, words, listed))
    return found


def changed(text: str, entry: Entry, typed: str) -> str:
    """The file's text with one key set to what was typed; without it when nothing was."""
    lines = text.splitlines()
    first, last = _span(lines, entry.table)
    place = next((i for i in range(first, last) if re.match(rf"\s*{re.escape(entry.key)}\s*=", lines[i])), None)
    end = _end_of_value(lines, place) if place is not None else 0
    new = [f"{entry.key} = {_literal(entry, typed)}"] if typed.strip() else []
    if place is not None:
        lines[place:end] = [new[0] + _comment(lines[place])] if new and end == place + 1 else new
    elif new and (first > 0 or not entry.table):
        while last > first and not lines[last - 1].strip():
            last -= 1
        lines[last:last] = new
    elif new:
        lines += ["", f"[{entry.table}]", *new]
    return "\n".join(lines) + "\n"


def fault(text: str, path: Path) -> str:
    """The first thing that is wrong with a campaign file's text, without the file's name; "" when it is right."""
    from procedures.tables import Procedure, Targets
    from rigctl import config
    from rigctl.errors import ConfigError

    try:
        file = config.parse_campaign(text, path)
        config.validated(Procedure, file.procedure, path, "procedure")
        config.validated(Targets, file.targets, path, "targets")
    except ConfigError as error:
        return str(error).removeprefix(f"{path}: ")
    return ""


def _kind(annotation: Any) -> tuple[tuple[str, ...], bool, bool]:
    """Choices, whether it holds words, whether it is a list."""
    origin = get_origin(annotation)
    if origin is tuple:
        choices, words, _ = _kind(get_args(annotation)[0])
        return choices, words, True
    if origin is Literal:
        return tuple(map(str, get_args(annotation))), isinstance(get_args(annotation)[0], str), False
    if origin in (Union, types.UnionType):
        return _kind(next(each for each in get_args(annotation) if each is not type(None)))
    if hasattr(annotation, "__metadata__"):
        return _kind(get_args(annotation)[0])
    return (), annotation is str, False


def _shown(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(map(_shown, value))
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)


def _literal(entry: Entry, typed: str) -> str:
    if entry.listed:
        parts = [part.strip() for part in typed.strip().strip("[]").split(",") if part.strip()]
        return f"[{', '.join(_scalar(part, entry.words) for part in parts)}]"
    return _scalar(typed.strip(), entry.words)


def _scalar(typed: str, words: bool) -> str:
    if words or not re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", typed):
        return json.dumps(typed.strip('"'), ensure_ascii=False)
    number = re.sub(r"^([+-]?)\.", r"\g<1>0.", typed)
    return re.sub(r"\.(?=$|[eE])", ".0", number)


def _span(lines: list[str], table: str) -> tuple[int, int]:
    """Where a table's keys are: from after its header to the next header."""
    headers = [i for i, line in enumerate(lines) if re.match(r"\s*\[{1,2}[A-Za-z]", line)]
    if not table:
        return 0, headers[0] if headers else len(lines)
    for place, i in enumerate(headers):
        if re.match(rf"\s*\[{re.escape(table)}\]", lines[i]):
            return i + 1, headers[place + 1] if place + 1 < len(headers) else len(lines)
    return 0, 0


def _end_of_value(lines: list[str], place: int) -> int:
    """The line after a value, which may be an array over several lines."""
    for end in range(place + 1, len(lines) + 1):
        try:
            tomllib.loads("\n".join(lines[place:end]))
        except tomllib.TOMLDecodeError:
            continue
        return end
    return place + 1


def _comment(line: str) -> str:
    """What stands behind a value on its line."""
    for place in (i for i, character in enumerate(line) if character == "#"):
        try:
            tomllib.loads(line[:place])
        except tomllib.TOMLDecodeError:
            continue
        return "  " + line[place:]
    return ""


def plan_told(found: Mapping[str, Any]) -> str:
    """A dry run in words: what is known of every plan, then what its experiment says beyond."""
    mountings = list(found.get("mountings", ()))
    seated = f" in {len(mountings)} mountings" if mountings else ""
    lines = [f"{found['experiment']}, {found['procedure']}: {found['runs_planned']} runs{seated}"]
    if mountings:
        shown = ", ".join(mountings[:6]) + (f", … {mountings[-1]}" if len(mountings) > 6 else "")
        lines.append(f"mountings   {shown}")
    lines.append(f"model       baseline{''.join(f' + {effect}' for effect in found['effects'])}")
    if found.get("theta0_sigma_arcsec") is not None:
        lines.append(f"accuracy    sigma(theta0) {found['theta0_sigma_arcsec']:.3g} arcsec in each mounting")
    elif "theta0_sigma_arcsec" in found:
        lines.append("accuracy    these runs do not determine theta0")
    if "rig_time_s" in found:
        lines.append(
            f"rig time    {_duration(found['rig_time_s'])} in a room as noisy as allowed; mounting not counted"
        )
    known = {"experiment", "procedure", "mountings", "runs_planned", "effects", "theta0_sigma_arcsec", "rig_time_s"}
    lines += [f"{key:11} {value}" for key, value in found.items() if key not in known]
    return "\n".join([*lines, "", "Checked against the rig's limits: everything can be reached. Nothing was moved."])


def _duration(seconds: float) -> str:
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
