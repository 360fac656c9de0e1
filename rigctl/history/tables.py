"""Histories on a terminal, on a page and as a document."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from rigctl.analysis.repeated import LEVEL, Consistency, Estimate, Scatter, sigmas
from rigctl.history.catalogue import Catalogue
from rigctl.history.item_history import ItemHistory, QuantityHistory
from rigctl.report.quantities import counted, number, p_value, probability, quantity
from rigctl.report.tables.result_table import ResultTable

HALF_CHART = 16
"""Characters to either side of the reference line."""

PREDICTED = {"mean": "mean", "drift": "line", "spread": "pooled value"}
"""What former calibrations are held to say, by model."""


def warnings_of(history: ItemHistory) -> list[str]:
    """One line for each quantity whose newest value disagrees with the former ones."""
    return [_warning(history, each) for each in history.quantities if each.disagrees]


def _warning(history: ItemHistory, of: QuantityHistory) -> str:
    tested, newest = of.consistency, of.entries[-1].calibration
    assert tested is not None
    of_all = f", {probability(of.p_value_corrected)} over {of.trials} quantities" if of.trials > 1 else ""
    former = counted(len(of.entries) - 1, "former calibration")
    return (
        f"{history.kind.serial}: {of.name} of {newest.date} ({newest.store}) disagrees with the {former}: "
        f"{_estimate(tested.difference, of.unit)} from their {PREDICTED[tested.model]}, "
        f"{sigmas(tested.p_value):.1f} sigma ({p_value(tested.p_value)}{of_all})"
    )


def title_of(history: ItemHistory) -> str:
    """Which item, by which experiment, how often."""
    kind = history.kind
    name = f" ({history.name})" if history.name else ""
    how = ", ".join(filter(None, [kind.experiment, kind.model, "SIMULATED: no item" if kind.simulated else ""]))
    return f"{kind.serial}{name}, {how}: {counted(len(history.calibrations), 'calibration')}"


def terminal_tables(history: ItemHistory) -> Iterator[ResultTable]:
    """The item, what was tested, and a control chart of each quantity."""
    yield ResultTable(title_of(history), notes=history.remarks)
    yield from filter(None, [consistency_table(history)])
    yield from (chart_table(each) for each in history.quantities)


def consistency_table(history: ItemHistory) -> ResultTable | None:
    """Of every quantity that was measured twice or more: newest, former ones, drift; None where none was."""
    if len(history.calibrations) < 2:
        return None
    columns = [
        "quantity",
        "#n",
        "newest less former",
        "#sigma",
        "#p",
        "#E_n",
        "drift per year",
        "#former p",
        "#Birge",
    ]
    rows = [_consistency_row(each) for each in history.quantities]
    marks = [each.disagrees or each.former_disagree for each in history.quantities]
    trials = max((each.trials for each in history.quantities), default=1)
    notes = [_level_note(trials)] if any(each.consistency for each in history.quantities) else []
    notes += [f"{each.name}: not tested, {each.untested}" for each in history.quantities if each.untested]
    slopes = [(each, each.drift.slope) for each in history.quantities if each.drift is not None and each.drifts]
    notes += [
        f"{each.name}: drifts by {_estimate(slope, each.unit)} per year ({p_value(slope.p_value)})"
        for each, slope in slopes
    ]
    notes += [
        f"{each.name}: the former calibrations disagree among each other; uncertainties widened by the Birge ratio"
        for each in history.quantities
        if each.former_disagree
    ]
    return ResultTable("Newest against former calibrations", columns, rows, marks, notes)


def _level_note(trials: int) -> str:
    each = f"; of {trials} tested together p below {LEVEL / trials:.2g}" if trials > 1 else ""
    return f"p: of a difference as large by chance; a warning below {100.0 * LEVEL:g} %{each}"


def _consistency_row(of: QuantityHistory) -> list[str]:
    tested = of.consistency
    if tested is None:
        return [of.name, str(len(of.entries)), "-", "", "", "", "", "", ""]
    former = tested.former
    return [
        of.name,
        str(len(of.entries)),
        _estimate(tested.difference, of.unit),
        f"{np.copysign(sigmas(tested.p_value), tested.difference.value):+.1f}",
        probability(tested.p_value),
        f"{tested.e_n:+.2f}",
        "-" if of.drift is None else _estimate(of.drift.slope, of.unit),
        probability(former.p_value) if former.dof else "-",
        number(former.birge_ratio) if former.dof else "-",
    ]


def chart_table(of: QuantityHistory) -> ResultTable:
    """A control chart of text: a row per calibration, the value beside the reference, with twice the part of its
    uncertainty that no other calibration shares."""
    own = np.array([each.independent for each in of.entries])
    away = of.placed - of.reference
    reach = float(np.max(np.abs(away) + 2.0 * own))
    rows = [
        [each.calibration.date, quantity(each.value, each.standard_uncertainty), _bar(offset, u, reach), _store(each)]
        for each, offset, u in zip(of.entries, away, own, strict=True)
    ]
    marks = [False] * (len(rows) - 1) + [of.disagrees]
    unit = of.unit if of.unit != "1" else ""
    scale = f"{HALF_CHART} characters are {number(reach, 2)} {unit}".rstrip()
    line = "the newest" if of.consistency is None else f"{PREDICTED[of.consistency.model]} of the former ones"
    title = f"{of.name} / {unit}" if unit else of.name
    notes = (
        [f"|: {line}; -o-: value and twice the independent part of its uncertainty; {scale}"] if len(rows) > 1 else []
    )
    return ResultTable(title, ["date", "#value", "chart", "store"], rows, marks, notes)


def _bar(offset: float, u: float, reach: float) -> str:
    """One row of a chart; the reference line is in the middle."""
    cells = [" "] * (2 * HALF_CHART + 1)

    def place(value: float) -> int:
        share = value / reach if reach > 0.0 else 0.0
        return HALF_CHART + round(HALF_CHART * min(max(share, -1.0), 1.0))

    for column in range(place(offset - 2.0 * u), place(offset + 2.0 * u) + 1):
        cells[column] = "-"
    cells[HALF_CHART] = "|"
    cells[place(offset)] = "o"
    return "".join(cells)


def _store(entry: Any) -> str:
    return str(entry.calibration.store)


def _estimate(estimate: Estimate, unit: str) -> str:
    return quantity(estimate.value, estimate.standard_uncertainty, unit)


def document_of(catalogue: Catalogue, histories: Sequence[ItemHistory]) -> dict[str, Any]:
    """Keys of `rigctl history --json`, as docs/commands.md describes them."""
    return {
        "directory": str(catalogue.directory),
        "stores": catalogue.stores,
        "items": [_item(each) for each in histories],
        "not_listed": [{"store": str(each.store), "reason": each.reason} for each in catalogue.not_listed],
        "warnings": [warning for each in histories for warning in warnings_of(each)],
    }


def _item(history: ItemHistory) -> dict[str, Any]:
    kind = history.kind
    return {
        "serial": kind.serial,
        "item": history.calibrations[-1].item.stated,
        "experiment": kind.experiment,
        "model": kind.model,
        "simulated": kind.simulated,
        "calibrations": [
            {
                "store": str(each.store),
                "started": each.started.isoformat(),
                "equipment": each.equipment,
                "effects": list(each.effects),
            }
            for each in history.calibrations
        ],
        "quantities": [_quantity(each) for each in history.quantities],
        "consistent": not any(each.disagrees for each in history.quantities),
        "remarks": list(history.remarks),
    }


def _quantity(of: QuantityHistory) -> dict[str, Any]:
    return {
        "name": of.name,
        "unit": of.unit,
        "kind": of.kind,
        "values": [
            {
                "store": str(each.calibration.store),
                "date": each.calibration.date,
                "value": each.value,
                "placed": placed,
                "standard_uncertainty": each.standard_uncertainty,
                "independent": each.independent,
                "dof": each.dof,
                "reference": reference,
            }
            for each, placed, reference in zip(of.entries, of.placed.tolist(), of.reference.tolist(), strict=True)
        ],
        "drift": None if of.drift is None else _drift(of),
        "consistency": None if of.consistency is None else _consistency(of, of.consistency),
        "untested": of.untested,
    }


def _drift(of: QuantityHistory) -> dict[str, Any]:
    assert of.drift is not None
    slope = of.drift.slope
    return {
        "per_year": slope.value,
        "standard_uncertainty": slope.standard_uncertainty,
        "dof": slope.dof,
        "p_value": slope.p_value,
        **_scatter(of.drift.scatter),
    }


def _consistency(of: QuantityHistory, tested: Consistency) -> dict[str, Any]:
    return {
        "against": tested.model,
        "predicted": tested.predicted,
        "difference": tested.difference.value,
        "standard_uncertainty": tested.difference.standard_uncertainty,
        "dof": tested.difference.dof,
        "normalised_difference": tested.normalised_difference,
        "e_n": tested.e_n,
        "sigma": sigmas(tested.p_value),
        "p_value": tested.p_value,
        "p_value_corrected": of.p_value_corrected,
        "consistent": not of.disagrees,
        "former": {**_scatter(tested.former), "p_value": tested.former.p_value},
    }


def _scatter(scatter: Scatter) -> dict[str, Any]:
    return {"chi2": scatter.chi2, "chi2_dof": scatter.dof, "birge_ratio": scatter.birge_ratio}
