"""Faults drawn by seed for the instruments of a rig file, as tables to append to it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from rigctl import config
from simulators.faults import random_plans

SERIAL = {"keyence-lkg3001", "newport-esp301"}
"""Driven over RS-232 or USB: only there may single bits be wrong, TCP has a sum of its own."""
WIRELESS = "drag-free-satellite"


def random_faults(seed: int, rig: Path, *, length_s: float, replies: int, faults: int) -> dict[str, dict[str, Any]]:
    """Fault tables by instrument; none for an instrument that has some in the file already."""
    file = config.read_rig(rig)
    kinds = {name: table.driver for name, table in file.instruments.items() if table.driver != WIRELESS}
    serial = [name for name, kind in kinds.items() if kind in SERIAL]
    if not kinds:
        return {}
    plans = random_plans(seed, kinds, length_s=length_s, replies=replies, faults=faults, serial=serial)
    return {name: plan.model_dump(mode="json", exclude_unset=True) for name, plan in plans.items()}


def as_toml(faults: dict[str, dict[str, Any]]) -> str:
    """The tables as text of a rig file."""
    return "".join(
        f"\n[instruments.{name}.faults]\n" + "".join(f"{key} = {_value(value)}\n" for key, value in plan.items())
        for name, plan in faults.items()
    )


def kinds_of(faults: dict[str, dict[str, Any]]) -> list[str]:
    """Which kinds of fault befall which instrument, as `fault of instrument`."""
    return sorted(f"{fault} of {name}" for name, plan in faults.items() for fault in plan if fault != "seed")


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_value(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    return json.dumps(value)
