"""What a study of an in-flight calibration works on: runs reduced to lines, their noise, and their samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from rigctl.analysis.kept import Reduction
from rigctl.campaign.recording import RunSource
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.inflight.effect_changes import EffectChanges
from rigctl.experiments.inflight.imagined import stronger
from rigctl.experiments.inflight.model.baseline import Baseline, Stretch
from rigctl.experiments.inflight.model.observed import Observed, observed
from rigctl.experiments.inflight.model.residual_samples import RunScan
from rigctl.experiments.inflight.model.sample_scans import run_scans
from rigctl.experiments.inflight.observations import observations_of
from rigctl.experiments.inflight.observe.reduction import ReducedRun
from rigctl.experiments.inflight.observe.store_reduction import reduced_without, reduction
from rigctl.experiments.inflight.sample_findings import relative_noise
from rigctl.workbench.study import Observations, Proposal


@dataclass(frozen=True, eq=False)
class FlightData:
    """The valid runs of `source`, as `reduced`, perhaps with imagined ones after them.

    `pulses_s` are times of pulses that are masked in the samples, by run. With `levels`, scans of the samples, the
    noise of each half is as large as its own samples say. `known_noise` is None where it has yet to be estimated.
    """

    source: RunSource
    reduced: Reduction[ReducedRun]
    known_noise: Observed | None = None
    pulses_s: Mapping[str, FloatArray] = field(default_factory=dict)
    levels: tuple[RunScan, ...] | None = None

    @classmethod
    def of(cls, source: RunSource) -> FlightData:
        """All valid runs; `DataError` when none can be used."""
        reduced = reduction(source)
        if not reduced.runs:
            why = next(iter(reduced.left_out.values()), "there is no valid run")
            raise DataError(f"no run of this recording can be used: {why}")
        return cls(source, reduced)

    @cached_property
    def observed(self) -> Observed:
        """The runs with their noise."""
        return observed(self.reduced.runs) if self.known_noise is None else self.known_noise

    @cached_property
    def baseline(self) -> Baseline:
        """Of all halves."""
        stretches = self.observed.stretches()
        return Baseline(stretches if self.levels is None else self._levelled(stretches, self.levels))

    def _levelled(self, stretches: Sequence[Stretch], levels: Sequence[RunScan]) -> list[Stretch]:
        by_run = {each.run_id: each for each in levels}
        halves = [half for run in self.reduced.runs for half in run.halves]
        return [
            replace(stretch, sigma=stretch.sigma * relative_noise(by_run[stretch.run_id], half))
            if stretch.run_id in by_run
            else stretch
            for stretch, half in zip(stretches, halves, strict=True)
        ]

    @cached_property
    def observations(self) -> Observations:
        """Lines of all halves, each half a run of its own and a block."""
        return observations_of(self.observed, self.baseline)

    @cached_property
    def effects(self) -> EffectChanges:
        """What effects do to these lines."""
        return EffectChanges(self.reduced.runs)

    @cached_property
    def scans(self) -> tuple[RunScan, ...]:
        """All runs' samples looked through, with the baseline as fitted to them; kept for just these runs."""
        if self.levels is not None:
            return self.levels
        return run_scans(self.source, self.reduced.runs, self.observed.values, self.pulses_s)

    @cached_property
    def without_pulses(self) -> FlightData:
        """The same without the samples that pulses cover."""
        pulses_s = {each.run_id: each.pulses.at_s for each in self.scans if len(each.pulses.at_s)}
        runs, left_out = [], dict(self.reduced.left_out)
        for run in self.reduced.runs:
            if run.run_id not in pulses_s:
                runs.append(run)
                continue
            try:
                runs.append(reduced_without(self.source, run, pulses_s[run.run_id]))
            except DataError as error:
                left_out[run.run_id] = str(error)
        return replace(self, reduced=Reduction(tuple(runs), left_out), known_noise=None, pulses_s=pulses_s)

    @cached_property
    def by_level(self) -> FlightData:
        """The same with the noise of each half as large as its own samples say."""
        return replace(self, known_noise=self.observed, levels=self.scans)

    def with_proposals(self, proposals: Sequence[Proposal]) -> FlightData:
        """These runs and sessions flown once more: like the runs there are, of which only lines count."""
        place_of = {run.session.name: place for place, run in enumerate(self.reduced.runs)}
        places = [place_of[str(each.settings["session"])] for each in proposals]
        further = []
        for number, (each, place) in enumerate(zip(proposals, places, strict=True), start=1):
            like = self.reduced.runs[place]
            amplitude = float(each.settings.get("amplitude", like.session.amplitude))
            further.append(stronger(like, f"next {number}", amplitude))
        runs, here = (*self.reduced.runs, *further), self.observed
        noises = (*here.noises, *(here.noises[place] for place in places))
        reduced = Reduction(runs, self.reduced.left_out)
        return replace(self, reduced=reduced, known_noise=Observed(runs, noises, here.values))
