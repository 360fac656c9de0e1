"""What the workbench found, as tables for a terminal of 80 columns; findings come as their JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from rigctl.report.quantities import counted, number, probability, quantity
from rigctl.report.verdicts import (
    ADEQUATE_P,
    Findings,
    advice,
    change_of,
    comparison_sentence,
    inseparable_sentences,
    model_name,
    named,
    sizes,
    transfer_sentence,
    verdict_sentence,
)

RANKS = 6
"""Ranks that are shown beside the significant ones."""

APART_SIGMA = 3.0
"""Parameters of two stores that are farther apart are shown."""

_LEFT = {"channel", "component", "unit", "run", "covariate", "effect", "parameter", "added", "", "result"}


def print_comparison(found: Findings) -> None:
    """The model beside the data: sentence, channels, worst data, trends, lines."""
    model = found["model"]
    _say(f"Model version {model['version']}: {model_name(model['effects'])}")
    _say(comparison_sentence(found))
    channels = [
        [
            row["channel"],
            row["component"],
            number(row["rms"]),
            number(row["noise"]),
            row["unit"],
            number(row["chi2"] / row["data"]) if row["data"] else "-",
            "FAILS" if fails(row) else "",
        ]
        for row in found["channels"]
    ]
    _print_table("Residuals by channel", ["channel", "component", "rms", "noise", "unit", "chi2/n", ""], channels)
    worst = [[row["run_id"], row["channel"], row["component"], f"{row['sigma']:+.1f}"] for row in found["worst"]]
    _print_table("Farthest from the model", ["run", "channel", "component", "sigma"], worst)
    _print_trends(found["trends"])
    for line in found["lines"]:
        _say(line_sentence(line))
    if "with" in found:
        print_transfer(found["with"])


def print_transfer(found: Findings) -> None:
    """Does what was fitted here hold there?"""
    _say(transfer_sentence(found))
    rows = []
    for name, pair in found["parameters"].items():
        if abs(pair["sigmas_apart"] or 0.0) > APART_SIGMA:
            both = (quantity(each["value"], each["sigma"], each["unit"]) for each in (pair["here"], pair["there"]))
            rows.append([name, *both, f"{pair['sigmas_apart']:+.1f}"])
    _print_table("Parameters that differ", ["parameter", "here", "there", "sigma"], rows)


def fails(channel: Findings) -> bool:
    """True when a channel's chi-square is too large for its data."""
    from scipy.special import chdtrc

    return bool(channel["data"]) and float(chdtrc(channel["data"], channel["chi2"])) < ADEQUATE_P


def line_sentence(line: Findings) -> str:
    """A line in the samples."""
    size = quantity(line.get("amplitude"), line.get("sigma"), line.get("unit", ""))
    return f"A line in the samples of {line['channel']}: {size} at {number(line['frequency_hz'], 5)} Hz."


def _print_trends(trends: Sequence[Findings]) -> None:
    significant = [row for row in trends if (row["p_value_corrected"] or 0.0) < ADEQUATE_P]
    if not significant:
        _say("The residuals follow no covariate.")
        return
    rows = [
        [
            row["covariate"],
            row["channel"],
            row["component"],
            probability(row["p_value_corrected"]),
            number(row["rms_explained"]),
        ]
        for row in significant[:8]
    ]
    _print_table("Residuals follow", ["covariate", "channel", "component", "p corr.", "explains"], rows)
    if len(significant) > 8:
        _say(f"and {len(significant) - 8} more: --json has all")


def print_diagnosis(found: Findings, store: str) -> None:
    """The verdict first, what to do next, then what it rests on."""
    _say(verdict_sentence(found))
    _say(f"Next: {advice(found, store)}")
    print_ranking(found)
    _list("Cannot be told apart with these data", _inseparable(found))
    _list("Cannot be tested with these data", (f"{e}: {why}" for e, why in found["not_testable"].items()))


def _inseparable(found: Findings) -> list[str]:
    """What concerns the result or the suggested effects, and how much else there is."""
    concerns = [
        pair
        for pair in found["inseparable"]
        if pair["from"].startswith("baseline:") or {pair["effect"], pair["from"]} & set(found["suggested"])
    ]
    others = len(found["inseparable"]) - len(concerns)
    more = [f"and {counted(others, 'pair')} of other effects: --json has them"] if others else []
    return [*inseparable_sentences(concerns), *more]


def print_ranking(found: Findings) -> None:
    """Effects from the most to the least significant, with sizes."""
    ranking = found["ranking"]
    if not ranking:
        return
    shown = [
        rank
        for place, rank in enumerate(ranking)
        if place < RANKS
        or (rank["p_value_corrected"] or 0.0) < found["alpha"]
        or rank["effect"] in found["suggested"]
    ]
    table = Table(title="Candidates", title_justify="left", box=SIMPLE_HEAD, padding=(0, 1))
    table.add_column("effect (*: suggested)", min_width=44, overflow="fold")
    for column in ("p corr.", "chi2 fall", "held out"):
        table.add_column(column, justify="right", no_wrap=True)
    for rank in shown:
        star = "*" if rank["effect"] in found["suggested"] else " "
        told = [f"{star} {named(rank['effect'], rank['choice'])}", *(f"    {size}" for size in sizes(rank))]
        if rank["equivalent_to"]:
            told.append(f"    like {', '.join(rank['equivalent_to'])}")
        _add(
            table,
            "\n".join(told),
            probability(rank["p_value_corrected"]),
            number(rank["chi2_fall"]),
            number(rank["held_out_error_ratio"]),
        )
    _show(table)
    _dim("held out: error after / before, on runs not used in the fit")
    if len(shown) < len(ranking):
        _dim(f"{len(ranking) - len(shown)} more with --json")


def print_versions(versions: Sequence[Findings]) -> None:
    """The versions of a model."""
    for version in versions:
        terms = [named(term["effect"], term["choice"]) for term in version["terms"]]
        _say(f"Model version {version['version']}: {model_name(terms)}")
        for effect, plugin in version["plugins"].items():
            _say(f"  {effect} from {plugin['path']}, SHA-256 {plugin['sha256'][:12]}")


def print_history(rungs: Sequence[Findings]) -> None:
    """The error ladder."""
    table = Table(title="Error ladder", title_justify="left", box=SIMPLE_HEAD, padding=(0, 1))
    table.add_column("version", min_width=44, overflow="fold")
    for column in ("chi2/dof", "error", "held out"):
        table.add_column(column, justify="right", no_wrap=True)
    for rung in rungs:
        entries = rung.get("result") or {}
        left = [
            f"    leaves {number(each['value'])} {each['unit']} of {c}" for c, each in rung.get("rms", {}).items()
        ]
        told = [*left, *(f"    {name} = {short_result(each)}" for name, each in entries.items())]
        _add(
            table,
            "\n".join([f"{rung['version']}: {change_of(rung)}", *told]),
            number(rung["chi2_per_dof"]),
            number(rung["error_fit"]),
            number(rung["error_held_out"]),
        )
    _show(table)
    _dim("error: rms of the whitened residuals, 1.00 = noise; held out: on blocks not used in the fit")
    for rung in rungs:
        if "note" in rung:
            _say(f"version {rung['version']}: not fitted: {rung['note']}")


def short_result(entry: Any) -> str:
    """One entry of a result: value, sigma and unit where it has them."""
    if isinstance(entry, Mapping) and isinstance(entry.get("value"), int | float):
        return quantity(entry["value"], entry.get("sigma"), entry.get("unit", ""))
    return str(entry)


def print_fit(found: Findings) -> None:
    """Parameters and how well they describe the data."""
    rows = [
        [name, quantity(each["value"], each["sigma"]), each["unit"]] for name, each in found["parameters"].items()
    ]
    _print_table(f"Fit of {model_name(found['effects'])}", ["parameter", "value", "unit"], rows)
    _say(comparison_sentence(found))
    _say(f"error {number(found['error_fit'])}, on held-out runs {number(found['error_held_out'])} (1.00 = noise)")


def _print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Nothing without rows; a column in which nothing stands is left out: a table's one channel has no components."""
    if not rows:
        return
    told = [place for place in range(len(columns)) if any(row[place] for row in rows)]
    table = Table(title=Text(title), title_justify="left", padding=(0, 1))
    for place in told:
        name = columns[place]
        table.add_column(name, justify="left" if name in _LEFT else "right", overflow="fold")
    for row in rows:
        _add(table, *(row[place] for place in told))
    _show(table)


def _add(table: Table, *cells: str) -> None:
    """Names hold brackets, which are no markup here."""
    table.add_row(*map(Text, cells))


def _show(table: Table) -> None:
    Console().print(table)


def _say(text: str) -> None:
    Console().print(text, highlight=False, markup=False)


def _dim(text: str) -> None:
    Console().print(text, style="dim", highlight=False, markup=False)


def _list(title: str, lines: Any) -> None:
    told = list(lines)
    if told:
        _say("\n".join([f"{title}:", *(f"  {line}" for line in told)]))
