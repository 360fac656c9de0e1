"""What a recording of the rotating platform says of itself: scale factors, biases, ranges, and each run's table."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rigctl import config
from rigctl.campaign.recording import Header
from rigctl.errors import ConfigError, DataError
from rigctl.experiments.rotating_platform.patterns import ROTATIONS, Pattern, custom_pattern, named_pattern

CHANNELS = ("z", "y")
"""The two chains by the axis they sense at angle 0: A is z, B is y."""

READINGS: Mapping[str, str] = {"z": "q_a_v", "y": "q_b_v"}
"""The column of each."""

COMMANDS: Mapping[str, str] = {"z": "dm1_z_v", "y": "dm1_y_v"}
"""The columns of the pendulum's offset inputs."""

MODULATED = (*ROTATIONS, "custom")
"""What `pattern` says of runs that are modulated; the others are flips, scans and noise records."""


@dataclass(frozen=True)
class Chains:
    """What is believed of the chains, by channel: scale factors [V s2/m], electrical bias and full scale [V]."""

    gain_v_per_m_s2: Mapping[str, float]
    command_v_per_m_s2: Mapping[str, float]
    bias_v: Mapping[str, float]
    full_scale_v: Mapping[str, float]
    g_m_s2: float


def chains(header: Header) -> Chains:
    """From a rig file's constants or from those of a bundle; `DataError` for one that is missing."""
    return Chains(
        gain_v_per_m_s2={"z": _needed(header, "gain_q_a_v_per_m_s2"), "y": _needed(header, "gain_q_b_v_per_m_s2")},
        command_v_per_m_s2={
            "z": _needed(header, "gain_dm1_z_v_per_m_s2"),
            "y": _needed(header, "gain_dm1_y_v_per_m_s2"),
        },
        bias_v={
            name: value
            for name, key in (("z", "bias_q_a_v"), ("y", "bias_q_b_v"))
            if (value := _constant(header, key)) is not None
        },
        full_scale_v={name: _full_scale(header, column) for name, column in READINGS.items()},
        g_m_s2=_needed(header, "g_m_s2"),
    )


def table_of(header: Header, conditions: Mapping[str, Any]) -> Pattern | None:
    """The table a run was made with; None where only its record tells it."""
    name, period_s = str(conditions["pattern"]), float(conditions["modulation_period_s"])
    guard_s = guard_of(conditions)
    if name in ROTATIONS:
        try:
            return named_pattern(name, period_s, guard_s=guard_s)
        except ConfigError:
            return None
    patterns = header.extra.get("patterns")
    return None if patterns is None else _custom(patterns, period_s)


def guard_of(conditions: Mapping[str, Any]) -> float:
    """The guard time after each turn that a run's table was made with [s]; 0 where nothing is said."""
    return _seconds(conditions, "guard_s")


def lead_of(conditions: Mapping[str, Any]) -> float:
    """The time before each motion that a run's table masks with it [s]; 0 where nothing is said."""
    return _seconds(conditions, "lead_s")


def _seconds(conditions: Mapping[str, Any], name: str) -> float:
    value = conditions.get(name, 0.0)
    return float(value) if isinstance(value, int | float) and value > 0.0 and math.isfinite(value) else 0.0


def _custom(patterns: Mapping[str, Any], period_s: float) -> Pattern | None:
    rows = zip(
        patterns["pattern"],
        patterns["period_s"],
        patterns["sign_cos_theta"],
        patterns["start_s"],
        patterns["stop_s"],
        strict=True,
    )
    dwells = [
        (int(float(sign)), float(start), float(stop))
        for name, period, sign, start, stop in rows
        if name == "custom" and math.isclose(float(period), period_s, rel_tol=1e-6)
    ]
    try:
        return custom_pattern(period_s, dwells) if dwells else None
    except ConfigError:
        return None


def _constant(header: Header, name: str) -> float | None:
    if name in header.constants:
        return float(header.constants[name])
    if header.rig_toml is None:
        return None
    value = config.parse_rig(header.rig_toml, Path("rig file")).constant(name, math.nan)
    return value if math.isfinite(value) else None


def _needed(header: Header, name: str) -> float:
    value = _constant(header, name)
    if value is None or not value > 0.0:
        raise DataError(f"[constants] of the recording: {name} is missing or not positive; write it")
    return value


def _full_scale(header: Header, column: str) -> float:
    channel = header.channels.get(column)
    return math.inf if channel is None or channel.full_scale is None else channel.full_scale
