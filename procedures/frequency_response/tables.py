"""What a campaign file may say: the `[procedure]` table of the frequency response."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rigctl.core.file_tables import Table

# Far beyond what any stage does, and near enough for everything that is reckoned from them to stay a number.
FrequencyHz = Annotated[float, Field(ge=1e-3, le=1e4)]
AccelerationMS2 = Annotated[float, Field(gt=0.0, le=1e4)]
Direction = Literal["forward", "reversed"]


class ListedRun(Table):
    """A `[[procedure.runs]]` table: one run of a campaign that is given as a list."""

    frequency_hz: FrequencyHz
    acceleration_m_s2: AccelerationMS2
    direction: Direction = "forward"


class Procedure(Table):
    """The `[procedure]` table: every frequency with every acceleration in every direction, or `runs` alone.

    Where an amplitude would exceed `amplitude_max_mm` it is that. The order is random within a mounting.
    """

    name: Literal["frequency-response"] = "frequency-response"
    frequencies_hz: tuple[FrequencyHz, ...] = ()
    accelerations_m_s2: tuple[AccelerationMS2, ...] = ()
    directions: tuple[Direction, ...] = Field(default=("forward", "reversed"), min_length=1)
    repeats: Annotated[int, Field(ge=1, le=100)] = 1
    runs: tuple[ListedRun, ...] = ()
    amplitude_max_mm: Annotated[float, Field(gt=0.0, le=1e4)] = 20.0
    dwell_s: Annotated[float, Field(gt=0.0, le=1e5)] = 20.0
    settle_s: Annotated[float, Field(ge=0.0, le=1e5)] = 2.0
    sample_rate_hz: Annotated[float, Field(ge=0.1, le=1e6)] = 200.0
    order_seed: Annotated[int, Field(ge=0)] = 0
    mounting: Literal["new", "kept"] = "new"
