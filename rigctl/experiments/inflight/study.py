"""An in-flight calibration as the workbench sees it: data, models, candidates, result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ConfigError, DataError
from rigctl.effects.catalogue import Effect
from rigctl.experiments.inflight.effects import OF_EACH
from rigctl.experiments.inflight.imagined import other_stimuli
from rigctl.experiments.inflight.model.parameters import NAMES
from rigctl.experiments.inflight.observe.series import temperatures
from rigctl.experiments.inflight.sample_findings import changing_level_in, pulses_in, strongest_line_in
from rigctl.experiments.inflight.study_data import FlightData
from rigctl.experiments.inflight.study_model import InflightModel, shown_name
from rigctl.workbench.study import Candidate, Line, Model, Proposal, Term
from rigctl.workbench.study_base import CatalogueStudy, line_frequencies_hz, own_model, parameters_as_json

INSEPARABLE: Mapping[str, tuple[str, ...]] = {
    "tracker-bias": ("ac12_rad", "ac13_rad", "ac11_dx_m", "ac11_dz_m"),
    "orbit-dating": ("ac13_rad", "ac11_dx_m", "ac11_dz_m"),
}
"""Effects that, by geometry, no session can separate from these parameters, whatever its data."""

COMMON: Mapping[str, str] = {
    **dict.fromkeys(
        ("thrust-quantisation", "mass-drift", "moved-mass-reaction"),
        "it moves both masses alike, and only their difference is compared",
    ),
    "spring-noise": "it raises the noise, which is measured in each run and not predicted",
}
"""Effects without a part in the differential channel's lines."""

PULSES, LEVEL, LINE = "glitches", "noise-level", "steady-line"

SHOWN_P = 0.01
"""Largest p-value under noise at which a finding in the samples is reported."""

IN_SAMPLES = (PULSES, LEVEL, LINE)
"""Effects that are looked for in the samples, and change no line."""


class InflightStudy(CatalogueStudy[FlightData]):
    """A recording of calibration sessions; `DataError` when no run can be used."""

    experiment = "inflight-calibration"

    def reduced_source(self) -> FlightData:
        """The runs of the recording, reduced; by a store kept."""
        return FlightData.of(self.source)

    @property
    def left_out(self) -> Mapping[str, str]:
        """By run_id, why a valid run could not be reduced."""
        return self.data.reduced.left_out

    def model(self, terms: Sequence[Term]) -> InflightModel:
        """The model with these terms; `ConfigError` for an unknown effect, `DataError` when data for it lack."""
        of_each = {term.effect: bool(term.choice) for term in terms}
        # A term with a choice has the form with a coefficient of each sensor.
        effects = [forms(effect)[-1 if of_each[effect.id] else 0][1] for effect in self.chosen(terms)]
        named = {effect.id for effect in effects}
        if len(named) < len(terms):
            raise ConfigError("an effect is in the model twice; name it once")
        # Pulses first: what is left of the samples then tells the levels.
        data = self.data.without_pulses if PULSES in named else self.data
        data = data.by_level if LEVEL in named else data
        effects = [effect for effect in effects if effect.id not in IN_SAMPLES]
        for effect in effects:
            if reason := _untestable(effect, data):
                raise DataError(f"'{effect.id}' cannot be in a model of this recording: {reason}")
        return InflightModel(data, terms, effects)

    def lacking(self, model: Model) -> list[Effect]:
        """Those that are not in the model and change lines."""
        present = {term.effect for term in model.terms}
        return [
            effect for effect in self.catalogue.values() if effect.id not in present and effect.id not in IN_SAMPLES
        ]

    def untestable(self, effect: Effect, model: Model) -> str | None:
        """Why the runs of `model` cannot be asked about an effect; None when they can."""
        return _untestable(effect, own_model(model, InflightModel).data)

    def candidates_for(self, effects: Sequence[Effect], model: Model, values: FloatArray) -> list[list[Candidate]]:
        """One candidate per effect; of one with coefficients of each sensor, mass or axis both forms."""
        data = own_model(model, InflightModel).data
        present = {term.effect for term in model.terms}
        beside = [effect for effect in self.catalogue.values() if effect.id in present]
        shared = np.asarray(values[: len(data.baseline.parameters)])
        return [
            # Both forms compete: whether each sensor has a coefficient of its own is for the data to say.
            [_candidate(Term(each.id, choice), each, data, shared, beside) for choice, each in forms(effect)]
            for effect in effects
        ]

    def unrecorded(self, model: Model, values: FloatArray) -> FloatArray:
        """What the effects that need a temperature could do at the data, where none is recorded; columns (n, k)."""
        data = own_model(model, InflightModel).data
        needing = [effect for effect in self.catalogue.values() if "temperature" in effect.needs]
        shared = np.asarray(values[: len(data.baseline.parameters)])
        columns = [data.baseline.shift(shared, change) for change in data.of_any_temperature(needing)]
        return np.stack(columns, axis=1) if columns else np.zeros((len(model.observations.value), 0))

    def search_samples(self) -> None:
        """For pulses, unsteady noise and lines between the known."""
        self.data.recorded.scans  # noqa: B018  kept by the store as it is asked for

    def lines(self, model: Model) -> Sequence[Line]:
        """What the samples show beside the lines: pulses, unsteady noise, and the strongest line between the known.

        Pulses and noise have no frequency, NaN.
        """
        present = {term.effect for term in model.terms}
        scans = own_model(model, InflightModel).data.recorded.scans
        lines = [
            None if PULSES in present else pulses_in(scans),
            None if LEVEL in present else changing_level_in(scans),
            strongest_line_in(scans, line_frequencies_hz(model.terms)),
        ]
        return [each for each in lines if each is not None and each.p_value < SHOWN_P]

    def result(self, model: Model, values: FloatArray, covariance: FloatArray) -> dict[str, Any]:
        """The ten parameters."""
        return parameters_as_json(model, values, covariance, len(NAMES))

    def options(self) -> list[Proposal]:
        """Each session once more, as long as it was: with the same stimulus, with one that is twice as strong, of
        another frequency, or a quarter of a period later."""
        options = []
        for run in {run.session.name: run for run in self.data.reduced.runs}.values():
            settings = {"session": run.session.name, "orbits": run.duration_s / run.session.orbit_period_s}
            stimuli = other_stimuli(run) if run.session.frequency_hz > 0.0 else [{}]
            options += [Proposal({**settings, **each}, takes_s=run.duration_s) for each in stimuli]
        return options

    def extended(self, proposals: Sequence[Proposal]) -> InflightStudy:
        """This recording with sessions flown once more."""
        return self.with_data(self.data.with_proposals(proposals))

    def inseparable(self) -> Mapping[str, tuple[str, ...]]:
        """Effects that no session can separate from parameters of the baseline."""
        return INSEPARABLE


def forms(effect: Effect) -> list[tuple[dict[str, str], Effect]]:
    """An effect with the fewest parameters, and with a coefficient of each sensor, mass or axis where it has those;
    each with the choice that a term of it has."""
    if effect.id not in OF_EACH:
        return [({}, effect)]
    what, further = OF_EACH[effect.id]
    fewest = {name: unit for name, unit in effect.parameters.items() if name not in further}
    return [({}, replace(effect, parameters=fewest)), ({"of": f"each {what}"}, effect)]


def _candidate(
    term: Term, effect: Effect, data: FlightData, shared: FloatArray, beside: Sequence[Effect]
) -> Candidate:
    nothing = np.zeros(len(effect.parameters))
    columns = [data.baseline.shift(shared, each) for each in data.effects.derivatives(effect, nothing)]
    return Candidate(
        term=term,
        names=tuple(shown_name(effect, name, beside) for name in effect.parameters),
        units=tuple(effect.parameters.values()),
        columns=np.stack(columns, axis=1),
        typical=np.array([effect.typical[name] for name in effect.parameters]),
    )


def _untestable(effect: Effect, data: FlightData) -> str | None:
    """Why these runs cannot be asked about an effect; None when they can."""
    if effect.id in COMMON:
        return COMMON[effect.id]
    if "temperature" in effect.needs and not all(temperatures(run.coarse.columns) for run in data.reduced.runs):
        return "no temperature is recorded; add columns temperature_1_k and temperature_2_k, or one temperature_c"
    return data.effects.reason_for_none(effect)
