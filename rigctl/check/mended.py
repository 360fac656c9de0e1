"""A rig file as it would be once what a check has found in it is mended."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from rigctl.files.rig_file import InstrumentTable, RigFile


def mended(file: RigFile, keys: Mapping[str, Mapping[str, Any]], left_out: Collection[str]) -> RigFile:
    """With these keys of instruments' tables in place of what it says, and without some instruments."""
    tables = {
        name: InstrumentTable.model_validate({**table.model_dump(), **keys.get(name, {})})
        for name, table in file.instruments.items()
        if name not in left_out
    }
    return file.model_copy(update={"instruments": tables})
