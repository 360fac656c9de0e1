"""Screen 3: axes, the scatter of vectors, angles, budget, comparison."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.widgets import Static, TabbedContent, TabPane

from rigctl.console.messages import AnalysisAsked
from rigctl.console.widgets.dialogs import OpenDialog
from rigctl.console.widgets.plot import MARKS, Line, Picture, Plot
from rigctl.report.quantities import quantity

Found = Mapping[str, Any]
OF_AXES = ("tab-scatter", "tab-angles", "tab-budget")
NONE_YET = "No result yet: u works it out from the store that is open."


class ResultsPane(Vertical):
    """Results of the store that is open."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("u", "update", "Update"),
        Binding("v", "compare", "Compare with"),
    ]

    def __init__(self) -> None:
        super().__init__(id="results")

    def compose(self) -> ComposeResult:
        """Tabs, each one question."""
        with TabbedContent(id="results-tabs"):
            with TabPane("Axes", id="tab-axes"), VerticalScroll():
                yield Static(NONE_YET, id="axes")
            with TabPane("Scatter", id="tab-scatter"), Horizontal(id="scatter"):
                yield Plot(Picture("vectors about their plane"), id="plane-0")
            with TabPane("Angles", id="tab-angles"), VerticalScroll():
                yield Static(NONE_YET, id="angles")
            with TabPane("Budget", id="tab-budget"), VerticalScroll():
                yield Static(NONE_YET, id="budget")
            with TabPane("Compare", id="tab-compare"), VerticalScroll():
                yield Static("v compares with the runs of another store.", id="compare")

    def clear(self) -> None:
        """Another store is open."""
        for name in ("axes", "angles", "budget"):
            self.query_one(f"#{name}", Static).update(NONE_YET)

    async def show_result(self, found: Found) -> None:
        """The keys of `rigctl result --json`."""
        tabs, has_axes = self.query_one("#results-tabs", TabbedContent), "axes" in found
        tabs.get_tab("tab-axes").label = "Axes" if has_axes else "Result"
        for tab in OF_AXES:
            (tabs.show_tab if has_axes else tabs.hide_tab)(tab)
        if not has_axes:
            self.query_one("#axes", Static).update(_general(found))
            return
        reference = found.get("reference") or {}
        self.query_one("#axes", Static).update(_axes(found, reference))
        self.query_one("#angles", Static).update(_angles(found, reference.get("offset_deg", {})))
        self.query_one("#budget", Static).update(_budget(found.get("budget") or {}))
        await self._show_planes(found.get("planes") or {})

    def show_comparison(self, found: Found) -> None:
        """The keys of `with` in `rigctl compare --json`."""
        self.query_one("#compare", Static).update(_transfer(found))
        self.query_one("#results-tabs", TabbedContent).active = "tab-compare"

    async def _show_planes(self, planes: Mapping[str, Any]) -> None:
        box = self.query_one("#scatter", Horizontal)
        await box.remove_children()
        for place, (name, rows) in enumerate(planes.items()):
            await box.mount(Plot(_plane(name, rows), id=f"plane-{place}"))
        if not planes:
            await box.mount(Plot(Picture("no axis has a plane yet"), id="plane-0"))

    def action_update(self) -> None:
        """Have the result worked out."""
        self.post_message(AnalysisAsked("result"))

    def action_compare(self) -> None:
        """Ask with which store."""

        def go(path: Path | None) -> None:
            if path is not None:
                self.post_message(AnalysisAsked("compare_with", (path,)))

        stores = sorted(Path().glob("*.rig.sqlite"))
        self.app.push_screen(OpenDialog("Compare with which store?", stores), go)


def _table(title: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold", box=None, padding=(0, 1), pad_edge=False)
    for name in columns:
        left = name in {"axis", "axes", "", "contribution", "type", "input", "parameter", "quantity", "here", "there"}
        table.add_column(name, justify="left" if left else "right", no_wrap=True)
    return table


def _axes(found: Found, reference: Found) -> RenderableType:
    table = _table("Sensing axes in the cube's frame", "axis", "x", "y", "z", "std_hc 2σ", "θ_m", "n", "")
    printed = reference.get("axes", {})
    for name, axis in found["axes"].items():
        verdict = "✓ pass" if axis["pass"] else "✗ FAIL"
        numbers = [f"{c:+.6f}" for c in axis["coc"]]
        spread = f"{axis['std_hc_2sigma_arcsec']:.2f}″"
        table.add_row(name, *numbers, spread, f"{axis['theta_m_arcsec']:+.3f}″", str(axis["vectors"]), verdict)
        if name in printed:
            std = reference.get("std_hc_2sigma_arcsec", {}).get(name)
            told = "" if std is None else f"{std:.2f}″"
            table.add_row(" ref", *(f"{c:+.6f}" for c in printed[name]), told, "", "", "", style="dim")
        table.add_row(" ±σ", *(f"{s:.1e}" for s in _sigmas(axis)), "", "", "", "", style="dim")
    limits = ", ".join(sorted({f"{axis['requirement_arcsec']:g}" for axis in found["axes"].values()}))
    notes = [
        *(
            [Text(f"pass: half-cone deviation at 2σ up to {limits} arcsec; n null vectors", style="dim")]
            if limits
            else []
        ),
        *(Text(f"axis {name}: no result: {why}") for name, why in found.get("missing", {}).items()),
    ]
    if reference.get("source"):
        notes.append(Text(f"ref: {reference['source']}", style="dim"))
    nulls = _table("Nulls", "axis", "", "mounting", "θ0 / deg", "σ / arcsec")
    for null in found["nulls"]:
        nulls.add_row(
            null["axis"],
            null["configuration"],
            str(null["mounting"]),
            f"{null['theta0_deg']:+.5f}",
            f"{null['theta0_sigma_arcsec']:.2f}",
        )
    return Group(*([table] if found["axes"] else []), *notes, Text(), nulls)


def _sigmas(axis: Found) -> list[float]:
    return [max(axis["covariance"][i][i], 0.0) ** 0.5 for i in range(3)]


def _angles(found: Found, printed: Found) -> RenderableType:
    table = _table("Angles between axes", "axes", "angle / deg", "|angle − 90| / deg", "σ / deg", "ref")
    for pair, angle in found["angles"].items():
        told = f"{printed[pair]:.2f}" if pair in printed else ""
        table.add_row(pair, f"{angle['deg']:.4f}", f"{angle['offset_deg']:.4f}", f"{angle['sigma_deg']:.4f}", told)
    return table if found["angles"] else Text("One axis has no angles to others.")


def _budget(budgets: Found) -> RenderableType:
    parts: list[RenderableType] = []
    for name, axis in budgets.items():
        table = _table(f"Uncertainty of axis {name} / arcsec", "contribution", "type", "input", "1", "2")
        for row in axis["contributions"]:
            table.add_row(row["name"][:26], row["type"], row["input"][:26], *(f"{x:.3f}" for x in row["arcsec"]))
        table.add_row("combined", "", "", *(f"{x:.3f}" for x in axis["combined_arcsec"]), style="bold")
        table.add_row("expanded (95 %)", "", "", *(f"{x:.3f}" for x in axis["expanded_95_arcsec"]), style="bold")
        parts += [table, Text()]
    return Group(*parts) if parts else Text("No axis, no budget.")


def _general(found: Found) -> RenderableType:
    """Any experiment's result: its numbers, the tables its report has, its remarks."""
    parts: list[RenderableType] = []
    numbers = list(_numbers(found))
    if numbers or not found.get("tables"):
        table = _table("Result", "quantity", "value", "σ", "")
        for row in numbers or _numbers({"": found.get("parameters", {})}):
            table.add_row(*row)
        parts += [table, Text()]
    for each in found.get("tables", ()):
        table = Table(title_justify="left", title_style="bold", box=None, padding=(0, 1), pad_edge=False)
        table.title = Text(each["sentence"])
        for column in each["columns"]:
            table.add_column(Text(column.lstrip("#~")), justify="right" if column.startswith("#") else "left")
        marked = each["marked"] or [False] * len(each["rows"])
        for row, mark in zip(each["rows"], marked, strict=True):
            table.add_row(*map(Text, row), style="bold" if mark else "")
        parts += [table, Text()]
    return Group(*parts, *map(Text, found.get("remarks", ())))


def _numbers(found: Found) -> Iterator[tuple[Text, str, str, str]]:
    """What is directly a value with its sigma, or one level below; tables have the rest."""
    for key, value in found.items():
        inner = value if isinstance(value, Mapping) and "sigma" not in value else {"": value}
        for name, each in inner.items():
            if key != "parameters" and isinstance(each, Mapping) and {"value", "sigma"} <= set(each):
                told = f"{key} {name}".strip(), f"{each['value']:.6g}", f"{each['sigma']:.2g}"
                yield Text(told[0]), *told[1:], str(each.get("unit", ""))


def _transfer(found: Found) -> RenderableType:
    table = Table(
        title="Parameters", title_justify="left", title_style="bold", box=None, padding=(0, 1), pad_edge=False
    )
    table.add_column("parameter", overflow="fold")
    for name in ("here", "there", "unit", "σ apart"):
        table.add_column(name, no_wrap=True, justify="right" if name == "σ apart" else "left")
    for name, pair in found["parameters"].items():
        here, there = (quantity(pair[side]["value"], pair[side]["sigma"]) for side in ("here", "there"))
        apart = pair["sigmas_apart"]
        table.add_row(Text(name), here, there, pair["here"]["unit"], "-" if apart is None else f"{apart:+.1f}")
    return Group(Text(f"with {found['store']}", style="dim"), Text(found["sentence"]), Text(), table)


def _plane(axis: str, rows: list[Found]) -> Picture:
    """Figures 15 to 17: out-of-plane angle by mounting."""
    lines = []
    for place, configuration in enumerate(dict.fromkeys(row["configuration"] for row in rows)):
        own = [row for row in rows if row["configuration"] == configuration]
        x = np.array([float(row["mounting"]) for row in own])
        y = np.array([row["out_of_plane_arcsec"] for row in own])
        lines.append(Line(x, y, configuration, MARKS[place], place))
    sigma, required = rows[0]["sigma_hc_arcsec"], rows[0]["requirement_arcsec"]
    reach = max(2.2 * sigma, *(abs(row["out_of_plane_arcsec"]) * 1.1 for row in rows))
    levels = tuple((n * sigma, told) for n, told in ((2, "+2σ"), (1, "+σ"), (0, "0"), (-1, "−σ"), (-2, "−2σ")))
    levels += ((required, "required"), (-required, "required"))
    title = f"{axis}: out of plane / arcsec"
    return Picture(title, tuple(lines), "mounting", y_range=(-reach, reach), levels=levels)
