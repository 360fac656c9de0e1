"""Results of an in-flight calibration, and of a study of many, for a page and a terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rigctl.campaign.store.store import Store
from rigctl.experiments.inflight.analysis import result
from rigctl.experiments.inflight.result.monte_carlo import DRAW, Draw, errors_of
from rigctl.experiments.inflight.result.published import published
from rigctl.report.drawn import Drawn
from rigctl.report.picture import MARKS, Line, Picture
from rigctl.report.quantities import number, quantity
from rigctl.report.tables.result_table import ResultTable
from rigctl.workbench.workbench import Workbench


def tables(result_json: Mapping[str, Any], reference: Mapping[str, Any]) -> list[ResultTable]:
    """Of one calibration, or tables 2 and 3 of the paper of a study of many, ours beside the printed ones."""
    del reference
    if "table2" in result_json:
        missions = map(_mission_table, result_json.get("test", {}).items())
        pulls = [_pulls(result_json)] if "pulls" in result_json else []
        return [_table2(result_json), _table3(result_json["table3"]), *pulls, *missions]
    made = [calibration_table(result_json)]
    if budget := result_json.get("budget"):
        made += [_budget(budget, result_json["parameters"]), _correlation(budget)]
    return [*made, *equivalence_tables(result_json["ep"])] if "ep" in result_json else made


def draw(workbench: Workbench, lines_hz: Sequence[float], found: Sequence[Any]) -> Drawn:
    """The result with its figures."""
    from rigctl.report.figures.inflight.figures import plates_of

    del lines_hz, found
    numbers = result(workbench)
    return Drawn(numbers, plates_of(numbers))


def progress(store: Store) -> list[Picture]:
    """Of a study: how far off its calibrations are, each by the parameter that is farthest from its objective."""
    draws = [Draw.from_json(document.data) for document in store.documents(DRAW)]
    if not draws:
        return []
    objectives = {name: row.objective for name, row in published().rows.items()}
    number_of = np.array([draw.number for draw in draws], dtype=float)
    lines = []
    for place, (estimate, word) in enumerate((("paper", "published"), ("joint", "joint"))):
        errors = errors_of(draws, estimate, "paper_truth") / np.array(list(objectives.values()))
        # A parameter that no session calibrates has no error.
        lines.append(Line(number_of, np.nanmax(errors, axis=1), f"{word} estimate", MARKS[place], place))
    return [
        Picture(
            "largest error / objective, of ten parameters",
            tuple(lines),
            "draw",
            levels=((1.0, "objective"),),
            y_scale="log",
        )
    ]


def calibration_table(result_json: Mapping[str, Any]) -> ResultTable:
    """The ten parameters by both estimates; marked where they are more than four sigma apart."""
    rows, marked = [], []
    for name, each in result_json["parameters"].items():
        paper, unit = each["paper"], each["unit"]
        rows.append(
            [
                name,
                quantity(each["value"], each["sigma"], unit),
                number(each["systematic"], 2) if each["systematic"] else "",
                "no session" if paper is None else quantity(paper["value"], paper["sigma"], unit),
            ]
        )
        apart = 0.0 if paper is None else abs(paper["value"] - each["value"])
        marked.append(paper is not None and apart > 4.0 * paper["sigma"])
    sentence = (
        f"Calibration: the joint fit of all lines, and the published estimate ({result_json['sweeps']} sweeps). "
        "Systematic is what no session sees, in the same unit."
    )
    columns = ["parameter", "#joint", "#systematic", "#published"]
    return ResultTable(sentence, columns, rows, marked, result_json["remarks"])


def _budget(budget: Mapping[str, Any], parameters: Mapping[str, Any]) -> ResultTable:
    """What each parameter's uncertainty comes to, and from what."""
    rows = []
    for place, name in enumerate(budget["outputs"]):
        combined = budget["combined"][place]
        shares = [((each["u"][place] / combined) ** 2, each) for each in budget["contributions"]]
        largest = sorted((share for share in shares if share[0] >= 0.01), key=lambda share: -share[0])
        rows.append(
            [
                name,
                f"{number(combined, 2)} {parameters[name]['unit']}".removesuffix(" 1"),
                number(budget["expanded_95"][place], 2),
                ", ".join(f"{each['name']} ({each['type']}) {100.0 * share:.0f} %" for share, each in largest),
            ]
        )
    sentence = (
        "Uncertainty of the joint estimate, all contributions: combined, expanded (95 %), and parts of the variance "
        "from 1 % on (A: statistics, B: belief)."
    )
    notes = [f"Monte Carlo: {budget['monte_carlo']['reason']}"]
    return ResultTable(sentence, ["parameter", "#combined", "#expanded", "parts"], rows, notes=notes, tab="Budget")


def _correlation(budget: Mapping[str, Any]) -> ResultTable:
    sigma = budget["combined"]
    short = [name.removeprefix("ac11_").split("_")[0] for name in budget["outputs"]]
    rows = [
        [name, *(f"{each / (sigma[i] * sigma[j]):+.2f}" for j, each in enumerate(row))]
        for i, (name, row) in enumerate(zip(short, budget["covariance"], strict=True))
    ]
    return ResultTable("Correlation of the parameters", ["", *(f"#{name}" for name in short)], rows, tab="Budget")


def _pulls(result_json: Mapping[str, Any]) -> ResultTable:
    """Errors of a study over what each draw's budget says of them."""
    draws, chi2 = result_json["draws"], result_json["chi2"]
    rows = [[name, number(each["mean"], 2), number(each["rms"], 3)] for name, each in result_json["pulls"].items()]
    sentence = (
        f"Pulls of the joint estimate, exact truth, over {draws} calibrations: errors over the uncertainty of each "
        f"one's budget. By chance means are 0 ± {number(draws**-0.5, 2)}, rms 1 ± {number((2 * draws) ** -0.5, 2)}."
    )
    spread = number((2.0 * chi2["expected"] / draws) ** 0.5, 2)
    wanted = f"{chi2['expected']} ± {spread} expected"
    notes = [f"chi-square of all ten with their covariance: {number(chi2['mean'], 4)}, {wanted}"]
    return ResultTable(sentence, ["parameter", "#mean", "#rms"], rows, notes=notes)


def equivalence_tables(ep: Mapping[str, Any]) -> list[ResultTable]:
    """The test of the equivalence principle: delta by session, and what each parameter does to it."""
    sessions = {name: each for name, each in ep.items() if name != "combined"}
    rows = [
        [
            name,
            each["session"],
            number(each["orbits"]),
            *(_scaled(each[key]) for key in ("uncorrected", "delta")),
            *(number(_SCALE * each["delta"][key], 2) for key in _SIGMAS),
            _scaled(each["quadrature"]),
        ]
        for name, each in sessions.items()
    ]
    both = ep["combined"]["delta"]
    rows.append(["all", "", "", "", _scaled(both), *(number(_SCALE * both[key], 2) for key in _SIGMAS[:2]), "", ""])
    marked = [abs(each["quadrature"]["value"]) > 4.0 * each["quadrature"]["sigma"] for each in sessions.values()]
    sentence = (
        "Test of the equivalence principle, in 1e-15: delta before and after correction with the calibration, its "
        "sigma by noise, by the calibration, and by what no session sees; the part in quadrature should be nil."
    )
    columns = ["run", "session", "#orbits", "#before", "#delta", "#noise", "#cal.", "#unseen", "#quadrature"]
    return [ResultTable(sentence, columns, rows, [*marked, False]), *map(_rows_of, sessions.items())]


_SCALE = 1e15
_SIGMAS = ("sigma_noise", "sigma_calibration", "systematic")


def _scaled(each: Mapping[str, float]) -> str:
    return quantity(_SCALE * each["value"], _SCALE * each["sigma"])


def _rows_of(session: tuple[str, Mapping[str, Any]]) -> ResultTable:
    name, each = session
    rows = [[parameter, *(number(row[key], 2) for key in row)] for parameter, row in each["rows"].items()]
    totals = (
        sum(row[key] for row in each["rows"].values()) for key in ("before_m_s2", "in_phase_m_s2", "after_m_s2")
    )
    rows.append(["total", *(number(total, 2) for total in totals)])
    sentence = (
        f"What each parameter does in {name} at the frequency of the test, m/s2: before by its calibrated value, "
        "the part of that in phase with gravity, after by its standard uncertainty; linear totals."
    )
    return ResultTable(sentence, ["parameter", "#before", "#in phase", "#after"], rows)


def _mission_table(session: tuple[str, Mapping[str, Any]]) -> ResultTable:
    """Tables 1 and 3 as sessions of the test have them."""
    name, each = session
    rows = [[parameter, *(number(row[key], 3) for key in _ROW)] for parameter, row in each["rows"].items()]
    totals = {key: sum(row[key] for row in each["rows"].values()) for key in _ROW}
    rows.append(["total", "", "", *(number(totals[key], 3) for key in _ROW[2:])])
    pull, off = each["pull"], {key: _SCALE * each[key]["rms"] for key in ("error", "uncorrected")}
    sigmas = [number(_SCALE * each[key], 2) for key in _SIGMAS[:2]]
    sentence = (
        f"{name}, {number(each['orbits'])} orbits: delta is off by {number(off['error'], 3)}e-15 rms (by noise "
        f"{sigmas[0]}, by calibration {sigmas[1]}), uncorrected by {number(off['uncorrected'], 3)}; pulls have a "
        f"mean of {number(pull['mean'], 2)} and an rms of {number(pull['rms'], 3)}, where "
        f"{number(pull['expected_rms'], 3)} is expected. What each parameter does at {number(each['f_ep_hz'], 4)} "
        "Hz: a unit of it, and all of it at its bound, beside table 1; the joint estimate's errors; m/s2."
    )
    columns = ["parameter", "#driver", "#printed", "#before", "#printed", "#worst", "#mean"]
    return ResultTable(sentence, columns, rows)


_ROW = (
    *("per_unit_m_s2", "printed_per_unit_m_s2"),
    *("at_bound_m_s2", "printed_before_m_s2", "worst_m_s2", "mean_m_s2"),
)


def _table2(result_json: Mapping[str, Any]) -> ResultTable:
    rows: list[list[str]] = []
    for name, each in result_json["table2"].items():
        summaries = [("printed", each["reference"], None)]
        for estimate, word in (("paper", "published"), ("joint", "joint")):
            for truth in ("paper", "exact"):
                # One sigma for both truths: it is stated by the estimate, which knows neither.
                sigma = each[estimate]["analytic_sigma"] if truth == "exact" else None
                summaries.append((f"{word}, {truth} truth", each[estimate][f"{truth}_truth"], sigma))
        heads = [name, f"< {number(each['objective'], 2)}", f"{100.0 * each['over_objective']:.3g} % over"]
        for place, (words, summary, sigma) in enumerate(summaries):
            numbers = [number(summary[key], 2) for key in ("worst", "mean", "std")]
            # Of errors without their sign: mean and scatter about it make up the root mean square.
            numbers.append(number(math.hypot(summary["mean"], summary["std"]), 2))
            head = heads[place] if place < len(heads) else ""
            rows.append([head, words, *numbers, "" if sigma is None else number(sigma, 2)])
    sentence = (
        f"Table 2: |estimate - true| over {result_json['draws']} simulated calibrations, below each name its "
        "objective and the share of them over it (published estimate, paper truth); sigma is what the estimates "
        "state, of noise alone: to be compared with the root mean square."
    )
    return ResultTable(sentence, ["parameter", "estimate, truth", "#worst", "#mean", "#std", "#rms", "#sigma"], rows)


def _table3(table: Mapping[str, Any]) -> ResultTable:
    rows = [
        [each["term"], *(number(each[key], 2) for key in ("before_m_s2", "worst_m_s2", "mean_m_s2"))]
        for each in table["rows"].values()
    ]
    printed = table["reference"]
    rows.append(["total", *(number(table[key], 3) for key in ("before_m_s2", "total_worst_m_s2", "total_mean_m_s2"))])
    # The paper prints no total before calibration.
    rows.append(["printed total", "", *(number(printed[key], 3) for key in ("total_worst_m_s2", "total_mean_m_s2"))])
    sentence = (
        "Table 3: what is left at the frequency of the test, m/s2, before and after calibration; linear totals, "
        f"to stay below {number(table['limit_m_s2'])}."
    )
    over = [False] * (len(rows) - 2) + [table["total_worst_m_s2"] > table["limit_m_s2"], False]
    return ResultTable(sentence, ["term", "#before", "#worst", "#mean"], rows, over)
