"""What a campaign file may say: the `[procedure]` and `[targets]` tables of the sensing-axis experiment."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AliasChoices, Field, field_validator

from rigctl.core.file_tables import Table

# Far beyond what any rig does, and near enough for everything that is reckoned from them to stay a number.
FrequencyHz = Annotated[float, Field(ge=1e-3, le=1e4)]
RateHz = Annotated[float, Field(ge=1e-2, le=1e7)]
DurationS = Annotated[float, Field(ge=1e-2, le=1e6)]
AmplitudeMm = Annotated[float, Field(ge=1e-6, le=1e4)]
Approach = Literal[1, -1]


class ListedRun(Table):
    """A `[[procedure.runs]]` table: one run of a scan that is given as a list.

    What is left out is as in `[procedure]`; older files say `angle_deg` for `theta_deg`. `mounting` 0 is what is
    mounted already, 1, 2, ... are new ones.
    """

    theta_deg: Annotated[float, Field(validation_alias=AliasChoices("theta_deg", "angle_deg"))]
    frequency_hz: FrequencyHz
    amplitude_mm: AmplitudeMm | None = None
    approach: Approach = 1
    dwell_s: DurationS | None = None
    axis: str | None = None
    configuration: str | None = None
    mounting: Annotated[int, Field(ge=0)] | None = None
    temperature_c: float | None = None
    wait_s: Annotated[float, Field(ge=0, le=1e6)] = 0.0


class Procedure(Table):
    """The `[procedure]` table."""

    name: Literal["six-mountings", "null-search", "angle-scan", "scan", "quick-check"]
    axes: tuple[str, ...] = Field(min_length=1)
    configurations: tuple[str, ...] = Field(default=("pendulum", "flag"), min_length=1)
    mountings: Annotated[int, Field(ge=1, le=1000)] = 1
    frequencies_hz: tuple[FrequencyHz, ...] = Field(default=(0.3, 0.5, 0.6), min_length=1)
    amplitude_mm: AmplitudeMm = 5.0
    sample_rate_hz: RateHz = 100.0
    coarse_s: DurationS = 6.0
    start_deg: float = 0.0
    angles_deg: tuple[float, ...] = ()
    dwell_s: DurationS = 20.0
    noise_check_s: Annotated[float, Field(ge=0, le=1e6)] = 100.0
    approaches: tuple[Approach, ...] = Field(default=(1,), min_length=1)
    amplitudes_mm: tuple[AmplitudeMm, ...] = ()
    repeats: Annotated[int, Field(ge=1, le=1000)] = 1
    order: Literal["random", "as-listed"] = "random"
    order_seed: Annotated[int, Field(ge=0)] = 0
    mounting: Literal["new", "same", "kept"] = "new"
    runs: tuple[ListedRun, ...] = ()

    @field_validator("axes", "configurations", "frequencies_hz", "angles_deg", "approaches", "amplitudes_mm")
    @classmethod
    def _no_repeats(cls, values: tuple[object, ...]) -> tuple[object, ...]:
        if len(set(values)) < len(values):
            raise ValueError("has the same entry twice")
        return values


class Targets(Table):
    """The `[targets]` table: when it is good enough."""

    theta0_sigma_arcsec: Annotated[float, Field(ge=1e-6, le=1e6)] = 2.0
    noise_m_s2_rthz: Annotated[float, Field(ge=1e-15, le=1.0)] = 3e-6
