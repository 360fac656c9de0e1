"""What a simulated Ensemble is like: its stage, its set-up, and the readings of the manual it follows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from simulators.aerotech_ensemble.addressing import Addressing, NamedAxis
from simulators.aerotech_ensemble.dialect import EnsembleDialect, StageDialect

REGISTERS_MAX = 1_000_000
"""Of either kind: more than any controller has."""
WaitMode = Literal["nowait", "movedone", "inpos"]


class StageSimulatorSettings(BaseModel):
    """Keys of a simulated stage; `dialect` chooses where the wire's behaviour is not known for sure."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    dialect: StageDialect = StageDialect()
    rigctl_program: bool = True
    """Has the operator compiled and loaded `rigctl.ab`?"""
    programs: dict[str, str] = {}
    """More of the controller's file system: AeroBasic sources by the names of the compiled files."""

    axis: str = Field(default="X", pattern=r"^[A-Za-z]\w*$")
    """AxisName; the axis also answers to @0."""
    units: str = "mm"
    """UnitsName."""
    version: str = "4.01.000"

    position_min_mm: float = -25.0
    """SoftwareLimitLow."""
    position_max_mm: float = 25.0
    """SoftwareLimitHigh."""
    travel_min_mm: float = -26.0
    """Where the limit switch is, in the stage's own coordinate."""
    travel_max_mm: float = 26.0
    speed_max_mm_s: float = Field(default=1000.0, gt=0)
    """A faster command is a fault; chosen for an air-bearing stage with linear motor."""
    acceleration_max_mm_s2: float = Field(default=10_000.0, gt=0)
    """Where the motor no longer follows: a position error; chosen likewise."""
    speed_mm_s: float = Field(default=10.0, gt=0)
    """DefaultSpeed."""
    ramp_rate_mm_s2: float = Field(default=100.0, gt=0)
    """DefaultRampRate."""
    abort_deceleration_mm_s2: float = Field(default=500.0, gt=0)
    """AbortDecelRate."""
    settle_s: float = Field(default=0.01, ge=0)
    """From the end of a move to "in position"."""

    counts_per_mm: float = Field(default=200_000.0, gt=0)
    """CountsPerUnit: 5 nm, a 20 um scale interpolated 4000 times."""
    encoder_noise_mm: float = Field(default=0.0, ge=0)
    """RMS of white noise on every encoder reading."""
    seed: int = 0

    estop_level: bool = False
    """The E-stop input's level, bit 31: high makes the status word negative. Only a level, not a fault."""

    home_position_mm: float = 0.0
    """Where the reference mark is, in the stage's own coordinate."""
    home_speed_mm_s: float = Field(default=10.0, gt=0)
    home_search_s: float = Field(default=2.0, ge=0)
    """What homing takes beyond the way to the mark."""

    harmonics: tuple[float, ...] = ()
    """Amplitudes of the 2nd, 3rd, ... harmonic of an oscillation, relative to the fundamental."""
    clock_ppm: float = Field(default=0.0, gt=-1e6)
    """How fast the controller's clock is: a true frequency is (1 + ppm 1e-6) times the commanded one."""

    wait_mode: WaitMode = "movedone"
    """DefaultWaitMode: in force after every ENABLE."""
    command_timeout_s: float = Field(default=0.0, ge=0)
    """CommandTimeout: a command that blocks longer is answered `$`; 0 is never."""
    socket_timeout_s: float = Field(default=300.0, ge=0)
    """Socket2Timeout: an idle client is disconnected; 0 is never."""
    startup_s: float = Field(default=5.0, ge=0)
    """After RESET nothing is answered for so long."""

    integer_registers: int = Field(default=50, ge=0, le=REGISTERS_MAX)
    """GlobalIntegers; one public site has 50 of them and 512 doubles."""
    double_registers: int = Field(default=512, ge=0, le=REGISTERS_MAX)
    """GlobalDoubles."""

    capture_trigger: int = 1
    """The DATAACQ TRIGGER number the rig's trigger line is wired to; no other sees an edge."""
    capture_input: int = 1
    """The DATAACQ INPUT number of the encoder; the others record zeros."""
    capture_points_max: int = Field(default=50_000, ge=1)
    capture_latency_s: float = Field(default=0.0, ge=0)
    """From the edge to the latched position."""

    @property
    def addressing(self) -> Addressing:
        """How the axis is named in a line."""
        raise NotImplementedError

    @property
    def parameter_numbers(self) -> Mapping[int, str]:
        """The names of parameters by number, where they are not those of EnsembleParameterId.h."""
        return {}

    @property
    def not_understood(self) -> frozenset[str]:
        """Keywords that the ASCII interface does not know, although programs or other controllers do."""
        over_ascii = {"OSCILLATE": self.dialect.oscillate_over_ascii, "DATAACQ": self.dialect.capture_over_ascii}
        return frozenset(keyword for keyword, understood in over_ascii.items() if not understood)

    @property
    def home_statement(self) -> str:
        """HOME as the maker's HomeAsync has it."""
        return "HOME @axis"

    @property
    def program_source(self) -> str:
        """Which of our programs the operator has loaded."""
        return "rigctl.ab"

    @model_validator(mode="after")
    def _ranges_are_not_empty(self) -> Self:
        if not self.position_min_mm < self.position_max_mm:
            raise ValueError("position_min_mm must lie below position_max_mm")
        if not self.travel_min_mm < self.travel_max_mm:
            raise ValueError("travel_min_mm must lie below travel_max_mm")
        return self


class EnsembleSimulatorSettings(StageSimulatorSettings):
    """Keys of a simulated Ensemble."""

    dialect: EnsembleDialect = EnsembleDialect()

    @property
    def addressing(self) -> NamedAxis:
        """The axis has a name."""
        return NamedAxis(self.axis, self.dialect.bare_speed_word)
