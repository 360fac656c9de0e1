"""A campaign file as a form: its keys one by one, each checked while it is typed; comments and the rest stay."""

from __future__ import annotations

import json
import re
import tomllib
import types
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel

from procedures.campaigns import investigable
from rigctl.console.entries import Entry, Listing
from rigctl.console.messages import Launch
from rigctl.console.widgets.dialogs import Fault
from rigctl.core.additions import procedures_for
from rigctl.core.errors import ConfigError
from rigctl.core.experiments import measured
from rigctl.files.campaign_file import CampaignFile, ModelTable, parse_campaign, read_campaign, settings_of
from rigctl.files.rig_file import read_rig
from rigctl.files.toml_files import validated


class CampaignForm:
    """A campaign file that is being edited: its text, and its keys as entries."""

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self.text = self._untouched = text
        self.parts = entries(text)
        self._entries = {part.name: part for part in self.parts if isinstance(part, Entry)}

    @property
    def saved(self) -> bool:
        """Whether the file has this text."""
        try:
            return self.text == self.path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError):
            return False

    @property
    def edited(self) -> bool:
        """Whether something was typed that is not saved; the file itself may have been changed by others."""
        return self.text != self._untouched

    def save(self, path: Path) -> None:
        """Write it, under its name or another; `OSError`."""
        path.write_text(self.text, encoding="utf-8")
        self.path, self._untouched = path, self.text

    def type(self, name: str, typed: str) -> bool:
        """Set the entry of that name to what was typed; False when that changes nothing."""
        entry = self._entries.get(name)
        if entry is None or typed == entry.text:
            return False
        self.text = changed(self.text, entry, typed)
        self._entries[name] = replace(entry, text=typed)
        return True

    def fault(self) -> str:
        """The first thing that is wrong with the text, without the file's name; "" when it is right."""
        try:
            file = parse_campaign(self.text, self.path)
            for table, model in settings_of(file.experiment, file.procedure).items():
                validated(model, getattr(file, table), self.path, table)
        except ConfigError as error:
            return str(error).removeprefix(f"{self.path}: ")
        return ""


def first_launch(form: CampaignForm, watched: Path | None) -> Launch:
    """How a campaign is started as a rule: into a store of its name, or the one it goes on with."""
    store = Path(form.path.stem + ".rig.sqlite")
    try:
        goes_on = read_campaign(form.path).goes_on
    except ConfigError:  # the dialog says what is wrong
        goes_on = False
    return Launch(form.path, watched if goes_on and watched is not None else _free(store))


def _free(path: Path) -> Path:
    """A name that nothing has yet."""
    number, free = 2, path
    while free.exists():
        free = path.with_name(re.sub(r"(\.rig\.sqlite)$", rf"-{number}\1", path.name))
        number += 1
    return free


def launch_fault(launch: Launch) -> Fault | None:
    """What speaks against a launch, as far as the files say at a glance; the rest the campaign's process tells."""
    try:
        file = read_campaign(launch.campaign)
    except ConfigError as error:
        return Fault("campaign", str(error))
    if not launch.store.name:
        return Fault("store", "name the store")
    if launch.investigate:
        if fault := _investigation_fault(launch, file):
            return fault
    elif launch.max_runs is not None:
        return Fault("max-runs", "only an investigation has a most; tick it, or leave this empty")
    elif launch.store.exists() and not file.goes_on:
        return Fault("store", f"{launch.store} exists already; choose another name")
    if not launch.store.absolute().parent.is_dir():
        return Fault("store", f"{launch.store.parent}: no such directory")
    if launch.rig is None and not file.rig:
        return Fault("rig", "the campaign file names no rig; name one here")
    try:
        read_rig(launch.rig or file.rig_path)
    except ConfigError as error:
        return Fault("rig", str(error))
    return None


def _investigation_fault(launch: Launch, file: CampaignFile) -> Fault | None:
    try:
        investigable(file).set_points(file)
    except ConfigError as error:
        return Fault("campaign", str(error))
    if launch.rig is not None:
        return Fault("rig", "an investigation uses the campaign file's rig; leave this empty")
    if launch.seed is not None:
        return Fault("seed", "an investigation has the campaign file's seed; leave this empty")
    if launch.max_runs == 0:
        return Fault("max-runs", "at least one run")
    return None


def entries(text: str) -> list[Entry | Listing]:
    """The keys a campaign file may have, table by table, with what it says; what is not TOML says nothing."""
    data = _tables(text)
    parts: list[Entry | Listing] = []
    for table, model in _models(data).items():
        table_data = data.get(table, {}) if table else data
        for key, field in model.model_fields.items():
            choices, words, listed = _kind(field.annotation)
            # Experiments are installed, so their names are in no annotation.
            choices = tuple(measured()) if (table, key) == ("", "experiment") else choices
            if (table, key) == ("procedure", "name"):
                choices = tuple(dict.fromkeys((*choices, *procedures_for(str(data.get("experiment"))))))
            if not table and key in {"path", "text"}:
                continue
            if any(isinstance(each, type) and issubclass(each, BaseModel) for each in _parts(field.annotation)):
                if listed and key in table_data:
                    parts.append(Listing(table, key, tuple(map(_row, table_data[key]))))
            elif table or key not in _OTHER_TABLES:
                default = None if field.is_required() else "" if field.default is None else _shown(field.default)
                written = _shown(table_data[key]) if key in table_data else ""
                parts.append(Entry(table, key, written, default, choices, words, listed))
    return parts


_OTHER_TABLES = {"procedure", "targets"}
"""Keys of the whole file that are tables of an experiment's own."""


def _tables(text: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return {}


def _models(data: Mapping[str, Any]) -> dict[str, type[BaseModel]]:
    procedure = data.get("procedure", {})
    declared = settings_of(str(data.get("experiment")), procedure if isinstance(procedure, Mapping) else {})
    return {"": CampaignFile, **declared, "model": ModelTable}


def _parts(annotation: Any) -> list[Any]:
    """The types an annotation is made of."""
    inner = get_args(annotation)
    return [annotation, *(part for each in inner for part in _parts(each))]


def _row(table: Mapping[str, Any]) -> str:
    return "  ".join(f"{key} {_shown(value)}" for key, value in table.items())


def changed(text: str, entry: Entry, typed: str) -> str:
    """The file's text with one key set to what was typed; without it when nothing was."""
    lines = text.splitlines()
    first, last = _span(lines, entry.table)
    place = next((i for i in range(first, last) if re.match(rf"\s*{re.escape(entry.key)}\s*=", lines[i])), None)
    end = _end_of_value(lines, place) if place is not None else 0
    new_lines = [f"{entry.key} = {_literal(entry, typed)}"] if typed.strip() else []
    if place is not None:
        # A comment behind a value stays; behind an array over several lines there is no one place for it.
        lines[place:end] = [new_lines[0] + _comment(lines[place])] if new_lines and end == place + 1 else new_lines
    elif new_lines and (first > 0 or not entry.table):
        # Before the empty lines that end a table.
        while last > first and not lines[last - 1].strip():
            last -= 1
        lines[last:last] = new_lines
    elif new_lines:
        lines += ["", f"[{entry.table}]", *new_lines]
    return "\n".join(lines) + "\n"


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
    # Whatever is no number is written as a text, so that the file stays TOML and the fault names the key.
    if words or not re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", typed):
        return json.dumps(typed.strip('"'), ensure_ascii=False)
    # TOML wants a digit on both sides of the point.
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
            # Only a parser knows where an array ends: brackets may stand in texts.
            tomllib.loads("\n".join(lines[place:end]))
        except tomllib.TOMLDecodeError:
            continue
        return end
    return place + 1


def _comment(line: str) -> str:
    """What stands behind a value on its line."""
    # The first # before which the line is a whole value: one in a text leaves the text open.
    for place in (i for i, character in enumerate(line) if character == "#"):
        try:
            tomllib.loads(line[:place])
        except tomllib.TOMLDecodeError:
            continue
        return "  " + line[place:]
    return ""
