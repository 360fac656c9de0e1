"""Screen 1: the instruments, jog and home, strip charts and spectrum."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from typing import ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.widgets import DataTable, Static

from rigctl.console.messages import MotionAsked, Noted, ReconnectAsked
from rigctl.console.readings import InstrumentView, Limits, Strip, recorded_instruments
from rigctl.console.screens.rig_charts import Charts
from rigctl.console.store_view import StoreView
from rigctl.console.widgets.dialogs import TextDialog
from rigctl.core.numbers import decimal

COLUMNS = ("instrument", "state", "value", "age", "identity")
MARKS = {"ready": "●", "moving": "▶", "homing": "▶", "stopped": "■", "lost": "✗", "silent": "?", "connecting": "…"}
STALE_S = 3.0

NUMBERS_S = 0.5
"""Numbers that change faster cannot be read, and a table is dear to draw; a change of state is shown at once."""


class RigPane(Vertical):
    """Instruments on top, charts below."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("m", "move", "Move"),
        Binding("h", "home", "Home"),
        Binding("left_square_bracket", "jog(-1)", "Jog-", key_display="["),
        Binding("right_square_bracket", "jog(1)", "Jog+", key_display="]"),
        Binding("j", "step", "Step"),
        Binding("c", "reconnect", "Connect"),
    ]

    def __init__(self, jog_step: float) -> None:
        super().__init__(id="rig")
        self.jog_step = jog_step
        self.opening = ""
        self._views: dict[str, InstrumentView] = {}
        self._rows: dict[str, tuple[str, ...]] = {}
        self._numbers_s = 0.0
        self._detail = Text()

    def compose(self) -> ComposeResult:
        """Table, line of details, charts."""
        yield DataTable(id="instruments", cursor_type="row", zebra_stripes=False)
        yield Static(id="detail")
        yield Charts()

    def on_mount(self) -> None:
        """Columns once, rows as instruments come."""
        table = self.query_one(DataTable)
        # So that 80 columns show all but the end of an identity.
        for name, width in zip(COLUMNS, (13, 12, 23, 6, None), strict=True):
            table.add_column(name, key=name, width=width)

    def show_bench(self, views: Sequence[InstrumentView], strips: Mapping[str, Strip]) -> None:
        """The rig this console holds."""
        self._show_instruments(views)
        self.query_one(Charts).show_bench(strips)

    def show_store(self, view: StoreView) -> None:
        """The rig as the campaign that holds it tells."""
        self._show_instruments(recorded_instruments(view))
        self.query_one(Charts).show_store(view)

    def _show_instruments(self, views: Sequence[InstrumentView]) -> None:
        table = self.query_one(DataTable)
        rows = {view.name: _row(view) for view in views}
        # Rows are written anew only where instruments came or went; otherwise the cells that differ.
        if list(self._rows) != list(rows):
            table.clear()
            for name, row in rows.items():
                table.add_row(*row, key=name)
        elif time.monotonic() - self._numbers_s > NUMBERS_S or _states(self._rows) != _states(rows):
            self._numbers_s = time.monotonic()
            for name, row in rows.items():
                for column, before, cell in zip(COLUMNS, self._rows[name], row, strict=True):
                    if cell != before:
                        table.update_cell(name, column, cell)
        else:
            rows = self._rows
        self._views, self._rows = {view.name: view for view in views}, rows
        self._show_detail()

    def _show_detail(self) -> None:
        view = self._chosen()
        if view is None:
            line = f"… opening {self.opening}" if self.opening else "No rig is open: o opens a rig file or a store."
            self._say(Text(line))
            return
        limits = f"  limits {view.limits}  jog step {self.jog_step:g} {view.limits.unit}" if view.limits else ""
        identity = f"  {view.identity}" if view.identity else ""
        text = Text(f"{view.name}: {view.role}, {view.driver}, {view.address}{identity}{limits}")
        if view.error:
            text = Text(f"✗ {view.error}", style="bold", no_wrap=False)
        self._say(text)

    def _say(self, detail: Text) -> None:
        # A widget is drawn anew even when told the same.
        if self._detail != detail:
            self._detail = detail
            self.query_one("#detail", Static).update(detail)

    def show_opening(self, rig: str) -> None:
        """A rig is being opened, which may take a while; "": it is not any more."""
        self.opening = rig
        self._show_detail()

    def on_data_table_row_highlighted(self) -> None:
        """Another instrument's details."""
        self._show_detail()

    def _chosen(self) -> InstrumentView | None:
        table = self.query_one(DataTable)
        names = list(self._views)
        return self._views[names[table.cursor_row]] if 0 <= table.cursor_row < len(names) else None

    def _stage(self) -> tuple[InstrumentView, Limits] | None:
        view = self._chosen()
        if view is None or view.limits is None:
            self.post_message(Noted("choose a stage in the table first: ↑ ↓", "warning"))
            return None
        return view, view.limits

    def action_move(self) -> None:
        """Ask where to, then move."""
        if (chosen := self._stage()) is None:
            return
        view, limits = chosen
        about = f"now {_values_text(view)}; limits {limits}"
        TextDialog(f"Move {view.name}", about, "", limits.refusal_of).ask(
            self.app, lambda text: self.post_message(MotionAsked(view.name, "move", (decimal(text.strip()),)))
        )

    def action_home(self) -> None:
        """Home the stage that is chosen."""
        if (chosen := self._stage()) is not None:
            self.post_message(MotionAsked(chosen[0].name, "home"))

    def action_jog(self, direction: int) -> None:
        """One step from where the stage is; refused where it would leave the limits."""
        if (chosen := self._stage()) is not None:
            self.post_message(MotionAsked(chosen[0].name, "jog", (direction * self.jog_step,)))

    def action_step(self) -> None:
        """Another size of the jog's steps."""

        def keep(text: str) -> None:
            self.jog_step = decimal(text.strip())

        TextDialog("Jog step", "deg or mm per step", f"{self.jog_step:g}", _no_step).ask(self.app, keep)

    def action_reconnect(self) -> None:
        """Try what does not answer again."""
        self.post_message(ReconnectAsked())


def _no_step(text: str) -> str:
    try:
        return "" if 0.0 < decimal(text.strip()) <= 90.0 else "a step is more than 0 and at most 90"
    except ValueError:
        return f"'{text}' is not a number"


def _row(view: InstrumentView) -> tuple[str, ...]:
    now_s = time.monotonic()
    age_s = max((now_s - each.taken_s for each in view.values), default=math.nan)
    return (
        view.name,
        f"{MARKS.get(view.state, ' ')} {view.state}",
        _values_text(view),
        _age_told(age_s),
        view.identity,
    )


def _age_told(age_s: float) -> str:
    if math.isnan(age_s):
        return ""
    if age_s < STALE_S:  # while it is fresh, its age is not a number to be read ten times a second
        return "< 1 s" if age_s < 1.0 else f"{age_s:.0f} s"
    return f"{min(age_s, 999):.0f} s!"


def _states(rows: Mapping[str, tuple[str, ...]]) -> list[str]:
    return [row[1] for row in rows.values()]


def _values_text(view: InstrumentView) -> str:
    if not view.values:
        return "-"
    digits = 4 if view.values[0].unit in {"deg", "mm", "V"} else 2
    if len(view.values) > 1:
        digits = 3
    values = (f"{each.value:.{digits}f}" if math.isfinite(each.value) else "--" for each in view.values)
    return f"{' '.join(values)} {view.values[0].unit}"
