"""The charts of screen 1: strips of the last values, and the spectrum of the accelerometer."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rich.text import Text
from textual.app import ComposeResult
from textual.containers import Grid
from textual.widgets import Static

from rigctl.console.readings import Strip, gain_of, toml_of
from rigctl.console.store_view import StoreView
from rigctl.console.widgets.plot import Plot
from rigctl.report.picture import Line, Picture

if TYPE_CHECKING:  # numpy comes with the first numbers there are
    from rigctl.campaign.recording import ChannelInfo
    from rigctl.core.arrays import FloatArray

CHARTS = ("accelerometer", "lasers", "stage", "angle")
OF_KIND = {"accelerometer": "accelerometer", "displacement": "lasers", "position": "stage", "angle": "angle"}
"""Which chart shows a channel of a recording; those of other kinds take charts that would be empty."""

# Around the drive's frequencies, 0.3 to 0.6 Hz.
NOISE_BAND_HZ = (0.2, 2.0)


class Charts(Grid):
    """Four strips, a spectrum, and the level of the noise in words."""

    def __init__(self) -> None:
        super().__init__(id="charts")
        self._noise = Text()

    def compose(self) -> ComposeResult:
        """One after the other."""
        for name in CHARTS:
            yield Plot(Picture(name), id=f"chart-{name}")
        yield Plot(Picture("spectrum"), id="chart-spectrum")
        yield Static(id="noise")

    def show_bench(self, strips: Mapping[str, Strip]) -> None:
        """The rig this console holds."""
        lasers = [
            strip for name, strip in strips.items() if name not in {"angle", "position", "voltage", "temperature"}
        ]
        self._chart("accelerometer", "V", [_line(strips.get("voltage"))])
        self._chart("lasers", "mm", [_line(strip, _short(strip.name), i) for i, strip in enumerate(lasers)])
        self._chart("stage", "mm", [_line(strips.get("position"))])
        self._chart("angle", "deg", [_line(strips.get("angle"))])
        voltage = strips.get("voltage")
        if voltage is not None and len(voltage.values) > 32:
            from rigctl.analysis.density import amplitude_density

            span_s = float(voltage.ago_s[-1] - voltage.ago_s[0])
            # In volts: without a campaign nobody has said which sensor this is, nor what is required.
            self._show_spectrum(
                *amplitude_density(voltage.values, (len(voltage.values) - 1) / max(span_s, 1e-3)), 1.0, "V", None
            )

    def show_store(self, view: StoreView) -> None:
        """The rig as the campaign that holds it tells."""
        t_s = view.samples.get("t_s")

        def line(column: str, name: str, colour: int) -> Line | None:
            values = view.samples.get(column)
            if values is None or t_s is None or not len(values):
                return None
            shown = min(len(values), len(t_s))  # of a run that is being recorded one may be longer
            return Line(t_s[-shown:], values[-shown:], name, colour=colour)

        x_label = f"run {view.run_id}, t / s"
        for chart, (title, columns) in zip(CHARTS, charts_of(view.channels), strict=True):
            names = [_short(column) if len(columns) > 1 or title == "lasers" else "" for column in columns]
            unit = view.channels[columns[0]].unit if columns else ""
            lines = [line(column, name, i) for i, (column, name) in enumerate(zip(columns, names, strict=True))]
            self._chart(chart, unit, lines, x_label, title)
        turns = [run for run in view.runs[-200:] if "theta_deg" in run.conditions]
        if turns:
            import numpy as np

            angles = np.array([float(run.conditions["theta_deg"]) for run in turns])
            # Only the last runs are drawn: numbered so that the latest has the number of them all.
            numbers = np.arange(len(view.runs) - len(turns) + 1, len(view.runs) + 1, dtype=float)
            self._chart("angle", "deg", [Line(numbers, angles, mark="o")], "run")
        self._show_run_spectrum(view)

    def _show_run_spectrum(self, view: StoreView) -> None:
        sensors = [name for name, channel in view.channels.items() if channel.kind == "accelerometer"]
        values, t_s = view.samples.get(sensors[0] if sensors else ""), view.samples.get("t_s")
        if values is None or t_s is None or len(values) < 64 or not view.runs:
            return
        from rigctl.analysis.density import amplitude_density

        unit = view.channels[sensors[0]].unit
        gain = gain_of(view)
        target = toml_of(view.campaign_toml).get("targets", {}).get("noise_m_s2_rthz")
        rate_hz = (len(t_s) - 1) / float(t_s[-1] - t_s[0])
        self._show_spectrum(*amplitude_density(values, rate_hz), gain, "m/s²" if gain != 1.0 else unit, target)

    def _chart(
        self, name: str, unit: str, lines: Sequence[Line | None], x_label: str = "t / s", title: str = ""
    ) -> None:
        shown = tuple(line for line in lines if line is not None)
        heading = f"{title or name} / {unit}" if unit else title or name
        self.query_one(f"#chart-{name}", Plot).show(Picture(heading, shown, x_label))

    def _show_spectrum(
        self, frequency_hz: FloatArray, density: FloatArray, gain: float, unit: str, target: float | None
    ) -> None:
        from rigctl.analysis.density import median_density

        heights = density / gain
        levels = ((target, "required"),) if target else ()
        shown = [*heights[heights > 0.0].tolist(), *(level for level, _ in levels)]
        y_range = (min(shown), max(shown)) if target and len(shown) > 1 else None
        line = Line(frequency_hz, heights)
        title = f"spectrum / {unit}/√Hz"
        picture = Picture(title, (line,), "f / Hz", y_range=y_range, levels=levels, x_scale="log", y_scale="log")
        self.query_one("#chart-spectrum", Plot).show(picture)
        noise = _noise_text(median_density(frequency_hz, density / gain, *NOISE_BAND_HZ), unit, target)
        if noise != self._noise:
            self._noise = noise
            self.query_one("#noise", Static).update(noise, layout=False)


def _noise_text(level: float | None, unit: str, target: float | None) -> Text:
    if level is None:
        return Text("noise: no band of 0.2 .. 2 Hz yet", style="dim")
    text = Text(f"noise 0.2 .. 2 Hz\n{level:.1e} {unit}/√Hz\n")
    if target is None:
        text.append("no requirement known", style="dim")
    else:
        text.append(f"required {target:.1e}\n")
        text.append("✓ within" if level <= target else "✗ ABOVE", style="bold")
    return text


def _line(strip: Strip | None, name: str = "", colour: int = 0) -> Line | None:
    return None if strip is None else Line(strip.ago_s, strip.values, name, colour=colour)


def _short(name: str) -> str:
    """A column's name without its unit."""
    return re.sub(r"_(v|mm|deg|c)$", "", name.removeprefix("laser_"))


def charts_of(channels: Mapping[str, ChannelInfo]) -> list[tuple[str, list[str]]]:
    """Title and columns of each of `CHARTS`: channels by their kind, kinds without a chart in those left empty."""
    kinds: dict[str, list[str]] = {}
    for name, channel in channels.items():
        kinds.setdefault(channel.kind, []).append(name)
    others = iter([kind for kind in kinds if kind not in OF_KIND and kind not in {"flag", "time"}])
    charts = []
    for kind, title in OF_KIND.items():
        if kind not in kinds and (other := next(others, None)) is not None:
            kind, title = other, other or "other"
        charts.append((title, kinds.get(kind, [])))
    return charts
