"""Soft limits of stages, and set-points checked against them before a byte is sent."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rigctl.core.errors import LimitError


@dataclass(frozen=True)
class RotationLimits:
    """Soft limits of a rotation stage."""

    angle_min_deg: float
    angle_max_deg: float
    speed_deg_s: float
    acceleration_deg_s2: float

    def require_angle(self, name: str, angle_deg: float) -> None:
        """`LimitError` of the stage `name` when it must not turn there."""
        low, high = self.angle_min_deg, self.angle_max_deg
        # NaN is refused too in this form.
        if not low <= angle_deg <= high:
            raise LimitError(f"{name}: {angle_deg:g} deg is outside the limits {low:g} to {high:g} deg")

    def require_inside(self, name: str, low_deg: float, high_deg: float, controller_limits: str) -> None:
        """`LimitError` of the stage `name` when these reach beyond the limits set in its controller."""
        # Else the controller would refuse in the middle of a campaign what was allowed here.
        if low_deg > self.angle_min_deg or high_deg < self.angle_max_deg:
            raise LimitError(
                f"{name}: the limits {self.angle_min_deg:g} to {self.angle_max_deg:g} deg reach beyond the "
                f"controller's own, {low_deg:g} to {high_deg:g} deg; narrow angle_min_deg and angle_max_deg, "
                f"or widen {controller_limits}"
            )


@dataclass(frozen=True)
class LinearLimits:
    """Soft limits of a linear stage; positions are relative to home."""

    position_min_mm: float
    position_max_mm: float
    speed_mm_s: float
    acceleration_mm_s2: float

    def require_position(self, name: str, position_mm: float) -> None:
        """`LimitError` of the stage `name` when it must not go there."""
        low, high = self.position_min_mm, self.position_max_mm
        if not low <= position_mm <= high:
            raise LimitError(f"{name}: {position_mm:g} mm is outside the travel {low:g} to {high:g} mm")

    def require_inside(self, name: str, low_mm: float, high_mm: float, controller_limits: str) -> None:
        """`LimitError` of the stage `name` when these reach beyond the limits set in its controller."""
        if low_mm > self.position_min_mm or high_mm < self.position_max_mm:
            raise LimitError(
                f"{name}: the travel {self.position_min_mm:g} to {self.position_max_mm:g} mm reaches beyond the "
                f"controller's own limits, {low_mm:g} to {high_mm:g} mm; narrow position_min_mm and "
                f"position_max_mm, or widen {controller_limits}"
            )

    def require_oscillation(
        self, name: str, centre_mm: float, amplitude_mm: float, frequency_hz: float, duration_s: float
    ) -> None:
        """`LimitError` of the stage `name` when it must not, or cannot, oscillate so."""
        # NaN is refused too in this form.
        if not (amplitude_mm > 0 and 0 < frequency_hz < math.inf and 0 < duration_s < math.inf):
            raise LimitError(
                f"{name}: an oscillation needs amplitude, frequency and duration above zero, "
                f"not {amplitude_mm:g} mm, {frequency_hz:g} Hz, {duration_s:g} s"
            )
        self.require_position(name, centre_mm)
        # A sinusoid of amplitude A has the largest speed A w and the largest acceleration A w^2.
        w = 2.0 * math.pi * frequency_hz
        largest_mm, limit = min(
            (
                min(centre_mm - self.position_min_mm, self.position_max_mm - centre_mm),
                f"travel {self.position_min_mm:g} to {self.position_max_mm:g} mm",
            ),
            (self.speed_mm_s / w, f"speed limit {self.speed_mm_s:g} mm/s"),
            (self.acceleration_mm_s2 / w**2, f"acceleration limit {self.acceleration_mm_s2:g} mm/s2"),
        )
        if amplitude_mm > largest_mm:
            raise LimitError(
                f"{name}: {amplitude_mm:g} mm at {frequency_hz:g} Hz about {centre_mm:g} mm exceeds the {limit}; "
                f"the amplitude can be {largest_mm:.4g} mm at most"
            )
