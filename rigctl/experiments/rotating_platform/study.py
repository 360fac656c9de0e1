"""The rotating platform as the workbench sees it: data, models, candidates, result."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from rigctl.campaign.recording import RunSource
from rigctl.effects.catalogue import Effect, catalogue, unknown_effect
from rigctl.effects.plugins import Plugin
from rigctl.errors import DataError
from rigctl.experiments.rotating_platform.imagined import imagined_channels, options
from rigctl.experiments.rotating_platform.model import Placed, PlatformModel, Recorded, placed, slopes_at_zero
from rigctl.experiments.rotating_platform.observables import channel_runs
from rigctl.experiments.rotating_platform.recorded import chains
from rigctl.experiments.rotating_platform.store_reduction import reduction
from rigctl.interfaces import FloatArray
from rigctl.workbench.study import Candidate, Line, Model, NotTestable, Proposal, Term

NOT_TESTED = ("theta-locked-bias", "pendulum-reaction")
"""Effects that no modulation shows: they turn with the platform as an acceleration does."""


class PlatformStudy:
    """A recording of modulated runs, ours or imported, with what `plugins` add to the catalogue.

    Runs are reduced when they are first needed. `ConfigError` when two effects share an id.
    """

    experiment = "rotating-platform"

    def __init__(self, source: RunSource, plugins: Sequence[Plugin] = ()) -> None:
        self.source = source
        added = [effect for plugin in plugins for effect in plugin.effects.values()]
        self.catalogue: Mapping[str, Effect] = catalogue(self.experiment, added)
        self.left_out: dict[str, str] = {}

    @cached_property
    def recorded(self) -> Recorded:
        """All runs, reduced; `DataError` when there are none."""
        found = reduction(self.source)
        channels, refused = channel_runs(found.runs)
        self.left_out = {**found.left_out, **refused}
        if not channels:
            why = next(iter(self.left_out.values()), "it has no modulated run")
            raise DataError(f"no valid run could be reduced: {why}")
        return Recorded(tuple(channels), chains(self.source.header).g_m_s2)

    def effects(self) -> dict[str, str]:
        """Every effect that can be added, in the order in which they act: id and the physics in a sentence."""
        return {name: effect.summary for name, effect in self.catalogue.items()}

    def model(self, terms: Sequence[Term]) -> PlatformModel:
        """The model with these terms; `ConfigError` for an unknown effect, `DataError` when data for it lack."""
        for term in terms:
            if term.effect not in self.catalogue:
                raise unknown_effect(term.effect, self.catalogue)
            if reason := self._untestable(self.catalogue[term.effect]):
                raise DataError(f"'{term.effect}' cannot be in a model of this recording: {reason}")
        return PlatformModel(self.recorded, self._placed(terms), terms)

    def candidates(self, model: Model, values: FloatArray) -> tuple[list[Candidate], list[NotTestable]]:
        """Every effect that `model` lacks, at the fitted `values`; a scanned one once per value of its scan."""
        here = own_model(model)
        present = {term.effect for term in here.terms}
        taken = [parameter.own for each in here.placed for parameter in each.parameters]
        found: list[Candidate] = []
        refused: list[NotTestable] = []
        for effect in self.catalogue.values():
            if effect.id in present or effect.scanned:
                continue
            if reason := self._untestable(effect):
                refused.append(NotTestable(effect.id, reason))
                continue
            own = [self._candidate(here, values, placed(effect, term, taken)) for term in choices(effect)]
            own = [each for each in own if np.any(each.derivative)]
            found += own
            if not own:
                refused.append(
                    NotTestable(effect.id, _NOTHING_HERE.get(effect.id, "it changes nothing in these runs"))
                )
        return found, refused

    def lines(self, model: Model) -> Sequence[Line]:
        """Steady lines in what is left of the samples."""
        del model
        return ()

    def result(self, model: Model, values: FloatArray, covariance: FloatArray) -> dict[str, Any]:
        """The gain of the tilt and the accelerations without one."""
        here = own_model(model)
        sigmas = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        return {
            parameter.name: {"value": float(value), "sigma": float(sigma), "unit": unit}
            for parameter, value, sigma, unit, _ in zip(
                here.parameters, values, sigmas, here.units, range(3), strict=False
            )
        }

    def options(self) -> list[Proposal]:
        """Patterns, periods and tilts for the next runs."""
        return options([each.run for each in self.recorded.channels])

    def extended(self, proposals: Sequence[Proposal]) -> PlatformStudy:
        """This recording and runs that could be made next."""
        other = copy.copy(self)
        further = imagined_channels(proposals, self.recorded.channels, chains(self.source.header))
        other.recorded = replace(
            self.recorded,
            channels=(*self.recorded.channels, *further),
            imagined=frozenset(each.run.run_id for each in further),
        )
        return other

    def _placed(self, terms: Sequence[Term]) -> list[Placed]:
        found: list[Placed] = []
        by_id = {term.effect: term for term in terms}
        for name, effect in self.catalogue.items():
            if name in by_id and not effect.scanned:
                taken = [parameter.own for each in found for parameter in each.parameters]
                found.append(placed(effect, by_id[name], taken))
        return found

    def _candidate(self, model: PlatformModel, values: FloatArray, one: Placed) -> Candidate:
        amplitudes, columns = slopes_at_zero(model, values, one, self.recorded.observations.sigma)
        return Candidate(
            term=one.term,
            names=tuple(each.name for each in amplitudes),
            units=tuple(each.unit for each in amplitudes),
            derivative=columns,
            typical=np.array([each.typical for each in amplitudes]),
        )

    def _untestable(self, effect: Effect) -> str | None:
        chain = self.recorded.chain["z"]
        if "temperature" in effect.needs and not (
            np.isfinite(chain.temperature).all() and self._temperature_varies_within_a_run
        ):
            return "no run has samples of temperature_c that vary"
        if "time" in effect.needs and not all(
            np.isfinite(float(each.run.conditions.get("start_s", np.nan))) for each in self.recorded.channels
        ):
            return "the runs do not say when they began; write start_s"
        return None

    @cached_property
    def _temperature_varies_within_a_run(self) -> bool:
        return any(np.ptp(each.run.cells.state[:, 2]) > 0.0 for each in self.recorded.channels)


_NOTHING_HERE = {
    "off-centre": "the platform is at rest wherever samples count",
}


def choices(effect: Effect) -> list[Term]:
    """The terms an effect may come as: one, or one per value of its scan."""
    names = list(effect.scans)
    return [Term(effect.id, dict(zip(names, values, strict=True))) for values in product(*effect.scans.values())]


def own_model(model: Model) -> PlatformModel:
    """A model of this study."""
    if not isinstance(model, PlatformModel):
        raise TypeError("a model of this study is wanted")
    return model
