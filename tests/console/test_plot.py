"""What an operator does with a plot: a cursor on its points, a window that zooms, error bars, and what is chosen."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from textual.app import App, ComposeResult
from textual.events import MouseScrollUp
from textual.pilot import Pilot

from rigctl.console.widgets.braille import dotted, joined, scaled, within
from rigctl.console.widgets.drawing import drawn
from rigctl.console.widgets.plot import Plot
from rigctl.console.widgets.window import Point, Points, Step, Window
from rigctl.report.picture import Line, Picture

NUMBERS = st.floats(-1e6, 1e6, allow_subnormal=False)
FEW = st.lists(st.tuples(st.integers(-4, 4), st.integers(-4, 4)), min_size=1, max_size=30)


def text_of(picture: Picture, width: int = 60, height: int = 16, **looked_at: object) -> list[str]:
    return ["".join(piece for piece, _ in row) for row in drawn(picture, width, height, **looked_at)]  # type: ignore[arg-type]


@given(FEW, st.sampled_from([("left", "right"), ("down", "up")]))
def test_steps_visit_every_mark_once(points: list[tuple[int, int]], ways: tuple[Step, Step]) -> None:
    x, y = (np.array(each, dtype=float) for each in zip(*points, strict=True))
    half = len(x) // 2
    among = Points([Line(x[:half], y[:half], mark="o"), Line(x[half:], y[half:], mark="x"), Line(x, y)])
    window = Window((-5.0, 5.0), (-5.0, 5.0))
    at = among.nearest(window, 0.0, 0.0)
    assert at is not None
    back, forth = ways
    for _ in points:
        at = among.stepped(window, at, back, 10)
    seen = {at}
    for _ in points:
        at = among.stepped(window, at, forth, 10)
        seen.add(at)
    assert len(seen) == len(points)


def test_a_step_along_a_joined_line_is_one_column() -> None:
    x = np.linspace(0.0, 1.0, 60_001)
    among = Points([Line(x, np.sin(x))])
    at = among.stepped(Window((0.0, 1.0), (-1.0, 1.0)), Point(0, 0), "right", 60)
    assert at == Point(0, 1000)
    assert among.stepped(Window((0.0, 1.0), (-1.0, 1.0)), Point(0, 60_000), "right", 60) == Point(0, 60_000)


@given(NUMBERS, NUMBERS, st.floats(1e-3, 1e3), st.floats(0.0, 1.0))
def test_zooming_out_undoes_zooming_in(low: float, about: float, width: float, share: float) -> None:
    window = Window((low, low + width), (about, about + width))
    at = low + share * width, about + share * width
    closer = window.zoomed(0.5, at)
    assert closer.x[1] - closer.x[0] == pytest.approx(0.5 * width, rel=1e-6, abs=1e-8)
    assert closer.x[0] <= at[0] + 1e-9 * abs(at[0])
    assert closer.x[1] >= at[0] - 1e-9 * abs(at[0])
    again = closer.zoomed(2.0, at)
    assert again.x == pytest.approx(window.x, rel=1e-9, abs=1e-8)
    assert again.y == pytest.approx(window.y, rel=1e-9, abs=1e-8)


def test_a_range_without_digits_left_is_not_zoomed_any_more() -> None:
    window = Window((1.0, 1.0 + 1e-13), (0.0, 1.0))
    assert window.zoomed(0.5, (1.0, 0.5)).x == window.x


@given(
    st.lists(st.tuples(st.floats(-2.0, 3.0), st.floats(-2.0, 3.0)), min_size=2, max_size=40),
    st.floats(-1.0, 1.0),
    st.floats(0.1, 2.0),
)
def test_a_part_of_a_line_is_drawn_as_if_all_of_it_were(
    points: list[tuple[float, float]], low: float, width: float
) -> None:
    x, y = (np.array(each) for each in zip(*points, strict=True))
    high = low + width

    def dots(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return dotted(*joined(scaled(x, low, high, 40), scaled(y, -2.0, 3.0, 40)), 20, 10)

    assert np.array_equal(dots(*within(x, y, low, high)), dots(x, y))


def test_the_cursor_tells_values_error_bar_series_and_run() -> None:
    x, y = np.array([1.0, 10.0, 100.0]), np.array([1e-6, 2e-6, 4e-6])
    line = Line(x, y, "null", "o", bars=(0.5 * y, 1.5 * y), labels=("0001", "0002", "0003"))
    picture = Picture("density", (line,), "f / Hz", x_scale="log", y_scale="log")
    text = text_of(picture, cursor=Point(0, 1))
    assert any("10, 2e-06 ± 1e-06  null  0002" in row for row in text)
    # Bars go from end to end: half a decade of three is a sixth of the height.
    middle = next(row for row in range(len(text)) if "o" in text[row][9:] and text[row].index("o", 9) == 34)
    assert [text[middle + step][34] for step in (-1, 1)] == ["│", "│"]


def test_only_the_point_and_its_values_are_reversed() -> None:
    line = Line(np.array([0.0, 1.0, 2.0]), np.array([0.0, 5.0, 1.0]), "", "o")
    rows = drawn(Picture("three", (line,), "n"), 60, 16, cursor=Point(0, 1))
    reversed_text = ["".join(text for text, ink in row if ink.reverse) for row in rows]
    assert [text for text in reversed_text if text] == ["o", " 1, 5 "]


def test_a_bar_that_reaches_below_nothing_ends_at_the_axis() -> None:
    line = Line(
        np.array([1.0, 2.0]), np.array([1.0, 10.0]), "", "o", bars=(np.array([-1.0, 8.0]), np.array([3.0, 12.0]))
    )
    text = text_of(Picture("positive", (line,), "n", y_scale="log"))
    column = next(row.index("o", 9) for row in reversed(text[1:-1]) if "o" in row[9:])
    below = [row[column] for row in text[1:-1]]
    assert below[below.index("o") + 1 :] == ["│"] * (len(below) - below.index("o") - 1)


class Alone(App[None]):
    """A plot with the focus."""

    def __init__(self, picture: Picture) -> None:
        super().__init__()
        self.plot = Plot(picture)
        self.chosen: list[str] = []

    def compose(self) -> ComposeResult:
        yield self.plot

    def on_plot_chosen(self, message: Plot.Chosen) -> None:
        self.chosen.append(message.label)


def looked_at(picture: Picture, look: Callable[[Alone, Pilot[None]], Awaitable[None]]) -> Alone:
    app = Alone(picture)

    async def sit() -> None:
        async with app.run_test(size=(80, 24)) as pilot:
            app.plot.focus()
            await look(app, pilot)

    asyncio.run(sit())
    return app


def scattered() -> Picture:
    x = np.arange(20.0)
    return Picture("residuals", (Line(x, x % 7, "accel", "o", labels=tuple(f"{n:04d}" for n in range(20))),), "angle")


def test_keys_go_to_points_and_choose_them() -> None:
    async def look(app: Alone, pilot: Pilot[None]) -> None:
        await pilot.press("left", "pageup", "enter", "end", "enter", "left", "left", "enter", "home", "enter")

    assert looked_at(scattered(), look).chosen == ["0006", "0019", "0017", "0000"]


def test_what_is_beside_a_zoomed_window_comes_into_sight_with_the_cursor() -> None:
    async def look(app: Alone, pilot: Pilot[None]) -> None:
        await pilot.press("home", *["plus"] * 5)
        window = app.plot.window
        assert window is not None
        assert window.x[1] - window.x[0] < 1.0
        await pilot.press("right", "right")
        moved = app.plot.window
        assert moved is not None
        assert moved.x[0] <= 2.0 <= moved.x[1]
        assert moved.y[0] <= 2.0 <= moved.y[1]
        await pilot.press("shift+right")
        assert app.plot.window is not None
        assert app.plot.window.x[0] > moved.x[0]
        # More data change neither; another plot has its own.
        app.plot.show(scattered())
        assert app.plot.window is not None
        assert app.plot.cursor == Point(0, 2)
        app.plot.show(Picture("residuals: 3.9 after 3 runs", scattered().lines, "angle"))
        assert app.plot.cursor == Point(0, 2)
        await pilot.press("0")
        assert app.plot.window is None
        assert app.plot.cursor is None
        await pilot.press("home", "plus")
        app.plot.show(Picture("spectrum", scattered().lines, "f / Hz"))
        assert app.plot.window is None
        assert app.plot.cursor is None

    looked_at(scattered(), look)


def test_the_mouse_does_the_same() -> None:
    async def look(app: Alone, pilot: Pilot[None]) -> None:
        # The first point stands in the lowest row, near the axis.
        await pilot.click(Plot, offset=(11, 21))
        assert app.plot.cursor == Point(0, 0)
        await pilot.click(Plot, offset=(11, 21), times=2)
        app.plot.action_whole()
        await pilot._post_mouse_events([MouseScrollUp], Plot, (40, 12))
        window = app.plot.window
        assert window is not None
        assert window.x[1] - window.x[0] < 12.0

    assert looked_at(scattered(), look).chosen == ["0000"]


def test_what_is_seen_can_be_dragged() -> None:
    async def look(app: Alone, pilot: Pilot[None]) -> None:
        whole = app.plot._area
        assert whole is not None
        await pilot.mouse_down(Plot, offset=(40, 12))
        await pilot.hover(Plot, offset=(30, 12))
        await pilot.mouse_up(Plot, offset=(30, 12))
        window = app.plot.window
        assert window is not None
        # Ten columns to the left: what was beyond the right edge comes into sight.
        moved = 10.0 / whole.width * (whole.x[1] - whole.x[0])
        assert window.x == pytest.approx((whole.x[0] + moved, whole.x[1] + moved))
        assert window.y == pytest.approx(whole.y)
        await pilot.hover(Plot, offset=(20, 12))
        assert app.plot.window == window

    looked_at(scattered(), look)


def test_a_plot_without_data_takes_its_keys_without_complaint() -> None:
    async def look(app: Alone, pilot: Pilot[None]) -> None:
        await pilot.press("left", "plus", "shift+up", "enter", "0")
        await pilot.click(Plot, offset=(20, 10))

    assert looked_at(Picture("nothing yet"), look).chosen == []
