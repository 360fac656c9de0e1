"""What to measure next, and how an investigation ended, for a terminal of 80 columns; findings come as their JSON."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table
from rich.text import Text

from rigctl.report.quantities import counted, number
from rigctl.report.verdicts import Findings, model_name

SHORT = {"theta_deg": "deg", "frequency_hz": "Hz", "amplitude_mm": "mm", "dwell_s": "s", "temperature_c": "C"}


def print_recommendation(found: Findings) -> None:
    """The promise in words, then the runs in their order."""
    console = Console()
    console.print(found["description"], highlight=False, markup=False)
    if found["runs"]:
        console.print(runs_table(found["runs"]))


def print_outcome(found: Findings, store: str) -> None:
    """How an investigation ended."""
    console = Console()
    model, added = found["model"], found["added"]
    saved = f"{counted(found['runs'], 'run')}; a full scan has {found['full_scan_runs']}"
    lines = [
        f"Verdict: {found['verdict']} after {saved}.",
        f"Added: {', '.join(added)}." if added else "Nothing was added.",
        f"Model version {model['version']}: {model_name(model['effects'])}.",
    ]
    if found["remains"]:
        lines.append(f"What remains: {found['remains']}.")
    lines.append(f"See `rigctl fit {store}` and `rigctl model history {store}`.")
    console.print("\n".join(lines), highlight=False, markup=False)


def runs_table(runs: Sequence[Findings]) -> Table:
    """Settings of runs, one row each, in the order in which to make them."""
    names = list(dict.fromkeys(name for run in runs for name in run))
    table = Table(title="Runs, in this order", title_justify="left", padding=(0, 1))
    for name in ("", *names):
        table.add_column(SHORT.get(name, name), justify="right", overflow="fold")
    for place, run in enumerate(runs, 1):
        cells = [str(place), *(_shown(run.get(name)) for name in names)]
        table.add_row(*map(Text, cells))
    return table


def _shown(value: object) -> str:
    if value is None:
        return ""
    return number(value, 6) if isinstance(value, int | float) else str(value)
