"""Satellites without noise and star tracker's bias, and what is measured on them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.worlds.satellite.forcing import Command, Injection
from simulators.worlds.satellite.layout import COLUMNS
from simulators.worlds.satellite.settings import SatelliteSettings
from simulators.worlds.satellite.simulation import Simulation

ORBIT_S, STEP_S = 5950.0, 0.25
TEN_ORBITS = 238_000
F_ORB, F_CAL = 1.0 / ORBIT_S, 73.0 / (10.0 * ORBIT_S)


def quiet(**more: Any) -> SatelliteSettings:
    """Nature without noise, and a star tracker that is mounted straight."""
    bounds = {"tracker_bias_rad": 0.0, **more.pop("bounds", {})}
    given = {"kind": "drag-free-satellite", "seed": 17, "noise_on": False, "bounds": bounds, **more}
    return SatelliteSettings.model_validate(given)


@dataclass(frozen=True)
class Flown:
    """A run of some draws, (samples, columns, draws)."""

    telemetry: FloatArray

    def column(self, name: str, draw: int = 0) -> FloatArray:
        return self.telemetry[:, COLUMNS.index(name), draw]

    def common(self, axis: str, draw: int = 0) -> FloatArray:
        return 0.5 * (self.column(f"m1_{axis}", draw) + self.column(f"m2_{axis}", draw))

    def different(self, axis: str, draw: int = 0) -> FloatArray:
        return 0.5 * (self.column(f"m1_{axis}", draw) - self.column(f"m2_{axis}", draw))


def line(series: FloatArray, frequency_hz: float) -> complex:
    """c - i s of a line with a whole number of periods in the series."""
    t_s = STEP_S * np.arange(len(series))
    return complex(2.0 * np.mean((series - series.mean()) * np.exp(-2j * np.pi * frequency_hz * t_s)))


def fly(settings: SatelliteSettings, injection: Injection | None = None, **more: Any) -> Flown:
    """Fly one run: `draws`, `samples`, `hold`, `run`."""
    command = Command(more.get("samples", TEN_ORBITS), injection or Injection(), more.get("hold", "both"))
    return Flown(Simulation(settings, more.get("draws", (0,)), more.get("run", 1), command).take(command.samples))
