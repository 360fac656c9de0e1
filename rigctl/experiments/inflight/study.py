"""An in-flight calibration as the workbench sees it."""

from __future__ import annotations

import copy
import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from rigctl.analysis.least_squares import Parameter
from rigctl.campaign.recording import KeepsReductions, RunSource
from rigctl.core.errors import ConfigError, DataError
from rigctl.core.interfaces import FloatArray
from rigctl.effects.catalogue import Effect, catalogue, unknown_effect
from rigctl.experiments.inflight.imagined import stronger
from rigctl.experiments.inflight.model.baseline import NUISANCES, Baseline, Stretch
from rigctl.experiments.inflight.model.flight import Reducer
from rigctl.experiments.inflight.model.parameters import NAMES
from rigctl.experiments.inflight.observe.found import level_found, line_found, loudness, pulses_found
from rigctl.experiments.inflight.observe.kept_scan import scan_from_bytes, scan_to_bytes
from rigctl.experiments.inflight.observe.observed import Observed, observed
from rigctl.experiments.inflight.observe.recorded import (
    RECIPE,
    Reduction,
    orbit_period_of,
    reduced_without,
    reduction,
)
from rigctl.experiments.inflight.observe.reduction import ReducedRun
from rigctl.experiments.inflight.observe.samples import RunScan, covered, scan
from rigctl.experiments.inflight.observe.weights import ComplexArray
from rigctl.workbench.study import (
    Candidate,
    Line,
    Model,
    NoisePool,
    NotTestable,
    Observations,
    Proposal,
    Series,
    Term,
)

if TYPE_CHECKING:
    from rigctl.effects.plugins import Plugin

DIFFERENTIAL, OWN = "2 m_dx", "own channel"

INSEPARABLE: Mapping[str, tuple[str, ...]] = {
    "tracker-bias": ("ac12_rad", "ac13_rad", "ac11_dx_m", "ac11_dz_m"),
    "orbit-dating": ("ac13_rad", "ac11_dx_m", "ac11_dz_m"),
}
"""Effects that no session can tell from these parameters, whatever its data: by geometry."""

COMMON: Mapping[str, str] = {
    "thrust-quantisation": "it moves both masses alike, and only their difference is compared",
    "mass-drift": "it moves both masses alike, and only their difference is compared",
    "moved-mass-reaction": "it moves both masses alike, and only their difference is compared",
    "spring-noise": "it raises the noise, which is measured in each run and not predicted",
}
"""Effects without a part in the differential channel's lines."""

PULSES, LEVEL, LINE = "glitches", "noise-level", "steady-line"
"""Effects that are looked for in the samples."""

SHOWN_P = 0.01
"""What the samples show is spoken of when noise does so less often."""

STRONGER = 2.0
"""What may be injected next, over what was."""

_IN_SAMPLES = (PULSES, LEVEL, LINE)
_LINEAR = 1e-6
_STEP = 1e-3


class InflightModel:
    """Baseline and effects for the lines of all halves; a `rigctl.workbench.study.Model`."""

    def __init__(self, study: InflightStudy, terms: Sequence[Term], effects: Sequence[Effect]) -> None:
        self._study, self._effects = study, tuple(effects)
        self.terms: tuple[Term, ...] = tuple(terms)
        baseline = study.baseline
        self._own = [(effect, name) for effect in effects for name in effect.parameters]
        self.parameters: Sequence[Parameter] = (
            *baseline.parameters,
            *(
                Parameter(_shown(effect, name, effects), 0.0, step=_STEP * effect.typical[name])
                for effect, name in self._own
            ),
        )
        self.units: Sequence[str] = (*baseline.units, *(effect.parameters[name] for effect, name in self._own))
        self.owners: Sequence[str] = (*("" for _ in baseline.parameters), *(effect.id for effect, _ in self._own))
        self.local: Sequence[bool] = tuple(
            parameter.name.startswith("inverse_gain[") for parameter in self.parameters
        )

    @property
    def study(self) -> InflightStudy:
        """The study whose data it predicts."""
        return self._study

    @property
    def observations(self) -> Observations:
        """The data, in the order of predictions."""
        return self._study.observations

    def predict(self, values: FloatArray) -> FloatArray:
        """The data for parameter values of shape (m,); shape (n,)."""
        shared, changes = self._split(values)
        return np.asarray(self.observations.value - self._study.baseline.residual(shared, changes))

    def jacobian(self, values: FloatArray) -> FloatArray:
        """d predict / d values, shape (n, m)."""
        shared, changes = self._split(values)
        baseline = self._study.baseline
        columns = [-baseline.jacobian(shared, changes)]
        at = len(shared)
        for effect in self._effects:
            own = values[at : at + len(effect.parameters)]
            for derivative in self._study.derivatives(effect, own):
                columns.append(baseline.shift(shared, derivative)[:, None])
            at += len(effect.parameters)
        return np.hstack(columns)

    def _split(self, values: FloatArray) -> tuple[FloatArray, list[ComplexArray] | None]:
        """The baseline's values, and what the effects do to the amplitudes of all halves."""
        count = len(self._study.baseline.parameters)
        total: list[ComplexArray] | None = None
        at = count
        for effect in self._effects:
            made = self._study.changes(effect, values[at : at + len(effect.parameters)])
            total = made if total is None else [a + b for a, b in zip(total, made, strict=True)]
            at += len(effect.parameters)
        return values[:count], total


class InflightStudy:
    """A recording of calibration sessions, ours or imported, with what `plugins` add to the catalogue.

    Runs are reduced when first needed, and by a store kept. `ConfigError` when two effects share an id, `DataError`
    when no run can be used.
    """

    experiment = "inflight-calibration"

    def __init__(self, source: RunSource, plugins: Sequence[Plugin] = ()) -> None:
        self._source = source
        added = [effect for plugin in plugins for effect in plugin.effects.values()]
        self.catalogue: Mapping[str, Effect] = catalogue(self.experiment, added)
        self._masked: Mapping[str, FloatArray] = {}
        self._levels: Mapping[str, RunScan] = {}
        self._kept: dict[tuple[str, tuple[float, ...]], list[ComplexArray]] = {}
        self._units: dict[str, list[list[ComplexArray]] | None] = {}

    def effects(self) -> dict[str, str]:
        """Every effect that can be added: id and the physics in a sentence."""
        return {name: effect.summary for name, effect in self.catalogue.items()}

    @property
    def constants(self) -> Mapping[str, float]:
        """What the recorder believed."""
        return self._source.header.constants

    @property
    def left_out(self) -> Mapping[str, str]:
        """By run_id, why a valid run could not be reduced."""
        return self.reduced.left_out

    @cached_property
    def reduced(self) -> Reduction:
        """The valid runs."""
        found = reduction(self._source)
        if not found.runs:
            why = next(iter(found.left_out.values()), "there is no valid run")
            raise DataError(f"no run of this recording can be used: {why}")
        return found

    @cached_property
    def observed(self) -> Observed:
        """The runs with their noise."""
        return observed(self.reduced.runs)

    @cached_property
    def baseline(self) -> Baseline:
        """Of all halves."""
        return Baseline([self._loud(stretch, place) for place, stretch in enumerate(self.observed.stretches())])

    def _loud(self, stretch: Stretch, place: int) -> Stretch:
        if stretch.run_id not in self._levels:
            return stretch
        half = [each for run in self.reduced.runs for each in run.halves][place]
        return replace(stretch, sigma=stretch.sigma * loudness(self._levels[stretch.run_id], half))

    @cached_property
    def observations(self) -> Observations:
        """Lines of all halves, each half a run of its own and a block."""
        return _observations(self.observed, self.baseline)

    def model(self, terms: Sequence[Term]) -> InflightModel:
        """The model with these terms; `ConfigError` for an unknown effect, `DataError` when data for it lack."""
        named = {term.effect for term in terms}
        for name in named:
            if name not in self.catalogue:
                raise unknown_effect(name, self.catalogue)
        if len(named) < len(terms):
            raise ConfigError("an effect is in the model twice; name it once")
        here = self._without_pulses if PULSES in named else self
        here = here._by_level if LEVEL in named else here
        effects = [each for name, each in self.catalogue.items() if name in named and name not in _IN_SAMPLES]
        for effect in effects:
            if reason := here._untestable(effect):
                raise DataError(f"'{effect.id}' cannot be in a model of this recording: {reason}")
        return InflightModel(here, terms, effects)

    def candidates(self, model: Model, values: FloatArray) -> tuple[list[Candidate], list[NotTestable]]:
        """Every effect that `model` lacks, at the fitted `values`."""
        here = _own(model).study
        there = {term.effect for term in model.terms}
        shared = np.asarray(values[: len(self.baseline.parameters)])
        beside = [effect for effect in self.catalogue.values() if effect.id in there]
        found: list[Candidate] = []
        refused: list[NotTestable] = []
        for effect in self.catalogue.values():
            if effect.id in there or effect.id in _IN_SAMPLES:
                continue
            if reason := here._untestable(effect):
                refused.append(NotTestable(effect.id, reason))
                continue
            found.append(here._candidate(effect, shared, beside))
        return found, refused

    def lines(self, model: Model) -> Sequence[Line]:
        """What the samples show beside the lines: pulses, unsteady noise, and the strongest line between the known.

        Pulses and noise have no frequency, NaN.
        """
        there = {term.effect for term in model.terms}
        here = _own(model).study
        found = [] if PULSES in there else [pulses_found(here.scans)]
        found += [] if LEVEL in there else [level_found(here.scans)]
        known = [float(term.choice["frequency_hz"]) for term in model.terms if "frequency_hz" in term.choice]
        found += [line_found(here.scans, known)]
        return [each for each in found if each is not None and each.p_value < SHOWN_P]

    @cached_property
    def scans(self) -> list[RunScan]:
        """All runs' samples looked through, with the baseline as fitted to them; kept for just these runs."""
        runs = self.reduced.runs
        hidden = b"".join(pulses.tobytes() for pulses in self._masked.values())
        names = " ".join(sorted(run.run_id for run in runs))
        recipe = f"{RECIPE} samples {zlib.crc32(names.encode() + hidden):08x}"
        kept = self._source if isinstance(self._source, KeepsReductions) else None
        known = kept.reduced_names(recipe) if kept else set()
        found = []
        for run in runs:
            data = kept.reduction(recipe, run.run_id) if kept and run.run_id in known else None
            if data is not None:
                found.append(scan_from_bytes(data))
                continue
            found.append(scan(run, self._samples(run), self.observed.values))
            if kept and not kept.readonly:
                kept.keep_reductions(recipe, {run.run_id: scan_to_bytes(found[-1])})
        return found

    def _samples(self, run: ReducedRun) -> dict[str, FloatArray]:
        samples = self._source.samples(run.run_id)
        pulses = self._masked.get(run.run_id)
        if pulses is None:
            return samples
        hidden = covered(samples["t_s"], pulses)
        return {
            name: column if name == "t_s" else np.where(hidden, np.nan, column) for name, column in samples.items()
        }

    @cached_property
    def _without_pulses(self) -> InflightStudy:
        """This study without the samples that pulses cover."""
        other = self._copied()
        other._masked = {each.run_id: each.pulses.at_s for each in self.scans if len(each.pulses.at_s)}
        period_s = orbit_period_of(self._source)
        runs, left_out = [], dict(self.reduced.left_out)
        for run in self.reduced.runs:
            if run.run_id not in other._masked:
                runs.append(run)
                continue
            try:
                runs.append(reduced_without(self._source, run, other._masked[run.run_id], other._samples, period_s))
            except DataError as error:
                left_out[run.run_id] = str(error)
        other.reduced = Reduction(tuple(runs), left_out)
        return other

    @cached_property
    def _by_level(self) -> InflightStudy:
        """This study with the noise of each half as loud as its own samples say."""
        other = self._copied()
        other.reduced, other._levels = self.reduced, {each.run_id: each for each in self.scans}
        return other

    def _copied(self) -> InflightStudy:
        other = copy.copy(self)
        for name in list(vars(other)):
            if isinstance(getattr(type(self), name, None), cached_property):
                del vars(other)[name]
        other._kept, other._units = {}, {}
        return other

    def result(self, model: Model, values: FloatArray, covariance: FloatArray) -> dict[str, Any]:
        """The ten parameters."""
        sigmas = np.sqrt(np.diag(covariance))
        return {
            name: {"value": float(value), "sigma": float(sigma), "unit": unit}
            for name, value, sigma, unit in zip(NAMES, values, sigmas, model.units, strict=False)
        }

    def options(self) -> list[Proposal]:
        """Each session once more, as long as it was, with the same stimulus and with one that is twice as strong."""
        found = []
        for run in {run.session.name: run for run in self.reduced.runs}.values():
            session = run.session
            settings: dict[str, Any] = {"session": session.name, "orbits": run.duration_s / session.orbit_period_s}
            strengths = (1.0, STRONGER) if session.frequency_hz > 0.0 else ()
            stimuli = [
                {"calibration_frequency_hz": session.frequency_hz, "amplitude": strength * session.amplitude}
                for strength in strengths
            ]
            found += [Proposal({**settings, **each}, takes_s=run.duration_s) for each in stimuli or [{}]]
        return found

    def extended(self, proposals: Sequence[Proposal]) -> InflightStudy:
        """This recording with sessions flown once more: like the runs there are, of which only lines count."""
        known = {run.session.name: place for place, run in enumerate(self.reduced.runs)}
        places = [known[str(each.settings["session"])] for each in proposals]
        runs = []
        for number, (each, place) in enumerate(zip(proposals, places, strict=True), start=1):
            like = self.reduced.runs[place]
            amplitude = float(each.settings.get("amplitude", like.session.amplitude))
            runs.append(stronger(like, f"next {number}", amplitude))
        here, other = self.observed, self._copied()
        other.reduced = Reduction((*self.reduced.runs, *runs), self.reduced.left_out)
        other.observed = Observed(
            other.reduced.runs, (*here.noises, *(here.noises[place] for place in places)), here.values
        )
        return other

    def inseparable(self) -> Mapping[str, tuple[str, ...]]:
        """Effects that by construction are not to be told from parameters of the baseline."""
        return INSEPARABLE

    # Effects

    def changes(self, effect: Effect, values: FloatArray) -> list[ComplexArray]:
        """What an effect does to the amplitudes of all halves."""
        units = self._linear(effect)
        if units is not None:
            made = [np.zeros_like(each) for each in units[0]]
            for value, unit in zip(values, units, strict=True):
                for total, part in zip(made, unit, strict=True):
                    total += value * part
            return made
        return self._evaluated(effect, values)

    def derivatives(self, effect: Effect, values: FloatArray) -> list[list[ComplexArray]]:
        """d changes / d each of its parameters."""
        units = self._linear(effect)
        if units is not None:
            return units
        found = []
        for place, name in enumerate(effect.parameters):
            step = _STEP * abs(effect.typical[name])
            up, down = (self._evaluated(effect, values + sign * step * _unit(place, values)) for sign in (1.0, -1.0))
            found.append([(a - b) / (2.0 * step) for a, b in zip(up, down, strict=True)])
        return found

    def _linear(self, effect: Effect) -> list[list[ComplexArray]] | None:
        """Changes per unit of each parameter; None for an effect that is not linear in them."""
        if effect.id not in self._units:
            typical = np.array([effect.typical[name] for name in effect.parameters])
            units = [
                [each / size for each in self._evaluated(effect, size * _unit(place, typical))]
                for place, size in enumerate(typical)
            ]
            whole = self._evaluated(effect, 2.0 * typical)
            summed = [
                sum(2.0 * size * unit[half] for size, unit in zip(typical, units, strict=True))
                for half in range(len(whole))
            ]
            off = sum(float(np.sum(np.abs(a - b) ** 2)) for a, b in zip(whole, summed, strict=True))
            size = sum(float(np.sum(np.abs(a) ** 2)) for a in whole)
            self._units[effect.id] = units if off <= _LINEAR**2 * size else None
        return self._units[effect.id]

    def _evaluated(self, effect: Effect, values: FloatArray) -> list[ComplexArray]:
        key = (effect.id, tuple(float(value) for value in values))
        if key not in self._kept:
            if len(self._kept) > 200:
                self._kept.clear()
            parameters = dict(zip(effect.parameters, map(float, values), strict=True))
            self._kept[key] = [half for reducer in self._reducers for half in reducer.changes(effect, parameters)]
        return self._kept[key]

    @cached_property
    def _reducers(self) -> list[Reducer]:
        return [Reducer(run) for run in self.reduced.runs]

    def _candidate(self, effect: Effect, shared: FloatArray, beside: Sequence[Effect]) -> Candidate:
        nothing = np.zeros(len(effect.parameters))
        columns = [self.baseline.shift(shared, derivative) for derivative in self.derivatives(effect, nothing)]
        return Candidate(
            term=Term(effect.id),
            names=tuple(_shown(effect, name, beside) for name in effect.parameters),
            units=tuple(effect.parameters.values()),
            derivative=np.stack(columns, axis=1),
            typical=np.array([effect.typical[name] for name in effect.parameters]),
        )

    def _untestable(self, effect: Effect) -> str | None:
        """Why this recording cannot be asked about an effect; None when it can."""
        if effect.id in COMMON:
            return COMMON[effect.id]
        if "temperature" in effect.needs and not all(_has_temperature(run) for run in self.reduced.runs):
            return "no temperature is recorded; add columns temperature_1_k and temperature_2_k"
        try:
            units = self.derivatives(effect, np.zeros(len(effect.parameters)))
        except DataError as error:
            return str(error)
        size = max(float(np.max(np.abs(half), initial=0.0)) for unit in units for half in unit)
        return None if size > 0.0 else "it changes nothing in these runs"


def _own(model: Model) -> InflightModel:
    if not isinstance(model, InflightModel):
        raise TypeError("a model of this study is wanted")
    return model


def _has_temperature(run: ReducedRun) -> bool:
    names = ("temperature_1_k", "temperature_2_k")
    return all(name in run.coarse.columns for name in names)


def _unit(place: int, like: FloatArray) -> FloatArray:
    made = np.zeros(len(like))
    made[place] = 1.0
    return made


def _shown(effect: Effect, name: str, beside: Sequence[Effect]) -> str:
    """A parameter's name; with its effect's before it where another has the same."""
    others = {other for each in beside if each.id != effect.id for other in each.parameters}
    return f"{effect.id}.{name}" if name in others or name in (*NAMES, *NUISANCES) else name


def _observations(given: Observed, baseline: Baseline) -> Observations:
    series: dict[Series, int] = {}
    series_of: list[int] = []
    stretch_of: list[int] = []
    for number, each in enumerate(baseline.stretches):
        names = []
        for place in each.compared:
            line = each.lines[place]
            where = line.name if line.harmonic == 0 else f"{each.session.name} {line.name}"
            names += [(DIFFERENTIAL, f"{where} {part}") for part in ("cosine", "sine")]
        if each.has_own:
            names += [(OWN, f"{each.session.name} f {part}") for part in ("in-phase", "quadrature")]
        for channel, component in names:
            series_of.append(series.setdefault(Series(channel, component, "m/s2"), len(series)))
            stretch_of.append(number)
    run_of_stretch = [run for run, each in enumerate(given.runs) for _ in each.halves]
    run_of = np.array(stretch_of, dtype=np.intp)
    return Observations(
        run_ids=tuple(each.run_id for each in baseline.stretches),
        series=tuple(series),
        pools=tuple(NoisePool(run.run_id, noise.dof) for run, noise in zip(given.runs, given.noises, strict=True)),
        value=baseline.observed(),
        sigma=baseline.sigma(),
        series_of=np.array(series_of, dtype=np.intp),
        run_of=run_of,
        pool_of=np.array(run_of_stretch, dtype=np.intp)[run_of],
        group_of=np.zeros(len(run_of), dtype=np.intp),
        block_of=np.arange(len(baseline.stretches), dtype=np.intp),
        covariates=_covariates(given),
    )


def _covariates(given: Observed) -> dict[str, FloatArray]:
    """Columns over the halves: when, which half, and every number of runs.csv that varies."""
    rows = [(run, place, half) for run in given.runs for place, half in enumerate(run.halves)]
    found = {"half": np.array([float(place) for _, place, _ in rows])}
    names = dict.fromkeys(name for run in given.runs for name in run.conditions)
    for name in names:
        values = [run.conditions.get(name, math.nan) for run, _, _ in rows]
        numbers = [float(v) if isinstance(v, int | float) and not isinstance(v, bool) else math.nan for v in values]
        column = np.array(numbers)
        if name == "start_s":
            column = column + np.array([0.5 * (half.start_s + half.stop_s) for _, _, half in rows])
        if np.isfinite(column).any() and np.nanmax(column) > np.nanmin(column):
            found[name] = column
    return found
