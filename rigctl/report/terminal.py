"""Tables and progress for a terminal. Progress goes to stderr, tables to stdout."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.table import Table


class ProgressBar:
    """A bar on a terminal, plain lines elsewhere; a terminal that goes away is no reason to stop."""

    def __init__(self) -> None:
        self._console = Console(stderr=True)
        self._bar = Progress(
            TextColumn("{task.fields[state]}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("runs, {task.fields[left]} left, {task.description}"),
            console=self._console,
        )
        self._task = self._bar.add_task("", total=None, state="", left="?")
        self._last = ""

    def __enter__(self) -> ProgressBar:
        if self._console.is_terminal:
            self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._console.is_terminal:
            self._bar.stop()

    def show(self, status: Mapping[str, Any]) -> None:
        """The status as `rigctl status --json` gives it."""
        try:
            self._show(status)
        except OSError:
            return

    def _show(self, status: Mapping[str, Any]) -> None:
        step, left = str(status["step"]), duration(status["eta_s"])
        if self._console.is_terminal:
            self._bar.update(
                self._task,
                description=step,
                total=status["runs_planned"] or None,
                completed=status["runs_done"],
                state=status["state"],
                left=left,
            )
        elif step.split(" / ")[0] != self._last:
            self._last = step.split(" / ")[0]
            self._console.print(
                f"{status['state']}: {self._last}, {status['runs_done']} of {status['runs_planned']} runs, "
                f"{left} left",
                highlight=False,
                soft_wrap=True,
            )


def duration(seconds: float | None) -> str:
    """Seconds as a person says them."""
    if seconds is None:
        return "?"
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


def repeats_line(repeated: Mapping[str, int]) -> str:
    """How many runs were repeated and why; empty when none was."""
    if not repeated:
        return ""
    why = ", ".join(f"{error} {count}" for error, count in repeated.items())
    return f"{sum(repeated.values())} repeated after a fault ({why})"


def print_status(status: Mapping[str, Any]) -> None:
    """A campaign's status in two lines, and a third when runs were repeated."""
    console = Console()
    console.print(
        f"{status['state']}: {status['runs_done']} of {status['runs_planned']} runs"
        f" ({status['runs_invalid']} invalid), {duration(status['eta_s'])} left",
        highlight=False,
    )
    if status.get("step"):
        console.print(str(status["step"]), highlight=False)
    if line := repeats_line(status.get("runs_repeated", {})):
        console.print(line, highlight=False)


def print_result(result: Mapping[str, Any], reference: Mapping[str, Any]) -> None:
    """Axes and angles, beside the reference values where a campaign file gives some; fits 80 columns."""
    console = Console()
    if result.get("quick_check"):
        _print_quick_check(console, result["quick_check"])
    if result["axes"]:
        _print_axes(console, result["axes"], reference)
    else:
        console.print(_nulls(result["nulls"]))
    if result["angles"]:
        console.print(_angles(result["angles"], reference.get("offset_deg", {})))
    for name, reason in result.get("missing", {}).items():
        console.print(f"axis {name}: no result: {reason}", highlight=False, soft_wrap=True)
    if reference.get("source"):
        console.print(f"ref: {reference['source']}", style="dim", highlight=False)
    if result.get("budget"):
        print_budget(result["budget"])


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


def print_budget(budget: Mapping[str, Any]) -> None:
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
