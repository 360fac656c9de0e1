"""Faults drawn by seed for the instruments of a rig file."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

from rigctl.files.rig_file import read_rig
from rigctl.rig import drivers_of, simulator_of
from simulators.faults import FaultPlan, random_plans

Plans = Mapping[str, FaultPlan]


def random_faults(
    seed: int, rig: Path, *, length_s: float, replies: int, faults: int, never: Collection[str] = ()
) -> Plans:
    """Plans by instrument, of all kinds of fault but `never`."""
    drivers = {name: driver.declaration for name, driver in drivers_of(read_rig(rig)).items()}
    possible = {
        name: set(simulator_of(driver).possible_faults(serial=driver.serial_baud is not None)).difference(never)
        for name, driver in drivers.items()
    }
    return random_plans(seed, possible, length_s=length_s, replies=replies, faults=faults)


def as_toml(plans: Plans) -> str:
    """The tables as text of a rig file."""
    return "".join(f"\n{plan.as_toml(name)}" for name, plan in plans.items())


def kinds_of(plans: Plans) -> list[str]:
    """What befalls which instrument, as `fault of instrument`."""
    named = [(fault, name) for name, plan in plans.items() for fault in plan.model_dump(exclude_none=True)]
    return sorted(f"{fault} of {name}" for fault, name in named if fault != "seed")
