"""What differs between controllers and stages, and what their manuals leave open."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class Esp301Dialect(BaseModel):
    """What controllers of this family do one way or the other; the defaults are what drivers found on a real one."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    baud: Literal[19200, 921600] = 19200
    """What its line is set to: RS-232 as drivers found it, or as over its USB connector."""
    keypad_lock: bool = True
    """Is LC, which locks the keypad, understood? An older firmware may not know it."""


class Esp301SimulatorSettings(BaseModel):
    """One controller with stages of one kind; values are in degrees."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    dialect: Esp301Dialect = Esp301Dialect()
    version: str = "ESP301 Version 3.0.1 6/1/99"
    stage: str = "RV120HAT, SN0001"
    line_characters_max: int = Field(default=80, ge=8)
    errors_queued_max: int = Field(default=10, ge=1)
    timestamp_tick_s: float = Field(default=0.0004, gt=0)
    abort_turns_motor_off: bool = True
    """What `AB` does by default (configured with ZE on the real one)."""

    unit: int = Field(default=7, ge=0, le=11)
    decimals: int = Field(default=4, ge=0, le=7)
    resolution_deg: float = Field(default=1e-4, gt=0)
    travel_min_deg: float = -170.0
    travel_max_deg: float = 170.0
    speed_deg_s: float = Field(default=10.0, gt=0)
    speed_max_deg_s: float = Field(default=20.0, gt=0)
    acceleration_deg_s2: float = Field(default=40.0, gt=0)
    acceleration_max_deg_s2: float = Field(default=80.0, gt=0)
    home_speed_deg_s: float = Field(default=10.0, gt=0)
    home_search_s: float = Field(default=3.0, ge=0)
    settle_s: float = Field(default=0.05, ge=0)
