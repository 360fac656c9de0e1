"""What a recording of the rotating platform says of itself: scale factors, biases, ranges, guards."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rigctl.campaign.recording import Header
from rigctl.core.errors import DataError
from rigctl.files.rig_file import parse_rig

CHANNELS = ("z", "y")
"""The two chains by the axis they sense at angle 0: A is z, B is y."""

READINGS: Mapping[str, str] = {"z": "q_a_v", "y": "q_b_v"}
"""The column of each."""

COMMANDS: Mapping[str, str] = {"z": "dm1_z_v", "y": "dm1_y_v"}
"""The columns of the pendulum's offset inputs."""


@dataclass(frozen=True)
class Chains:
    """What is believed of the chains, by channel: scale factors [V s2/m], electrical bias and full scale [V].

    `amplifier` (V/V) is what a sensor is read without when it is turned over; absent where it is not known.
    """

    gain_v_per_m_s2: Mapping[str, float]
    command_v_per_m_s2: Mapping[str, float]
    bias_v: Mapping[str, float]
    full_scale_v: Mapping[str, float]
    g_m_s2: float
    amplifier: Mapping[str, float] = field(default_factory=dict)


def chains(header: Header) -> Chains:
    """From a rig file's constants or from those of a bundle; `DataError` for one that is missing."""
    return Chains(
        gain_v_per_m_s2={"z": _needed(header, "gain_q_a_v_per_m_s2"), "y": _needed(header, "gain_q_b_v_per_m_s2")},
        command_v_per_m_s2={
            "z": _needed(header, "gain_dm1_z_v_per_m_s2"),
            "y": _needed(header, "gain_dm1_y_v_per_m_s2"),
        },
        bias_v=_known(header, {"z": "bias_q_a_v", "y": "bias_q_b_v"}),
        full_scale_v={name: _full_scale(header, column) for name, column in READINGS.items()},
        g_m_s2=_needed(header, "g_m_s2"),
        amplifier=_known(header, {"z": "amplifier_q_a_v_per_v", "y": "amplifier_q_b_v_per_v"}),
    )


def guards_of(conditions: Mapping[str, Any]) -> dict[str, float]:
    """`guard_s` after each turn and `lead_s` before it that a run's table was made with; 0 where nothing is said."""
    given = {name: conditions.get(name, 0.0) for name in ("guard_s", "lead_s")}
    return {
        name: float(value) if isinstance(value, int | float) and value > 0.0 and math.isfinite(value) else 0.0
        for name, value in given.items()
    }


def constant(header: Header, name: str) -> float | None:
    """A constant of a bundle or of the rig file; None where neither has it."""
    if name in header.constants:
        return float(header.constants[name])
    if header.rig_toml is None:
        return None
    value = parse_rig(header.rig_toml, Path("rig file")).constant(name, math.nan)
    return value if math.isfinite(value) else None


def _known(header: Header, names: Mapping[str, str]) -> dict[str, float]:
    return {channel: value for channel, name in names.items() if (value := constant(header, name)) is not None}


def _needed(header: Header, name: str) -> float:
    value = constant(header, name)
    if value is None or not value > 0.0:
        raise DataError(f"[constants] of the recording: {name} is missing or not positive; write it")
    return value


def _full_scale(header: Header, column: str) -> float:
    channel = header.channels.get(column)
    # A bundle from elsewhere may not say: then nothing is saturated.
    return math.inf if channel is None or channel.full_scale is None else channel.full_scale
