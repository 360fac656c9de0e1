"""The report on a store: what is known of its model, gathered once and written as a page, as figures, or both."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rigctl.campaign.status import repeats_in
from rigctl.campaign.store.store import Store
from rigctl.core.errors import UNFIT, ConfigError
from rigctl.core.experiments import of_readings
from rigctl.report import html
from rigctl.report.drawn import Drawn, drawing_of
from rigctl.report.figure_script import HINT, SCRIPT, STYLE
from rigctl.report.figures.data import Plate, file_name, write_plates
from rigctl.report.figures.residuals import clearest_first, residual_plate
from rigctl.report.figures.workbench import ladder_plate, ranking_plate
from rigctl.report.opening import calibrated
from rigctl.report.quantities import counted
from rigctl.report.status_lines import repeats_line
from rigctl.report.tables.result_table import ResultTable
from rigctl.report.tables.workbench import channels_table, ladder_tables, parameters_table, ranking_table, rms_tables
from rigctl.report.verdicts import (
    advice,
    comparison_sentence,
    excluded_sentence,
    inseparable_sentences,
    line_sentence,
    model_name,
    repeats_sentence,
    scatter_sentences,
    slow_noise_sentences,
    verdict_sentence,
    warning_sentences,
)
from rigctl.workbench.findings import Comparison
from rigctl.workbench.model import versions
from rigctl.workbench.workbench import ALPHA, Workbench

SIDE_BY_SIDE = 3
"""Versions whose residuals stand side by side: the first, the last, and what lies between."""

SHOWN_COVARIATES = 8
"""Covariates shown in the page, those that residuals follow most clearly; --figures writes all."""

MOST_ROWS = 60
"""Rows of a table that a report opens with: a longer one is looked up, not read."""

MAX_RANKS = 16
"""Candidates in the table, beside the significant ones."""

Tell = Callable[[str], None]


@dataclass(frozen=True)
class Evidence:
    """Everything a report shows; `drawn` is what the experiment adds."""

    store: Store
    rungs: Sequence[Mapping[str, Any]]
    comparisons: Sequence[Comparison]
    diagnosis: Mapping[str, Any]
    fit: Mapping[str, Any]
    ladder: Plate[Any]
    rankings: Sequence[Plate[Any]]
    covariates: Sequence[str]
    drawn: Drawn

    def residuals(self, covariates: Sequence[str]) -> list[Plate[Any]]:
        """Figures of the residuals against some of the `covariates`."""
        return [residual_plate(covariate, self.comparisons) for covariate in covariates]

    @property
    def plates(self) -> list[Plate[Any]]:
        """All figures."""
        return [
            self.ladder,
            *self.residuals(self.covariates),
            *self.drawn.spectra,
            *self.rankings,
            *self.drawn.plates,
        ]


def write_report(bench: Workbench, out: Path | None, figures: Path | None, tell: Tell) -> list[Path]:
    """Write the page to `out` and the figures into `figures`, where given; returns what was written.

    The page is there whole or not at all. Raises `DataError` when it cannot be written.
    """
    if out is not None:
        html.require_directory(out)
    # A study has no runs to compare and diagnose, but a result to show.
    drawn = _without_runs(bench)
    if drawn is None:
        evidence = gather(bench, tell)
        plates, left_out = evidence.plates if figures else [], evidence.drawn.left_out
        text = page(evidence) if out else ""
    else:
        plates, left_out, text = list(drawn.plates), drawn.left_out, study_page(bench.store, drawn) if out else ""
    written = write_plates(plates, left_out, figures) if figures else []
    if out is not None:
        html.write_page(out, text)
        written = [out, *written]
    return written


def _without_runs(bench: Workbench) -> Drawn | None:
    """What a store without runs amounts to, such as a study of simulated draws; None where there is no such thing."""
    if bench.store.runs(valid_only=True):
        return None
    try:
        drawn = drawing_of(bench.store.header.experiment, bench.store.path).draw(bench, (), ())
    except UNFIT:
        return None
    return drawn if drawn.result else None


def gather(bench: Workbench, tell: Tell) -> Evidence:
    """Fit, compare and diagnose what has not been; everything is kept in the store."""
    store, current = bench.store, bench.current
    rungs = bench.history(tell)
    comparisons = [bench.compare(version) for version in _side_by_side(bench, rungs, tell)]
    tell("diagnosing")
    diagnosis = bench.diagnosis(ALPHA, tell)
    tell("drawing")
    last = comparisons[-1]
    lines_hz = [float(term.choice["frequency_hz"]) for term in current.terms if "frequency_hz" in term.choice]
    return Evidence(
        store,
        rungs,
        comparisons,
        diagnosis,
        fit=bench.model_fit(),
        ladder=ladder_plate(rungs),
        rankings=[ranking_plate(diagnosis)] if diagnosis["ranking"] else [],
        covariates=clearest_first(comparisons[0]),
        drawn=_drawn(bench, lines_hz, last.lines),
    )


def _drawn(bench: Workbench, lines_hz: Sequence[float], missing: Sequence[Any]) -> Drawn:
    try:
        return drawing_of(bench.store.header.experiment, bench.store.path).draw(bench, lines_hz, missing)
    # A report is written all the same: the model may be judged where no result can be had.
    except UNFIT as error:
        return Drawn(left_out={"result": str(error)})


def _side_by_side(
    bench: Workbench, rungs: Sequence[Mapping[str, Any]], tell: Tell
) -> Iterator[versions.ModelVersion]:
    """The first version, the current one and the latest between, as far as they have a fit and their plugins."""
    usable, unfitted = [], {rung["version"] for rung in rungs if "note" in rung}
    for version in versions.versions(bench.store):
        if version.version in unfitted:
            continue
        try:
            usable.append(bench.version(version.version))
        # A version whose plug-in is not there cannot be evaluated; the others can.
        except ConfigError as error:
            tell(str(error))
    # The first and the latest ones: what lies between tells least.
    chosen = usable if len(usable) <= SIDE_BY_SIDE else [usable[0], *usable[1 - SIDE_BY_SIDE :]]
    for version in chosen:
        tell(f"comparing version {version.version}")
        yield version


def study_page(store: Store, drawn: Drawn) -> str:
    """The report on a store that has a result and no runs."""
    title = store.header.title or store.path.name
    result, details = _parted(_tables(store, drawn))
    body = [
        html.heading(title, 1),
        html.paragraph(f"{store.header.experiment}; {store.path.name}", "soft"),
        *_calibrated(store),
        html.heading("Result"),
        *_shown(result),
        *_left_out(drawn),
        *_figures(drawn),
        *_details(details),
    ]
    return html.page(title, body, STYLE, SCRIPT)


def page(evidence: Evidence) -> str:
    """The report as one HTML document: what was calibrated, the result and the verdict, then the evidence."""
    store, diagnosis, headline = evidence.store, evidence.diagnosis, _headline(evidence.rungs)
    title, name = store.header.title or store.path.name, store.path.name
    repeated = repeats_line(repeats_in(store))
    parameters = parameters_table(evidence.fit)
    # An experiment without a result of its own has its parameters as the result.
    result, details = _parted(_tables(store, evidence.drawn) or [parameters])
    body = [
        html.heading(title, 1),
        html.paragraph(
            f"{store.header.experiment}, {_amount(evidence)}; "
            f"model version {headline['version']}: {model_name(headline['effects'])}; {name}",
            "soft",
        ),
        *_calibrated(store),
        *([html.paragraph(f"Runs: {repeated}.", "soft")] if repeated else []),
        *map(html.paragraph, _warned(evidence.rungs)),
        html.paragraph(verdict_sentence(diagnosis), f"verdict {diagnosis['verdict']}"),
        html.heading("Result"),
        *_shown(result),
        *_left_out(evidence.drawn),
        html.paragraph("What to do next:", "soft"),
        html.command(advice(diagnosis, name)),
        *map(html.paragraph, slow_noise_sentences(diagnosis)),
        *_figures(evidence.drawn),
        html.heading("Error ladder"),
        # One version makes no ladder; its numbers stand in the table.
        *([html.figure(evidence.ladder)] if len(evidence.rungs) > 1 else []),
        *map(html.table, [*ladder_tables(evidence.rungs), *rms_tables(evidence.rungs)]),
        html.heading("Residuals"),
        *_residuals(evidence),
    ]
    if evidence.drawn.spectra:
        body += [html.heading("What is left in the samples"), *map(html.figure, evidence.drawn.spectra)]
    body += [html.heading("Candidates"), *_candidates(evidence)]
    told = parameters.columns in [each.columns for each in (*result, *details)]
    body += _details([*details, *([] if told else [parameters])])
    return html.page(title, body, STYLE, SCRIPT)


def _calibrated(store: Store) -> list[str]:
    return [html.paragraph(said) for said in calibrated(store) if said] + [html.paragraph(HINT, "soft hint")]


def _tables(store: Store, drawn: Drawn) -> list[ResultTable]:
    return list(drawing_of(store.header.experiment, store.path).tables(drawn.result, {})) if drawn.result else []


def _parted(tables: Sequence[ResultTable]) -> tuple[list[ResultTable], list[ResultTable]]:
    """What a report opens with, and what is looked up: long tables, and what uncertainties are made of."""
    opening = [each for each in tables if each.printed and each.tab != "Budget" and len(each.rows) <= MOST_ROWS]
    return opening, [each for each in tables if each not in opening]


def _shown(tables: Sequence[ResultTable]) -> Iterator[str]:
    for each in tables:
        if each.title:
            yield html.paragraph(each.title)
        yield html.table(each)


def _details(tables: Sequence[ResultTable]) -> list[str]:
    return [html.heading("Details of the result"), *_shown(tables)] if tables else []


def _left_out(drawn: Drawn) -> Iterator[str]:
    yield html.listing(f"{what}: {reason}" for what, reason in drawn.left_out.items())


def _figures(drawn: Drawn) -> list[str]:
    shown = _distinct(drawn.plates)
    return [html.heading("The result in figures"), *map(html.figure, shown)] if shown else []


def _headline(rungs: Sequence[Mapping[str, Any]]) -> Mapping[str, Any]:
    """The last version that nothing speaks against; the current one where there is none."""
    return next((rung for rung in reversed(rungs) if not rung.get("warnings")), rungs[-1])


def _warned(rungs: Sequence[Mapping[str, Any]]) -> list[str]:
    """What speaks against the current version, and which one the headline stays with."""
    warned, headline = warning_sentences(rungs[-1:]), _headline(rungs)
    if headline is not rungs[-1]:
        warned.append(f"Nothing speaks against version {headline['version']}.")
    return warned


def _amount(evidence: Evidence) -> str:
    # Some experiments make several blocks of data of a run: runs are those of the store.
    data, runs = len(evidence.comparisons[-1].observations.value), len(evidence.store.runs(valid_only=True))
    if of_readings(evidence.store.header.experiment):
        return counted(data, "reading")
    return f"{counted(data, 'datum', 'data')} of {counted(runs, 'run')}"


def _residuals(evidence: Evidence) -> Iterator[str]:
    last = evidence.comparisons[-1].as_json()
    yield html.paragraph(comparison_sentence(last))
    yield from map(html.paragraph, filter(None, [excluded_sentence(last)]))
    yield from (html.paragraph(said, "soft") for said in [repeats_sentence(last), *scatter_sentences(last)] if said)
    yield html.table(channels_table(last))
    yield from map(html.figure, evidence.residuals(evidence.covariates[:SHOWN_COVARIATES]))
    if more := ", ".join(map(file_name, evidence.covariates[SHOWN_COVARIATES:])):
        yield html.paragraph(f"Not shown, as the residuals follow them less: {more}.", "soft")
    yield html.listing(line_sentence(line) for line in last["lines"])


def _candidates(evidence: Evidence) -> Iterator[str]:
    diagnosis = evidence.diagnosis
    if evidence.rankings:
        yield from map(html.figure, evidence.rankings)
        yield html.table(ranking_table(diagnosis, MAX_RANKS))
    if diagnosis["inseparable"]:
        yield html.heading("Cannot be told apart with these data", 3)
        yield html.listing(inseparable_sentences(diagnosis["inseparable"]))
    for title, key in (
        ("Explain it only as nature never has them", "impossible"),
        ("Cannot be tested with these data", "not_testable"),
    ):
        if diagnosis[key]:
            yield html.heading(title, 3)
            yield html.listing(f"{effect}: {reason}" for effect, reason in diagnosis[key].items())


def result_pieces(bench: Workbench) -> Iterator[str]:
    """The tables and figures of a store's result."""
    lines_hz = [float(term.choice["frequency_hz"]) for term in bench.current.terms if "frequency_hz" in term.choice]
    drawn = _drawn(bench, lines_hz, ())
    yield from _shown(_tables(bench.store, drawn))
    yield from map(html.figure, _distinct(drawn.plates))
    yield from _left_out(drawn)


def _distinct(plates: Sequence[Plate[Any]]) -> list[Plate[Any]]:
    """Without those that show what an earlier one shows: the paper's figure 12 is that of one of the mountings."""
    return [plate for i, plate in enumerate(plates) if all(plate.rows != earlier.rows for earlier in plates[:i])]
