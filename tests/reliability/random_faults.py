"""Faults drawn by seed for the instruments of a rig file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rigctl import config
from simulators.faults import FaultPlan, random_plans

SERIAL = {"keyence-lkg3001", "newport-esp301"}
"""Driven over RS-232 or USB: only there may single bits be wrong, TCP has a sum of its own."""

Plans = Mapping[str, FaultPlan]


def random_faults(seed: int, rig: Path, *, length_s: float, replies: int, faults: int) -> Plans:
    """Plans by instrument."""
    kinds = {name: table.driver for name, table in config.read_rig(rig).instruments.items()}
    serial = [name for name, kind in kinds.items() if kind in SERIAL]
    return random_plans(seed, kinds, length_s=length_s, replies=replies, faults=faults, serial=serial)


def as_toml(plans: Plans) -> str:
    """The tables as text of a rig file."""
    return "".join(f"\n{plan.as_toml(name)}" for name, plan in plans.items())


def kinds_of(plans: Plans) -> list[str]:
    """What befalls which instrument, as `fault of instrument`."""
    named = [(fault, name) for name, plan in plans.items() for fault in plan.model_dump(exclude_none=True)]
    return sorted(f"{fault} of {name}" for fault, name in named if fault != "seed")
