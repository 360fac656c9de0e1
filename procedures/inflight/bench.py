"""The bench of an in-flight campaign: the satellite of a rig file and its orbit."""

from __future__ import annotations

from dataclasses import dataclass

from procedures.campaigns import Instruments
from rigctl.core.errors import ConfigError
from rigctl.core.satellites import DragFreeSatellite

ORBIT = ("orbit_period_s", "eccentricity")


@dataclass(frozen=True)
class Flight:
    """The satellite, and what is believed of its orbit."""

    satellite: DragFreeSatellite
    orbit_period_s: float
    eccentricity: float


def flight_of(rig: Instruments) -> Flight:
    """The satellite of a rig and its orbit; `ConfigError` when the rig file lacks one."""
    for name in ORBIT:
        if name not in rig.file.constants:
            raise ConfigError(f"{rig.file.path}: [constants.{name}] is missing; add what is believed of the orbit")
    period_s, eccentricity = (rig.file.constants[name].value for name in ORBIT)
    if not (1.0 <= period_s <= 1e9 and 0.0 <= eccentricity < 1.0):
        raise ConfigError(
            f"{rig.file.path}: constants: no orbit has a period of {period_s:g} s and e = {eccentricity:g}"
        )
    return Flight(rig.only("satellite"), period_s, eccentricity)
