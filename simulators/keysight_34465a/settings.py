"""Which meter is simulated: its identity, options and imperfections."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class MeterSettings(BaseModel):
    """A 34465A; noise is white, per reading, and drawn from `seed`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    manufacturer: str = "Keysight Technologies"
    model: str = "34465A"
    serial: str = "MY12345678"
    firmware: str = "A.03.01-03.15-03.01-00.52-04-02"
    options: tuple[Literal["DIG", "MEM"], ...] = ("DIG",)
    memory_readings: int | None = Field(default=None, ge=1)
    """None: 50 000, or 2 000 000 with option MEM."""
    line_frequency_hz: Literal[50, 60] = 50
    latency_s: float | None = None
    """From the trigger edge to the instant a reading stands for; None: a reading is the mean over its aperture, which
    ends with the edge that the meter gives and begins with one that it is given."""
    noise_v_rms: float = Field(default=0.0, ge=0.0)
    noise_c_rms: float = Field(default=0.0, ge=0.0)
    resolution_v: float | None = Field(default=None, gt=0.0)
    """Least step of the ADC; None: what range and integration time give."""
    resolution_c: float = Field(default=1e-3, gt=0.0)
    seed: int = Field(default=0, ge=0)
    clock_ppm: float = Field(default=0.0, gt=-1e6)
    """How much faster than rig time its sample timer goes."""
    control_port: int = 0
    """What SYST:COMM:TCP:CONT? answers; 0: no control socket."""

    @property
    def identity(self) -> str:
        """The reply to *IDN?."""
        return f"{self.manufacturer},{self.model},{self.serial},{self.firmware}"

    @property
    def digitizes(self) -> bool:
        """True with option DIG, which is standard from firmware 3.0."""
        return "DIG" in self.options or self.firmware >= "A.03"

    @property
    def memory(self) -> int:
        """How many readings the memory holds."""
        return self.memory_readings or (2_000_000 if "MEM" in self.options else 50_000)
