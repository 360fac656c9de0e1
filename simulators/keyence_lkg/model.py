"""What is fixed in one generation of controllers, and how one controller is configured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from pydantic import BaseModel, ConfigDict

from simulators.keyence_lkg.faults import Fault
from simulators.keyence_lkg.registers import Register, digits, six_digits, switch


class LkgSettings(BaseModel):
    """How a simulated controller is built and configured, and what the sources leave open.

    `decimals` of the value in mm; `storage_values` is the capacity; `refusal_names_setting` puts `OF` rather than
    `SW` into the refusal of `SW,OF`; `count_digits` of the counts in the storage status. The reply to R0 takes
    `mode_return_s`, and for `mode_settle_s` more, measuring is refused. Every reply takes `reply_delay_s`. The
    controller's own clock is fast by `clock_ppm`. The TIMING input, for contacts and NPN outputs, does not see pulses
    shorter than `timing_pulse_min_s`; 0 for one that sees all.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    range_mm: float = 15.0
    decimals: int = 4
    sampling_us: float = 1000.0
    latency_s: float = 0.0
    storage_values: int = 65_536
    refusal_names_setting: bool = True
    count_digits: int = 7
    mode_return_s: float = 0.0
    mode_settle_s: float = 0.0
    reply_delay_s: float = 0.0
    clock_ppm: float = 0.0
    timing_pulse_min_s: float = 2e-3


@dataclass(frozen=True)
class Model:
    """What is fixed in one generation."""

    kind: str
    outputs: int
    sampling_us: tuple[float, ...]
    codes: Mapping[Fault, str]


def common_registers(model: Model, settings: LkgSettings) -> list[Register]:
    """The settings that both generations write alike."""
    if settings.sampling_us not in model.sampling_us:
        raise ValueError(f"sampling_us = {settings.sampling_us:g}: no sampling cycle of a {model.kind}")
    cycle = str(model.sampling_us.index(settings.sampling_us))
    offset = six_digits(settings.decimals)
    return [
        Register(("CA",), 0, (digits(1, 0, len(model.sampling_us) - 1),), (cycle,)),
        Register(("OF",), model.outputs, (offset,), (offset("+000000"),)),
        Register(("HE",), model.outputs, (switch,), ("0",)),
    ]
