"""What a notebook shows of findings: the sentences, tables and figures of a report, and frames to go on with.

Each is the finding itself, with `plot` and `frame` beside its own attributes. A plot is a `Plate`: its rows are data,
and `plate.svg` is the figure as SVG.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rigctl.analysis.measurement_result import MeasurementResult
from rigctl.core.errors import DataError
from rigctl.core.extra import needed
from rigctl.report import html
from rigctl.report.document import result_pieces
from rigctl.report.figures.data import Plate
from rigctl.report.figures.residuals import ResidualRow, clearest_first, residual_plate
from rigctl.report.figures.workbench import LadderRow, RankRow, ladder_plate, ranking_plate
from rigctl.report.quantities import number
from rigctl.report.tables.result_table import ResultTable
from rigctl.report.tables.workbench import channels_table, ladder_table, parameters_table, ranking_table, rms_tables
from rigctl.report.verdicts import (
    comparison_sentence,
    excluded_sentence,
    noise_sentence,
    scatter_sentences,
    verdict_sentence,
)
from rigctl.workbench.findings import Comparison, Diagnosis, ModelFit
from rigctl.workbench.workbench import Workbench

if TYPE_CHECKING:
    from pandas import DataFrame

_RANKS = 8

_Part = str | ResultTable | Plate[Any]


@dataclass(frozen=True, repr=False)
class ShownComparison(Comparison):
    """A comparison, shown."""

    def plot(self, covariate: str | None = None) -> Plate[ResidualRow]:
        """The residuals against a covariate, by default that which they follow most clearly; `DataError`."""
        covariate = covariate or next(iter(clearest_first(self)), None)
        if covariate is None:
            raise DataError("no condition varies from run to run; name one to plot against: plot(COVARIATE)")
        return residual_plate(covariate, [self])

    def frame(self) -> DataFrame:
        """A row of pandas for each datum: run, channel, component, whitened residual, covariates of its run."""
        given = self.observations
        series = [given.series[place] for place in given.series_of]
        columns = {
            "run_id": [given.run_ids[place] for place in given.run_of],
            "channel": [each.channel for each in series],
            "component": [each.component for each in series],
            "residual_sigma": self.residuals,
        }
        covariates = {name: _words(given.of_runs(name), given.levels.get(name)) for name in given.covariates}
        return _frame({**covariates, **columns})

    def _repr_html_(self) -> str:
        found = self.as_json()
        said = [
            comparison_sentence(found),
            excluded_sentence(found),
            noise_sentence(found),
            *scatter_sentences(found),
        ]
        parts: list[_Part] = [*said, channels_table(found)]
        return _page([*parts, self.plot()] if self.observations.covariates else parts)


@dataclass(frozen=True, repr=False)
class ShownDiagnosis(Diagnosis):
    """A diagnosis, shown."""

    def plot(self) -> Plate[RankRow]:
        """The candidates by how significant they are."""
        return ranking_plate(self.as_json())

    def frame(self) -> DataFrame:
        """A row of pandas for each candidate, the first of the ranking on top."""
        names = ("effect", "p_value", "p_value_corrected", "chi2_fall", "held_out_error_ratio", "keep")
        ranks = [each.as_json() for each in self.ranking]
        return _frame({name: [rank[name] for rank in ranks] for name in names})

    def _repr_html_(self) -> str:
        found = self.as_json()
        parts: list[_Part] = [verdict_sentence(found), excluded_sentence(found), noise_sentence(found)]
        return _page([*parts, ranking_table(found, _RANKS), self.plot()] if self.ranking else parts)


@dataclass(frozen=True, repr=False)
class ShownFit(ModelFit):
    """A fit, shown."""

    def frame(self) -> DataFrame:
        """A row of pandas for each parameter, by its name: value, standard uncertainty, unit."""
        known = self.parameters.values()
        columns = {
            "value": [each.value for each in known],
            "sigma": [each.sigma for each in known],
            "unit": [each.unit for each in known],
        }
        return _frame(columns, list(self.parameters), "parameter")

    def _repr_html_(self) -> str:
        return _page([*self.warnings, parameters_table(self.as_json())])


class Ladder(list[dict[str, Any]]):
    """The error ladder: what `rigctl model history --json` gives, shown."""

    def plot(self) -> Plate[LadderRow]:
        """The errors by version, on fitted and on held-out runs."""
        return ladder_plate(self)

    def frame(self) -> DataFrame:
        """A row of pandas for each version."""
        names = ("added", "removed", "chi2_per_dof", "error_fit", "error_held_out")
        versions = [rung["version"] for rung in self]
        return _frame({name: [rung[name] for rung in self] for name in names}, versions, "version")

    def _repr_html_(self) -> str:
        return _page([ladder_table(self), *rms_tables(self), self.plot()])


@dataclass(frozen=True, repr=False)
class ShownMeasurement(MeasurementResult):
    """A measurement result, shown with its budget."""

    def frame(self) -> DataFrame:
        """A row of pandas for each quantity: value, unit, standard uncertainty with its degrees of freedom, coverage
        factor and expanded uncertainty; then a column for the part of each source."""
        columns = {
            "value": self.values,
            "unit": [each.unit for each in self.quantities],
            "u": self.standard_uncertainty,
            "dof": self.effective_dof,
            "k": self.coverage_factor,
            "U": self.coverage_factor * self.standard_uncertainty,
        }
        parts = {f"u by {source.name}": source.standard_uncertainty for source in self.sources}
        return _frame({**columns, **parts}, [each.name for each in self.quantities], "quantity")

    def _repr_html_(self) -> str:
        expanded = self.coverage_factor * self.standard_uncertainty
        known = zip(self.quantities, self.values, expanded, self.coverage_factor, self.effective_dof, strict=True)
        quantities = [
            [each.name, f"{value:.10g}", number(u, 2), each.unit, number(k), number(dof)]
            for each, value, u, k, dof in known
        ]
        budget = [
            [source.name, source.type, number(source.dof), *(number(u, 2) for u in source.standard_uncertainty)]
            for source in self.sources
        ]
        parts = [f"#u of {each.name}" for each in self.quantities]
        return _page(
            [
                ResultTable("Result", ["quantity", "#value", "#U (95 %)", "unit", "#k", "#dof"], quantities),
                ResultTable("Budget", ["source", "type", "#dof", *parts], budget, notes=self.remarks),
            ]
        )


@dataclass(frozen=True)
class ShownResult:
    """A store's result as a report has it: pieces of HTML, tables and figures."""

    pieces: tuple[str, ...]

    def _repr_html_(self) -> str:
        return "\n".join(self.pieces)


def shown_comparison(found: Comparison) -> ShownComparison:
    """The same, shown."""
    return ShownComparison(**vars(found))


def shown_diagnosis(found: Diagnosis) -> ShownDiagnosis:
    """The same, shown."""
    return ShownDiagnosis(**vars(found))


def shown_fit(found: ModelFit) -> ShownFit:
    """The same, shown."""
    return ShownFit(**vars(found))


def shown_measurement(found: MeasurementResult) -> ShownMeasurement:
    """The same, shown."""
    return ShownMeasurement(**vars(found))


def shown_result(workbench: Workbench) -> ShownResult:
    """What a store amounts to, as its report shows it."""
    # A notebook's page has no paper of that name.
    return ShownResult(tuple(piece.replace("var(--paper)", "none") for piece in result_pieces(workbench)))


def _page(parts: Iterable[_Part]) -> str:
    """Sentences, tables and figures one after the other."""
    return "\n".join(_pieces(parts))


def _pieces(parts: Iterable[_Part]) -> Iterator[str]:
    for part in parts:
        if isinstance(part, Plate):
            yield part._repr_html_()
        elif isinstance(part, ResultTable):
            yield html.table(part)
        elif part:
            yield html.paragraph(part)


def _words(values: Any, levels: Sequence[str] | None) -> Any:
    """A covariate of words as words; "" for none."""
    if not levels:
        return values
    return [levels[int(value)] if np.isfinite(value) else "" for value in values]


def _frame(columns: dict[str, Any], index: Sequence[Any] | None = None, name: str | None = None) -> DataFrame:
    pandas = needed("pandas")
    frame: DataFrame = pandas.DataFrame(columns, index=None if index is None else pandas.Index(index, name=name))
    return frame
