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
        elif step.split(" / ")[0] != self._last:
            # In a log a line per step of the procedure, not one per run.
            self._last = step.split(" / ")[0]
            self._console.print(
                f"{status['state']}: {self._last}, {status['runs_done']} of {status['runs_planned']} runs, "
                f"{left} left",
                highlight=False,
                soft_wrap=True,
            )
