"""What a file is that is to be opened."""

from __future__ import annotations

import tomllib
from pathlib import Path

from rigctl.core.errors import ConfigError


def kind_of(path: Path) -> tuple[str, str]:
    """Whether a TOML file is a `rig` or a `campaign`, and its text; `ConfigError` when it cannot be read."""
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file; check the name") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: not UTF-8 text (byte {error.start}); save it as UTF-8") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not TOML: {error}") from None
    return ("campaign" if "experiment" in tables or "procedure" in tables else "rig"), text
