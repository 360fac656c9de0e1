"""Sensing axes, for a page and a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np

from rigctl.analysis.plane import ARCSEC
from rigctl.campaign.origin import campaign_of
from rigctl.campaign.recording import RunRecord
from rigctl.campaign.stated import uncertainties_of
from rigctl.campaign.store.store import Store
from rigctl.core.errors import UNFIT, DataError, ProcedureError
from rigctl.effects.catalogue import chosen
from rigctl.experiments.sensing_axis.analysis import analyse, numbers
from rigctl.experiments.sensing_axis.model.fit import RecordingFit, fit_mounting
from rigctl.experiments.sensing_axis.observe.recorded import recorded_calibration
from rigctl.experiments.sensing_axis.observe.reduction import observables, reduce_run
from rigctl.experiments.sensing_axis.result.budget import axis_budgets
from rigctl.report.drawn import Drawn
from rigctl.report.picture import MARKS, Line, Picture
from rigctl.report.tables.result_table import ResultTable
from rigctl.workbench.workbench import Workbench

if TYPE_CHECKING:  # drawing, which a printed result does without
    from rigctl.report.figures.sensing_axis.null_search import ResponseRow
    from rigctl.report.figures.sensing_axis.plane import PlaneRow

FITS = 8
"""So many fits tell how the uncertainty of a null falls with its runs: each takes its time while a campaign runs."""


def tables(found: Mapping[str, Any], reference: Mapping[str, Any]) -> list[ResultTable]:
    """Quick check, axes, nulls, angles and budget, as far as there are any, beside the reference values."""
    # First: what follows is not to be believed then.
    shown = [ResultTable("", notes=found["warnings"], tab="Axes")] if found.get("warnings") else []
    shown += [_quick_check(found["quick_check"])] if found.get("quick_check") else []
    budgets, stated = found.get("budget") or {}, found["stated"]
    frame = "host's" if stated["host_frame"] else "cube's"
    if found["axes"]:
        verdicts = {name: _verdict(axis["pass"]) for name, axis in found["axes"].items() if stated["requirement"]}
        shown += [_axes(found["axes"], verdicts, reference), _by_budget(found["axes"], verdicts, budgets, frame)]
    notes = [f"axis {name}: no result: {reason}" for name, reason in found.get("missing", {}).items()]
    notes += [f"ref: {reference['source']}"] if reference.get("source") else []
    shown.append(_nulls(found["nulls"], printed=not found["axes"]))
    shown += [_angles(found["angles"], reference.get("offset_deg", {}))] if found["angles"] else []
    shown += [ResultTable("", notes=notes, tab="Axes")] if notes else []
    shown += [_budget(name, axis, frame) for name, axis in budgets.items()]
    host = found.get("host") or {"axes": []}
    return [*shown, *([_correlation(host)] if len(host["axes"]) > 1 else [])]


def draw(workbench: Workbench, lines_hz: Sequence[float], found: Sequence[Any]) -> Drawn:
    """The axes with their figures, and the spectrum of what is left in the samples."""
    from rigctl.report.figures.sensing_axis.figures import plates_of
    from rigctl.report.figures.sensing_axis.null_search import representative
    from rigctl.report.figures.sensing_axis.spectrum import spectrum_plates
    from rigctl.report.figures.sensing_axis.time_series import time_series_plate

    store = workbench.store
    spectra = list(spectrum_plates(store, lines_hz, found))
    try:
        axes = analyse(workbench)
        recorded = time_series_plate(store, representative(axes.fit.model.runs))
        budgets = axis_budgets(axes, uncertainties_of(store.header))
        plates, left_out = plates_of(axes, budgets)
    except (ProcedureError, DataError) as error:
        return Drawn(spectra=spectra, left_out={"figures of the sensing axes": str(error)})
    return Drawn(numbers(axes, budgets), [recorded, *plates], spectra, left_out)


def pictures(workbench: Workbench) -> list[Picture]:
    """The null vectors about their planes (figures 15 to 17), a plot for each axis."""
    from rigctl.report.figures.sensing_axis.plane import plane_plate

    result = analyse(workbench)
    settings = result.fit.model.package.axes
    return [_out_of_plane(plane_plate(name, axis, settings[name]).rows) for name, axis in result.axes.items()]


def _out_of_plane(rows: Sequence[PlaneRow]) -> Picture:
    lines = []
    for place, configuration in enumerate(dict.fromkeys(row.configuration for row in rows)):
        of_configuration = [row for row in rows if row.configuration == configuration]
        x = np.array([float(row.mounting) for row in of_configuration])
        y = np.array([row.out_of_plane_arcsec for row in of_configuration])
        u = np.array([row.sigma_fit_arcsec for row in of_configuration])
        lines.append(Line(x, y, configuration, MARKS[place], place, bars=(y - u, y + u)))
    sigma, required = rows[0].sigma_hc_arcsec, rows[0].requirement_arcsec
    # Room for the lines at 2 sigma with their names, and for a null that lies beyond them.
    reach = max(2.2 * sigma, *(abs(row.out_of_plane_arcsec) * 1.1 for row in rows))
    levels = tuple((n * sigma, label) for n, label in ((2, "+2σ"), (1, "+σ"), (0, "0"), (-1, "−σ"), (-2, "−2σ")))
    if np.isfinite(required):
        levels += ((required, "required"), (-required, "required"))
    title = f"{rows[0].axis}: out of plane / arcsec"
    return Picture(title, tuple(lines), "mounting", y_range=(-reach, reach), levels=levels)


def progress(store: Store) -> list[Picture]:
    """The signed response of the last mounting against angle with its null, as figure 12, and how sigma falls."""
    from rigctl.report.figures.sensing_axis.null_search import response_plate

    records = _last_mounting(store)
    if not records:
        return []
    effects = chosen(store.header.experiment, campaign_of(store).model.effects)
    channels = store.header.channels
    runs = observables(
        [reduce_run(r.run_id, r.conditions, store.samples(r.run_id), channels=channels) for r in records], harmonics=1
    )
    first, calibration = runs[0], recorded_calibration(store.header)
    fits: dict[int, RecordingFit] = {}
    sigmas_arcsec: dict[int, float] = {}
    for count in np.unique(np.linspace(1, len(runs), FITS, dtype=int)).tolist():
        # The first few do not determine a null.
        with suppress(*UNFIT):
            fits[count] = fit_mounting(runs[:count], *calibration, effects)
            sigmas_arcsec[count] = fits[count].null(*first.place).theta0_sigma_rad / ARCSEC
    if len(runs) not in sigmas_arcsec:
        return []
    sigma_arcsec = sigmas_arcsec[len(runs)]
    title = f"{first.axis} {first.configuration} {first.mounting}: S/(µm/s²/mm), ±{sigma_arcsec:.2f}″"
    response = _response(title, response_plate("null", fits[len(runs)], runs).rows)
    counts, sigmas = np.array(list(sigmas_arcsec), dtype=float), np.array(list(sigmas_arcsec.values()))
    falling = Picture(
        f"σ(θ0) / arcsec: {sigma_arcsec:.2f}″ after {len(runs)} runs",
        (Line(counts, sigmas), Line(counts, sigmas, mark="o")),
        "runs",
        y_scale="log",
    )
    return [response, falling]


def _response(title: str, rows: Sequence[ResponseRow]) -> Picture:
    """Figure 12 for a terminal: a line and marks for each frequency, the crossing at zero."""
    widest_arcsec = max(abs(row.theta_minus_theta0_arcsec) for row in rows if row.kind == "measured")
    # Also where all runs stand at the null: 20 arcsec to either side.
    reach = max(1.2 * widest_arcsec, 20.0)
    lines = []
    measured_hz = {row.frequency_hz for row in rows if row.frequency_hz and row.kind == "measured"}
    for place, frequency in enumerate(sorted(measured_hz)):
        # The coarse run is degrees away and would flatten the crossing.
        near = [row for row in rows if row.frequency_hz == frequency and abs(row.theta_minus_theta0_arcsec) <= reach]
        for kind, mark, name in (("model", "", ""), ("measured", MARKS[place % 6], f"{frequency:.2g} Hz")):
            shown = [row for row in near if row.kind == kind]
            x = np.array([row.theta_minus_theta0_arcsec for row in shown])
            y = np.array([row.response_um_s2_per_mm for row in shown])
            u = np.array([row.response_sigma_um_s2_per_mm or 0.0 for row in shown])
            bars, run_ids = ((y - u, y + u), tuple(row.run_id for row in shown)) if mark else (None, ())
            lines.append(Line(x, y, name, mark, place, bars, run_ids))
    return Picture(title, tuple(line for line in lines if len(line.x)), "θ − θ0 / arcsec", x_range=(-reach, reach))


def _last_mounting(store: Store) -> list[RunRecord]:
    records = store.runs(valid_only=True)
    keys = ("axis", "configuration", "mounting")
    return [run for run in records if all(run.conditions.get(k) == records[-1].conditions.get(k) for k in keys)]


def _verdict(passed: bool) -> str:
    return "pass" if passed else "FAIL"


def _axes(axes: Mapping[str, Any], verdicts: Mapping[str, str], reference: Mapping[str, Any]) -> ResultTable:
    """Axes in the cube's frame; no `verdicts` where nobody has stated a requirement."""
    rows, printed = [], reference.get("axes", {})
    for name, axis in axes.items():
        numbers = [f"{axis['std_hc_2sigma_arcsec']:.2f}", f"{axis['theta_m_arcsec']:+.3f}", str(axis["vectors"])]
        rows.append([name, *_components(axis["coc"]), *numbers, verdicts.get(name, "")])
        # Rounding may leave a variance along the axis, which is zero, below zero.
        sigmas = [max(axis["covariance"][i][i], 0.0) ** 0.5 for i in range(3)]
        rows.append([" ±σ", *(f"{sigma:.1e}" for sigma in sigmas), "", "", "", ""])
        if axis["eq12"]:
            theta_m = f"{axis['eq12']['theta_m_arcsec']:+.3f}"
            rows.append(["eq12", *_components(axis["eq12"]["coc"]), "", theta_m, "", ""])
        if name in printed:
            half_cone, theta_m = (_digits(reference, key, name) for key in ("std_hc_2sigma_arcsec", "theta_m_arcsec"))
            rows.append([" ref", *_components(printed[name]), half_cone, theta_m, "", ""])
    limits = ", ".join(f"{limit:g}" for limit in sorted({axis["requirement_arcsec"] for axis in axes.values()}))
    note = (
        "half-cone: half-cone deviation at 2 sigma, mean: its mean, both in arcsec; n: null vectors; eq12: the axis "
        "by the paper's normal equations, to which its printed means belong; "
        + (f"pass: half-cone up to {limits} arcsec" if verdicts else "nobody has stated a requirement: no verdict")
    )
    columns = ["axis", "#x", "#y", "#z", "#half-cone", "#mean", "#n", "verdict"]
    marked = [row[-1] == "FAIL" for row in rows]
    return ResultTable("Sensing axes in the cube's frame", columns, rows, marked, [note], "Axes")


def _by_budget(
    axes: Mapping[str, Any], verdicts: Mapping[str, str], budgets: Mapping[str, Any], frame: str
) -> ResultTable:
    """The product: axes as the host sees them, with what the rotation into its frame is uncertain by; in the cube's
    `frame` where nobody has stated how it stands in the host's."""
    rows = []
    for name, axis in axes.items():
        expanded = f"{max(budgets[name]['expanded_95_arcsec']):.2f}" if name in budgets else ""
        rows.append([name, *_components(axis["uoaf"]), expanded, verdicts.get(name, "")])
        rows.append([" ±σ", *(f"{max(axis['uoaf_covariance'][i][i], 0.0) ** 0.5:.1e}" for i in range(3)), "", ""])
    shown = "; U95: its expanded uncertainty, of the larger component" if budgets else ", which `rigctl result` shows"
    columns = ["axis", "#x", "#y", "#z", "#U95 / arcsec", "verdict"]
    marked = [row[-1] == "FAIL" for row in rows]
    notes = [f"±σ: by the budget{shown}"]
    if frame != "host's":
        notes.append("nobody has stated how the cube stands in the host's frame")
    title = f"Sensing axes in the {frame} frame" + ("" if frame == "host's" else ", by the budget")
    return ResultTable(title, columns, rows, marked, notes, "Axes")


def _digits(reference: Mapping[str, Any], key: str, axis: str) -> str:
    value = reference.get(key, {}).get(axis)
    return "" if value is None else f"{value:+.3f}" if key == "theta_m_arcsec" else f"{value:.2f}"


def _components(vector: Sequence[float]) -> list[str]:
    return [f"{component:+.6f}" for component in vector]


def _quick_check(check: Mapping[str, Any]) -> ResultTable:
    scale = check["laser_scale"]
    rows = {
        "verdict": "pass" if check["passed"] else "FAIL",
        "null, roll not allowed for": f"{check['theta0_deg']:+.4f} deg",
        "gain": f"{check['gain_v_per_m_s2']:.3f} V/(m/s2)",
        "reversal (S+ + S-)/(S+ - S-)": f"{check['reversal']:+.2e} ± {check['reversal_sigma']:.1e}",
        "main laser over encoder": "no main head" if scale is None else f"{scale:.5f}",
    }
    return ResultTable("Quick check", ["quantity", "value"], list(rows.items()), tab="Axes")


def _nulls(nulls: Sequence[Mapping[str, Any]], *, printed: bool) -> ResultTable:
    rows = [
        [
            null["axis"],
            null["configuration"],
            str(null["mounting"]),
            f"{null['theta0_deg']:+.5f}",
            f"{null['theta0_sigma_arcsec']:.2f}",
        ]
        for null in nulls
    ]
    columns = ["axis", "configuration", "#mounting", "#theta0 / deg", "#sigma / arcsec"]
    return ResultTable("Nulls", columns, rows, tab="Axes", printed=printed)


def _angles(angles: Mapping[str, Any], printed: Mapping[str, float]) -> ResultTable:
    rows = [
        [
            pair,
            *(f"{angle[key]:.4f}" for key in ("deg", "offset_deg", "sigma_deg")),
            f"{printed[pair]:.2f}" if pair in printed else "",
        ]
        for pair, angle in angles.items()
    ]
    columns = ["axes", "#angle / deg", "#|angle - 90| / deg", "#sigma / deg", "#ref / deg"]
    return ResultTable("Angles between axes", columns, rows, tab="Angles")


def _budget(name: str, axis: Mapping[str, Any], frame: str) -> ResultTable:
    """The uncertainty budget of an axis in the `frame`: two angles perpendicular to it, 1 sigma."""
    rows = [[each["name"], each["type"], each["input"], *_arcsec(each["arcsec"])] for each in axis["contributions"]]
    rows.append(["combined", "", "", *_arcsec(axis["combined_arcsec"])])
    rows.append(["expanded (95 %)", "", "", *_arcsec(axis["expanded_95_arcsec"])])
    inside = ", ".join(f"{part} {arcsec:.2f}" for part, arcsec in axis["included_in_scatter"].items())
    notes = [f"in the scatter already, per mounting: {inside}", f"Monte Carlo: {axis['monte_carlo']['reason']}"]
    # Combined and expanded, which are no contributions.
    marked = [False] * (len(rows) - 2) + [True, True]
    columns = ["contribution", "type", "input", "#1", "#2"]
    return ResultTable(
        f"Uncertainty of axis {name} in the {frame} frame / arcsec", columns, rows, marked, notes, "Budget"
    )


def _correlation(host: Mapping[str, Any]) -> ResultTable:
    """How the components of the budgets go together."""
    components = [f"{axis} {place}" for axis in host["axes"] for place in (1, 2)]
    rows = [
        [name, *(f"{each:+.3f}" for each in row)]
        for name, row in zip(components, host["component_correlation"], strict=True)
    ]
    columns = ["component", *(f"#{name}" for name in components)]
    return ResultTable("Correlation of the components, all axes", columns, rows, tab="Budget")


def _arcsec(components: Sequence[float]) -> list[str]:
    return [f"{component:.3f}" for component in components]
