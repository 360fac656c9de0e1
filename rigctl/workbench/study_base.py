"""What every study does alike: effects and plug-ins in one catalogue, terms checked against it, candidates made."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any, ClassVar, Generic, Self, TypeVar

import numpy as np

from rigctl.analysis.line_scan import FoundLine
from rigctl.campaign.recording import RunSource
from rigctl.core.arrays import FloatArray
from rigctl.effects.catalogue import Effect, catalogue, unknown_effect
from rigctl.effects.plugins import Plugin
from rigctl.workbench.study import Candidate, Line, Model, NotTestable, Term

Data = TypeVar("Data")
ModelType = TypeVar("ModelType", bound=Model)


class StudyBase(ABC, Generic[Data]):
    """A recording, ours or imported, and what `plugins` add to the catalogue of its experiment.

    `data` are its reduced runs, by default those of `source`, reduced when first needed. A study with imagined runs
    is a new one with other `data`. `ConfigError` when two effects share an id.
    """

    experiment: str
    expressions: ClassVar[Mapping[str, str]] = {}
    """How the function of an effect writes a covariate, where that is no column of the laboratory's own."""
    drafts: ClassVar[Sequence[str]] = ("1.0", "run.signal")
    """What an effect without a name may be proportional to, at any point, as expressions of `run`."""

    def __init__(self, source: RunSource, plugins: Sequence[Plugin] = (), data: Data | None = None) -> None:
        self.source = source
        self._plugins = tuple(plugins)
        added = [effect for plugin in plugins for effect in plugin.effects.values()]
        self.catalogue: Mapping[str, Effect] = catalogue(self.experiment, added)
        self._given = data

    @cached_property
    def data(self) -> Data:
        """The runs, reduced; `DataError` when they cannot be used."""
        return self.reduced_source() if self._given is None else self._given

    @abstractmethod
    def reduced_source(self) -> Data:
        """The runs of `source`."""

    def with_data(self, data: Data) -> Self:
        """The same study of other runs."""
        return type(self)(self.source, self._plugins, data)

    def effects(self) -> Mapping[str, str]:
        """Every effect that can be added, in the order in which they act: id and the physics in a sentence."""
        return {name: effect.summary for name, effect in self.catalogue.items()}

    def lines(self, model: Model) -> Sequence[Line]:
        """Steady lines in the samples; none where the data are no samples."""
        del model
        return ()

    def chosen(self, terms: Sequence[Term]) -> list[Effect]:
        """The effects of terms in the order in which they act; `ConfigError` for one that is unknown."""
        named = {term.effect for term in terms}
        for term in terms:
            if term.effect not in self.catalogue:
                raise unknown_effect(term.effect, self.catalogue)
        # The catalogue's order, not that in which terms were added: K2 f^2 comes after the forces that make f.
        return [effect for name, effect in self.catalogue.items() if name in named]


class CatalogueStudy(StudyBase[Data]):
    """A study whose candidates are effects of the catalogue, asked one after the other."""

    def candidates(self, model: Model, values: FloatArray) -> tuple[list[Candidate], list[NotTestable]]:
        """Every effect that `model` lacks, at the fitted `values`; a scanned one appears once per choice."""
        asked: list[Effect] = []
        reasons: dict[str, str] = {}
        for effect in self.lacking(model):
            if reason := self.untestable(effect, model):
                reasons[effect.id] = reason
            else:
                asked.append(effect)
        candidates: list[Candidate] = []
        for effect, choices in zip(asked, self.candidates_for(asked, model, values), strict=True):
            # What changes nothing here would have a column of zeros: no test, and no fit.
            changing = [each for each in choices if np.any(each.derivative)]
            candidates += changing
            if not changing:
                reasons[effect.id] = self.reason_for_no_change(effect)
        return candidates, [NotTestable(name, reasons[name]) for name in self.catalogue if name in reasons]

    def lacking(self, model: Model) -> list[Effect]:
        """The effects of the catalogue that a model could be extended with."""
        present = {term.effect for term in model.terms}
        return [effect for effect in self.catalogue.values() if effect.id not in present and not effect.scanned]

    @abstractmethod
    def untestable(self, effect: Effect, model: Model) -> str | None:
        """Why the runs of `model` cannot be asked about an effect; None when they can."""

    @abstractmethod
    def candidates_for(
        self, effects: Sequence[Effect], model: Model, values: FloatArray
    ) -> Iterable[Sequence[Candidate]]:
        """For each of the effects its candidates, one per choice, at the fitted `values`."""

    def reason_for_no_change(self, effect: Effect) -> str:
        """Why an effect without any influence on the data cannot be tested."""
        del effect
        return "it changes nothing in these runs"


def own_model(model: Model, expected: type[ModelType]) -> ModelType:
    """A model that its own study made; `TypeError` for another study's."""
    if not isinstance(model, expected):
        raise TypeError("a model of this study is wanted")
    return model


def parameters_as_json(
    model: Model, values: FloatArray, covariance: FloatArray, count: int | None = None
) -> dict[str, Any]:
    """The first `count` parameters of a model, by default all: by name, `value`, `sigma` and `unit`."""
    sigmas = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    rows = list(zip(model.parameters, values, sigmas, model.units, strict=True))
    return {
        parameter.name: {"value": float(value), "sigma": float(sigma), "unit": unit}
        for parameter, value, sigma, unit in rows[:count]
    }


def line_frequencies_hz(terms: Sequence[Term]) -> tuple[float, ...]:
    """Frequencies of the terms that are lines in the samples."""
    return tuple(float(term.choice["frequency_hz"]) for term in terms if "frequency_hz" in term.choice)


def steady_line(line: FoundLine, term: Term, channel: str, unit: str, duration_s: float) -> Line:
    """A line found in samples as the workbench has it; runs of `duration_s` tell how well its frequency is known."""
    # Cramer-Rao for a sine of free phase in each run, in terms of the relative uncertainty of its amplitude.
    sigma_hz = 3.0**0.5 / (np.pi * duration_s) * line.sigma / line.amplitude
    frequency = {"value": line.frequency_hz, "sigma": float(sigma_hz), "unit": "Hz"}
    return Line(
        term=term,
        channel=channel,
        frequency_hz=line.frequency_hz,
        amplitude=line.amplitude,
        sigma=line.sigma,
        unit=unit,
        p_value=line.p_value,
        held_out_error_ratio=line.held_out_error_ratio,
        parameters={
            "amplitude": {"value": line.amplitude, "sigma": line.sigma, "unit": unit},
            "frequency": {**frequency, "aliases_hz": list(line.aliases_hz)},
        },
    )
