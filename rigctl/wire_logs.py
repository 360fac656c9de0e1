"""The wire logs of a rig: one file for each instrument that has a wire."""

from __future__ import annotations

import importlib.metadata
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from drivers.transport import Connect
from drivers.wire.lines import Header, Opening
from drivers.wire.logged import HEAD_BYTES, RING_BYTES, LoggedConnect, WireLogger
from drivers.wire.secrets import address_without_secret
from rigctl.core.clock import Clock
from rigctl.core.errors import ConfigError
from rigctl.files.rig_file import RigFile

_SECRET = re.compile(r"passw|secret|token", re.IGNORECASE)


class WireLogs:
    """Made with the rig; where its file names no directory, nothing is logged and nothing costs."""

    def __init__(self, file: RigFile, clock: Clock) -> None:
        self._file, self._clock = file, clock
        self._directory = Path(file.rig.wire_log)
        self._loggers: dict[str, WireLogger] = {}

    @property
    def files(self) -> dict[str, Path]:
        """The file of each instrument that has been connected to."""
        return {name: logger.path for name, logger in self._loggers.items() if logger.path is not None}

    def logged(self, name: str, connect: Connect) -> Connect:
        """What opens the same connections, logged if the rig file says so."""
        if not self._file.rig.wire_log:
            return connect
        table = self._file.instruments[name]
        header = Header(
            instrument=name,
            driver=table.driver,
            address=address_without_secret(table.address),
            opening="",
            rigctl=importlib.metadata.version("rigctl"),
            started="",
            head_bytes=HEAD_BYTES,
            ring_bytes=RING_BYTES,
        )
        self._loggers[name] = WireLogger(self._directory, header, self._clock, secrets_of(table.settings))
        return LoggedConnect(connect, self._loggers[name])

    def prepare(self, opening: Opening) -> None:
        """Make the directory; `ConfigError` where it cannot be written, or two instruments would share a file."""
        if not self._loggers:
            return
        for logger in self._loggers.values():
            logger.header = replace(logger.header, opening=opening)
        self._require_names_apart()
        try:
            self._directory.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise self._unwritable(error.strerror or str(error)) from error
        if not os.access(self._directory, os.W_OK | os.X_OK):
            raise self._unwritable("permission denied")

    def _require_names_apart(self) -> None:
        seen: dict[str, str] = {}
        for name in self._loggers:
            # Some file systems do not tell A from a.
            other = seen.setdefault(name.casefold(), name)
            if other != name:
                raise ConfigError(
                    f"{self._file.path}: instruments '{other}' and '{name}' would share a wire log; "
                    "give them names that differ by more than capitals"
                )

    def _unwritable(self, why: str) -> ConfigError:
        return ConfigError(
            f"wire log: the directory {self._directory} cannot be written ({why}); name another in --wire-log "
            f"or in wire_log of [rig] in {self._file.path}"
        )


def secrets_of(settings: Mapping[str, Any]) -> list[str]:
    """The values of those keys of an instrument's settings that are called passwords."""
    return list(_secrets("", settings))


def _secrets(key: str, value: Any) -> Iterator[str]:
    if isinstance(value, Mapping):
        for name, each in value.items():
            yield from _secrets(name, each)
    elif isinstance(value, str) and _SECRET.search(key):
        yield value
