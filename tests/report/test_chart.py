"""Figures of our own: where values stand, which ticks there are, what can be hovered, and that no words overlap."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from rigctl.report.chart.figure import Figure
from rigctl.report.chart.scale import Scale
from rigctl.report.chart.text import width

SVG = "{http://www.w3.org/2000/svg}"


@pytest.mark.parametrize(
    ("low", "high", "labels", "factor"),
    [
        (0.0, 10.0, ["0", "2", "4", "6", "8", "10"], ""),
        (-0.5, 0.5, ["−0.4", "−0.2", "0.0", "0.2", "0.4"], ""),
        (1.0, 2.2, ["1.00", "1.25", "1.50", "1.75", "2.00"], ""),
        (0.0, 3e-9, ["0", "1", "2", "3"], "×10⁻⁹"),
        (0.0, 2.5e6, ["0.0", "0.5", "1.0", "1.5", "2.0", "2.5"], "×10⁶"),
    ],
)
def test_linear_ticks_are_round_numbers_with_their_factor_apart(
    low: float, high: float, labels: list[str], factor: str
) -> None:
    ticks = Scale().ticks(low, high, 5)
    assert (list(ticks.labels), ticks.factor) == (labels, factor)


@pytest.mark.parametrize(
    ("low", "high", "labels"),
    [
        (1e-3, 1e2, ["10⁻³", "10⁻²", "10⁻¹", "10⁰", "10¹", "10²"]),
        (0.3, 0.9, ["0.3", "0.4", "0.5", "0.6", "0.8"]),
        (0.5, 30.0, ["10⁰", "10¹"]),
    ],
)
def test_logarithmic_ticks_are_decades_or_where_there_are_few_parts_of_them(
    low: float, high: float, labels: list[str]
) -> None:
    assert list(Scale("log").ticks(low, high, 6).labels) == labels


def test_whole_numbers_have_whole_ticks() -> None:
    assert list(Scale(integer=True).ticks(3.5, 4.5, 5).places) == [4.0]
    assert list(Scale(integer=True).ticks(0.5, 30.5, 4).places) == [10.0, 20.0, 30.0]


def test_a_symmetric_logarithm_is_linear_about_zero_and_as_steep_where_the_parts_meet() -> None:
    scale = Scale("symlog", linear_up_to=3.0)
    places = scale.values_of(np.array([-30.0, -3.0, 0.0, 1.5, 3.0, 30.0, 300.0]))
    assert places == pytest.approx([-19 / 9, -10 / 9, 0.0, 5 / 9, 10 / 9, 19 / 9, 28 / 9])


def drawn(figure: Figure, name: str = "f") -> ET.Element:
    return ET.fromstring(figure.svg(name, "a <caption>"))


def test_markers_stand_where_their_values_are_and_say_them() -> None:
    figure = Figure(2.0)
    axes = figure.subplots()
    axes.plot([0.0, 5.0, 10.0], [0.0, 5.0, np.nan], "s", label="<b>measured</b>", titles=[])
    axes.set_xlim(0.0, 10.0)
    axes.set_ylim(0.0, 10.0)
    root = drawn(figure)
    frame = root.find(f".//{SVG}rect[@class='frame']")
    markers = root.findall(f".//{SVG}g[@class='m']/{SVG}path")
    assert frame is not None
    left, top, wide, high = (float(frame.get(key, "")) for key in ("x", "y", "width", "height"))
    places = [tuple(map(float, re.findall(r"[\d.]+", each.get("d", ""))[:2])) for each in markers]
    assert places[0] == pytest.approx((left, top + high), abs=0.02)
    assert places[1] == pytest.approx((left + 0.5 * wide, top + 0.5 * high), abs=0.02)
    assert [each.findtext(f"{SVG}title") for each in markers] == ["<b>measured</b>: 0, 0", "<b>measured</b>: 5, 5"]
    assert root.get("aria-label") == "a <caption>"


def test_what_the_pointer_is_told_of_are_the_limits_of_each_panel() -> None:
    figure = Figure(2.0)
    first, second = figure.subplots(1, 2, sharex=True)
    first.plot([1.0, 100.0], [1.0, 2.0])
    second.plot([10.0, 1000.0], [3.0, 4.0])
    first.set_xscale("log")
    panels = drawn(figure).findall(f"{SVG}g[@class='panel']")
    axes_x = {panel.get("data-x") for panel in panels}
    assert len(axes_x) == 1
    kind, low, high, _ = axes_x.pop().split()  # type: ignore[union-attr]
    assert kind == "log"
    assert (float(low), float(high)) == pytest.approx((10.0**-0.15, 10.0**3.15))


def test_ten_thousand_points_are_a_small_figure_that_covers_the_same() -> None:
    rng = np.random.default_rng(1)
    figure = Figure(2.0)
    axes = figure.subplots()
    y = rng.normal(size=100_000)
    axes.plot(np.arange(y.size), y)
    axes.plot(np.arange(y.size), y, "o")
    text = figure.svg("dense")
    assert len(text) < 1_000_000
    (line,) = re.findall(r'<path d="(M[\d. ]+L[^"]*)" fill="none" stroke="#000000" stroke-width="1"', text)
    heights = [float(each) for each in re.findall(r"[ML][\d.]+ ([\d.]+)", line)]
    markers = np.array(re.findall(r"M([\d.]+) ([\d.]+)h0", text), dtype=float)
    # The highest and the lowest sample are on the line, and to half a dot's size among the dots.
    assert min(heights) == pytest.approx(markers[:, 1].min(), abs=0.51)
    assert max(heights) == pytest.approx(markers[:, 1].max(), abs=0.51)


def test_two_figures_of_a_page_do_not_share_a_clip_path() -> None:
    ids = []
    for name in ("first", "second"):
        figure = Figure(1.0)
        for axes in figure.subplots(2):
            axes.plot([0.0, 1.0], [0.0, 1.0])
        ids += re.findall(r'clipPath id="([^"]*)"', figure.svg(name))
    assert len(ids) == len(set(ids)) == 4


def test_long_names_and_many_words_do_not_overlap() -> None:
    figure = Figure(2.0)
    above, below = figure.subplots(2, sharex=True)
    names = [f"operator number {k}" for k in range(12)]
    for axes in (above, below):
        for k in range(7):
            axes.plot([0.0, 11.0], [0.0, float(k)], label=f"a series with a long name {k}")
        axes.legend()
        axes.set_xticks(range(12), names)
        axes.set_yticks([0.0, 6.0], ["a very long name " * 10, "short"])
    boxes = []
    for text in drawn(figure).iter(f"{SVG}text"):
        x, y, size = (float(text.get(key, "")) for key in ("x", "y", "font-size"))
        wide = 0.8 * width(text.text or "", size)
        left = x - {"end": wide, "middle": wide / 2}.get(text.get("text-anchor", ""), 0.0)
        box = (x - size, y, x, y + wide) if text.get("transform") else (left, y - 0.7 * size, left + wide, y)
        assert box[0] > -1.0
        boxes.append(box)
    for place, (left, top, right, bottom) in enumerate(boxes):
        for other in boxes[place + 1 :]:
            apart = right <= other[0] or other[2] <= left or bottom <= other[1] or other[3] <= top
            assert apart, (boxes[place], other)
