"""Residuals in sigma against a covariate, for versions of the model side by side."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from rigctl.core.units import name_and_unit
from rigctl.report.chart.axes import Axes
from rigctl.report.chart.figure import Figure
from rigctl.report.figures.data import Plate, file_name
from rigctl.report.figures.style import SOFT, series_style
from rigctl.workbench.findings import Comparison
from rigctl.workbench.verdict.covariates import distinct

MAX_SERIES = 4
"""Series shown, the worst ones: a report is read, not searched; the CSV has them all."""

FEWEST_POINTS = 6
"""With fewer data a series shows nothing against a covariate; those of its channel are one picture then."""

LINEAR_SIGMA = 3.0
"""Up to here the scale is linear, beyond logarithmic: one picture for 1 sigma and for 1000."""

CROWDED, TICKS_APART = 2.2, 3.5
"""Decades on half an axis from which ticks at LINEAR_SIGMA and at 10 touch, and those at every decade."""

MAX_TICKS = 5
"""Values of a covariate, when there are no more, that have a tick each."""

_SAME = 1e-3
"""Values closer than this share of their range are one set-point."""


class ResidualRow(NamedTuple):
    """One datum under one version of the model; `level` is the word that `value` stands for, "" for a number.

    A tuple: a report makes a hundred thousand of them.
    """

    covariate: str
    value: float
    level: str
    version: int
    effects: str
    channel: str
    component: str
    run_id: str
    residual_sigma: float


def clearest_first(first: Comparison) -> list[str]:
    """Covariates that vary, those that a version's residuals follow most clearly first.

    One that goes with another, such as an angle asked for with the angle reached, is left out.
    """
    clearest: dict[str, float] = {}
    for trend in first.trends:
        clearest[trend.covariate] = min(trend.p_value_corrected, clearest.get(trend.covariate, 1.0))
    return sorted(distinct(first.observations.covariates), key=lambda name: clearest.get(name, 1.0))


def residual_plate(covariate: str, comparisons: Sequence[Comparison]) -> Plate[ResidualRow]:
    """Make the figure of one covariate; rows of series in the order of their misfit under the first version."""
    misfit = {(c.channel, c.component): c.chi2 / max(c.data, 1) for c in comparisons[0].channels}
    rows = [row for comparison in comparisons for row in _rows(covariate, comparison)]
    # Worst first under the first version: the order stays while versions take the misfit away.
    rows.sort(key=lambda row: -misfit.get((row.channel, row.component), 0.0))
    caption = (
        f"Residuals (data − model) in units of their noise against {axis_label(covariate)}, by version of the model; "
        f"up to {MAX_SERIES} series, the worst under the first version; a channel whose series have fewer than "
        f"{FEWEST_POINTS} data each is one. Band: ±{LINEAR_SIGMA:g} sigma; beyond it the "
        "scale is logarithmic."
    )
    return Plate(f"residuals_{file_name(covariate)}", caption, rows, draw_residuals)


def _rows(covariate: str, comparison: Comparison) -> Iterator[ResidualRow]:
    given = comparison.observations
    effects = " + ".join(term.effect for term in comparison.terms)
    values, levels = given.of_runs(covariate), given.levels.get(covariate, ())
    # Runs that do not have the covariate are no points.
    known = np.flatnonzero(np.isfinite(values))
    columns = (values, comparison.residuals, given.series_of, given.run_of)
    for value, residual, number, run in zip(*(column[known].tolist() for column in columns), strict=True):
        series = given.series[number]
        # A covariate of words is kept as the places of its words.
        level = levels[int(value)] if levels else ""
        name = (series.channel, series.component)
        yield ResidualRow(covariate, value, level, comparison.version, effects, *name, given.run_ids[run], residual)


def draw_residuals(rows: Sequence[ResidualRow]) -> Figure:
    """A row of panels per series, a column per version; series of few data are together, by channel."""
    rows = _together(rows)
    series = list(dict.fromkeys((row.channel, row.component) for row in rows))[:MAX_SERIES]
    versions = sorted({row.version: row.effects for row in rows}.items())
    drawn_in: dict[tuple[str, str, int], list[ResidualRow]] = defaultdict(list)
    for row in rows:
        drawn_in[row.channel, row.component, row.version].append(row)
    figure = Figure(0.8 + 1.1 * len(series))
    panels = figure.subplots(len(series), len(versions), sharex=True, sharey="row", squeeze=False)
    for (channel, component), line in zip(series, panels, strict=True):
        for index, ((version, _), panel) in enumerate(zip(versions, line, strict=True)):
            drawn = drawn_in[channel, component, version]
            look = series_style(index)
            panel.axhspan(-LINEAR_SIGMA, LINEAR_SIGMA, color=SOFT, alpha=0.2)
            panel.axhline(0.0, color=SOFT, linewidth=0.6)
            panel.plot(
                [r.value for r in drawn],
                [r.residual_sigma for r in drawn],
                look.marker,
                color=look.color,
                markersize=2.4,
                titles=[f"run {r.run_id}" for r in drawn],
            )
        shown = [row for version, _ in versions for row in drawn_in[channel, component, version]]
        _scale(line[0], [row.residual_sigma for row in shown])
        line[0].set_ylabel(f"{channel}\n{component}".strip())
    for (version, effects), panel in zip(versions, panels[0], strict=True):
        panel.set_title(_heading(version, effects))
    words = {row.value: row.level for row in rows if row.level}
    # Covariates that were set have few values, which a reader looks for by themselves.
    few = _few([row.value for row in rows])
    for panel in panels[-1]:
        if words:
            panel.set_xticks(list(words), list(words.values()))
        elif few:
            panel.set_xticks(few, [_plain(place) for place in few])
        panel.set_xlabel(axis_label(rows[0].covariate))
    figure.supylabel("residual / σ")
    return figure


def _together(rows: Sequence[ResidualRow]) -> Sequence[ResidualRow]:
    data = Counter((row.channel, row.component, row.version) for row in rows)
    if len({row.channel for row in rows}) == len({(row.channel, row.component) for row in rows}):
        return rows
    if np.median(list(data.values())) >= FEWEST_POINTS:
        return rows
    return [row._replace(component="") for row in rows]


def _heading(version: int, effects: str) -> str:
    last = effects.rpartition(" + ")
    return f"version {version}: " + (f"… + {last[2]}" if last[0] else last[2] or "baseline")


def _few(values: Sequence[float]) -> list[float]:
    """Set-points that can be written below the axis one by one; none when they are too many or too close."""
    rising = np.unique(values)
    span = rising[-1] - rising[0]
    groups = np.split(rising, np.flatnonzero(np.diff(rising) > _SAME * span) + 1)
    ticks = [float(group.mean()) for group in groups]
    close = bool(np.any(np.diff(ticks) < span / (2 * MAX_TICKS)))
    return [] if close or len(ticks) > MAX_TICKS else ticks


def _plain(value: float) -> str:
    return f"{value:.4g}".replace("-", "−")


def _scale(axes: Axes, residuals: Sequence[float]) -> None:
    # Never narrower than twice the band, so that noise alone looks like noise.
    largest = max(2.0 * LINEAR_SIGMA, 2.0 * max(map(abs, residuals), default=0.0))
    axes.set_yscale("symlog", linthresh=LINEAR_SIGMA)
    axes.set_ylim(-largest, largest)
    half = 1.0 + math.log10(
        largest / LINEAR_SIGMA
    )  # of the axis, in decades: up to LINEAR_SIGMA it is as long as one
    # So many decades apart that ticks do not touch.
    decades = [10.0**k for k in range(1, int(math.log10(largest)) + 1, math.ceil(half / TICKS_APART))]
    upper = [LINEAR_SIGMA, *decades] if half <= CROWDED else decades
    ticks = [*(-tick for tick in reversed(upper)), 0.0, *upper]
    axes.set_yticks(ticks, [_plain(tick) for tick in ticks])


def axis_label(covariate: str) -> str:
    """A covariate with its unit set apart, where its name promises one."""
    name, unit = name_and_unit(covariate)
    return f"{name.replace('_', ' ')} / {unit.replace('degC', '°C')}" if unit else covariate
