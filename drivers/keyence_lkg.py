"""Keyence LK-G triangulation lasers: the LK-G3001 and the LK-G5000 controllers, serial or Ethernet."""

from __future__ import annotations

from drivers.keyence_lkg3001 import Lkg3001
from drivers.keyence_lkg5000 import Lkg5000
from drivers.keyence_settings import KeyenceSettings
from rigctl.core.declarations import USUAL_BAUD, DriverDeclaration, Use

__all__ = ["KeyenceSettings", "Lkg3001", "Lkg5000"]

LKG3001 = DriverDeclaration(
    "keyence-lkg3001",
    contract=1,
    roles=dict.fromkeys(("displacement", "spare"), Use(KeyenceSettings, Lkg3001)),
    simulator="simulators.keyence_lkg.declaration:LKG3001",
    implied={"generation": "lkg3001"},
    serial_baud=USUAL_BAUD,
)
LKG5000 = DriverDeclaration(
    "keyence-lkg5000",
    contract=1,
    roles=dict.fromkeys(("displacement", "spare"), Use(KeyenceSettings, Lkg5000)),
    simulator="simulators.keyence_lkg.declaration:LKG5000",
    implied={"generation": "lkg5000"},
)
