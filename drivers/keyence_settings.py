"""What differs between the two LK-G generations, and what an operator says about a controller."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

AVERAGES = tuple(4**n for n in range(10))
"""Sampling cycles in the moving average, by the number that selects it (SW,OC)."""


@dataclass(frozen=True)
class Generation:
    """One generation's command set, in the words the two differ in.

    `measure` gives the command that asks for the values of some outputs (in ascending order), and is refused
    by the other generation; `sampling_us` is ordered by the number that selects the cycle (SW,CA); `errors`
    gives the text of each code.
    """

    model: str
    outputs: int
    output_digits: int
    measure: Callable[[Sequence[int]], str]
    status_error: str
    sampling_us: tuple[float, ...]
    storage_max: int
    storage_shared: bool
    errors: dict[str, str]

    def output(self, number: int) -> str:
        """The number of an output as this generation writes it."""
        return f"{number:0{self.output_digits}d}"


def _measure_lkg3001(outputs: Sequence[int]) -> str:
    return f"M{outputs[0]}" if len(outputs) == 1 else "M0"


def _measure_lkg5000(outputs: Sequence[int]) -> str:
    if len(outputs) == 1:
        return f"MS,{outputs[0]:02d}"
    return "MM," + "".join("1" if output in outputs else "0" for output in range(1, 13))


LKG3001 = Generation(
    model="LK-G3001",
    outputs=2,
    output_digits=1,
    measure=_measure_lkg3001,
    status_error="01",
    sampling_us=(20.0, 50.0, 100.0, 200.0, 500.0, 1000.0),
    storage_max=65_536,
    storage_shared=False,
    errors={
        "00": "command error",
        "01": "status error",
        "20": "command length error",
        "21": "parameter count error",
        "22": "invalid parameter",
        "88": "timeout",
        "99": "other error",
    },
)

LKG5000 = Generation(
    model="LK-G5000",
    outputs=12,
    output_digits=2,
    measure=_measure_lkg5000,
    status_error="51",
    sampling_us=(2.55, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0),
    storage_max=1_200_000,
    storage_shared=True,
    errors={
        "50": "command error",
        "51": "status error",
        "60": "command length error",
        "61": "parameter count error",
        "62": "parameter out of range",
        "88": "timeout",
        "99": "other error",
        "00": "head connection error",
        **{f"{head:02d}": f"error of head {head}" for head in range(1, 13)},
        "13": "controller error",
        "15": "SRAM error",
        "16": "USB error",
        "17": "Ethernet error",
    },
)

_GENERATIONS = {"lkg3001": LKG3001, "lkg5000": LKG5000}


class KeyenceSettings(BaseModel):
    """One controller, as the instrument's table in a rig file says it.

    `heads` names a channel (ending in `_mm`) for each output used. `storage_max` is the number of values the
    controller stores: per output for the LK-G3001, shared by the outputs for the LK-G5000; its own maximum
    when left out. A value stored at a trigger edge is that of `latency_s` after the edge; the moving average,
    which puts it (averaging - 1) / 2 sampling cycles earlier, comes on top.

    Times are rig seconds: `link_timeout_s` for an answer, `mode_timeout_s` for the return to measuring (the
    LK-G5000 takes 0.6 s and 0.75 s per expansion unit), `readout_timeout_s` for one output's stored values
    (65 536 of them last 51 s at 115 200 baud), `edge_timeout_s` is how long no new edge may come before a
    recording is taken for ended, `poll_s` the time between two questions for the status. `start_u_s` is how well the
    rig time of an LK-G3001's first stored value has to be known (standard uncertainty; its storage runs on its own
    clock): a recording of which it is known less well is an error.

    `timing_pulse_s` is how long the pulses at an LK-G5000's TIMING input are: what a pulse stretcher makes of a
    multimeter's 2 us, or a slow source gives. None: straight from VM COMP, too short for most.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    generation: Literal["lkg3001", "lkg5000"]
    heads: dict[str, int] = Field(min_length=1)
    sampling_us: float = 1000.0
    averaging: int = 1
    storage_max: int | None = Field(default=None, ge=1)
    latency_s: float = Field(default=0.0, ge=0.0)
    range_mm: float = Field(default=15.0, gt=0.0)
    link_timeout_s: float = Field(default=2.0, gt=0.0)
    mode_timeout_s: float = Field(default=5.0, gt=0.0)
    readout_timeout_s: float = Field(default=120.0, gt=0.0)
    edge_timeout_s: float = Field(default=5.0, gt=0.0)
    poll_s: float = Field(default=0.1, gt=0.0)
    start_u_s: float = Field(default=0.02, gt=0.0)
    timing_pulse_s: float | None = Field(default=None, gt=0.0)

    @property
    def dialect(self) -> Generation:
        """The generation's command set."""
        return _GENERATIONS[self.generation]

    @property
    def other_dialect(self) -> Generation:
        """The command set of the generation that this is not."""
        return LKG5000 if self.dialect is LKG3001 else LKG3001

    @property
    def samples_max(self) -> int:
        """The longest recording of all heads at once."""
        values = self.dialect.storage_max if self.storage_max is None else self.storage_max
        return values // len(self.heads) if self.dialect.storage_shared else values

    @model_validator(mode="after")
    def _check(self) -> KeyenceSettings:
        dialect = self.dialect
        for name, output in self.heads.items():
            if not name.endswith("_mm"):
                raise ValueError(f"heads: {name!r} must end in _mm")
            if not 1 <= output <= dialect.outputs:
                raise ValueError(f"heads.{name} = {output}: the {dialect.model} has outputs 1 to {dialect.outputs}")
        if len(set(self.heads.values())) < len(self.heads):
            raise ValueError("heads: each needs an output of its own")
        if self.sampling_us not in dialect.sampling_us:
            raise ValueError(
                f"sampling_us = {self.sampling_us:g}: the {dialect.model} has {_listed(dialect.sampling_us)}"
            )
        if self.averaging not in AVERAGES:
            raise ValueError(f"averaging = {self.averaging}: there are {_listed(AVERAGES)}")
        if self.storage_max is not None and self.storage_max > dialect.storage_max:
            raise ValueError(
                f"storage_max = {self.storage_max}: the {dialect.model} stores {dialect.storage_max} values"
            )
        return self


def _listed(choices: tuple[float, ...] | tuple[int, ...]) -> str:
    return ", ".join(f"{choice:.10g}" for choice in choices)
