"""What an operator may set for a Keysight 34465A, by its use."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from rigctl.core.errors import LimitError

RANGES_V = (0.1, 1.0, 10.0, 100.0, 1000.0)
PROBES = {"frtd": "FRTD,85", "rtd": "RTD,85", "fthermistor": "FTH,5000", "thermistor": "THER,5000"}
"""Four-wire and two-wire platinum (alpha 0.00385) and 5 kohm thermistors."""


def known_range(range_v: float) -> float:
    """A range that these meters have; `ValueError` for another."""
    if range_v not in RANGES_V:
        raise ValueError(f"the meter's ranges are {', '.join(f'{r:g}' for r in RANGES_V)} V")
    return range_v


def require_period(name: str, period_s: float, aperture_s: float, longest_s: float) -> None:
    """`LimitError` of the meter `name` for a period below its aperture, or beyond its timer's longest."""
    if not aperture_s <= period_s <= longest_s:
        raise LimitError(
            f"{name}: a sample every {period_s:g} s asked for; possible are {aperture_s:g} s "
            f"(aperture_s) to {longest_s:g} s"
        )


class VoltmeterSettings(BaseModel):
    """What an operator may set for a voltmeter, master or slave.

    `latency_s` is from the trigger edge to the instant that a reading stands for. Left out it is the middle of the
    aperture, which is believed to end with the edge that a pacing meter gives, and begins with the edge it is given.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    channel: str = Field(default="accel_v", min_length=1)
    range_v: Annotated[float, AfterValidator(known_range)] = 10.0
    aperture_s: float = Field(default=1e-3, ge=20e-6, le=1.67)
    latency_s: float | None = None
    memory_readings: int = Field(default=50_000, ge=1)
    transfer: Literal["real64", "ascii"] = "real64"
    link_timeout_s: float = Field(default=2.0, gt=0.0)


class ThermometerSettings(BaseModel):
    """What an operator may set for a thermometer; `reference_ohm` is a platinum probe's resistance at 0 degC."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    probe: Literal["frtd", "rtd", "fthermistor", "thermistor"] = "frtd"
    reference_ohm: float = Field(default=100.0, ge=49.0, le=2100.0)
    link_timeout_s: float = Field(default=2.0, gt=0.0)
