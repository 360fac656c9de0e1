"""A recording's model, theta0 in degrees and the rest in SI as files and commands have them.

Effects that it lacks, and whether the recording can be asked about them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rigctl.analysis.least_squares import Parameter, Prior
from rigctl.core.arrays import ComplexArray, FloatArray
from rigctl.core.errors import RigError
from rigctl.effects.catalogue import Effect
from rigctl.experiments.sensing_axis.model.chain import Runs, amplitudes
from rigctl.experiments.sensing_axis.model.components import Stacked, observed
from rigctl.experiments.sensing_axis.model.model import RecordingModel
from rigctl.experiments.sensing_axis.model.parameters import family_of
from rigctl.experiments.sensing_axis.observe.observables import HARMONICS, RunObservables
from rigctl.workbench.asked_again import once_in_a_row
from rigctl.workbench.study import Candidate, Observations, Term

OF_A_MOUNTING = ("theta0", "dc", "delta_x", "delta_y", "delta_z")

_DEGREES = 180.0 / np.pi


class SensingAxisModel:
    """A `rigctl.workbench.study.Model`; `inner` is the same in SI and radians."""

    def __init__(self, inner: RecordingModel, data: Stacked, terms: Sequence[Term]) -> None:
        self.inner = inner
        self.terms = tuple(terms)
        self._data = data
        # Nulls are stage angles, which files and commands give in degrees; the fit is in radians.
        in_degrees = [parameter.name.startswith("theta0[") for parameter in inner.parameters]
        self._in_degrees = np.flatnonzero(in_degrees)
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
    def never_negative(self) -> frozenset[str]:
        """Names of parameters that nature has with one sign only."""
        kinds = {family_of(effect, name) for effect in self.inner.effects for name in effect.never_negative}
        families = [each for each in self.inner.families if each.base in kinds]
        return frozenset(self.parameters[each.first + k].name for each in families for k in range(each.count))

    @property
    def observations(self) -> Observations:
        """The data, in the order of predictions."""
        return self._data.observations

    def predict(self, values: FloatArray) -> FloatArray:
        """The data for parameter values of shape (m,); shape (n,)."""
        return observed(self.inner.predict(self.si(values)))[self._data.present]

    @once_in_a_row
    def jacobian(self, values: FloatArray) -> FloatArray:
        """d predict / d values, shape (n, m)."""
        slopes = self.slopes(self.inner, self.si(values))
        slopes[:, self._in_degrees] /= _DEGREES
        return slopes

    def slopes(self, model: RecordingModel, values: FloatArray, owners: Sequence[str] | None = None) -> FloatArray:
        """Derivatives of these data for any model of these runs, in SI; shape (n, its parameters)."""
        return model.jacobian(values, observed, present=self._data.present, owners=owners)

    def si(self, values: FloatArray) -> FloatArray:
        """Parameter values in SI and radians."""
        return np.asarray(values, dtype=np.float64) / self._shown

    def si_covariance(self, covariance: FloatArray) -> FloatArray:
        """Their covariance in SI and radians."""
        return np.asarray(covariance / np.outer(self._shown, self._shown))


def _scaled(parameter: Parameter, factor: float) -> Parameter:
    prior = parameter.prior
    return replace(
        parameter,
        start=parameter.start * factor,
        step=None if parameter.step is None else parameter.step * factor,
        prior=None if prior is None else Prior(prior.mean * factor, prior.sigma * factor),
    )


def free_heads(effect: Effect, model: RecordingModel) -> list[str]:
    """Heads on which an effect might act and in the model does not."""
    taken = {head for each in model.effects if each.id == effect.id for head in model.reach(each)}
    return [head for head in model.reach(effect) if head not in taken]


def candidates_of(
    effects: Sequence[Effect], catalogue: Mapping[str, Effect], model: SensingAxisModel, values: FloatArray
) -> list[list[Candidate]]:
    """For each effect its candidates at the fitted `values`; one model with all of them gives the derivatives."""
    inner = model.inner
    whole = inner.with_effects(_in_order([*inner.effects, *effects], catalogue))
    slopes = model.slopes(whole, _with_zeros(inner, whole, model.si(values)), [each.id for each in effects])
    return [
        [
            _candidate(effect, head, inner, whole, slopes)
            for head in (free_heads(effect, inner) if effect.scope == "head" else ("",))
        ]
        for effect in effects
    ]


def _in_order(effects: Sequence[Effect], catalogue: Mapping[str, Effect]) -> list[Effect]:
    """One of each id, in the order in which they act; of two the later, which acts on all heads."""
    last = {effect.id: effect for effect in effects}
    return [last[name] for name in catalogue if name in last]


def _with_zeros(model: RecordingModel, whole: RecordingModel, values: FloatArray) -> FloatArray:
    """Values of a model as those of `whole`, which has more effects: these are absent."""
    known = {family.base: family for family in model.families}
    extended = np.zeros(len(whole.parameters))
    for family in whole.families:
        if family.base in known:
            first = known[family.base].first
            extended[family.first : family.first + family.count] = values[first : first + known[family.base].count]
    return extended


def _candidate(
    effect: Effect, head: str, model: RecordingModel, whole: RecordingModel, slopes: FloatArray
) -> Candidate:
    # Several drifts have a rate: with another of them in the model, this one's carries its effect's name.
    taken = {name for each in model.effects if each.id != effect.id for name in each.parameters}
    columns: list[int] = []
    names: list[str] = []
    typical: list[float] = []
    for name in effect.parameters:
        family = next(each for each in whole.families if each.base == family_of(effect, name, head))
        shown = f"{effect.id}.{name}" if name in taken else name
        for column in range(family.first, family.first + family.count):
            label = whole.parameters[column].name.partition("[")[2]
            columns.append(column)
            names.append(f"{shown}[{label}" if label else shown)
            typical.append(effect.typical[name])
    return Candidate(
        term=Term(effect.id, {"head": head} if head else {}),
        names=tuple(names),
        units=tuple(whole.units[column] for column in columns),
        # Side by side in memory, which an index in brackets does not keep.
        columns=slopes.T[columns].T,
        typical=np.array(typical),
    )


_SAME = 1e-9
_TAKEN_UP = 1e-2
"""Of what an effect does to the fundamental's quadrature: a delay does less to its in-phase part."""


def untestable(effect: Effect, model: RecordingModel) -> str | None:
    """Why `model`'s runs lack what the effect acts by; None when they can be asked.

    `model` need not have the effect. Runs that differ in too little for the parameters to be told apart are not the
    matter here: that is for the fit to say.
    """
    if effect not in model.tried.untestable:
        model.tried.untestable[effect] = _reason_against(effect, model)
    return model.tried.untestable[effect]


def _reason_against(effect: Effect, model: RecordingModel) -> str | None:
    for need in effect.needs:
        reason = _NEEDS[need](model.runs)
        if reason:
            return reason
    if effect.on == "laser_m" and not model.heads:
        return "no displacement head was recorded"
    if effect.scope == "head" and not model.reach(effect):
        return "no head that was recorded looks across the motion"
    return _flaw(effect, model) or _taken_up(effect, model)


def _taken_up(effect: Effect, model: RecordingModel) -> str | None:
    """Whether the offsets of the heads' own clocks, fitted in every run, take up all that an effect does."""
    if effect.on != "laser_m":
        return None
    for head in model.reach(effect) or model.heads:
        if any(reading.clock is None for run in model.runs if (reading := run.lasers_m.get(head))):
            return None
        run = model.at_head(head)
        of_period = np.broadcast_to(effect(run, **effect.typical), run.x.shape)
        added = np.abs(_parts_of(amplitudes(of_period, HARMONICS)))
        if (added[..., 1:] > _TAKEN_UP * added[..., :1]).any():
            return None
    return "it only delays heads on clocks of their own, whose offsets are fitted in every run"


def _parts_of(harmonics: ComplexArray) -> FloatArray:
    """The fundamental's quadrature, then all other parts but the mean."""
    rest = harmonics[..., 2:]
    return np.concatenate([harmonics[..., 1:2].imag, harmonics[..., 1:2].real, rest.real, rest.imag], axis=-1)


def _flaw(effect: Effect, model: RecordingModel) -> str | None:
    """What a column that is missing, or a number that is, makes of the effect."""
    for run in _asked(effect, model):
        try:
            # A result that is no number is what is looked for here.
            with np.errstate(all="ignore"):
                added = effect(run, **effect.typical)
        except RigError as error:
            return str(error)
        if not np.isfinite(added).all():
            unknown = [name for name, column in _conditions(run).items() if not np.isfinite(column).all()]
            return "it is not a number in every run" + (f": {', '.join(unknown)} unknown" if unknown else "")
    return None


def _asked(effect: Effect, model: RecordingModel) -> list[Runs]:
    if effect.on == "laser_m":
        return [model.at_head(head) for head in (model.reach(effect) or model.heads)]
    # Any finite signal will do: what is asked is whether the conditions are known.
    return [model.conditions.at(signal=model.conditions.x)]


def _conditions(run: Runs) -> dict[str, np.ndarray]:
    recorded = {"temperature_c": run.temperature, "approach": run.approach, "start_s": run.start}
    return {**recorded, **run.columns}


def _temperature(runs: Sequence[RunObservables]) -> str | None:
    return _flat([run.temperature_c for run in runs], "temperature_c", "the temperature was the same in all runs")


def _time(runs: Sequence[RunObservables]) -> str | None:
    return _flat([run.start_s for run in runs], "start_s", "all runs began at the same time")


def _approach(runs: Sequence[RunObservables]) -> str | None:
    # Zero: nobody wrote from which side.
    directions = [run.approach if run.approach else np.nan for run in runs]
    same = "every angle was reached from the same side, so that the shift is part of theta0"
    return _flat(directions, "approach", same)


def _flat(values: Sequence[float], column: str, same: str) -> str | None:
    known = np.array(values, dtype=np.float64)
    missing = int(np.sum(~np.isfinite(known)))
    if missing == len(known):
        return f"{column} was not recorded"
    if missing:
        return f"{column} is missing in {missing} of {len(known)} runs"
    return same if np.ptp(known) <= _SAME else None


_NEEDS = {"temperature": _temperature, "time": _time, "approach": _approach}
