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
from textual.widget import Widget
from textual.widgets import DataTable, Static

from rigctl.console.messages import MotionAsked, Noted, ReconnectAsked
from rigctl.console.readings import InstrumentView, Limits, Strip, Value, recorded_instruments
from rigctl.console.screens.rig_charts import Charts
from rigctl.console.store_view import StoreView
from rigctl.console.widgets.dialogs import TextDialog
from rigctl.core.numbers import decimal
from rigctl.report.quantities import age

COLUMNS = ("instrument", "state", "quantity", "value", "age", "identity")
MARKS = {"ready": "●", "moving": "▶", "homing": "▶", "stopped": "■", "lost": "✗", "silent": "?", "connecting": "…"}
STALE_S = 3.0

NUMBERS_S = 0.5
"""Numbers that change faster cannot be read, and a table is dear to draw; a change of state is shown at once."""

BEHIND_S = 1.0
"""Behind a dialog each change has the whole terminal drawn and dimmed anew, half a core at ten a second."""


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
        self._numbers_s = self._charted_s = 0.0
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
        for name, width in zip(COLUMNS, (13, 12, 11, 14, 7, None), strict=True):
            table.add_column(name, key=name, width=width)

    def show_bench(self, views: Sequence[InstrumentView], strips: Mapping[str, Strip]) -> None:
        """The rig this console holds."""
        self._show_instruments(views)
        now_s = time.monotonic()
        if self.screen.is_active or now_s - self._charted_s >= BEHIND_S:
            self._charted_s = now_s
            self.query_one(Charts).show_bench(strips)

    def show_store(self, view: StoreView) -> None:
        """The rig as the campaign that holds it tells."""
        self._show_instruments(recorded_instruments(view))
        self.query_one(Charts).show_store(view)

    def show_ages(self, view: StoreView) -> None:
        """The same again: values grow older where nothing comes."""
        self._show_instruments(recorded_instruments(view))

    def rest(self) -> Widget:
        """Where the focus is while nothing else is asked for."""
        return self.query_one(DataTable)

    def _show_instruments(self, views: Sequence[InstrumentView]) -> None:
        table = self.query_one(DataTable)
        rows = {key: row for view in views for key, row in _rows(view)}
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
        keys = list(self._rows)
        if not 0 <= table.cursor_row < len(keys):
            return None
        return self._views.get(keys[table.cursor_row].partition(" ")[0])

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
        about = f"now {_value_text(view.values[0]) if view.values else 'unknown'}; limits {limits}"
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


def _rows(view: InstrumentView) -> list[tuple[str, tuple[str, ...]]]:
    """A row for each value, which has an age of its own; the instrument stands in the first."""
    head = (view.name, f"{MARKS.get(view.state, ' ')} {view.state}")
    if not view.values:
        return [(f"{view.name} ", (*head, "", "-", "", view.identity))]
    now_s = time.monotonic()
    return [
        (
            f"{view.name} {value.label}",
            (
                *(head if place == 0 else ("", "")),
                value.label,
                _value_text(value),
                _age_told(now_s - value.taken_s),
                view.identity if place == 0 else "",
            ),
        )
        for place, value in enumerate(view.values)
    ]


def _age_told(age_s: float) -> str:
    # What is not fresh is marked: a number that stands still looks like one that is steady.
    return f"{age(age_s)}!" if age_s > STALE_S else age(age_s)


def _states(rows: Mapping[str, tuple[str, ...]]) -> list[str]:
    return [row[1] for row in rows.values()]


def _value_text(value: Value) -> str:
    digits = 4 if value.unit in {"deg", "mm", "V"} else 2
    return f"{value.value:.{digits}f} {value.unit}" if math.isfinite(value.value) else "--"
