"""What to measure next, and how an investigation ended, for a terminal of 80 columns; findings come as their JSON."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console

from rigctl.report.quantities import counted, number
from rigctl.report.tables.result_table import ResultTable
from rigctl.report.tables.terminal import print_tables
from rigctl.report.verdicts import Findings, model_name

SHORT = {"theta_deg": "deg", "frequency_hz": "Hz", "amplitude_mm": "mm", "dwell_s": "s", "temperature_c": "C"}


def print_recommendation(found: Findings) -> None:
    """The promise in words, then the runs in their order."""
    console = Console()
    console.print(found["description"], highlight=False, markup=False)
    if found["runs"]:
        print_tables([runs_table(found["runs"])])


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


def runs_table(runs: Sequence[Findings]) -> ResultTable:
    """Settings of runs, one row each, in the order in which to make them."""
    names = list(dict.fromkeys(name for run in runs for name in run))
    rows = [[str(place), *(_shown(run.get(name)) for name in names)] for place, run in enumerate(runs, 1)]
    return ResultTable("Runs, in this order", ["#", *(f"#{SHORT.get(name, name)}" for name in names)], rows)


def _shown(value: object) -> str:
    if value is None:
        return ""
    return number(value, 6) if isinstance(value, int | float) else str(value)
