"""Sensing axes, for a page and a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from rich.console import Console
from rich.table import Table

from rigctl.analysis.plane import ARCSEC
from rigctl.campaign.origin import campaign_of
from rigctl.campaign.recording import RunRecord
from rigctl.campaign.store.store import Store
from rigctl.core.errors import DataError, ProcedureError
from rigctl.effects.catalogue import chosen
from rigctl.experiments.sensing_axis.analysis import analyse, uncertainties_of
from rigctl.experiments.sensing_axis.model.fit import NullPoint, RecordingFit
from rigctl.experiments.sensing_axis.model.one_mounting import fit_mounting
from rigctl.experiments.sensing_axis.observe.recorded import recorded_calibration
from rigctl.experiments.sensing_axis.observe.reduction import observables, reduce_run
from rigctl.report.drawn import Drawn
from rigctl.report.quantities import number, quantity
from rigctl.report.tables.result_table import ResultTable
from rigctl.workbench.workbench import Workbench

FEW = 8
"""Of so many runs it is also said how well the null was known after each."""


def show(found: Mapping[str, Any], reference: Mapping[str, Any]) -> None:
    """Axes and angles, beside the reference values where a campaign file gives some; fits 80 columns."""
    console = Console()
    if found.get("quick_check"):
        _print_quick_check(console, found["quick_check"])
    if found["axes"]:
        _print_axes(console, found["axes"], reference)
    else:
        console.print(_nulls(found["nulls"]))
    if found["angles"]:
        console.print(_angles(found["angles"], reference.get("offset_deg", {})))
    for name, reason in found.get("missing", {}).items():
        console.print(f"axis {name}: no result: {reason}", highlight=False, soft_wrap=True)
    if reference.get("source"):
        console.print(f"ref: {reference['source']}", style="dim", highlight=False)
    if found.get("budget"):
        _print_budget(found["budget"])


def draw(workbench: Workbench, lines_hz: Sequence[float], found: Sequence[Any]) -> Drawn:
    """The axes with their figures, and the spectrum of what is left in the samples."""
    from rigctl.report.figures.sensing_axis.figures import plates_of
    from rigctl.report.figures.sensing_axis.spectrum import spectrum_plates

    store = workbench.store
    spectra = list(spectrum_plates(store, lines_hz, found))
    try:
        axes = analyse(workbench)
        plates, left_out = plates_of(axes, uncertainties_of(store.header))
    except (ProcedureError, DataError) as error:
        return Drawn(spectra=spectra, left_out={"figures of the sensing axes": str(error)})
    numbers = axes.as_json()
    return Drawn(numbers, _tables(numbers), plates, spectra, left_out)


def null_vectors(workbench: Workbench) -> dict[str, list[dict[str, Any]]]:
    """The null vectors about their planes as figures 15 to 17 show them, by axis."""
    from rigctl.report.figures.sensing_axis.plane import plane_plate

    found = analyse(workbench)
    settings = found.fit.model.package.axes
    return {
        name: [asdict(row) for row in plane_plate(name, axis, settings[name]).rows]
        for name, axis in found.axes.items()
    }


def null_search(store: Store) -> dict[str, Any]:
    """The signed response of the last mounting against angle, and its null, as figure 12 shows them."""
    from rigctl.report.figures.sensing_axis.null_search import response_plate

    records = _last_mounting(store)
    if not records:
        return {}
    effects = chosen(store.header.experiment, campaign_of(store).model.effects)
    runs = observables([reduce_run(r.run_id, r.conditions, store.samples(r.run_id)) for r in records], harmonics=1)
    first, calibration = runs[0], recorded_calibration(store.header)

    def null_after(count: int) -> tuple[RecordingFit, NullPoint]:
        fit = fit_mounting(runs[:count], *calibration, effects)
        return fit, fit.null(first.axis, first.configuration, first.mounting)

    fit, null = null_after(len(runs))
    earlier = range(1, len(runs)) if len(runs) <= FEW else ()
    return {
        "sigmas": [null_after(count)[1].theta0_sigma_rad / ARCSEC for count in earlier],
        "axis": first.axis,
        "configuration": first.configuration,
        "mounting": first.mounting,
        "runs": len(runs),
        "sigma_arcsec": null.theta0_sigma_rad / ARCSEC,
        "rows": [asdict(row) for row in response_plate("null", fit, runs).rows],
    }


def _last_mounting(store: Store) -> list[RunRecord]:
    records = store.runs(valid_only=True)
    keys = ("axis", "configuration", "mounting")
    return [run for run in records if all(run.conditions.get(k) == records[-1].conditions.get(k) for k in keys)]


def _tables(told: Mapping[str, Any]) -> list[ResultTable]:
    """Sensing axes and the angles between them, as far as there are any."""
    axes, angles = told["axes"], told["angles"]
    tables = []
    if axes:
        rows = [
            [
                name,
                *(f"{component:+.6f}" for component in axis["coc"]),
                f"{axis['std_hc_2sigma_arcsec']:.2f}",
                number(axis["requirement_arcsec"]),
                str(axis["vectors"]),
                "pass" if axis["pass"] else "fail",
            ]
            for name, axis in axes.items()
        ]
        columns = ["axis", "#x", "#y", "#z", "#half-cone / arcsec", "#required / arcsec", "#vectors", "verdict"]
        sentence = "Sensing axes in the cube's frame, with their half-cone deviation at 2 sigma."
        tables.append(ResultTable(sentence, columns, rows, [not axis["pass"] for axis in axes.values()]))
    if angles:
        rows = [[pair, quantity(angle["deg"], angle["sigma_deg"], "deg")] for pair, angle in angles.items()]
        tables.append(ResultTable("Angles between the axes.", ["axes", "#angle between them"], rows))
    return tables


def _print_axes(console: Console, found: Mapping[str, Any], reference: Mapping[str, Any]) -> None:
    axes = Table(title="Sensing axes in the cube's frame", title_justify="left", padding=(0, 1))
    for column in ("axis", "x", "y", "z", "std_hc 2s", "theta_m", "n", "ok?"):
        axes.add_column(column, justify="left" if column in {"axis", "ok?"} else "right", no_wrap=True)
    printed = reference.get("axes", {})
    for name, axis in found.items():
        axes.add_row(
            name,
            *(f"{c:+.6f}" for c in axis["coc"]),
            f'{axis["std_hc_2sigma_arcsec"]:.2f}"',
            f'{axis["theta_m_arcsec"]:+.3f}"',
            str(axis["vectors"]),
            "pass" if axis["pass"] else "FAIL",
        )
        if name in printed:
            std = reference.get("std_hc_2sigma_arcsec", {}).get(name)
            shown = "" if std is None else f'{std:.2f}"'
            axes.add_row(" ref", *(f"{c:+.6f}" for c in printed[name]), shown, "", "", "", style="dim")
    console.print(axes)
    limits = sorted({axis["requirement_arcsec"] for axis in found.values()})
    console.print(
        "std_hc 2s: half-cone deviation at 2 sigma, theta_m: its mean, n: null vectors; "
        f"pass up to {', '.join(f'{limit:g}' for limit in limits)} arcsec",
        style="dim",
        highlight=False,
    )


def _print_quick_check(console: Console, check: Mapping[str, Any]) -> None:
    scale = check["laser_scale"]
    rows = {
        "verdict": "pass" if check["passed"] else "FAIL",
        "null, roll not allowed for": f"{check['theta0_deg']:+.4f} deg",
        "gain": f"{check['gain_v_per_m_s2']:.3f} V/(m/s2)",
        "reversal (S+ + S-)/(S+ - S-)": f"{check['reversal']:+.2e} +- {check['reversal_sigma']:.1e}",
        "main laser over encoder": "no main head" if scale is None else f"{scale:.5f}",
    }
    table = Table(title="Quick check", title_justify="left", show_header=False)
    for name, value in rows.items():
        table.add_row(name, value)
    console.print(table)


def _nulls(nulls: list[Mapping[str, Any]]) -> Table:
    table = Table(title="Nulls", title_justify="left")
    for column in ("axis", "configuration", "mounting", "theta0/deg", "sigma/arcsec"):
        table.add_column(column, justify="left" if column in {"axis", "configuration"} else "right")
    for null in nulls:
        table.add_row(
            null["axis"],
            null["configuration"],
            str(null["mounting"]),
            f"{null['theta0_deg']:+.5f}",
            f"{null['theta0_sigma_arcsec']:.2f}",
        )
    return table


def _angles(angles: Mapping[str, Any], printed: Mapping[str, float]) -> Table:
    table = Table(title="Angles between axes", title_justify="left")
    for column in ("axes", "angle/deg", "|angle - 90|/deg", "sigma/deg", "ref |angle - 90|/deg"):
        table.add_column(column, justify="left" if column == "axes" else "right")
    for pair, angle in angles.items():
        table.add_row(
            pair,
            f"{angle['deg']:.4f}",
            f"{angle['offset_deg']:.4f}",
            f"{angle['sigma_deg']:.4f}",
            f"{printed[pair]:.2f}" if pair in printed else "",
        )
    return table


def _print_budget(budget: Mapping[str, Any]) -> None:
    """The uncertainty budget of each axis: two angles perpendicular to it, 1 sigma."""
    console = Console()
    for name, axis in budget.items():
        table = Table(title=f"Uncertainty of axis {name} / arcsec", title_justify="left", padding=(0, 1))
        for column in ("contribution", "type", "input", "1", "2"):
            table.add_column(column, justify="right" if column in {"1", "2"} else "left")
        for row in axis["contributions"]:
            table.add_row(row["name"], row["type"], row["input"], *(f"{x:.3f}" for x in row["arcsec"]))
        table.add_row("combined", "", "", *(f"{x:.3f}" for x in axis["combined_arcsec"]), style="bold")
        table.add_row("expanded (95 %)", "", "", *(f"{x:.3f}" for x in axis["expanded_95_arcsec"]), style="bold")
        console.print(table)
        inside = ", ".join(f"{part} {x:.2f}" for part, x in axis["included_in_scatter"].items())
        console.print(f"in the scatter already, per mounting: {inside}", style="dim", highlight=False)
        console.print(f"Monte Carlo: {axis['monte_carlo']['reason']}", style="dim", highlight=False)
