"""The columns of a recording of the rotating platform, and whether a run's samples are in their units."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from rigctl.campaign.layout import (
    COMMON_FIELDS,
    Columns,
    Field,
    Layout,
    UnitFindings,
    not_negative,
    number,
    one_of,
    positive,
    sample_step_s,
    sign,
    slip_between,
    time_slip,
)
from rigctl.core.arrays import FloatArray
from rigctl.experiments.rotating_platform.observe.patterns import MODULATED
from rigctl.experiments.rotating_platform.observe.stated_tilt import tilt_contradiction

# Times in minutes that are taken for seconds make sixty times as many periods as there were.
TURNS_PER_PERIOD_MIN = 0.1
PERIODS_MIN = 20.0


def _samples(run: Mapping[str, Any]) -> tuple[str, ...]:
    readings = ("t_s", "q_a_v", "q_b_v")
    return (*readings, "theta_deg", "moving") if run["pattern"] in MODULATED else readings


def _flaw(run: Mapping[str, Any]) -> str | None:
    pattern = run["pattern"]
    if pattern in MODULATED and not run.get("modulation_period_s", math.nan) > 0:
        return f"pattern {pattern} has no modulation_period_s; write the period of its table"
    if pattern == "flip" and "g_sign" not in run:
        return "a flip has no g_sign; add the column, +1 or -1"
    if pattern == "flip" and math.isnan(run["g_sign"]):
        return "a flip has no g_sign; write +1 or -1"
    return None


def _modulation_period(run: Mapping[str, Any]) -> float:
    return float(run["modulation_period_s"]) if run["pattern"] in MODULATED else 0.0


def _units(run: Mapping[str, Any], columns: Columns, _: Mapping[str, float]) -> UnitFindings:
    """The sampling rate, how often the platform turns in a period of its pattern, and the tilt."""
    step_s = sample_step_s(columns["t_s"])
    rate_hz = float(run.get("sample_rate_hz", math.nan))
    if slip := slip_between(step_s, 1 / rate_hz if rate_hz else math.nan):
        return UnitFindings(time_slip(f"samples are {step_s:.4g} apart", f"sample_rate_hz is {rate_hz:g}", slip))
    period_s, t_s = float(run.get("modulation_period_s", math.nan)), columns["t_s"]
    if not period_s > 0 or "theta_deg" not in columns:
        return UnitFindings()
    angle = columns["theta_deg"]
    known = np.isfinite(angle)
    periods = float(t_s[-1] - t_s[0]) / period_s
    turns = np.count_nonzero(np.diff(np.sign(np.cos(np.radians(angle[known])))))
    if periods > PERIODS_MIN and 0 < turns < TURNS_PER_PERIOD_MIN * periods:
        return UnitFindings(
            f"the platform turns {turns} times in {periods:.4g} periods of {period_s:g} s: t_s or modulation_period_s"
            " looks like another unit; write both in seconds"
        )
    tilt = None
    if "dm1_z_v" in columns:
        tilt = tilt_contradiction(run, _by_seconds(columns["dm1_z_v"], step_s), step_s * columns["t_s"].size)
    return UnitFindings(remarks=(tilt,) if tilt else ())


def _by_seconds(samples: FloatArray, step_s: float) -> FloatArray:
    """Means over a second each, which a source's noise does not move; those there are."""
    count = max(round(1.0 / step_s), 1)
    table = samples[: samples.size // count * count].reshape(-1, count)
    means = table.mean(axis=1)
    return np.asarray(means[np.isfinite(means)])


COLUMNS = Layout(
    fields={
        "pattern": Field(one_of(*MODULATED, "flip", "scan", "noise"), required=True),
        "modulation_period_s": Field(not_negative),
        "sample_rate_hz": Field(positive),
        "external": Field(one_of("constant", "sine", "triangle"), missing=""),
        "v_z_v": Field(number),
        "external_period_s": Field(not_negative),
        "g_sign": Field(sign),
        **COMMON_FIELDS,
    },
    samples_of=_samples,
    flaw_of_run=_flaw,
    units_of=_units,
    period_of=_modulation_period,
    constants=(
        "g_m_s2",
        "gain_q_a_v_per_m_s2",
        "gain_q_b_v_per_m_s2",
        "gain_dm1_y_v_per_m_s2",
        "gain_dm1_z_v_per_m_s2",
    ),
    other_constants=("bias_q_a_v", "bias_q_b_v", "amplifier_q_a_v_per_v", "amplifier_q_b_v_per_v"),
    handles_missing=True,
    patterns=True,
)
