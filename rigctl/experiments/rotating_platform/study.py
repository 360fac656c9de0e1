"""The rotating platform as the workbench sees it: data, models, candidates, result."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from rigctl.analysis.lines import FoundLine
from rigctl.campaign.recording import RunSource
from rigctl.core.errors import DataError
from rigctl.core.interfaces import FloatArray
from rigctl.effects.catalogue import Effect, catalogue, unknown_effect
from rigctl.effects.plugins import Plugin
from rigctl.experiments.rotating_platform.imagined import imagined_channels, options
from rigctl.experiments.rotating_platform.model.model import Placed, PlatformModel, Recorded, placed, slopes_at_zero
from rigctl.experiments.rotating_platform.observe.lines import Spectra, found_lines
from rigctl.experiments.rotating_platform.observe.observables import channel_runs
from rigctl.experiments.rotating_platform.observe.recorded import chains
from rigctl.experiments.rotating_platform.observe.store_reduction import reduction, refined_line, scan
from rigctl.workbench.study import Candidate, Line, Model, NotTestable, Proposal, Term

LINE = "line"
"""The effect that is found in the samples, not in the outputs of the periods."""


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
        self._reduced: dict[tuple[float, ...], Recorded] = {}
        self._spectra: dict[tuple[float, ...], Spectra] = {}
        self._proposals: tuple[Proposal, ...] = ()
        self._wider: dict[tuple[tuple[float, ...], int], Recorded] = {}

    @property
    def recorded(self) -> Recorded:
        """All runs, reduced; `DataError` when there are none."""
        return self._recorded(())

    def _recorded(self, lines_hz: tuple[float, ...]) -> Recorded:
        """The same with lines taken off the samples, and proposed runs beside them."""
        if lines_hz not in self._reduced:
            found = reduction(self.source, lines_hz)
            channels, refused = channel_runs(found.runs)
            self.left_out = {**found.left_out, **refused}
            if not channels:
                why = next(iter(self.left_out.values()), "it has no modulated run")
                raise DataError(f"no valid run could be reduced: {why}")
            runs = list({each.run.run_id: each.run for each in channels}.values())
            self._spectra[lines_hz] = scan(self.source, runs, lines_hz)
            g_m_s2 = chains(self.source.header).g_m_s2
            self._reduced[lines_hz] = Recorded(tuple(channels), g_m_s2, peaks=self._spectra[lines_hz].peaks)
        here = self._reduced[lines_hz]
        if not self._proposals:
            return here
        key = (lines_hz, len(self._proposals))
        if key not in self._wider:
            further = imagined_channels(self._proposals, here.channels, chains(self.source.header))
            self._wider[key] = replace(
                here,
                channels=(*here.channels, *further),
                imagined=frozenset(each.run.run_id for each in further),
                peaks=None,
            )
        return self._wider[key]

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
        return PlatformModel(self._recorded(_lines_of(terms)), self._placed(terms), terms)

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

    def neighbours(self, term: Term) -> dict[str, tuple[float, float]]:
        """Between which values the scan leaves open what a choice really is, by name; empty for what has no scan."""
        scans = self.catalogue[term.effect].scans
        return {name: _between(scans[name], float(value)) for name, value in term.choice.items() if name in scans}

    def candidate(self, model: Model, values: FloatArray, term: Term) -> Candidate:
        """An effect that `model` lacks with any values of its choice."""
        here = own_model(model)
        taken = [parameter.own for each in here.placed for parameter in each.parameters]
        return self._candidate(here, values, placed(self.catalogue[term.effect], term, taken))

    def lines(self, model: Model) -> Sequence[Line]:
        """Steady lines in what is left of the samples."""
        lines_hz = _lines_of(model.terms)
        self._recorded(lines_hz)
        periods_s = [each.run.cells.period_s for each in self._reduced[lines_hz].channels]
        spectra = self._spectra[lines_hz]
        runs = list({each.run.run_id: each.run for each in self._reduced[lines_hz].channels}.values())
        found = [refined_line(self.source, runs, lines_hz, each) for each in found_lines(spectra, periods_s)]
        return [_line(each, spectra.scan.longest_s) for each in found]

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
        other._proposals, other._wider = tuple(proposals), {}
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
        amplitudes, columns = slopes_at_zero(model, values, one, model.observations.sigma)
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


def _lines_of(terms: Sequence[Term]) -> tuple[float, ...]:
    """Frequencies that are taken off the samples."""
    return tuple(float(term.choice["frequency_hz"]) for term in terms if "frequency_hz" in term.choice)


def _line(found: FoundLine, duration_s: float) -> Line:
    # Cramer-Rao for a sine of free phase in each run, in terms of the relative uncertainty of its amplitude.
    spread_hz = 3.0**0.5 / (np.pi * duration_s) * found.sigma / found.amplitude
    frequency = {"value": found.frequency_hz, "sigma": float(spread_hz), "unit": "Hz"}
    return Line(
        term=Term(LINE, {"frequency_hz": found.frequency_hz}),
        channel="m_z",
        frequency_hz=found.frequency_hz,
        amplitude=found.amplitude,
        sigma=found.sigma,
        unit="m/s2",
        p_value=found.p_value,
        held_out_error_ratio=found.held_out_error_ratio,
        parameters={
            "amplitude": {"value": found.amplitude, "sigma": found.sigma, "unit": "m/s2"},
            "frequency": {**frequency, "aliases_hz": list(found.aliases_hz)},
        },
    )


def _between(scan: Sequence[float], value: float) -> tuple[float, float]:
    """The neighbours of a value of a scan; beyond its ends it goes on by the last ratio."""
    below = [each for each in scan if each < value]
    above = [each for each in scan if each > value]
    low = max(below) if below else value**2 / min(above)
    return low, (min(above) if above else value**2 / max(below))


def choices(effect: Effect) -> list[Term]:
    """The terms an effect may come as: one, or one per value of its scan."""
    names = list(effect.scans)
    return [Term(effect.id, dict(zip(names, values, strict=True))) for values in product(*effect.scans.values())]


def own_model(model: Model) -> PlatformModel:
    """A model of this study."""
    if not isinstance(model, PlatformModel):
        raise TypeError("a model of this study is wanted")
    return model
