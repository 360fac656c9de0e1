"""Histories as control charts and as one page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import date, datetime, timedelta
from functools import partial

import numpy as np

from rigctl.history.catalogue import Catalogue
from rigctl.history.item_history import ItemHistory, QuantityHistory
from rigctl.history.tables import consistency_table, title_of, warnings_of
from rigctl.report import html
from rigctl.report.chart.figure import Figure
from rigctl.report.figures.data import Plate, file_name
from rigctl.report.figures.style import BLUE, SOFT, VERMILION
from rigctl.report.quantities import counted, number, quantity
from rigctl.report.tables.result_table import ResultTable

DAY_S = 86400.0
EPOCH = date(1970, 1, 1)
NAME_CHARACTERS = 120
"""Of a figure's file: more than a name is read for, fewer than a file system allows."""
COVERAGE = 2.0
"""Bars are so many times the independent uncertainty to either side."""


@dataclass(frozen=True)
class ChartRow:
    """A value of one calibration, `placed` an angle beside the others; `reference` is what the former ones say.

    `independent` is the part of its standard uncertainty that no other calibration shares.
    """

    store: str
    started: str
    value: float
    standard_uncertainty: float
    independent: float
    placed: float
    reference: float


def all_charts(histories: Sequence[ItemHistory]) -> Iterator[Plate[ChartRow]]:
    """The control charts of all items, each with a name of its own."""
    seen: Counter[str] = Counter()
    for plate in (plate for each in histories for plate in charts(each)):
        name = plate.name[:NAME_CHARACTERS]
        seen[name] += 1
        yield replace(plate, name=f"{name}_{seen[name]}" if seen[name] > 1 else name)


def charts(history: ItemHistory) -> Iterator[Plate[ChartRow]]:
    """A control chart for each quantity."""
    kind = history.kind
    for each in history.quantities:
        name = file_name(f"{kind.serial}_{kind.experiment}_{each.name}")
        caption = (
            f"{each.name} of {kind.serial}: {counted(len(each.entries), 'calibration')}, bars of {COVERAGE:g} times "
            "the independent part of the uncertainty; line: what the former calibrations say."
        )
        draw = partial(_drawn, label=f"{each.name} / {each.unit or '1'}", disagrees=each.disagrees)
        yield Plate(name, caption, list(_rows(each)), draw)


def _rows(of: QuantityHistory) -> Iterator[ChartRow]:
    for entry, placed, reference in zip(of.entries, of.placed.tolist(), of.reference.tolist(), strict=True):
        calibration = entry.calibration
        yield ChartRow(
            str(calibration.store),
            calibration.started.isoformat(),
            entry.value,
            entry.standard_uncertainty,
            entry.independent,
            placed,
            reference,
        )


def _dates(first_day: float, last_day: float) -> tuple[list[float], list[str]]:
    """Places in days since 1970 with their dates, five of them; one where all is of one day."""
    days = sorted({round(first_day + share * (last_day - first_day)) for share in np.linspace(0.0, 1.0, 5)})
    return [float(day) for day in days], [(EPOCH + timedelta(days=day)).isoformat() for day in days]


def _drawn(rows: Sequence[ChartRow], *, label: str, disagrees: bool) -> Figure:
    figure = Figure(2.2)
    axes = figure.subplots()
    # Dates are days since 1970.
    time = np.array([datetime.fromisoformat(row.started).timestamp() / DAY_S for row in rows])
    value, reference = (np.array([getattr(row, name) for row in rows]) for name in ("placed", "reference"))
    bar = COVERAGE * np.array([row.independent for row in rows])
    axes.plot(time, reference, color=SOFT, linewidth=0.8)
    ends = [(slice(None, -1), BLUE, "o"), (slice(-1, None), VERMILION if disagrees else BLUE, "s")]
    for part, colour, marker in ends:
        axes.errorbar(time[part], value[part], bar[part], fmt=marker, color=colour, capsize=2.0)
    axes.set_xticks(*_dates(float(time.min()), float(time.max())))
    axes.set_ylabel(label)
    return figure


def page(catalogue: Catalogue, histories: Sequence[ItemHistory]) -> str:
    """Everything on one page: warnings first, then item by item."""
    title = f"Calibrations in {catalogue.directory}"
    body = [html.heading(title, 1)]
    body.append(html.paragraph(f"{counted(catalogue.stores, 'store')}, {counted(len(histories), 'item')}", "soft"))
    warned = [warning for each in histories for warning in warnings_of(each)]
    body += [html.paragraph(each, "verdict") for each in warned]
    if not warned and any(each.consistency for history in histories for each in history.quantities):
        agreed = "The newest calibration of every item that was calibrated before agrees with the former ones."
        body.append(html.paragraph(agreed, "verdict adequate"))
    for history in histories:
        body += _item(history)
    if catalogue.not_listed:
        body.append(html.heading("Not listed"))
        body.append(html.listing(f"{each.store}: {each.reason}" for each in catalogue.not_listed))
    return html.page(title, body)


def _item(history: ItemHistory) -> Iterator[str]:
    yield html.heading(title_of(history))
    yield from map(html.paragraph, history.remarks)
    tested = consistency_table(history)
    if tested is not None:
        yield html.table(tested)
    for each, plate in zip(history.quantities, charts(history), strict=True):
        yield html.heading(each.name, 3)
        if len(each.entries) > 1:
            yield html.figure(plate)
        yield html.table(_values(each))


def _values(of: QuantityHistory) -> ResultTable:
    rows = [
        [
            each.calibration.date,
            quantity(each.value, each.standard_uncertainty, of.unit),
            number(each.independent, 2),
            str(each.calibration.store),
        ]
        for each in of.entries
    ]
    columns = ["date", "#value", "#independent part", "store"]
    return ResultTable(of.name, columns, rows, [False] * (len(rows) - 1) + [of.disagrees])
