"""Files an operator writes: TOML read within bounds and checked whole before anything moves.

Every complaint is one line that names file, key and mend.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from rigctl.core.bounds import TOML_BYTES, TooLarge, amount, read_regular
from rigctl.core.errors import ConfigError, one_line
from rigctl.core.numbers import MAGNITUDE_MAX
from rigctl.core.toml import TomlFlaw, parsed

Model = TypeVar("Model", bound=BaseModel)

_PYTHON_MODEL = re.compile(r" or instance of \w+")

NOT_KEYS = {"path", "text"}
"""Fields of a file that do not come from its text."""


def read_text(path: Path) -> str:
    """The text of a file, its lines ended by LF, without a byte order mark; `ConfigError`."""
    try:
        # Equal files have equal hashes, whatever system their lines come from.
        return read_regular(path, TOML_BYTES).decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
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


def checked_file(model: type[Model], text: str, data: Mapping[str, Any], path: Path) -> Model:
    """The `data` of a file's text as `model`, which has `path` and `text` beside its keys; `ConfigError`."""
    for key in sorted(NOT_KEYS & set(data)):
        raise ConfigError(f"{path}: unknown key {key}; known there: {', '.join(_known_keys(model, []))}")
    return validated(model, {**data, "path": path, "text": text}, path)


def validated(model: type[Model], data: Mapping[str, Any], path: Path, prefix: str = "") -> Model:
    """Check data against a model, types as TOML has them; `ConfigError` with the first fault as file, key, mend."""
    try:
        # Strict, or pydantic would take the text "1" for a number.
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
    # An operator writes TOML, not Python.
    message = _PYTHON_MODEL.sub("", message).replace("valid tuple", "list").replace("valid dictionary", "table")
    given = fault.get("input")
    # A whole table would make the message longer than it is of use.
    shown = f", not {given!r}" if isinstance(given, str | int | float | bool) else ""
    return f"{key or 'file'}: {message}{shown}{more}"


def parsed_file(text: str, path: Path) -> dict[str, Any]:
    """The tables of a file's text, every number a quantity; `ConfigError`."""
    try:
        data = parsed(text)
    except TomlFlaw as flaw:
        line = "" if flaw.line is None else f"line {flaw.line}: "
        raise ConfigError(f"{path}: {line}{flaw}") from None
    _require_measurable(data, path)
    return data


def _require_measurable(value: Any, path: Path, key: str = "") -> None:
    if isinstance(value, Mapping):
        for name, each in value.items():
            _require_measurable(each, path, f"{key}.{name}" if key else name)
    elif isinstance(value, list):
        for index, each in enumerate(value):
            _require_measurable(each, path, f"{key}.{index}")
    # Not `>`, which lets NaN through.
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
        # The model may stand behind `| None` or in a `dict[str, ...]`.
        candidates = [annotation, *getattr(annotation, "__args__", ())]
        current = next((c for c in candidates if isinstance(c, type) and issubclass(c, BaseModel)), current)
    return [name for name in getattr(current, "model_fields", {}) if name not in NOT_KEYS]
