"""What differs between controllers and stages, and what their manuals leave open."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class XpsSimulatorSettings(BaseModel):
    """One controller and its stages; the defaults are an XPS-C8 with an RV120HAT rotation stage."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    firmware: str = "XPS-C8 Firmware V2.6.2"
    installer_version: str = "XPS-C8 Installer V2.6.2"
    administrator_password: str = "Administrator"  # noqa: S105 - the factory default
    sockets_max: int = Field(default=100, ge=1)
    servo_period_s: float = Field(default=125e-6, gt=0)
    gathering_values_max: int = Field(default=1_000_000, ge=1)

    resolution_deg: float = Field(default=1e-4, gt=0)
    travel_min_deg: float = -170.0
    travel_max_deg: float = 170.0
    speed_max_deg_s: float = Field(default=20.0, gt=0)
    acceleration_max_deg_s2: float = Field(default=80.0, gt=0)
    jerk_time_s: float = Field(default=0.02, gt=0)
    motion_law: Literal["trapezoid", "cycloid"] = "trapezoid"

    initialisation_s: float = Field(default=1.0, ge=0)
    home_search_s: float = Field(default=5.0, ge=0)
    home_speed_deg_s: float = Field(default=10.0, gt=0)
    settle_s: float = Field(default=0.05, ge=0)

    outside_limits_code: Literal[-17, -35] = -17
    killed_motion_code: int = Field(default=-27, lt=0)
    interlock_states: bool = False
    """Does the emergency stop lead to the states 83 and 84, which newer firmware has, or to 2?"""


XPS_D = XpsSimulatorSettings(
    firmware="XPS-D",
    installer_version="XPS-D-N13006",
    sockets_max=84,
    servo_period_s=100e-6,
    outside_limits_code=-35,
    killed_motion_code=-26,
    interlock_states=True,
)
"""What is known of an XPS-D, and of what is not the reading that is harder for a client."""
