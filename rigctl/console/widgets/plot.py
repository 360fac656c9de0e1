"""A plot in a terminal, with a cursor, and a window that zooms."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from rich.segment import Segment
from rich.style import Style
from textual.binding import Binding, BindingType
from textual.events import Click, MouseDown, MouseMove, MouseScrollDown, MouseScrollUp
from textual.geometry import Region
from textual.message import Message
from textual.strip import Strip
from textual.widget import Widget

from rigctl.console import themes
from rigctl.console.widgets.ink import DARK, LIGHT, NIGHT, REVERSED, Palette, Row, empty, has_point, label_of
from rigctl.report.picture import Picture

if TYPE_CHECKING:  # with numpy, which comes with the first numbers there are
    from rigctl.console.widgets.drawing import Area, Layout
    from rigctl.console.widgets.window import Point, Points, Step, Window

ZOOM, PAN = 0.5, 0.25
"""What is left of a range after zooming in, and the share of it that is moved at once."""


class Plot(Widget, can_focus=True):
    """Shows a `Picture`; given another one it draws the rows that differ.

    With the focus it has a cursor on one of its points, and a window that zooms and moves.
    """

    DEFAULT_CSS = "Plot { height: 1fr; width: 1fr; min-height: 4; }"

    BINDINGS: ClassVar[list[BindingType]] = [
        *(Binding(step, f"step('{step}')", show=False) for step in ("left", "right", "up", "down")),
        *(
            Binding(key, f"step('{step}')", show=False)
            for key, step in (("home", "first"), ("end", "last"), ("pageup", "highest"), ("pagedown", "lowest"))
        ),
        Binding("plus,equals_sign", f"zoom({ZOOM})", show=False),
        Binding("minus", f"zoom({1 / ZOOM})", show=False),
        Binding("0", "whole", show=False),
        Binding("shift+left", f"pan({-PAN}, 0.0)", show=False),
        Binding("shift+right", f"pan({PAN}, 0.0)", show=False),
        Binding("shift+up", f"pan(0.0, {PAN})", show=False),
        Binding("shift+down", f"pan(0.0, {-PAN})", show=False),
        Binding("enter", "choose", show=False),
    ]

    @dataclass
    class Chosen(Message):
        """What the point under the cursor is: one of its line's `labels`."""

        plot: Plot
        label: str

        @property
        def control(self) -> Plot:
            """Where it was chosen."""
            return self.plot

    def __init__(self, picture: Picture, *, id: str | None = None) -> None:  # noqa: A002
        super().__init__(id=id)
        self.picture = picture
        self.window: Window | None = None
        self.cursor: Point | None = None
        self._dragged, self._held_at = False, (0.0, 0.0)
        self._rows: list[Row] = []
        self._strips: list[Strip] = []
        self._drawn_for: tuple[object, ...] = ()

    def show(self, picture: Picture) -> None:
        """Draw another picture; the same one with more data keeps its window and its cursor."""
        former, now = ((each.title.partition(":")[0], each.x_label) for each in (self.picture, picture))
        if former != now or (self.cursor is not None and not has_point(picture, self.cursor)):
            self.window = self.cursor = None
        self.picture = picture
        # Of another size or in other colours no row is as it was; what is hidden may come back at its old size.
        if self._drawn_for != self._looks:
            self._drawn_for = ()
            self.refresh()
            return
        before, self._rows = self._rows, self._draw()
        base = self.rich_style
        changed = [y for y, row in enumerate(self._rows) if row != before[y]]
        for y in changed:
            self._strips[y] = self._strip(self._rows[y], base)
        if changed:
            self.refresh(*(Region(0, y, self.size.width, 1) for y in changed))

    def render_line(self, y: int) -> Strip:
        """A line of the picture at the size the widget has."""
        if self._drawn_for != self._looks:
            self._drawn_for = self._looks
            self._rows = self._draw()
            base = self.rich_style
            self._strips = [self._strip(row, base) for row in self._rows]
        return self._strips[y] if y < len(self._strips) else Strip.blank(self.size.width, self.rich_style)

    def _draw(self) -> list[Row]:
        rows = self._drawn() if self.picture.lines else empty(self.picture, *self.size)
        if self.has_focus and rows and rows[0]:
            (title, ink), *legend = rows[0]
            rows[0] = ((title, ink + REVERSED), *legend)
        return rows

    def _drawn(self) -> list[Row]:
        from rigctl.console.widgets.drawing import drawn

        return drawn(self.picture, *self.size, self._palette, self.window, self.cursor)

    # What the operator looks at

    def action_step(self, step: Step) -> None:
        """The cursor to another point; to the middle of what is seen where it was on none."""
        area = self._area
        if area is None:
            return
        from rigctl.console.widgets.window import ENDS

        points = self._points
        seen = area.seen
        begun, self.cursor = self.cursor, self.cursor or points.nearest(seen, *seen.middle)
        # The first step only shows it, unless it goes to an end.
        if self.cursor is not None and (begun is not None or step in ENDS):
            self.cursor = points.stepped(seen, self.cursor, step, area.width)
        self._follow_cursor(seen)

    def action_zoom(self, by: float) -> None:
        """Closer to the cursor, or to the middle of what is seen."""
        if (area := self._area) is not None:
            seen = area.seen
            self._look(seen.zoomed(by, self._at_cursor() or seen.middle))

    def action_pan(self, across: float, up: float) -> None:
        """What is beside."""
        if (area := self._area) is not None:
            self._look(area.seen.moved(across, up))

    def action_whole(self) -> None:
        """All there is, without a cursor."""
        self.cursor = None
        self._look(None)

    def action_choose(self) -> None:
        """Tell what the point under the cursor is."""
        if self.cursor is not None and (label := label_of(self.picture, self.cursor)):
            self.post_message(self.Chosen(self, label))

    def on_mouse_down(self, event: MouseDown) -> None:
        """What is seen may be dragged from here, beyond the plot too."""
        self._dragged, self._held_at = False, (event.screen_x, event.screen_y)
        self.capture_mouse()

    def on_mouse_move(self, event: MouseMove) -> None:
        """What is seen goes with the mouse whose button is held."""
        here, area = (event.screen_x, event.screen_y), self._area
        if self.app.mouse_captured is self and here != self._held_at and area is not None:
            (x, y), self._held_at = self._held_at, here
            self._dragged = True
            self.action_pan((x - here[0]) / area.width, (here[1] - y) / area.height)

    def on_mouse_up(self) -> None:
        """The button is let go."""
        self.release_mouse()

    def on_click(self, event: Click) -> None:
        """The cursor to the point that is nearest; a second click chooses it."""
        if self._dragged:
            return
        if (at := self._at_mouse(event.x, event.y)) is None:
            return
        area, x, y = at
        seen = area.seen
        self.cursor = self._points.nearest(seen, x, y)
        self._follow_cursor(seen)
        if event.chain > 1:
            self.action_choose()

    def on_mouse_scroll_up(self, event: MouseScrollUp) -> None:
        """Closer to what the mouse is on."""
        self._zoom_at_mouse(event, ZOOM)

    def on_mouse_scroll_down(self, event: MouseScrollDown) -> None:
        """And away from it."""
        self._zoom_at_mouse(event, 1 / ZOOM)

    def _zoom_at_mouse(self, event: MouseScrollUp | MouseScrollDown, by: float) -> None:
        if (at := self._at_mouse(event.x, event.y)) is not None:
            event.stop()
            area, x, y = at
            self._look(area.seen.zoomed(by, (x, y)))

    def _at_mouse(self, column: int, row: int) -> tuple[Area, float, float] | None:
        if (laid := self._laid_out) is None:
            return None
        area = laid.area
        across, up = column - laid.margin - 1, area.height - 1 - (row - len(laid.heading))
        if not (0 <= across < area.width and 0 <= up < area.height):
            return None
        x = area.x[0] + across / max(area.width - 1, 1) * (area.x[1] - area.x[0])
        return area, x, area.y[0] + up / max(area.height - 1, 1) * (area.y[1] - area.y[0])

    def _at_cursor(self) -> tuple[float, float] | None:
        if self.cursor is None:
            return None
        line = self._points.lines[self.cursor.line]
        return float(line.x[self.cursor.place]), float(line.y[self.cursor.place])

    def _follow_cursor(self, seen: Window) -> None:
        if (at := self._at_cursor()) is not None:
            there = seen.showing(*at)
            self._look(self.window if there == seen else there)

    def _look(self, window: Window | None) -> None:
        self.window = window
        self.show(self.picture)

    @property
    def _area(self) -> Area | None:
        laid = self._laid_out
        return None if laid is None else laid.area

    @property
    def _laid_out(self) -> Layout | None:
        if not self.picture.lines:
            return None
        from rigctl.console.widgets.drawing import laid_out

        return laid_out(self.picture, *self.size, self._palette, self.window)

    @property
    def _points(self) -> Points:
        from rigctl.console.widgets.drawing import on_its_scales
        from rigctl.console.widgets.window import Points

        return Points(on_its_scales(self.picture).lines)

    @property
    def _looks(self) -> tuple[object, ...]:
        return self.size, self.app.theme, self.has_focus

    @property
    def _palette(self) -> Palette:
        theme = self.app.current_theme
        return NIGHT if theme.name == themes.NIGHT.name else DARK if theme.dark else LIGHT

    def _strip(self, row: Row, base: Style) -> Strip:
        return Strip([Segment(text, base + ink) for text, ink in row]).adjust_cell_length(self.size.width, base)
