"""Which generator is simulated: its identity and imperfections."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class GeneratorSettings(BaseModel):
    """A 33522B, or another of the series with two outputs."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    manufacturer: str = "Agilent Technologies"
    model: Literal["33510B", "33512B", "33520B", "33522B"] = "33522B"
    serial: str = "MY57800256"
    firmware: str = "5.00-1.19-2.00-58-00"
    frequency_step_hz: float = Field(default=1e-6, gt=0.0)
    clock_ppm: float = 0.0
    """How much faster than rig time its clock goes."""

    @property
    def identity(self) -> str:
        """The reply to *IDN?."""
        return f"{self.manufacturer},{self.model},{self.serial},{self.firmware}"

    @property
    def sine_maximum_hz(self) -> float:
        """The fastest sine."""
        return 30e6 if self.model in ("33520B", "33522B") else 20e6
