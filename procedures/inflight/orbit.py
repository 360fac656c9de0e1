"""The satellite of a rig file and its orbit."""

from __future__ import annotations

from procedures.campaigns import Instruments
from procedures.inflight.calibration import Flight
from rigctl.core.errors import ConfigError

ORBIT = ("orbit_period_s", "eccentricity")


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
