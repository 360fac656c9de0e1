"""The tab that shows how far a campaign is: its steps, and what its runs tell as they come."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.text import Text
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.widgets import ProgressBar, Static, Tree
from textual.widgets.tree import TreeNode

from rigctl.console.store_view import StoreView
from rigctl.console.widgets.pages import Page
from rigctl.console.widgets.plot import Plot
from rigctl.report.picture import Picture
from rigctl.report.quantities import age

if TYPE_CHECKING:
    from rigctl.campaign.recording import RunRecord
    from rigctl.console.vitals import Vitals

STEPS_S = 1.0
"""The tree of steps is drawn anew at most so often."""

MOST_PLOTS, PLOT_ROWS = 3, 7
"""With fewer rows a plot shows nothing."""

STATES = {"running": "▶", "paused": "‖", "done": "✓", "aborted": "■", "interrupted": "✗"}


class ProgressPage(Page):
    """A line, a bar, the steps, and as many plots as there is room for."""

    def __init__(self) -> None:
        super().__init__("Progress", id="tab-progress")
        self._view: StoreView | None = None
        self._pictures: Sequence[Picture] = ()
        self._tree_of: tuple[object, ...] = ()
        self._steps_s = 0.0
        self._steps_behind = False
        self._vitals: Vitals | None = None
        self._told = ""
        self._line = Text()

    def compose(self) -> ComposeResult:
        """From top to bottom."""
        yield Static(id="progress-line")
        yield ProgressBar(id="progress", show_eta=False)
        with Horizontal(id="progress-body"):
            yield Tree("steps", id="steps")
            with Vertical(id="watched"):
                yield from (Plot(Picture("")) for _ in range(MOST_PLOTS))

    def on_mount(self) -> None:
        """No root line: the steps are the tree."""
        tree = self.query_one(Tree)
        tree.show_root = False
        tree.guide_depth = 2
        self.show_file(None)

    def show_file(self, file: Path | None) -> None:
        """Say what can be done with a campaign file that is open, while no campaign is watched."""
        if self._view is not None:
            return
        # The path last: it may be too long for the line.
        can = f"s starts, d tries {file}" if file else "o opens a campaign file or a store"
        self._say(Text(f"No campaign is watched. {can}"), 0, 100)

    def _say(self, line: Text, done: int, total: int) -> None:
        line.no_wrap, line.overflow = True, "ellipsis"
        self.query_one("#progress-line", Static).update(line)
        self.query_one(ProgressBar).update(total=total, progress=done)

    def show_store(self, view: StoreView, *, on_screen: bool) -> None:
        """The campaign as its store tells."""
        if self._view is None or view.path != self._view.path:
            self.show_pictures(())
        self._view = view
        status = view.status
        done, planned = int(status["runs_done"]), int(status["runs_planned"])
        repeated = sum(status.get("runs_repeated", {}).values())
        self._told = f"{done} of {planned} runs, {status['runs_invalid']} invalid"
        self._told += f", {repeated} repeated" if repeated else ""
        self.query_one(ProgressBar).update(total=max(planned, 1), progress=done)
        self._tell()
        self._steps_behind = True
        # The last state is shown in any case: no other comes after it.
        if on_screen or not view.alive:
            self._keep_steps_up(view)

    def show_vitals(self, vitals: Vitals | None) -> None:
        """How long ago the campaign gave a sign of life, and recorded anything."""
        self._vitals = vitals
        if self._view is not None:
            self._tell()
            # What came too soon after the last drawing may be the last that comes for long, as in a pause.
            self._keep_steps_up(self._view)

    def _keep_steps_up(self, view: StoreView) -> None:
        if self._steps_behind and (time.monotonic() - self._steps_s > STEPS_S or not view.alive):
            self._steps_s, self._steps_behind = time.monotonic(), False
            self._show_steps(view)

    def _tell(self) -> None:
        """What the store says, each with its age: nothing here goes on by itself."""
        view = self._view
        if view is None:
            return
        vitals = self._vitals if self._vitals is not None and self._vitals.path == view.path else None
        stalled = vitals is not None and vitals.stalled
        line = Text()
        line.append("✗ STALLED " if stalled else f"{STATES.get(view.state, '?')} {view.state} ", style="bold")
        line.append(f" {self._told}")
        if view.alive:
            from rigctl.report.time_left import time_left  # no campaign is watched before the first paint

            line.append(", time left unknown" if stalled else f", {time_left(view.status)}")
        line.append(f"  {view.status.get('step', '')}", style="dim")
        if vitals is not None:
            line.append(f"\n{_signs(vitals, view.run_ended_s)}", style="dim")
        if line != self._line:
            self._line = line
            self.query_one("#progress-line", Static).update(line)

    @property
    def chosen(self) -> RunRecord | None:
        """The run under the tree's cursor."""
        node = self.query_one(Tree).cursor_node
        return None if node is None else node.data

    def show_pictures(self, pictures: Sequence[Picture]) -> None:
        """What the runs tell, as last worked out, the most telling first."""
        self._pictures = pictures
        self.query_one("#progress-body").set_class(not pictures, "no-pictures")
        room = max(1, self.query_one("#progress-body").size.height // PLOT_ROWS)
        for place, plot in enumerate(self.query(Plot)):
            plot.display = place < min(room, len(pictures))
            if plot.display:
                plot.show(pictures[place])

    def on_resize(self) -> None:
        """Another number of plots has room."""
        self.show_pictures(self._pictures)

    def _show_steps(self, view: StoreView) -> None:
        invalid = [run.run_id for run in view.runs if not run.valid]
        shape = (view.path, len(view.runs), invalid, view.state, view.status.get("step"))
        if shape == self._tree_of:
            return
        self._tree_of = shape
        tree = self.query_one(Tree)
        chosen = self.chosen
        tree.clear()
        for run in view.runs:
            if "mounting" not in run.conditions:  # nothing to gather runs under
                tree.root.add_leaf(f"{'✓' if run.valid else '✗'} {run.run_id} {run.key}", run)
        running = view.state in {"running", "paused"}
        groups = _groups(view.runs)
        for place, (outer, mountings) in enumerate(groups.items()):
            _add_group(
                tree.root,
                outer,
                mountings,
                running=running,
                ended=view.state == "done",
                last=place == len(groups) - 1,
            )
        if running:
            tree.root.add_leaf(f"▶ now: {view.status.get('step') or 'preparing'}")
        # Who has chosen a run stays with it; else the newest is in sight.
        if chosen is None or not _choose(tree, chosen.run_id):
            tree.scroll_end(animate=False)


def _choose(tree: Tree[Any], run_id: str) -> bool:
    """Put the cursor on a run again; False where it is not shown."""
    nodes = list(tree.root.children)
    for node in nodes:
        if node.data is not None and node.data.run_id == run_id:
            parent = node.parent
            while parent is not None:
                parent.expand()
                parent = parent.parent
            # Its line is known once the tree is drawn.
            tree.call_after_refresh(tree.move_cursor, node)
            return True
        nodes += node.children
    return False


def _groups(runs: Sequence[RunRecord]) -> dict[str, dict[str, list[RunRecord]]]:
    """Runs by axis and configuration, then by mounting."""
    groups: dict[str, dict[str, list[RunRecord]]] = {}
    for run in runs:
        given = run.conditions
        if "mounting" in given:
            outer = f"{given.get('axis', '?')} {given.get('configuration', '')}".strip()
            groups.setdefault(outer, {}).setdefault(f"mounting {given['mounting']}", []).append(run)
    return groups


def _add_group(
    root: TreeNode[Any],
    name: str,
    mountings: Mapping[str, list[RunRecord]],
    *,
    running: bool,
    ended: bool,
    last: bool,
) -> None:
    count = sum(map(len, mountings.values()))
    # Whether a step is finished only its procedure knows: a tick says that the campaign is done, nothing less.
    node = root.add(f"{_sign(running and last, ended)} {name}: {count} runs", expand=last)
    for place, (mounting, runs) in enumerate(mountings.items()):
        now = running and last and place == len(mountings) - 1
        invalid = sum(not run.valid for run in runs)
        label = f"{_sign(now, ended)} {mounting}: {len(runs)}{f', {invalid} invalid' if invalid else ''}"
        leaf = node.add(label, expand=now)
        for run in runs if now or not running else ():  # a night has too many to draw them all each time
            leaf.add_leaf(_run_label(run), run)


def _sign(now: bool, ended: bool) -> str:
    return "▶" if now else "✓" if ended else "·"


def _run_label(run: RunRecord) -> str:
    given = run.conditions
    angle, frequency = given.get("theta_deg"), given.get("frequency_hz")
    label = f"{'✓' if run.valid else '✗'} {run.run_id}"
    if isinstance(angle, int | float):
        label += f" {angle:+.4f} deg"
    if isinstance(frequency, int | float):
        label += f" {frequency:.2g} Hz"
    return label


def _signs(vitals: Vitals, run_ended_s: float) -> str:
    beat_s, written_s = vitals.beat_age_s(), vitals.written_age_s()
    if beat_s is None:
        # When its file was written last says nothing: fits and marks come into it long after its campaign.
        ended = (
            "no run has ended"
            if math.isnan(run_ended_s)
            else f"last run ended {age(max(time.monotonic() - run_ended_s, 0.0))} ago"
        )
        return f"no process; {ended}"
    recorded = f"last recorded {age(written_s)} ago" if written_s is not None else "nothing recorded"
    return f"heartbeat {age(beat_s)} ago, {recorded}"
