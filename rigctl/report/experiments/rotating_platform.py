"""The result of the rotating platform, for a page and a terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from rigctl.core.errors import DataError, ProcedureError
from rigctl.experiments.rotating_platform.analysis import analyse
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS, chains
from rigctl.experiments.rotating_platform.result.bench_runs import scans
from rigctl.experiments.rotating_platform.result.chain_noise import AS_PRINTED
from rigctl.experiments.rotating_platform.result.published import SCAN_M_S2, scanned_alike
from rigctl.report.drawn import Drawn
from rigctl.report.quantities import number, quantity
from rigctl.report.tables.result_table import ResultTable
from rigctl.workbench.workbench import Workbench

_EQUATION_6 = ("offset", "cos", "sin")
_MEANS = ("accel_z", "accel_y", "bias_z", "bias_y")
_TURNED_OVER = (("gain_v_per_m_s2", "scale factor", "V s2/m"), ("bias_v", "electrical bias", "V"))


def draw(workbench: Workbench, lines_hz: Sequence[float], found: Sequence[Any]) -> Drawn:
    """Figures 5, 7, 8, 9 and table 4 as far as the runs allow, the noise, and the tables of the result."""
    from rigctl.report.figures.rotating_platform.figures import plates_of

    del lines_hz, found
    believed = chains(workbench.store.header)
    try:
        result = analyse(workbench)
    except (ProcedureError, DataError) as error:
        # What is wrong with a scan is told without an analysis: it is so under any noise.
        _, why_not = scans(workbench.store, believed, dict.fromkeys(CHANNELS, AS_PRINTED))
        return Drawn(left_out={"figures of the platform": str(error), **why_not})
    scanned, why_not = scans(workbench.store, believed, result.chain_noise)
    plates, left_out = plates_of(result, believed, scanned)
    numbers = result.as_json()
    return Drawn(numbers, plates, left_out={**left_out, **why_not})


def tables(found: Mapping[str, Any], reference: Mapping[str, Any]) -> list[ResultTable]:
    """The recording's own numbers; of the runs means, precision in an hour and responses."""
    del reference
    runs = found["runs"]
    notes = [remark for run in runs for remark in run["remarks"]]
    notes += [f"left out: {why}" for why in found["left_out"].values()]
    notes.append(f"Not tested by any modulation: {', '.join(found['not_tested'])}.")
    shown = [
        _recording(found),
        _scanned(found.get("scans", ())),
        _means(runs),
        _precision(found),
        _responses(runs),
        *([_budget(found["budget"])] if found.get("budget") else []),
    ]
    # Notes stand once, below the last table.
    *others, last = [each for each in shown if each.rows]
    return [*others, replace(last, notes=[*last.notes, *notes])]


def _recording(result: Mapping[str, Any]) -> ResultTable:
    gain = result["tilt_gain"]
    rows = [["gain of the commanded tilt", quantity(gain["value"], gain["sigma"])]]
    for axis, value in result["accel_m_s2"].items():
        rows.append([f"acceleration {axis}", quantity(value["value"], value["sigma"], "m/s2")])
    # Null where the electrical biases are not known.
    for sensor, value in (result["wobble_rad"] or {}).items():
        rows.append([f"wobble of sensor {sensor.upper()}", quantity(value["value"], value["sigma"], "rad")])
    for channel, flipped in result.get("flips", {}).items():
        # Of the whole chain where its amplifier is known, else of the sensor alone.
        turned = flipped["chain"] or flipped["sensor"]
        what = f"chain of channel {channel}" if flipped["chain"] else f"channel {channel} without its amplifier"
        for name, words, unit in _TURNED_OVER:
            value = quantity(turned[name]["value"], turned[name]["sigma"], unit)
            rows.append([f"{what}, sensor turned over: {words}", value])
    return ResultTable("The recording as a whole.", ["quantity", "value"], rows, notes=result["warnings"])


def _scanned(scans: Sequence[Mapping[str, Any]]) -> ResultTable:
    """Eq. 6 measured beside eq. 6 printed, where a scan was made under the same tilt."""
    unit = _unit([scan[channel][name] for scan in scans for channel in ("y", "z") for name in _EQUATION_6])
    rows = [
        [
            scan["run_id"],
            f"{scan['commanded_z_m_s2'] / unit:.0f}",
            f"m_{channel}",
            *(_short(scan[channel][name], unit) for name in _EQUATION_6),
            *(_printed(scan, channel, name, unit) for name in _EQUATION_6),
        ]
        for scan in scans
        for channel in ("y", "z")
    ]
    columns = [
        "scan",
        "#tilt z",
        "reading",
        "#offset",
        "#cos",
        "#sin",
        *(f"#{each}, printed" for each in _EQUATION_6),
    ]
    return ResultTable(f"Readings over the platform's angle / {_power(unit)} m/s2 (eq. 6).", columns, rows)


def _printed(scan: Mapping[str, Any], channel: str, name: str, unit: float) -> str:
    return f"{SCAN_M_S2[channel][name] / unit:.0f}" if scanned_alike(scan["commanded_z_m_s2"]) else ""


def _means(runs: Sequence[Mapping[str, Any]]) -> ResultTable:
    unit = _unit([run[f"{name}_m_s2"] for run in runs for name in _MEANS])
    rows = [
        [
            run["run_id"],
            f"{run['pattern']} {run['modulation_period_s']:g} s",
            f"{run['periods']} ({run['refitted']})" if run["refitted"] else str(run["periods"]),
            *(_short(run[f"{name}_m_s2"], unit) for name in _MEANS),
        ]
        for run in runs
    ]
    columns = ["run", "pattern", "#periods", "#accel z", "#accel y", "#bias z", "#bias y"]
    marked = [run["refitted"] > 0 or run["invalid"] > 0 for run in runs]
    title = f"Means of the runs / {_power(unit)} m/s2 (refitted periods in brackets)."
    return ResultTable(title, columns, rows, marked)


def _precision(result: Mapping[str, Any]) -> ResultTable:
    theory = [run["precision_1h_m_s2"][channel]["theory"] for run in result["runs"] for channel in ("z", "y")]
    unit = 10.0 ** math.floor(math.log10(min(theory, default=1.0)))
    rows = [
        [
            run["run_id"],
            run["estimator"],
            *(_of_an_hour(run["precision_1h_m_s2"][channel], unit) for channel in ("z", "y")),
            f"{run['conditions']['m0']:.1e} {run['conditions']['m1']:.1e} {run['conditions']['m2']:.1e}",
        ]
        for run in result["runs"]
    ]
    columns = ["run", "estimator", "#z: theory, measured", "#y: theory, measured", "#m0 m1 m2"]
    noise = ", ".join(f"{channel}: {each['source']}" for channel, each in result["theory_noise"].items())
    return ResultTable(f"Precision in an hour / {_power(unit)} m/s2 (99 %); theory of {noise}.", columns, rows)


def _responses(runs: Sequence[Mapping[str, Any]]) -> ResultTable:
    rows = [
        [
            run["run_id"],
            run["external"],
            number(run["response"]["accel_pp_m_s2"]),
            number(run["response"]["bias_pp_m_s2"]),
            *(f"{run['response']['shift_min'][place]:.1f}" for place in ("start", "centre", "end")),
        ]
        for run in runs
        if run["response"]
    ]
    columns = ["run", "external", "#accel z p-p", "#bias z p-p", "#start", "#centre", "#end"]
    title = "Peak to peak / m/s2, and by how many minutes the bias lags (stamped at start, centre, end)."
    return ResultTable(title, columns, rows)


def _budget(told: Mapping[str, Any]) -> ResultTable:
    """What the uncertainty of each output is made of, 1 sigma."""
    rows = [
        [each["name"], each["type"], each["input"], *(f"{u:.2g}" for u in each["u"])]
        for each in told["contributions"]
        if any(each["u"])
    ]
    rows.append(["combined", "", "", *(f"{u:.2g}" for u in told["combined"])])
    rows.append(["expanded (95 %)", "", "", *(f"{u:.2g}" for u in told["expanded_95"])])
    # Combined and expanded, which are no contributions.
    marked = [False] * (len(rows) - 2) + [True, True]
    columns = ["contribution", "type", "input", *(f"#{name.replace('_', ' ')}" for name in told["outputs"])]
    notes = [f"Monte Carlo: {told['monte_carlo']['reason']}"]
    title = "Uncertainty of tilt gain / 1, accelerations / m/s2, wobbles / rad."
    return ResultTable(title, columns, rows, marked, notes, "Budget")


def _unit(values: Sequence[Mapping[str, float | None]]) -> float:
    """The power of a thousand in which the largest has up to four digits before the point [m/s2]."""
    largest = max((abs(value["value"] or 0.0) for value in values), default=0.0)
    return 10.0 ** (3 * math.floor((math.log10(largest) - 1.0) / 3.0)) if largest > 0.0 else 1.0


def _power(unit: float) -> str:
    return f"1e{round(math.log10(unit))}"


def _short(value: Mapping[str, float | None], unit: float) -> str:
    mean, sigma = value["value"], value["sigma"]
    if mean is None or sigma is None:
        return "-"
    # The heading of the table has the power of ten.
    return quantity(mean / unit, sigma / unit).replace(" ± ", "±")


def _of_an_hour(value: Mapping[str, Any], unit: float) -> str:
    theory = f"{value['theory'] / unit:.2f}"
    if value["measured"] is None:
        return f"{theory}, -"
    low, high = value["interval_99"]
    return f"{theory}, {value['measured'] / unit:.2f} ({low / unit:.2f} to {high / unit:.2f})"
