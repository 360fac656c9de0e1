"""Which 3458A is simulated: its memory and its imperfections."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from simulators.keysight_3458a.dialect import Meter3458ADialect


class Meter3458ASimulatorSettings(BaseModel):
    """A 3458A; noise is white, per reading, and drawn from `seed`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    dialect: Meter3458ADialect = Meter3458ADialect()
    identity: str = "HP3458A"
    memory_bytes: int = Field(default=20_480, ge=4)
    """Of reading memory."""
    noise_v_rms: float = Field(default=0.0, ge=0.0)
    seed: int = Field(default=0, ge=0)
    clock_ppm: float = Field(default=0.0, gt=-1e6)
    """How much faster than rig time its timer goes."""
