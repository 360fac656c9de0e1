"""Which controller and stage are simulated, and how the manual is read."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class Gcs2Dialect(BaseModel):
    """What differs among controllers that speak GCS 2.0; the defaults are the harder ones."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    tells_unit: bool = False
    """Is `PUN?` understood?"""
    numbers: Literal["decimal", "exponent"] = "exponent"
    """How positions are written: `1=12.5000`, or `1=1.250000000e+01`."""
    settle_s: float = Field(default=0.1, ge=0)
    """From the end of a motion to on target."""


class Gcs2SimulatorSettings(BaseModel):
    """Keys of a simulated controller."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    dialect: Gcs2Dialect = Gcs2Dialect()
    identity: str = "(c)2021 Physik Instrumente (PI) GmbH & Co. KG, C-863.12, 0120001234, 1.2.1.0"
    axis: str = "1"
    unit: str = "deg"
    travel_min_deg: float = -170.0
    travel_max_deg: float = 170.0
    speed_max_deg_s: float = Field(default=40.0, gt=0)
    acceleration_max_deg_s2: float = Field(default=200.0, gt=0)
    resolution_deg: float = Field(default=1e-4, gt=0)
    reference_speed_deg_s: float = Field(default=10.0, gt=0)
    reference_s: float = Field(default=2.0, ge=0)
    """What a reference move takes at least."""
