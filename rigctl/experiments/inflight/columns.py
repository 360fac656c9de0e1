"""The columns of a recording in flight, and whether a run's samples are in their units."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

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
    slip_between,
    time_slip,
)
from rigctl.experiments.inflight.observe.gravity import gravity_findings, trace_remark
from rigctl.experiments.inflight.observe.sessions import (
    EQUIVALENCE,
    GRADIENT,
    SESSIONS,
    Session,
    fewest_orbits,
)
from rigctl.experiments.inflight.observe.stimulus import AMPLITUDE_UNITS, stimulus_findings


def _flaw(run: Mapping[str, Any]) -> str | None:
    session, unit = run["session"], run.get("amplitude_unit", "")
    if session == "ep_spin" and not run.get("spin_frequency_hz", math.nan) > 0.0:
        return "session ep_spin has no spin_frequency_hz; write how fast it turned"
    if session in (*GRADIENT, *EQUIVALENCE):
        return None
    for name in ("calibration_frequency_hz", "amplitude"):
        if math.isnan(run.get(name, math.nan)):
            return f"session {session} has no {name}; write what was injected"
    if unit and unit != AMPLITUDE_UNITS[session]:
        return f"amplitude_unit {unit} contradicts session {session}; write {AMPLITUDE_UNITS[session]} and convert"
    return None


def _injected_period(run: Mapping[str, Any]) -> float:
    frequency = run.get("calibration_frequency_hz", 0.0)
    return 1 / frequency if frequency > 0 else 0.0


def _units(run: Mapping[str, Any], columns: Columns, constants: Mapping[str, float]) -> UnitFindings:
    """The sampling period, how long the session lasts in orbits, the stimulus in its own channel or, in a session of
    the test, gravity, and the trace of its gradient."""
    found = _of_times_and_signals(run, columns, constants)
    trace = trace_remark(columns)
    return replace(found, remarks=(*found.remarks, trace)) if trace else found


def _of_times_and_signals(run: Mapping[str, Any], columns: Columns, constants: Mapping[str, float]) -> UnitFindings:
    step_s = sample_step_s(columns["t_s"])
    period_s = float(run.get("sample_period_s", math.nan))
    if slip := slip_between(step_s, period_s):
        return UnitFindings(time_slip(f"samples are {step_s:.4g} apart", f"sample_period_s is {period_s:g}", slip))
    orbit_s = constants.get("orbit_period_s", math.nan)
    asked_s = float(run.get("orbits", math.nan)) * orbit_s
    lasts_s = float(columns["t_s"][-1] - columns["t_s"][0]) + step_s
    if slip := slip_between(lasts_s, asked_s):
        return UnitFindings(time_slip(f"it lasts {lasts_s:.4g}", f"its orbits take {asked_s:.4g} s", slip))
    if not lasts_s >= fewest_orbits(run["session"]) * orbit_s:
        return UnitFindings()
    if run["session"] in AMPLITUDE_UNITS:
        return _stimulus(run, columns, step_s, orbit_s)
    if run["session"] in EQUIVALENCE:
        return gravity_findings(orbit_s, run["spin_frequency_hz"] if run["session"] == "ep_spin" else 0.0, columns)
    return UnitFindings()


def _stimulus(run: Mapping[str, Any], columns: Columns, step_s: float, orbit_s: float) -> UnitFindings:
    """Nothing to compare where the row tells no stimulus: the reduction says what it lacks."""
    frequency_hz, amplitude = run["calibration_frequency_hz"], run["amplitude"]
    if not (frequency_hz > 0.0 and amplitude != 0.0):
        return UnitFindings()
    return stimulus_findings(Session(run["session"], orbit_s, step_s, frequency_hz, amplitude), columns)


COLUMNS = Layout(
    fields={
        "session": Field(one_of(*SESSIONS), required=True),
        "orbits": Field(not_negative),
        "sample_period_s": Field(positive),
        "calibration_frequency_hz": Field(not_negative),
        "amplitude": Field(number),
        "amplitude_unit": Field(one_of("m/s2", "rad", "m"), missing=""),
        "phase_rad": Field(number),
        "spin_frequency_hz": Field(not_negative),
        **COMMON_FIELDS,
    },
    samples_of=lambda _: (
        "t_s",
        *(f"m{mass}_{axis}" for mass in (1, 2) for axis in "xyz"),
        *(f"t_{pair}" for pair in ("xx", "xz", "yy", "zz", "xy", "yz")),
        *(f"{name}_{axis}" for name in ("dw", "att", "command") for axis in "xyz"),
    ),
    flaw_of_run=_flaw,
    units_of=_units,
    period_of=_injected_period,
    constants=("orbit_period_s", "eccentricity"),
    other_constants=("tracker_bias_rad", "coupling_rad"),
    handles_missing=True,
)
