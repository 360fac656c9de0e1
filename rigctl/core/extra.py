"""Packages that are not everybody's."""

from __future__ import annotations

import importlib
from typing import Any

from rigctl.core.errors import ConfigError

CLUSTER, NOTEBOOK, BLUESKY, SIGN, FILES = "cluster", "notebook", "bluesky", "sign", "files"
"""The extras of `pip install 'rigctl[EXTRA]'`."""


def needed(package: str, extra: str = NOTEBOOK) -> Any:
    """The package imported; `ConfigError`, how to install it, where it is not there."""
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise ConfigError(f"{package} is not installed; pip install 'rigctl[{extra}]' brings it") from error
