"""The sensing-axis experiment as the workbench sees it: data, models, candidates, result."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from math import degrees
from typing import Any

import numpy as np

from rigctl.analysis.least_squares import Parameter, Prior
from rigctl.analysis.lines import FoundLine, LineScan, find_lines
from rigctl.analysis.plane import fit_plane
from rigctl.campaign.recording import RunSource
from rigctl.core.errors import ConfigError, DataError, ProcedureError
from rigctl.effects.catalogue import Effect, catalogue, unknown_effect
from rigctl.effects.plugins import Plugin
from rigctl.experiments.sensing_axis.imagined import imagined
from rigctl.experiments.sensing_axis.model.chain import FloatArray, Origins
from rigctl.experiments.sensing_axis.model.components import Stacked, observed, stacked
from rigctl.experiments.sensing_axis.model.fit import mountings_of, null_point
from rigctl.experiments.sensing_axis.model.model import RecordingModel, origins_of
from rigctl.experiments.sensing_axis.model.parameters import family_of
from rigctl.experiments.sensing_axis.model.testable import untestable
from rigctl.experiments.sensing_axis.observe.observables import RunObservables
from rigctl.experiments.sensing_axis.observe.recorded import recorded_calibration
from rigctl.experiments.sensing_axis.observe.reduction import ACCEL
from rigctl.experiments.sensing_axis.observe.set_points import Limits, options
from rigctl.experiments.sensing_axis.observe.store_reduction import Reduction, line_scan, reduction
from rigctl.files.package import HeadSettings
from rigctl.workbench.study import Candidate, Line, Model, NotTestable, Observations, Proposal, Term

LINE = "mains-pickup"
"""The effect that is found in the samples, not in the amplitudes."""

OF_A_MOUNTING = ("theta0", "dc", "delta_x", "delta_y", "delta_z")

_DEGREES = 180.0 / np.pi


class SensingAxisModel:
    """A recording's model with its parameters as files and commands give them: theta0 in degrees, the rest in SI."""

    def __init__(self, inner: RecordingModel, data: Stacked, terms: Sequence[Term]) -> None:
        self.inner = inner
        self.terms = tuple(terms)
        self._data = data
        in_degrees = [parameter.name.startswith("theta0[") for parameter in inner.parameters]
        self._shown = np.where(in_degrees, _DEGREES, 1.0)
        self.parameters: Sequence[Parameter] = tuple(
            _scaled(parameter, float(factor)) for parameter, factor in zip(inner.parameters, self._shown, strict=True)
        )
        self.units: Sequence[str] = tuple(
            "deg" if shown else unit for shown, unit in zip(in_degrees, inner.units, strict=True)
        )
        self.owners: Sequence[str] = tuple(inner.owners)
        self.local: Sequence[bool] = tuple(
            parameter.name.partition("[")[0] in OF_A_MOUNTING for parameter in inner.parameters
        )

    @property
    def observations(self) -> Observations:
        """The data, in the order of predictions."""
        return self._data.observations

    def predict(self, values: FloatArray) -> FloatArray:
        """The data for parameter values of shape (m,); shape (n,)."""
        return observed(self.inner.predict(self.si(values)))[self._data.present]

    def jacobian(self, values: FloatArray) -> FloatArray:
        """d predict / d values, shape (n, m)."""
        return self.slopes(self.inner, self.si(values)) / self._shown

    def slopes(self, model: RecordingModel, values: FloatArray, owners: Sequence[str] | None = None) -> FloatArray:
        """Derivatives of these data for any model of these runs, in SI; shape (n, its parameters)."""
        found = model.jacobian(values, observed, owners=owners)
        return found.reshape(*self._data.present.shape, -1)[self._data.present]

    def si(self, values: FloatArray) -> FloatArray:
        """Parameter values in SI and radians."""
        return np.asarray(values, dtype=np.float64) / self._shown

    def si_covariance(self, covariance: FloatArray) -> FloatArray:
        """Their covariance in SI and radians."""
        return np.asarray(covariance / np.outer(self._shown, self._shown))


class SensingAxisStudy:
    """A recording of the null search, ours or imported, with what `plugins` add to the catalogue.

    Runs are reduced when they are first needed. `ConfigError` when two effects share an id.
    """

    experiment = "sensing-axis"

    def __init__(self, source: RunSource, plugins: Sequence[Plugin] = ()) -> None:
        self._source = source
        added = [effect for plugin in plugins for effect in plugin.effects.values()]
        self.catalogue: Mapping[str, Effect] = catalogue(self.experiment, added)
        self._reductions: dict[tuple[float, ...], Reduction] = {}
        self._scans: dict[tuple[float, ...], LineScan] = {}
        self._package, self._heads, self._g_m_s2 = recorded_calibration(source.header)
        self._imagined: tuple[RunObservables, ...] = ()

    def effects(self) -> dict[str, str]:
        """Every effect that can be added, in the order in which they act: id and the physics in a sentence."""
        return {name: effect.summary for name, effect in self.catalogue.items()}

    @property
    def left_out(self) -> Mapping[str, str]:
        """By run_id, why a valid run could not be reduced."""
        return self._reduced(()).left_out

    def model(self, terms: Sequence[Term]) -> SensingAxisModel:
        """The model with these terms; `ConfigError` for an unknown effect, `DataError` when data for it lack."""
        effects = self.chosen(terms)
        runs = self._reduced(_lines_of(terms)).runs
        if not runs:
            raise DataError("no valid run could be reduced: there is nothing to fit")
        heads = self._placed_heads(runs)
        inner = RecordingModel(runs, self._package, heads, self._g_m_s2, origins=self._origins)
        for effect in effects:
            reason = None if effect.scanned else untestable(effect, inner)
            if reason:
                raise DataError(f"'{effect.id}' cannot be in a model of this recording: {reason}")
        return SensingAxisModel(inner.with_effects(effects), stacked(runs, inner.heads), terms)

    def candidates(self, model: Model, values: FloatArray) -> tuple[list[Candidate], list[NotTestable]]:
        """Every effect that `model` lacks, at the fitted `values`; one of a head appears once per head."""
        here = _own(model)
        refused: list[NotTestable] = []
        asked: list[Effect] = []
        for effect in self._lacking(here.inner):
            reason = untestable(effect, here.inner)
            if reason is None:
                asked.append(effect)
            else:
                refused.append(NotTestable(effect.id, reason))
        whole = here.inner.with_effects(self._in_order([*here.inner.effects, *asked]))
        slopes = here.slopes(whole, _extended(here.inner, whole, here.si(values)), [each.id for each in asked])
        found = []
        for effect in asked:
            for head in self._free_heads(effect, here.inner) if effect.scope == "head" else ("",):
                candidate = self._candidate(effect, head, here.inner, whole, slopes)
                if np.any(candidate.derivative):
                    found.append(candidate)
                elif not head:
                    refused.append(NotTestable(effect.id, "it changes nothing in these runs"))
        return found, refused

    def lines(self, model: Model) -> Sequence[Line]:
        """Steady lines in what the fitted harmonics, and the lines the model has already, leave of the samples."""
        lines_hz = _lines_of(model.terms)
        if lines_hz not in self._scans:
            self._scans[lines_hz] = line_scan(self._source, lines_hz)
        scan = self._scans[lines_hz]
        return [_line(found, scan.shortest_s) for found in find_lines(scan)]

    def result(self, model: Model, values: FloatArray, covariance: FloatArray) -> dict[str, Any]:
        """Every mounting's null; for axes with enough mountings the half-cone deviation at 2 sigma."""
        here = _own(model)
        si, spread = here.si(values), here.si_covariance(covariance)
        nulls = [null_point(here.inner, si, spread, mounting) for mounting in mountings_of(here.inner)]
        shown = {
            f"theta0[{null.axis},{null.configuration},{null.mounting}]": {
                "value": degrees(null.theta0_rad),
                "sigma": degrees(null.theta0_sigma_rad),
                "unit": "deg",
            }
            for null in nulls
        }
        for axis in dict.fromkeys(null.axis for null in nulls):
            vectors = [null.vector_coc for null in nulls if null.axis == axis and null.vector_coc is not None]
            shown.update(_plane(axis, np.array(vectors).reshape(-1, 3), self._package.axes[axis].nominal_axis))
        return shown

    def options(self) -> list[Proposal]:
        """Set-points for the next runs in the mounting that is there; see `set_points.options`."""
        return options(self._reduced(()).runs, self._limits)

    def extended(self, proposals: Sequence[Proposal]) -> SensingAxisStudy:
        """This recording and runs that could be made next, in the mounting that was used last."""
        runs = self._reduced(()).runs
        other = copy.copy(self)
        other._imagined = tuple(imagined(proposals, runs, self._limits))
        other._origins = self._origins if runs else origins_of(other._imagined)
        return other

    @property
    def _limits(self) -> Limits:
        channel = self._source.header.channels.get(ACCEL)
        full_scale_v = channel.full_scale if channel else None
        return Limits(self._package, self._heads, full_scale_v, known=self._source.header.rig_toml is not None)

    @cached_property
    def _origins(self) -> Origins:
        return origins_of(self._reduced(()).runs)

    def _reduced(self, lines_hz: tuple[float, ...]) -> Reduction:
        if lines_hz not in self._reductions:
            self._reductions[lines_hz] = reduction(self._source, lines_hz)
        found = self._reductions[lines_hz]
        return replace(found, runs=(*found.runs, *self._imagined)) if self._imagined else found

    def _placed_heads(self, runs: Sequence[RunObservables]) -> dict[str, HeadSettings]:
        """Heads of which it is known where they stand: without a rig file the face they look at tells it."""
        if self._source.header.rig_toml is not None:
            return dict(self._heads)
        faceless = {head for run in runs for head in run.lasers_m if head not in run.faces}
        return {name: head for name, head in self._heads.items() if name not in faceless}

    def chosen(self, terms: Sequence[Term]) -> list[Effect]:
        """The effects of terms in the order in which they act; several heads of one effect become one."""
        heads: dict[str, list[str]] = {}
        for term in terms:
            if term.effect not in self.catalogue:
                raise unknown_effect(term.effect, self.catalogue)
            named = heads.setdefault(term.effect, [])
            if "head" in term.choice:
                named.append(self._known_head(term))
        return [
            replace(effect, heads=tuple(dict.fromkeys(heads[name]))) if heads[name] else effect
            for name, effect in self.catalogue.items()
            if name in heads
        ]

    def _known_head(self, term: Term) -> str:
        head = str(term.choice["head"])
        if self.catalogue[term.effect].scope != "head":
            raise ConfigError(f"effect '{term.effect}' is not one of a head: leave '{head}' out")
        if head not in self._heads:
            raise ConfigError(f"effect '{term.effect}': no head '{head}'; there are: {', '.join(self._heads)}")
        return head

    def _lacking(self, model: RecordingModel) -> list[Effect]:
        present = {effect.id for effect in model.effects}
        return [
            effect
            for effect in self.catalogue.values()
            if not effect.scanned
            and (effect.id not in present or (effect.scope == "head" and self._free_heads(effect, model)))
        ]

    def _free_heads(self, effect: Effect, model: RecordingModel) -> list[str]:
        """Heads on which an effect might act and in the model does not."""
        taken = {head for each in model.effects if each.id == effect.id for head in model.reach(each)}
        return [head for head in model.reach(effect) if head not in taken]

    def _in_order(self, effects: Sequence[Effect]) -> list[Effect]:
        """One of each id, in the order in which they act; a later one, which has all heads, holds."""
        last = {effect.id: effect for effect in effects}
        return [last[name] for name in self.catalogue if name in last]

    def _candidate(
        self, effect: Effect, head: str, model: RecordingModel, whole: RecordingModel, slopes: FloatArray
    ) -> Candidate:
        taken = {name for each in model.effects if each.id != effect.id for name in each.parameters}
        columns: list[int] = []
        names: list[str] = []
        for name in effect.parameters:
            family = next(each for each in whole.families if each.base == family_of(effect, name, head))
            for column in range(family.first, family.first + family.count):
                label = whole.parameters[column].name.partition("[")[2]
                shown = f"{effect.id}.{name}" if name in taken else name
                columns.append(column)
                names.append(f"{shown}[{label}" if label else shown)
        return Candidate(
            term=Term(effect.id, {"head": head} if head else {}),
            names=tuple(names),
            units=tuple(whole.units[column] for column in columns),
            derivative=slopes[:, columns],
            typical=np.array([effect.typical[_plain(name)] for name in names]),
        )


def _plain(name: str) -> str:
    """A parameter's own name: without the effect's before it and the label behind."""
    return name.partition("[")[0].rpartition(".")[2]


def _extended(model: RecordingModel, whole: RecordingModel, values: FloatArray) -> FloatArray:
    """Values of a model as those of one with more effects, which are absent."""
    known = {family.base: family for family in model.families}
    extended = np.zeros(len(whole.parameters))
    for family in whole.families:
        if family.base in known:
            own = known[family.base]
            extended[family.first : family.first + family.count] = values[own.first : own.first + own.count]
    return extended


def _scaled(parameter: Parameter, factor: float) -> Parameter:
    prior = parameter.prior
    return replace(
        parameter,
        start=parameter.start * factor,
        step=None if parameter.step is None else parameter.step * factor,
        prior=None if prior is None else Prior(prior.mean * factor, prior.sigma * factor),
    )


def _lines_of(terms: Sequence[Term]) -> tuple[float, ...]:
    """Frequencies that are fitted in the samples."""
    return tuple(float(term.choice["frequency_hz"]) for term in terms if "frequency_hz" in term.choice)


def _line(found: FoundLine, duration_s: float) -> Line:
    # Cramer-Rao for a sine of free phase in each run, in terms of the relative uncertainty of its amplitude.
    spread_hz = 3.0**0.5 / (np.pi * duration_s) * found.sigma / found.amplitude
    frequency = {"value": found.frequency_hz, "sigma": float(spread_hz), "unit": "Hz"}
    return Line(
        term=Term(LINE, {"channel": ACCEL, "frequency_hz": found.frequency_hz}),
        channel=ACCEL,
        frequency_hz=found.frequency_hz,
        amplitude=found.amplitude,
        sigma=found.sigma,
        unit="V",
        p_value=found.p_value,
        held_out_error_ratio=found.held_out_error_ratio,
        parameters={
            "amplitude": {"value": found.amplitude, "sigma": found.sigma, "unit": "V"},
            "frequency": {**frequency, "aliases_hz": list(found.aliases_hz)},
        },
    )


def _plane(axis: str, vectors: FloatArray, nominal: FloatArray) -> dict[str, Any]:
    if not np.isfinite(vectors).all():
        return {}
    try:
        plane = fit_plane(vectors, nominal)
    except ProcedureError:
        return {}
    value = plane.std_hc_2sigma_arcsec
    sigma = value / np.sqrt(2.0 * (plane.vectors - 1.0))
    return {f"std_hc_2sigma[{axis}]": {"value": value, "sigma": float(sigma), "unit": "arcsec"}}


def _own(model: Model) -> SensingAxisModel:
    if not isinstance(model, SensingAxisModel):
        raise TypeError("a model of this study is wanted")
    return model
