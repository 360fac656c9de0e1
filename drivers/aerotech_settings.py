"""What an operator says of an axis of Aerotech's: limits, speeds, position capture, how long to wait."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from drivers.aerotech_words import NamedAxis, SoleAxis, Words
from rigctl.core.limits import LinearLimits

UNIT_UNKNOWN = "unknown"


class StageSettings(BaseModel):
    """The stage's keys in a rig file."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    position_min_mm: float = -25.0
    position_max_mm: float = 25.0
    speed_mm_s: float = Field(default=100.0, gt=0)
    acceleration_mm_s2: float = Field(default=1000.0, gt=0)
    move_speed_mm_s: float = Field(default=20.0, gt=0)
    """Of positioning moves; never above `speed_mm_s`."""
    ramp_rate_mm_s2: float = Field(default=100.0, gt=0)
    """Of positioning moves; never above `acceleration_mm_s2`."""
    position_tolerance_mm: float = Field(default=0.001, gt=0)
    program: str = Field(default="rigctl.bcx", pattern=r'^[^"]*$')
    """Our compiled program in the controller, from `drivers/aerobasic`; empty to go by ASCII commands alone."""
    program_task: int = Field(default=1, ge=1)
    """The task that oscillates."""
    capture_task: int = Field(default=2, ge=1)
    """The task that sets up and reads a capture, while the other oscillates."""
    program_timeout_s: float = Field(default=5.0, gt=0)
    """How long a program may take to begin, and to do what is no motion."""
    home_program: str = Field(default="HomeAsync.bcx", pattern=r'^[^"]*$')
    """The maker's program that homes; without it, or empty, HOME is sent, during which nothing can be stopped."""
    home_task: int = Field(default=5, ge=1)
    """The auxiliary task."""
    oscillate_distance: Literal["unknown", "peak-to-peak", "amplitude"] = "unknown"
    """What the controller's OSCILLATE takes its distance for; only motion tells."""
    oscillate_answers: Literal["unknown", "at once"] = "unknown"
    """Is an ASCII OSCILLATE answered before the motion ends? Only motion tells, and else nothing could stop it."""

    capture_input: int = Field(default=1, ge=0)
    capture_trigger: int = Field(default=1, ge=0)
    capture_register_first: int = Field(default=10, ge=7)
    """The first IGLOBAL register that captured positions are read into."""
    capture_registers: int | None = Field(default=None, ge=1)
    """How many registers, from the first, one DATAACQ READ may fill; all that the controller has when left out."""
    capture_points_max: int = Field(default=50_000, ge=1)
    capture_period_min_s: float = Field(default=0.0005, ge=0)
    capture_read: Literal["continues", "restarts"] = "restarts"
    """Does a second DATAACQ READ go on, or begin with the first point again? Then one read must hold all."""
    latency_s: float = 0.0
    """From the trigger edge to the latched position."""

    link_timeout_s: float = Field(default=2.0, gt=0)
    motion_timeout_s: float = Field(default=120.0, gt=0)
    poll_interval_s: float = Field(default=0.02, gt=0)

    @property
    def words(self) -> Words:
        """How the controller is spoken to, as far as that is known before it is asked."""
        raise NotImplementedError

    @property
    def unit_said(self) -> str:
        """What the operator says the axis counts in, for a controller that does not tell."""
        return UNIT_UNKNOWN

    @property
    def limits(self) -> LinearLimits:
        """The soft limits."""
        return LinearLimits(self.position_min_mm, self.position_max_mm, self.speed_mm_s, self.acceleration_mm_s2)

    @model_validator(mode="after")
    def _tasks_differ(self) -> Self:
        if self.program_task == self.capture_task:
            raise ValueError("program_task and capture_task must differ: one oscillates while the other captures")
        return self

    @model_validator(mode="after")
    def _travel_is_not_empty(self) -> Self:
        if not self.position_min_mm < self.position_max_mm:
            raise ValueError("position_min_mm must lie below position_max_mm")
        return self


class EnsembleSettings(StageSettings):
    """An Ensemble's axis among others."""

    axis: str = Field(default="X", pattern=r"^([A-Za-z]\w*|@\d)$")
    plane: int = Field(default=0, ge=0)

    @property
    def words(self) -> NamedAxis:
        """The axis has a name, or is called by its number."""
        return NamedAxis(self.axis, self.plane, self.axis)


class SoloistSettings(StageSettings):
    """A Soloist's one axis."""

    unit: Literal["unknown", "mm"] = "unknown"
    """What it counts in, for a controller whose parameters do not tell."""

    @property
    def unit_said(self) -> str:
        """What the operator says the axis counts in."""
        return self.unit

    @property
    def words(self) -> SoleAxis:
        """The axis is never named."""
        return SoleAxis()
