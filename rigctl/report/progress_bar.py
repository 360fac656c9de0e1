"""Progress of a campaign on a terminal, on stderr."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from rigctl.report.quantities import duration


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
        self._said = False, ""

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
        # The terminal went away; the campaign's own file says whether it goes on.
        except OSError:
            return

    def _show(self, status: Mapping[str, Any]) -> None:
        step, left = str(status["step"]), duration(status["eta_s"])
        if self._console.is_terminal:
            self._bar.update(
                self._task,
                description=step,
                # Nothing is planned yet while a procedure starts: the bar then moves without an end.
                total=status["runs_planned"] or None,
                completed=status["runs_done"],
                state=status["state"],
                left=left,
            )
            return
        waits = status["state"] == "paused"
        # In a log a line per step of the procedure, not one per run; of a pause all there is, which says why.
        where = step if waits else step.split(" / ")[0]
        waited, said = self._said
        # A pause that says less than it did is about to end.
        if waits == waited and (where == said or (waits and said.startswith(where))):
            return
        self._said = waits, where
        how_far = f"{status['runs_done']} of {status['runs_planned']} runs"
        line = f"{how_far}; {where}" if waits else f"{where}, {how_far}, {left} left"
        self._console.print(f"{status['state']}: {line}", highlight=False, soft_wrap=True)
