"""All that goes wrong with one instrument: `[instruments.NAME.faults]` of a rig file."""

from __future__ import annotations

from collections.abc import Collection

from rigctl.core.toml import to_toml_value
from simulators.faults.mishaps import InstrumentFaults
from simulators.faults.wire import WireFaults

ON_THE_GROUND = frozenset({"late", "silent", "duplicated", "disconnect"})
"""What can happen to telemetry that has no wire."""
ON_SERIAL_LINES = frozenset({"bits", "command_bits", "command_lost"})
"""TCP has a checksum of its own, and sends again what is lost."""
WIRE_FAULTS = tuple(name for name in WireFaults.model_fields if name != "seed")


class FaultPlan(InstrumentFaults, WireFaults):
    """What goes wrong, and when; one plan and one seed always give the same faults."""

    def as_toml(self, name: str) -> str:
        """The table of a rig file, for the instrument NAME."""
        faults = self.model_dump(exclude_none=True, exclude_defaults=True)
        lines = [f"{key} = {to_toml_value(value)}\n" for key, value in faults.items()]
        return "".join([f"[instruments.{name}.faults]\n", *lines])

    def unsupported(self, kind: str, possible: Collection[str]) -> str:
        """Why an instrument of this kind, with these possible faults, cannot suffer it; "" when it can."""
        wanted = (name for name in FaultPlan.model_fields if name != "seed" and getattr(self, name) is not None)
        impossible = [name for name in wanted if name not in possible]
        if bare := [name for name in impossible if name in ON_SERIAL_LINES]:
            return (
                f"{bare[0]}: TCP has a checksum of its own, bits are turned on serial lines only; use garbage or "
                "truncated"
            )
        if impossible:
            return f"{impossible[0]}: this cannot befall a {kind}; it can have {', '.join(possible)}"
        return ""


def faults_of(suffered: Collection[str], *, wired: bool, serial: bool) -> list[str]:
    """The faults of an instrument that suffers these itself, and of its wire, by their keys in a rig file."""
    wire = {name for name in WIRE_FAULTS if serial or name not in ON_SERIAL_LINES} if wired else ON_THE_GROUND
    return sorted({*wire, *suffered})
