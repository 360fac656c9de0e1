"""What the workbench found and proposes, for a terminal of 80 columns; findings come as their JSON."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rigctl.report.quantities import counted, number, probability
from rigctl.report.tables.result_table import ResultTable, print_tables
from rigctl.report.tables.workbench import (
    channels_table,
    ladder_table,
    parameters_table,
    ranking_table,
    rms_tables,
    transfer_table,
)
from rigctl.report.verdicts import (
    ADEQUATE_P,
    Findings,
    advice,
    comparison_sentence,
    excluded_sentence,
    inseparable_sentences,
    line_sentence,
    model_name,
    named,
    noise_sentence,
    repeats_sentence,
    scatter_sentences,
    slow_noise_sentences,
    transfer_sentence,
    verdict_sentence,
    warning_sentences,
)

RANKS = 6
"""Ranks that are shown beside the significant ones."""

TRENDS = 8
"""Trends that are shown."""

APART_SIGMA = 3.0
"""Parameters of two stores that are farther apart are shown."""


def print_comparison(comparison: Findings) -> None:
    """The model beside the data: sentence, channels, worst data, trends, lines."""
    model = comparison["model"]
    worst = [[row["run_id"], row["channel"], row["component"], f"{row['sigma']:+.1f}"] for row in comparison["worst"]]
    shown = [
        _text(f"Model version {model['version']}: {model_name(model['effects'])}", comparison_sentence(comparison)),
        _text(excluded_sentence(comparison)),
        _text(noise_sentence(comparison), repeats_sentence(comparison), *scatter_sentences(comparison)),
        channels_table(comparison),
        ResultTable("Farthest from the model", ["run", "channel", "component", "#sigma"], worst),
        _trends(comparison["trends"]),
        _text(*map(line_sentence, comparison["lines"])),
    ]
    if "with" in comparison:
        shown += [_text(transfer_sentence(comparison["with"])), transfer_table(comparison["with"], APART_SIGMA)]
    print_tables(each for each in shown if each.rows or each.notes)


def _trends(trends: Sequence[Findings]) -> ResultTable:
    significant = [row for row in trends if (row["p_value_corrected"] or 0.0) < ADEQUATE_P]
    if not significant:
        return _text("The residuals follow no covariate.")
    rows = [
        [
            *(row[key] for key in ("covariate", "channel", "component")),
            probability(row["p_value_corrected"]),
            number(row["rms_explained"]),
        ]
        for row in significant[:TRENDS]
    ]
    more = [f"and {len(significant) - TRENDS} more: --json has all"] if len(significant) > TRENDS else []
    columns = ["covariate", "channel", "component", "#p corr.", "#explains"]
    return ResultTable("Residuals follow", columns, rows, notes=more)


def print_diagnosis(diagnosis: Findings, store: str) -> None:
    """The verdict first, what to do next, then what it rests on."""
    said_first = (verdict_sentence(diagnosis), f"Next: {advice(diagnosis, store)}", excluded_sentence(diagnosis))
    shown = [_text(*filter(None, said_first), noise_sentence(diagnosis))]
    shown += [_text(*said)] if (said := scatter_sentences(diagnosis)) else []
    shown += [_text(*said)] if (said := slow_noise_sentences(diagnosis)) else []
    shown += [ranking_table(diagnosis, RANKS)] if diagnosis["ranking"] else []
    shown.append(_listed("Cannot be told apart with these data", _inseparable(diagnosis)))
    for title, key in (
        ("Explain it only as nature never has them", "impossible"),
        ("Cannot be tested with these data", "not_testable"),
    ):
        shown.append(_listed(title, [f"{effect}: {reason}" for effect, reason in diagnosis[key].items()]))
    print_tables(each for each in shown if each.rows or each.notes)


def _inseparable(diagnosis: Findings) -> list[str]:
    """What concerns the result or the suggested effects, and how much else there is."""
    concerns = [
        pair
        # A night's catalogue has hundreds of pairs that concern nobody.
        for pair in diagnosis["inseparable"]
        if pair["from"].startswith("baseline:") or {pair["effect"], pair["from"]} & set(diagnosis["suggested"])
    ]
    others = len(diagnosis["inseparable"]) - len(concerns)
    said = inseparable_sentences(concerns)
    if others:
        them = "it" if others == 1 else "them"
        said.append(f"{'and ' if said else ''}{counted(others, 'pair')} of other effects: --json has {them}")
    return said


def print_versions(versions: Sequence[Findings]) -> None:
    """The versions of a model."""
    for version in versions:
        places = version["places"]
        terms = [
            named(term["effect"], {**term["choice"], **places.get(term["effect"], {})}) for term in version["terms"]
        ]
        plugins = [
            f"  {effect} from {p['path']}, SHA-256 {p['sha256'][:12]}" for effect, p in version["plugins"].items()
        ]
        print_tables([_text(f"Model version {version['version']}: {model_name(terms)}", *plugins)])


def print_history(rungs: Sequence[Findings]) -> None:
    """The error ladder."""
    print_tables([*_warnings(rungs), ladder_table(rungs), *rms_tables(rungs)])


def print_fit(fit: Findings) -> None:
    """Parameters and how well they describe the data."""
    excluded = [_text(said)] if (said := excluded_sentence(fit)) else []
    print_tables([*_warnings([fit]), *excluded, parameters_table(fit)])


def _warnings(rungs: Sequence[Findings]) -> list[ResultTable]:
    sentences = warning_sentences(rungs)
    return [_text(*sentences)] if sentences else []


def _text(*lines: str) -> ResultTable:
    return ResultTable("", notes=[line for line in lines if line])


def _listed(title: str, lines: Iterable[str]) -> ResultTable:
    return ResultTable(f"{title}:", notes=[f"  {line}" for line in lines])


SHORT = {"theta_deg": "deg", "frequency_hz": "Hz", "amplitude_mm": "mm", "dwell_s": "s", "temperature_c": "C"}


def print_recommendation(recommendation: Findings) -> None:
    """The promise in words, then the runs in their order."""
    runs = recommendation["runs"]
    print_tables([_text(recommendation["description"]), *([runs_table(runs)] if runs else [])])


def print_outcome(outcome: Findings, store: str) -> None:
    """How an investigation ended."""
    model, added = outcome["model"], outcome["added"]
    saved = f"{counted(outcome['runs'], 'run')}; a full scan has {outcome['full_scan_runs']}"
    lines = (
        f"Verdict: {outcome['verdict']} after {saved}.",
        f"Added: {', '.join(added)}." if added else "Nothing was added.",
        f"Model version {model['version']}: {model_name(model['effects'])}.",
        f"What remains: {outcome['remains']}." if outcome["remains"] else "",
        f"See `rigctl fit {store}` and `rigctl model history {store}`.",
    )
    print_tables([_text(*lines)])


def runs_table(runs: Sequence[Findings]) -> ResultTable:
    """Settings of runs, one row each, in the order in which to make them."""
    names = list(dict.fromkeys(name for run in runs for name in run))
    rows = [[str(place), *(_shown(run.get(name)) for name in names)] for place, run in enumerate(runs, 1)]
    return ResultTable("Runs, in this order", ["#", *(f"#{SHORT.get(name, name)}" for name in names)], rows)


def _shown(value: object) -> str:
    if value is None:
        return ""
    return number(value, 6) if isinstance(value, int | float) else str(value)
