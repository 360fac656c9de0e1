"""What an operator says of any rotation stage: its soft limits and how long to wait."""

from __future__ import annotations

from typing import Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from rigctl.core.limits import RotationLimits


class RotationSettings(BaseModel):
    """Keys of a rotation stage's table in a rig file, whichever controller it has."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    angle_min_deg: float = -170.0
    angle_max_deg: float = 170.0
    speed_deg_s: float = Field(default=10.0, gt=0, allow_inf_nan=False)
    acceleration_deg_s2: float = Field(default=40.0, gt=0, allow_inf_nan=False)
    link_timeout_s: float = Field(default=2.0, gt=0)
    motion_timeout_s: float = Field(default=120.0, gt=0)
    arrival_tolerance_deg: float = Field(default=0.01, gt=0)

    @property
    def limits(self) -> RotationLimits:
        """The soft limits."""
        return RotationLimits(self.angle_min_deg, self.angle_max_deg, self.speed_deg_s, self.acceleration_deg_s2)

    @model_validator(mode="after")
    def _range_is_not_empty(self) -> Self:
        if not self.angle_min_deg < self.angle_max_deg:
            raise ValueError("angle_min_deg must lie below angle_max_deg")
        return self
