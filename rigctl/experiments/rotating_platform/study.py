"""The rotating platform as the workbench sees it: data, models, candidates, result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any, ClassVar

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.effects.catalogue import Effect
from rigctl.experiments.rotating_platform.model.model import PlatformModel, slopes_at_zero, slopes_elsewhere
from rigctl.experiments.rotating_platform.model.recorded_runs import Recorded
from rigctl.experiments.rotating_platform.observe.line_spectra import found_lines, harmonic_lines
from rigctl.experiments.rotating_platform.observe.observables import READ, TURN_CYCLES
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS
from rigctl.experiments.rotating_platform.observe.store_reduction import refined_line
from rigctl.experiments.rotating_platform.study_data import PlatformData, RecordedRuns, options
from rigctl.workbench.placed import EffectParameter, Placed, placed
from rigctl.workbench.study import Candidate, Line, Model, Proposal, Term
from rigctl.workbench.study_base import (
    CatalogueStudy,
    line_frequencies_hz,
    own_model,
    parameters_as_json,
    steady_line,
)

LINE = "line"
"""The effect that is found in the samples, not in the outputs of the periods."""

_RESULTS = 3
"""The first parameters are the result: the gain of the tilt, and the two accelerations without a tilt."""


class PlatformStudy(CatalogueStudy[PlatformData]):
    """A recording of modulated runs."""

    experiment = "rotating-platform"
    expressions: ClassVar[Mapping[str, str]] = {
        "time_s": "run.t",
        "within_run_s": "run.within",
        "c_z_m_s2": "run.c_z",
        "c_y_m_s2": "run.c_y",
        "temperature_c": "run.temperature",
        "modulation_frequency_hz": "1.0 / run.period",
        "stop": "run.cos",
        "turns": "run.turns",
        **{f"turns_modulo_{cycle}": f"run.turns % {cycle}" for cycle in TURN_CYCLES},
        **{f"turns_in_run_modulo_{cycle}": f"run.turns_in_run % {cycle}" for cycle in TURN_CYCLES},
    }

    def reduced_source(self) -> PlatformData:
        """The recorded runs; each set of lines taken off their samples is reduced when it is asked for."""
        return PlatformData(RecordedRuns(self.source))

    @property
    def recorded(self) -> Recorded:
        """All runs, reduced; `DataError` when there are none."""
        return self.data.channels()

    @property
    def left_out(self) -> Mapping[str, str]:
        """By run_id, why a valid run could not be reduced."""
        return self.data.recorded.reduced(()).left_out

    def model(self, terms: Sequence[Term]) -> PlatformModel:
        """The model with these terms; `ConfigError` for an unknown effect, `DataError` when data for it lack."""
        by_effect = {term.effect: term for term in terms}
        parts: list[Placed] = []
        for effect in self.chosen(terms):
            if reason := self._lacking_condition(effect):
                raise DataError(f"'{effect.id}' cannot be in a model of this recording: {reason}")
            if not effect.scanned:
                parts.append(placed(effect, by_effect[effect.id], CHANNELS, parts))
        return PlatformModel(self.data.channels(line_frequencies_hz(terms)), parts, terms)

    def untestable(self, effect: Effect, model: Model) -> str | None:
        """Why the runs of `model` cannot be asked about an effect; None when they can."""
        del model
        return self._lacking_condition(effect)

    def _lacking_condition(self, effect: Effect) -> str | None:
        if "temperature" in effect.needs and not self.data.temperature_varies_within_runs:
            return "no run has samples of temperature_c that vary"
        if "time" in effect.needs and not self.data.times_are_known:
            return "the runs do not say when they began; write start_s"
        return None

    def candidates_for(self, effects: Sequence[Effect], model: Model, values: FloatArray) -> list[list[Candidate]]:
        """One candidate per effect; of a scanned one, one per value of its scan."""
        return [
            [
                *(self.candidate(model, values, term) for term in _choices(effect)),
                *self._elsewhere(model, values, effect),
            ]
            for effect in effects
        ]

    def _elsewhere(self, model: Model, values: FloatArray, effect: Effect) -> list[Candidate]:
        """An effect as it is seen from another minimum of the fit with it."""
        here, term = own_model(model, PlatformModel), Term(effect.id)
        one = placed(effect, term, CHANNELS, here.placed)
        slopes = None if effect.scans else slopes_elsewhere(here, values, one, here.observations.sigma)
        return [] if slopes is None else [_as_candidate(term, *slopes)]

    def reason_for_no_change(self, effect: Effect) -> str:
        """Why an effect without any influence on the data cannot be tested."""
        if effect.id == "off-centre":
            return "the platform is at rest wherever samples count"
        return super().reason_for_no_change(effect)

    def neighbours(self, term: Term) -> dict[str, tuple[float, float]]:
        """Between which values the scan leaves open what a choice really is, by name; empty for what has no scan."""
        scans = self.catalogue[term.effect].scans
        return {name: _between(scans[name], float(value)) for name, value in term.choice.items() if name in scans}

    def within(self, term: Term) -> dict[str, tuple[float, float]]:
        """Between the ends of the scan, and as far beyond as its values are apart."""
        scans = self.catalogue[term.effect].scans
        return {name: (_between(each, min(each))[0], _between(each, max(each))[1]) for name, each in scans.items()}

    def candidate(self, model: Model, values: FloatArray, term: Term) -> Candidate:
        """An effect that `model` lacks with any values of its choice."""
        here = own_model(model, PlatformModel)
        one = placed(self.catalogue[term.effect], term, CHANNELS, here.placed)
        return _as_candidate(one.term, *slopes_at_zero(here, values, one, here.observations.sigma))

    def lines(self, model: Model) -> Sequence[Line]:
        """Steady lines in what is left of the samples."""
        lines_hz = line_frequencies_hz(model.terms)
        reduced = self.data.recorded.reduced(lines_hz)
        periods_s = [each.run.cells.period_s for each in reduced.channels.channels]
        longest_s = reduced.spectra.scan.longest_s
        in_data, lines = harmonic_lines(reduced.spectra), []
        for rough in (*in_data, *found_lines(reduced.spectra, periods_s)):
            line, channel = refined_line(self.source, reduced.runs, lines_hz, rough)
            term = Term(LINE, {"frequency_hz": line.frequency_hz})
            # The powers of both channels were summed: it is one line, told of the channel that shows it best.
            told = steady_line(line, term, READ[channel], "m/s2", longest_s)
            lines.append(replace(told, in_data=rough in in_data))
        return lines

    def result(self, model: Model, values: FloatArray, covariance: FloatArray) -> dict[str, Any]:
        """The gain of the tilt and the accelerations without one."""
        return parameters_as_json(model, values, covariance, _RESULTS)

    def options(self) -> list[Proposal]:
        """Patterns, periods and tilts for the next runs."""
        return options([each.run for each in self.recorded.channels])

    def extended(self, proposals: Sequence[Proposal]) -> PlatformStudy:
        """This recording and runs that could be made next."""
        return self.with_data(PlatformData(self.data.recorded, proposals))


def _as_candidate(term: Term, amplitudes: Sequence[EffectParameter], columns: FloatArray) -> Candidate:
    return Candidate(
        term=term,
        names=tuple(each.name for each in amplitudes),
        units=tuple(each.unit for each in amplitudes),
        columns=columns,
        typical=np.array([each.typical for each in amplitudes]),
    )


def _between(scan: Sequence[float], value: float) -> tuple[float, float]:
    """The neighbours of a value of a scan; beyond its ends it goes on by the last ratio."""
    below = [each for each in scan if each < value]
    above = [each for each in scan if each > value]
    low = max(below) if below else value**2 / min(above)
    return low, (min(above) if above else value**2 / max(below))


def _choices(effect: Effect) -> list[Term]:
    """The terms an effect may come as: one, or one per combination of the values of its scans."""
    names = list(effect.scans)
    return [Term(effect.id, dict(zip(names, values, strict=True))) for values in product(*effect.scans.values())]
