"""What the files of a bundle hold, experiment by experiment: columns, their values, what may be absent."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from rigctl.campaign.bundle import unit_checks
from rigctl.core.experiments import experiment_named
from rigctl.core.numbers import NotMeasurable, decimal_or_missing
from rigctl.core.plausible import ABSOLUTE_ZERO_C, ANGLE_MAX_DEG, HOTTEST_C

_COUNT_MAX = 10**9

FACES = ("x", "y", "z", "-x", "-y", "-z")


@dataclass(frozen=True)
class Field:
    """One known column of runs.csv: `parse` raises `ValueError` saying what is expected."""

    parse: Callable[[str], Any]
    missing: float | str = math.nan
    required: bool = False


@dataclass(frozen=True)
class Layout:
    """The bundle of one experiment.

    `samples` are the columns every run file has; `samples_of` those of one run with its conditions.
    `flaw_of_run` says why a row of runs.csv contradicts itself, None when it does not. `period_of` is the
    time [s] a run must at least last.
    `units_of` compares what was asked for with what the samples show. `handles_missing`: the analysis masks gaps
    and missing samples itself. `patterns`: custom patterns are in patterns.csv.
    """

    fields: Mapping[str, Field]
    samples_of: Callable[[Mapping[str, Any]], tuple[str, ...]]
    flaw_of_run: Callable[[Mapping[str, Any]], str | None]
    period_of: Callable[[Mapping[str, Any]], float]
    units_of: Callable[[Mapping[str, Any], unit_checks.Columns, Mapping[str, float]], unit_checks.UnitFindings]
    constants: tuple[str, ...] = ()
    handles_missing: bool = False
    patterns: bool = False


def number(text: str) -> float:
    """Any number."""
    try:
        return decimal_or_missing(text)
    except NotMeasurable:
        raise
    except ValueError:
        hint = ", with a decimal point" if "," in text else ""
        raise ValueError(f"a number{hint}") from None


def not_negative(text: str) -> float:
    """A number that is 0 or more."""
    value = number(text)
    if value < 0:
        raise ValueError("a number that is not negative")
    return value


def positive(text: str) -> float:
    """A number above 0."""
    value = number(text)
    if value <= 0:
        raise ValueError("a number above 0")
    return value


def angle_deg(text: str) -> float:
    """What a stage can turn to."""
    value = number(text)
    if abs(value) > ANGLE_MAX_DEG:
        raise ValueError(f"an angle in degrees, at most {ANGLE_MAX_DEG:g}")
    return value


def temperature_c(text: str) -> float:
    """Not below absolute zero."""
    value = number(text)
    if not ABSOLUTE_ZERO_C <= value <= HOTTEST_C:
        raise ValueError(f"a temperature in degrees Celsius, {ABSOLUTE_ZERO_C:g} to {HOTTEST_C:g}")
    return value


def whole_number(text: str) -> int:
    """An integer, perhaps written by a spreadsheet as 1.0."""
    value = number(text)
    if not value.is_integer() or abs(value) > _COUNT_MAX:
        raise ValueError("a whole number")
    return int(value)


def sign(text: str) -> int:
    """+1 or -1."""
    if text not in {"+1", "1", "-1", "1.0", "-1.0"}:
        raise ValueError("+1 or -1")
    return int(float(text))


def flag(text: str) -> bool:
    """1 or 0."""
    if text not in {"0", "1", "0.0", "1.0"}:
        raise ValueError("1 or 0")
    return float(text) == 1


def one_of(*choices: str) -> Callable[[str], str]:
    """A parser of one word out of `choices`."""

    def parse(text: str) -> str:
        if text not in choices:
            raise ValueError(", ".join(choices[:-1]) + f" or {choices[-1]}")
        return text

    return parse


face = one_of(*FACES)
_NUMBER = Field(number)
_COMMON = {"temperature_c": Field(temperature_c), "start_s": _NUMBER, "valid": Field(flag)}


def _no_flaw(_: Mapping[str, Any]) -> str | None:
    return None


def _drive_period(run: Mapping[str, Any]) -> float:
    return 1 / float(run["frequency_hz"])


SENSING_AXIS = Layout(
    fields={
        "axis": Field(one_of("X", "Y", "Z"), required=True),
        "configuration": Field(one_of("pendulum", "flag"), required=True),
        "mounting": Field(whole_number, required=True),
        "theta_deg": Field(angle_deg, required=True),
        "approach": Field(sign),
        "frequency_hz": Field(positive, required=True),
        "amplitude_mm": Field(not_negative),
        **_COMMON,
    },
    samples_of=lambda _: ("t_s", "stage_x_mm", "accel_v"),
    flaw_of_run=_no_flaw,
    units_of=unit_checks.sensing_axis,
    period_of=_drive_period,
)


MODULATED = ("a", "b", "c", "c_tm", "custom")


def _platform_samples(run: Mapping[str, Any]) -> tuple[str, ...]:
    readings = ("t_s", "q_a_v", "q_b_v")
    return (*readings, "theta_deg", "moving") if run["pattern"] in MODULATED else readings


def _platform_flaw(run: Mapping[str, Any]) -> str | None:
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


ROTATING_PLATFORM = Layout(
    fields={
        "pattern": Field(one_of(*MODULATED, "flip", "scan", "noise"), required=True),
        "modulation_period_s": Field(not_negative),
        "sample_rate_hz": Field(positive),
        "external": Field(one_of("constant", "sine", "triangle"), missing=""),
        "v_z_v": _NUMBER,
        "external_period_s": Field(not_negative),
        "g_sign": Field(sign),
        **_COMMON,
    },
    samples_of=_platform_samples,
    flaw_of_run=_platform_flaw,
    units_of=unit_checks.rotating_platform,
    period_of=_modulation_period,
    constants=(
        "g_m_s2",
        "gain_q_a_v_per_m_s2",
        "gain_q_b_v_per_m_s2",
        "gain_dm1_y_v_per_m_s2",
        "gain_dm1_z_v_per_m_s2",
    ),
    handles_missing=True,
    patterns=True,
)

_UNINJECTED = ("dx", "dz", "dx+dz")
_AMPLITUDE_UNITS = {
    **dict.fromkeys(("ad11", "ad12", "ad13", "k2d"), "m/s2"),
    **dict.fromkeys(("ac12", "ac13", "k2c_1", "k2c_2"), "m"),
    "dy": "rad",
}


def _session_flaw(run: Mapping[str, Any]) -> str | None:
    session, unit = run["session"], run.get("amplitude_unit", "")
    if session in _UNINJECTED:
        return None
    for name in ("calibration_frequency_hz", "amplitude"):
        if math.isnan(run.get(name, math.nan)):
            return f"session {session} has no {name}; write what was injected"
    if unit and unit != _AMPLITUDE_UNITS[session]:
        return f"amplitude_unit {unit} contradicts session {session}; write {_AMPLITUDE_UNITS[session]} and convert"
    return None


def _injected_period(run: Mapping[str, Any]) -> float:
    frequency = run.get("calibration_frequency_hz", 0.0)
    return 1 / frequency if frequency > 0 else 0.0


INFLIGHT = Layout(
    fields={
        "session": Field(one_of(*_UNINJECTED, *_AMPLITUDE_UNITS), required=True),
        "orbits": Field(not_negative),
        "sample_period_s": Field(positive),
        "calibration_frequency_hz": Field(not_negative),
        "amplitude": _NUMBER,
        "amplitude_unit": Field(one_of("m/s2", "rad", "m"), missing=""),
        "phase_rad": _NUMBER,
        **_COMMON,
    },
    samples_of=lambda _: (
        "t_s",
        *(f"m{mass}_{axis}" for mass in (1, 2) for axis in "xyz"),
        *(f"t_{pair}" for pair in ("xx", "xz", "yy", "zz", "xy", "yz")),
        *(f"{name}_{axis}" for name in ("dw", "att", "command") for axis in "xyz"),
    ),
    flaw_of_run=_session_flaw,
    units_of=unit_checks.inflight,
    period_of=_injected_period,
    constants=("orbit_period_s", "eccentricity"),
    handles_missing=True,
)


def layout_of(experiment: str) -> Layout | None:
    """The columns of an experiment's runs; None where a recording is a table of readings."""
    declared = experiment_named(experiment)
    return declared.load(declared.columns) if declared.columns else None
