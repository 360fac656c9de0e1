"""What no source at hand says of an LK-G3001's wire: the manual has it on pages 5-7 to 5-23."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

BY_OUTPUT = "by-output"
"""No target: each output is set up by itself."""
TARGETS: dict[str, tuple[tuple[int, ...], ...]] = {
    "none-out1-out2-both": ((), (0,), (1,), (0, 1)),
    BY_OUTPUT: (),
    "both-out1-out2": ((0, 1), (0,), (1,)),
    "out1-out2-both": ((0,), (1,), (0, 1)),
}
"""Which outputs a storage takes, by the number that `SW,CI` has for its target."""


class Lkg3001Dialect(BaseModel):
    """The readings of the manual that are possible; as it is by default, clients have the hardest life.

    `target` is what the numbers of `SW,CI`'s first field mean. Its count has exactly `count_digits`, its cycle
    `cycle_digits` (0: any number of digits). `status_by_output`: `AN` takes an output, else none and gives both
    counts. `status_repeats_output` and `values_repeat_output`: the replies to `AN` and `AO` say whose they are. A
    storage begins `start_delay_s` after the reply to `AS`.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    target: Literal["none-out1-out2-both", "by-output", "both-out1-out2", "out1-out2-both"] = "out1-out2-both"
    count_digits: int = Field(default=6, ge=0, le=7)
    cycle_digits: int = Field(default=2, ge=0, le=2)
    status_by_output: bool = True
    status_repeats_output: bool = True
    values_repeat_output: bool = True
    start_delay_s: float = Field(default=0.05, ge=0.0)

    @property
    def targets(self) -> tuple[tuple[int, ...], ...]:
        """The outputs of each target, by its number."""
        return TARGETS[self.target]
