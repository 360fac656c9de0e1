"""Screen 1: the instruments, jog and home, strip charts and spectrum."""

from __future__ import annotations

import math
import re
import time
import tomllib
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Grid, Vertical
from textual.widgets import DataTable, Static

from rigctl.console.bench import InstrumentView, Limits, Strip, Value
from rigctl.console.messages import HomeAsked, JogAsked, MoveAsked, Noted, ReconnectAsked
from rigctl.console.widgets.dialogs import MoveDialog, TextDialog
from rigctl.console.widgets.plot import Line, Picture, Plot
from rigctl.core.numbers import decimal

if TYPE_CHECKING:
    from rigctl.campaign.recording import ChannelInfo
    from rigctl.console.feed import StoreView
    from rigctl.core.arrays import FloatArray

COLUMNS = ("instrument", "state", "value", "age", "identity")
MARKS = {"ready": "●", "moving": "▶", "homing": "▶", "stopped": "■", "lost": "✗", "silent": "?", "connecting": "…"}
STALE_S = 3.0
CHARTS = ("accelerometer", "lasers", "stage", "angle")
OF_KIND = {"accelerometer": "accelerometer", "displacement": "lasers", "position": "stage", "angle": "angle"}
"""Which chart shows a channel of a recording; those of other kinds take charts that would be empty."""

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
        self._said: dict[str, Text] = {}

    def compose(self) -> ComposeResult:
        """Table, line of details, charts."""
        yield DataTable(id="instruments", cursor_type="row", zebra_stripes=False)
        yield Static(id="detail")
        with Grid(id="charts"):
            for name in CHARTS:
                yield Plot(Picture(name), id=f"chart-{name}")
            yield Plot(Picture("spectrum"), id="chart-spectrum")
            yield Static(id="noise")

    def on_mount(self) -> None:
        """Columns once, rows as instruments come."""
        table = self.query_one(DataTable)
        for name, width in zip(COLUMNS, (13, 12, 23, 6, None), strict=True):
            table.add_column(name, key=name, width=width)

    def show_bench(self, views: Sequence[InstrumentView], strips: Mapping[str, Strip]) -> None:
        """The rig this console holds."""
        self._show_instruments(views)
        lasers = [
            strip for name, strip in strips.items() if name not in {"angle", "position", "voltage", "temperature"}
        ]
        self._chart("accelerometer", "V", [_line(strips.get("voltage"))])
        self._chart("lasers", "mm", [_line(strip, _short(strip.name), i) for i, strip in enumerate(lasers)])
        self._chart("stage", "mm", [_line(strips.get("position"))])
        self._chart("angle", "deg", [_line(strips.get("angle"))])
        voltage = strips.get("voltage")
        if voltage is not None and len(voltage.values) > 32:
            span_s = float(voltage.ago_s[-1] - voltage.ago_s[0])
            self._show_spectrum(
                *density(voltage.values, (len(voltage.values) - 1) / max(span_s, 1e-3)), 1.0, "V", None
            )

    def show_store(self, view: StoreView) -> None:
        """The rig as the campaign that holds it tells."""
        import numpy as np

        rig = _tables(view.rig_toml)
        self._show_instruments(_from_store(view, rig))
        t_s = view.samples.get("t_s")

        def line(column: str, name: str, colour: int) -> Line | None:
            values = view.samples.get(column)
            if values is None or t_s is None or not len(values):
                return None
            shown = min(len(values), len(t_s))  # of a run that is being recorded one may be longer
            return Line(t_s[-shown:], values[-shown:], name, colour=colour)

        told = f"run {view.run_id}, t / s"
        for chart, (title, columns) in zip(CHARTS, charts_of(view.channels), strict=True):
            names = [_short(column) if len(columns) > 1 or title == "lasers" else "" for column in columns]
            unit = view.channels[columns[0]].unit if columns else ""
            lines = [line(column, name, i) for i, (column, name) in enumerate(zip(columns, names, strict=True))]
            self._chart(chart, unit, lines, told, title)
        turns = [run for run in view.runs[-200:] if "theta_deg" in run.conditions]
        if turns:
            angles = np.array([float(run.conditions["theta_deg"]) for run in turns])
            numbers = np.arange(len(view.runs) - len(turns) + 1, len(view.runs) + 1, dtype=float)
            self._chart("angle", "deg", [Line(numbers, angles, mark="o")], "run")
        self._show_run_spectrum(view, rig)

    def _show_run_spectrum(self, view: StoreView, rig: Mapping[str, Any]) -> None:
        sensors = [name for name, channel in view.channels.items() if channel.kind == "accelerometer"]
        values, t_s = view.samples.get(sensors[0] if sensors else ""), view.samples.get("t_s")
        if values is None or t_s is None or len(values) < 64 or not view.runs:
            return
        unit = view.channels[sensors[0]].unit
        gain = _gain(rig, view.runs[-1].conditions)
        target = _tables(view.campaign_toml).get("targets", {}).get("noise_m_s2_rthz")
        rate_hz = (len(t_s) - 1) / float(t_s[-1] - t_s[0])
        self._show_spectrum(*density(values, rate_hz), gain, "m/s²" if gain != 1.0 else unit, target)

    def _chart(
        self, name: str, unit: str, lines: Sequence[Line | None], x_label: str = "t / s", title: str = ""
    ) -> None:
        shown = tuple(line for line in lines if line is not None)
        told = f"{title or name} / {unit}" if unit else title or name
        self.query_one(f"#chart-{name}", Plot).show(Picture(told, shown, x_label))

    def _show_spectrum(
        self, frequency_hz: FloatArray, density_v: FloatArray, gain: float, unit: str, target: float | None
    ) -> None:
        import numpy as np

        with np.errstate(divide="ignore"):
            x, y = np.log10(frequency_hz), np.log10(density_v / gain)
        keep = np.isfinite(y)
        levels = ((math.log10(target), "required"),) if target else ()
        line = Line(x[keep], y[keep])
        picture = Picture(f"spectrum / {unit}/√Hz, log", (line,), "log f / Hz", levels=levels)
        if target and keep.any():
            low, high = float(y[keep].min()), float(y[keep].max())
            picture = Picture(
                picture.title,
                (line,),
                picture.x_label,
                y_range=(min(low, math.log10(target)), max(high, math.log10(target))),
                levels=levels,
            )
        self.query_one("#chart-spectrum", Plot).show(picture)
        self._say("noise", _noise_told(frequency_hz, density_v / gain, unit, target))

    def _show_instruments(self, views: Sequence[InstrumentView]) -> None:
        table = self.query_one(DataTable)
        rows = {view.name: _row(view) for view in views}
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
            told = f"… opening {self.opening}" if self.opening else "No rig is open: o opens a rig file or a store."
            self._say("detail", Text(told))
            return
        limits = f"  limits {view.limits}  jog step {self.jog_step:g} {view.limits.unit}" if view.limits else ""
        who = f"  {view.identity}" if view.identity else ""
        text = Text(f"{view.name}: {view.role}, {view.driver}, {view.address}{who}{limits}")
        if view.error:
            text = Text(f"✗ {view.error}", style="bold", no_wrap=False)
        self._say("detail", text)

    def _say(self, where: str, text: Text) -> None:
        if self._said.get(where) != text:
            self._said[where] = text
            self.query_one(f"#{where}", Static).update(text, layout=where == "detail")

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

        def go(value: float | None) -> None:
            if value is not None:
                self.post_message(MoveAsked(view.name, value))

        self.app.push_screen(MoveDialog(view.name, limits, _values_told(view)), go)

    def action_home(self) -> None:
        """Home the stage that is chosen."""
        if (chosen := self._stage()) is not None:
            self.post_message(HomeAsked(chosen[0].name))

    def action_jog(self, direction: int) -> None:
        """One step from where the stage is; refused where it would leave the limits."""
        if (chosen := self._stage()) is not None:
            self.post_message(JogAsked(chosen[0].name, direction * self.jog_step))

    def action_step(self) -> None:
        """Another size of the jog's steps."""

        def keep(text: str | None) -> None:
            if text is not None:
                self.jog_step = decimal(text.strip())

        self.app.push_screen(TextDialog("Jog step", "deg or mm per step", f"{self.jog_step:g}", _no_step), keep)

    def action_reconnect(self) -> None:
        """Try what does not answer again."""
        self.post_message(ReconnectAsked())


def _no_step(text: str) -> str:
    try:
        return "" if 0.0 < decimal(text.strip()) <= 90.0 else "a step is more than 0 and at most 90"
    except ValueError:
        return f"'{text}' is not a number"


def density(volts: FloatArray, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    """One-sided amplitude density of evenly spaced samples by frequency, the mean of overlapping Hann windows."""
    import numpy as np

    values = volts[np.isfinite(volts)]
    size = min(len(values), 4096)
    if size < 16:
        return np.zeros(0), np.zeros(0)
    window = np.hanning(size)
    starts = range(0, len(values) - size + 1, max(size // 2, 1))
    power = [
        np.abs(np.fft.rfft(window * (part - part.mean()))) ** 2 for part in (values[s : s + size] for s in starts)
    ]
    scale = 2.0 / (rate_hz * float(np.sum(window**2)))
    frequency_hz = np.asarray(np.fft.rfftfreq(size, 1.0 / rate_hz)[1:], dtype=np.float64)
    return frequency_hz, np.asarray(np.sqrt(scale * np.mean(power, axis=0))[1:], dtype=np.float64)


def _noise_told(frequency_hz: FloatArray, found: FloatArray, unit: str, target: float | None) -> Text:
    """The median density between 0.2 and 2 Hz: lines such as the drive's do not move it."""
    import numpy as np

    band = (frequency_hz > 0.2) & (frequency_hz < 2.0)
    if not band.any():
        return Text("noise: no band of 0.2 .. 2 Hz yet", style="dim")
    level = float(np.median(found[band]))
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


def _row(view: InstrumentView) -> tuple[str, ...]:
    now_s = time.monotonic()
    age_s = max((now_s - each.taken_s for each in view.values), default=math.nan)
    return (
        view.name,
        f"{MARKS.get(view.state, ' ')} {view.state}",
        _values_told(view),
        _age_told(age_s),
        view.identity,
    )


def charts_of(channels: Mapping[str, ChannelInfo]) -> list[tuple[str, list[str]]]:
    """Title and columns of each of `CHARTS`: channels by their kind, kinds without a chart in those left empty."""
    kinds: dict[str, list[str]] = {}
    for name, channel in channels.items():
        kinds.setdefault(channel.kind, []).append(name)
    others = iter([kind for kind in kinds if kind not in OF_KIND and kind not in {"flag", "time"}])
    found = []
    for kind, title in OF_KIND.items():
        if kind not in kinds and (other := next(others, None)) is not None:
            kind, title = other, other or "other"
        found.append((title, kinds.get(kind, [])))
    return found


def _age_told(age_s: float) -> str:
    if math.isnan(age_s):
        return ""
    if age_s < STALE_S:  # while it is fresh, its age is not a number to be read ten times a second
        return "< 1 s" if age_s < 1.0 else f"{age_s:.0f} s"
    return f"{min(age_s, 999):.0f} s!"


def _states(rows: Mapping[str, tuple[str, ...]]) -> list[str]:
    return [row[1] for row in rows.values()]


def _values_told(view: InstrumentView) -> str:
    if not view.values:
        return "-"
    digits = 4 if view.values[0].unit in {"deg", "mm", "V"} else 2
    if len(view.values) > 1:
        digits = 3
    told = (f"{each.value:.{digits}f}" if math.isfinite(each.value) else "--" for each in view.values)
    return f"{' '.join(told)} {view.values[0].unit}"


@lru_cache(maxsize=4)
def _tables(text: str) -> dict[str, Any]:
    """A file kept in a store, which was checked when it was put there."""
    return tomllib.loads(text)


def _gain(rig: Mapping[str, Any], conditions: Mapping[str, Any]) -> float:
    """V/(m/s2) of the sensor that is mounted; 1 where the rig file does not say."""
    try:
        sensor = rig["package"]["axes"][conditions["axis"]]["sensor"][conditions["configuration"]]
        return float(sensor["gain_v_per_m_s2"])
    except (KeyError, TypeError):
        return 1.0


def _from_store(view: StoreView, rig: Mapping[str, Any]) -> list[InstrumentView]:
    """The instruments as the store tells: identity, and the last value of each that was recorded."""
    found = []
    state = "campaign" if view.alive else "recorded"
    for name, table in rig.get("instruments", {}).items():
        identity = view.identities.get(name, {})
        who = " ".join(str(identity[key]) for key in ("model", "serial", "firmware") if identity.get(key))
        values = tuple(
            Value(label, value, unit, view.sampled_s)
            for label, value, unit in _recorded(view, table)
            if math.isfinite(value)
        )
        driver, address = str(table["driver"]), str(table["address"])
        found.append(InstrumentView(name, str(table["role"]), driver, address, state, who, values, ""))
    return found


def _recorded(view: StoreView, table: Mapping[str, Any]) -> list[tuple[str, float, str]]:
    conditions = view.runs[-1].conditions if view.runs else {}
    last = {name: float(values[-1]) for name, values in view.samples.items() if len(values)}
    role = table["role"]
    if role == "rotation" and ("theta_deg" in conditions or "theta_deg" in last):
        return [("angle", float(conditions.get("theta_deg", last.get("theta_deg", math.nan))), "deg")]
    if role == "thermometer" and "temperature_c" in conditions:
        return [("temperature", float(conditions["temperature_c"]), "degC")]
    if role == "linear" and "stage_x_mm" in last:
        return [("position", last["stage_x_mm"], "mm")]
    if (channel := table.get("channel", "accel_v")) in last and role in {"readout", "voltmeter"}:
        return [("voltage", last[channel], "V")]
    return [(head, last[head], "mm") for head in table.get("heads", {}) if head in last]
