"""The sensing-axis experiment as the workbench sees it: data, models, candidates, result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from math import degrees
from typing import Any, ClassVar

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ConfigError, DataError, ProcedureError
from rigctl.effects.catalogue import Effect
from rigctl.experiments.sensing_axis.model.components import Stacked, stacked
from rigctl.experiments.sensing_axis.model.fit import mountings_of, null_point
from rigctl.experiments.sensing_axis.model.model import RecordingModel
from rigctl.experiments.sensing_axis.observe.courses import courses
from rigctl.experiments.sensing_axis.observe.reduction import ACCEL
from rigctl.experiments.sensing_axis.observe.set_points import options
from rigctl.experiments.sensing_axis.result.result import axis_result
from rigctl.experiments.sensing_axis.study_data import RecordedRuns, ScanData
from rigctl.experiments.sensing_axis.study_model import SensingAxisModel, candidates_of, free_heads, untestable
from rigctl.workbench.study import Candidate, Course, Line, Model, Proposal, Term
from rigctl.workbench.study_base import CatalogueStudy, line_frequencies_hz, own_model, steady_line

LINE = "mains-pickup"
"""The effect that is found in the samples, not in the amplitudes."""


class SensingAxisStudy(CatalogueStudy[ScanData]):
    """A recording of the null search."""

    experiment = "sensing-axis"
    expressions: ClassVar[Mapping[str, str]] = {
        "temperature_c": "run.temperature",
        "start_s": "run.start",
        "approach": "run.approach",
        "theta_deg": "np.degrees(run.theta)",
    }
    drafts: ClassVar[Sequence[str]] = ("1.0", "run.signal", "run.x", "run.v", "run.a", "run.signal**2")

    def reduced_source(self) -> ScanData:
        """The recorded runs; each set of fitted lines is reduced when it is asked for."""
        return ScanData(RecordedRuns(self.source))

    @property
    def left_out(self) -> Mapping[str, str]:
        """By run_id, why a valid run could not be reduced."""
        return self.data.recorded.reduction(()).left_out

    def model(self, terms: Sequence[Term]) -> SensingAxisModel:
        """The model with these terms; `ConfigError` for an unknown effect, `DataError` when data for it lack."""
        effects = self.chosen(terms)
        lines_hz = line_frequencies_hz(terms)
        # The same data in every model: what is worked out from them alone is worked out once.
        if lines_hz not in self._without_effects:
            self._without_effects[lines_hz] = self._baseline(lines_hz)
        inner, data = self._without_effects[lines_hz]
        for effect in effects:
            reason = None if effect.scanned else untestable(effect, inner)
            if reason:
                raise DataError(f"'{effect.id}' cannot be in a model of this recording: {reason}")
        return SensingAxisModel(inner.with_effects(effects), data, terms)

    @cached_property
    def _without_effects(self) -> dict[tuple[float, ...], tuple[RecordingModel, Stacked]]:
        """Baseline and data by the lines that were fitted in the samples."""
        return {}

    def _baseline(self, lines_hz: tuple[float, ...]) -> tuple[RecordingModel, Stacked]:
        runs = self.data.runs(lines_hz)
        if not runs:
            raise DataError("no valid run could be reduced: there is nothing to fit")
        recorded, heads = self.data.recorded, self.data.placed_heads(runs)
        inner = RecordingModel(runs, recorded.package, heads, recorded.g_m_s2, origins=self.data.origins)
        return inner, stacked(runs, inner.heads)

    def chosen(self, terms: Sequence[Term]) -> list[Effect]:
        """The effects of terms in the order in which they act; several heads of one effect become one."""
        heads: dict[str, list[str]] = {}
        effects = super().chosen(terms)
        for term in terms:
            if "head" in term.choice:
                heads.setdefault(term.effect, []).append(self._known_head(term))
        return [
            replace(effect, heads=tuple(dict.fromkeys(heads[effect.id]))) if effect.id in heads else effect
            for effect in effects
        ]

    def _known_head(self, term: Term) -> str:
        head, known = str(term.choice["head"]), self.data.recorded.heads
        if self.catalogue[term.effect].scope != "head":
            raise ConfigError(f"effect '{term.effect}' is not one of a head: leave '{head}' out")
        if head not in known:
            raise ConfigError(f"effect '{term.effect}': no head '{head}'; there are: {', '.join(known)}")
        return head

    def lacking(self, model: Model) -> list[Effect]:
        """Those that are not in the model, and those of heads that are there for other heads only."""
        inner = own_model(model, SensingAxisModel).inner
        present = {effect.id for effect in inner.effects}
        return [
            effect
            for effect in self.catalogue.values()
            if not effect.scanned
            and (effect.id not in present or (effect.scope == "head" and free_heads(effect, inner)))
        ]

    def untestable(self, effect: Effect, model: Model) -> str | None:
        """Why the runs of `model` cannot be asked about an effect; None when they can."""
        return untestable(effect, own_model(model, SensingAxisModel).inner)

    def candidates_for(self, effects: Sequence[Effect], model: Model, values: FloatArray) -> list[list[Candidate]]:
        """One candidate per effect; of an effect on a head, one per head."""
        return candidates_of(effects, self.catalogue, own_model(model, SensingAxisModel), values)

    def lines(self, model: Model) -> Sequence[Line]:
        """Steady lines in what the fitted harmonics, and the lines the model has already, leave of the samples."""
        from rigctl.analysis.lines import find_lines  # which a result does without

        scan = self.data.recorded.line_scan(line_frequencies_hz(model.terms))
        lines = []
        for line in find_lines(scan):
            term = Term(LINE, {"channel": ACCEL, "frequency_hz": line.frequency_hz})
            lines.append(steady_line(line, term, ACCEL, "V", scan.shortest_s))
        return lines

    def result(self, model: Model, values: FloatArray, covariance: FloatArray) -> dict[str, Any]:
        """Every mounting's null; for axes with enough mountings the half-cone deviation at 2 sigma."""
        here = own_model(model, SensingAxisModel)
        si, si_covariance = here.si(values), here.si_covariance(covariance)
        nulls = [null_point(here.inner, si, si_covariance, mounting) for mounting in mountings_of(here.inner)]
        shown = {
            f"theta0[{null.label}]": {
                "value": degrees(null.theta0_rad),
                "sigma": degrees(null.theta0_sigma_rad),
                "unit": "deg",
            }
            for null in nulls
        }
        for axis in dict.fromkeys(null.axis for null in nulls):
            try:
                plane = axis_result(axis, here.inner.package, [null for null in nulls if null.axis == axis]).plane
            except ProcedureError:
                continue
            value = plane.std_hc_2sigma_arcsec
            # A standard deviation is known to 1 / sqrt(2 dof) of itself.
            sigma = float(plane.hc_unbiased * value / np.sqrt(2.0 * plane.dof))
            shown[f"std_hc_2sigma[{axis}]"] = {"value": value, "sigma": sigma, "unit": "arcsec"}
        return shown

    def options(self) -> list[Proposal]:
        """Set-points for the next runs in the mounting that is there; see `set_points.options`."""
        return options(self.data.runs(), self.data.recorded.limits)

    def courses(self) -> list[Course]:
        """Orders and times at which to measure again in the mounting that is there; see `observe.courses`."""
        return courses(self.data.runs())

    def extended(self, proposals: Sequence[Proposal]) -> SensingAxisStudy:
        """This recording and runs that could be made next, in the mounting that was used last."""
        return self.with_data(self.data.with_proposals(proposals))
