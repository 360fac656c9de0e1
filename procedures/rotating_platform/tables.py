"""What a campaign file may say: the `[procedure]` table of the rotating-platform experiment."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from rigctl.core.file_tables import Table
from rigctl.experiments.rotating_platform.observe.patterns import MODULATED

# Far beyond what any platform does, and near enough for everything that is reckoned from them to stay a number.
RateHz = Annotated[float, Field(ge=1e-2, le=1e4)]
PeriodS = Annotated[float, Field(ge=1e-2, le=1e6)]
RecordS = Annotated[float, Field(ge=1e-2, le=1e8)]
PauseS = Annotated[float, Field(ge=0, le=1e6)]
Drift = Literal["nothing", "constant", "linear", "quadratic", "cubic"]
Turning = Literal["back-and-forth", "forward"]

MOST_SAMPLES = 10_000_000
"""Of one modulation period; it is held as a whole."""


class CustomPattern(Table):
    """A `[[procedure.custom]]` table: the dwells of one period as [sign of cos theta, start_s, stop_s]."""

    modulation_period_s: PeriodS
    dwells: tuple[tuple[int, float, float], ...] = Field(min_length=1)


class ListedRun(Table):
    """A `[[procedure.runs]]` table: one recording, or several of them where `v_z_v` is a list.

    What is left out of `sample_rate_hz`, `rotation_s`, `guard_s`, `lead_s`, `turning` and `rejects` is as in
    `[procedure]`.
    """

    pattern: Literal["a", "b", "c", "c_tm", "custom", "flip", "scan", "noise"]
    modulation_period_s: PeriodS | None = None
    periods: Annotated[int, Field(ge=1, le=100_000)] | None = None
    duration_s: RecordS | None = None
    step_deg: Annotated[float, Field(ge=0.1, le=90)] = 15.0
    dwell_s: PeriodS = 60.0
    sample_rate_hz: RateHz | None = None
    external: Literal["constant", "sine", "triangle"] = "constant"
    v_z_v: float | tuple[float, ...] = 0.0
    v_y_v: float = 0.0
    external_period_s: PeriodS | None = None
    rotation_s: PeriodS | None = None
    guard_s: PauseS | None = None
    lead_s: PauseS | None = None
    turning: Turning | None = None
    rejects: Drift | None = None

    @property
    def modulated(self) -> bool:
        """Whether the platform turns back and forth on a periodic table."""
        return self.pattern in MODULATED

    @property
    def levels_v(self) -> tuple[float, ...]:
        """The commands on the z input, one for each recording."""
        return self.v_z_v if isinstance(self.v_z_v, tuple) else (self.v_z_v,)

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.modulated and (self.modulation_period_s is None or self.periods is None):
            raise ValueError(f"pattern {self.pattern} needs modulation_period_s and periods")
        if self.pattern in {"flip", "noise"} and self.duration_s is None:
            raise ValueError(f"pattern {self.pattern} needs duration_s")
        # The scan must end one step before where it began.
        if self.pattern == "scan" and not math.isclose(360.0 / self.step_deg, round(360.0 / self.step_deg)):
            raise ValueError(f"step_deg {self.step_deg:g} does not divide a whole turn")
        if (self.external == "constant") != (self.external_period_s is None):
            raise ValueError("external sine and triangle need external_period_s, constant has none")
        if not self.levels_v:
            raise ValueError("v_z_v is empty")
        return self


class Procedure(Table):
    """The `[procedure]` table."""

    name: Literal["bias-rejection"]
    sample_rate_hz: RateHz = 10.0
    rotation_s: PeriodS | None = None
    guard_s: PauseS = 0.0
    lead_s: PauseS = 0.0
    turning: Turning = "back-and-forth"
    estimator: Literal["projection", "joint-ls"] = "projection"
    rejects: Drift = "constant"
    settle_s: PauseS = 10.0
    temperature_every_s: PeriodS = 60.0
    custom: tuple[CustomPattern, ...] = ()
    runs: tuple[ListedRun, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _periods_can_be_had(self) -> Self:
        periods = [custom.modulation_period_s for custom in self.custom]
        if len(set(periods)) < len(periods):
            raise ValueError("two custom patterns have the same modulation_period_s; runs could not tell them apart")
        for run in self.runs:
            samples = (run.modulation_period_s or 0.0) * (run.sample_rate_hz or self.sample_rate_hz)
            if samples > MOST_SAMPLES:
                raise ValueError(f"a period of {samples:g} samples is more than {MOST_SAMPLES}; sample more slowly")
        custom_periods_s = {run.modulation_period_s for run in self.runs if run.pattern == "custom"}
        for period_s in sorted(each for each in custom_periods_s if each is not None and each not in periods):
            raise ValueError(
                f"no custom pattern has a modulation_period_s of {period_s:g} s; add [[procedure.custom]]"
            )
        return self
