"""What a study of an in-flight calibration works on: runs reduced to lines, their noise, and their samples."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property

import numpy as np

from rigctl.analysis.kept import Packed, Reduction
from rigctl.campaign.recording import RunSource, why_none
from rigctl.core.arrays import ComplexArray, FloatArray
from rigctl.core.errors import DataError
from rigctl.core.units import ABSOLUTE_ZERO_C
from rigctl.effects.catalogue import Effect
from rigctl.experiments.inflight.effect_changes import EffectChanges
from rigctl.experiments.inflight.imagined import flown_again
from rigctl.experiments.inflight.model.baseline import Baseline
from rigctl.experiments.inflight.model.observed import Observed, observed
from rigctl.experiments.inflight.model.residual_samples import Peak, Pulses, RunScan, scan
from rigctl.experiments.inflight.observations import observations_of
from rigctl.experiments.inflight.observe.reduction import ReducedRun
from rigctl.experiments.inflight.observe.series import temperatures, without_pulses
from rigctl.experiments.inflight.observe.sessions import CALIBRATION, EQUIVALENCE
from rigctl.experiments.inflight.observe.store_reduction import kept_by, reduced_without, reduction
from rigctl.experiments.inflight.observe.waves import templates
from rigctl.experiments.inflight.sample_findings import relative_noise
from rigctl.experiments.inflight.templates import by_own_columns
from rigctl.workbench.study import Observations, Proposal


@dataclass(frozen=True, eq=False)
class RecordedRuns:
    """The valid runs of `source`, reduced; `pulses_s` are times of pulses that are masked in the samples, by run."""

    source: RunSource
    reduced: Reduction[ReducedRun]
    pulses_s: Mapping[str, FloatArray] = field(default_factory=dict)

    @cached_property
    def observed(self) -> Observed:
        """The runs with their noise."""
        return observed(self.reduced.runs)

    @cached_property
    def scans(self) -> tuple[RunScan, ...]:
        """All runs' samples searched, with the baseline as fitted to them; kept for just these runs."""
        return run_scans(self.source, self.reduced.runs, self.observed.values, self.pulses_s)

    @cached_property
    def without_pulses(self) -> RecordedRuns:
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
        return replace(self, reduced=Reduction(tuple(runs), left_out), pulses_s=pulses_s)


def _contents(run: ReducedRun) -> list[float]:
    amplitudes = run.whole.amplitudes.table
    return [run.conditions.get("start_s", np.nan), *amplitudes.real.ravel(), *amplitudes.imag.ravel()]


@dataclass(frozen=True, eq=False)
class FlightData:
    """`recorded` runs, and after them imagined ones: a recorded run as it would be with other settings.

    Only recorded runs have samples. With `levelled`, the noise of each recorded half is as large as its samples say.
    """

    recorded: RecordedRuns
    imagined: tuple[tuple[str, ReducedRun], ...] = ()
    """Each with the run_id of the recorded run whose noise it has."""
    levelled: bool = False

    @classmethod
    def of(cls, source: RunSource) -> FlightData:
        """All valid runs; `DataError` when none can be used."""
        reduced = reduction(source).sorted_by(_contents)
        if not reduced.runs:
            if source.runs() and all(run.conditions.get("session") in EQUIVALENCE for run in source.runs()):
                raise DataError(
                    "no run of this recording calibrates: it has sessions of the test only, which are corrected with "
                    f"what others find; add some of {', '.join(CALIBRATION)}"
                )
            raise DataError(f"no run of this recording can be used: {why_none(source, reduced.left_out)}")
        return cls(RecordedRuns(source, reduced))

    @property
    def reduced(self) -> Reduction[ReducedRun]:
        """The recorded runs, and those left out."""
        return self.recorded.reduced

    @cached_property
    def observed(self) -> Observed:
        """All runs with their noise."""
        here = self.recorded.observed
        noise_of = {run.run_id: noise for run, noise in zip(here.runs, here.noises, strict=True)}
        # An imagined session has the noise of the run that it repeats.
        noises = (noise_of.get(like, here.noises[0]) for like, _ in self.imagined)
        return Observed((*here.runs, *(run for _, run in self.imagined)), (*here.noises, *noises), here.values)

    @cached_property
    def baseline(self) -> Baseline:
        """Of all halves."""
        stretches = self.observed.stretches()
        if self.levelled:
            scan_of = {each.run_id: each for each in self.recorded.scans}
            halves = [half for run in self.reduced.runs for half in run.halves]
            for place, half in enumerate(halves):
                stretch = stretches[place]
                level = relative_noise(scan_of[stretch.run_id], half)
                stretches[place] = replace(stretch, sigma=stretch.sigma * level)
        return Baseline(stretches)

    @cached_property
    def observations(self) -> Observations:
        """Lines of all halves, each half a run of its own and a block; nobody asks what imagined runs leave."""
        given = observations_of(self.observed, self.baseline)
        if self.imagined:
            return given
        return replace(given, templates=by_own_columns(self.reduced.runs, self.effects, self.baseline, self._at))

    @property
    def _at(self) -> FloatArray:
        """Parameters of the baseline where effects are looked at."""
        start = np.array([each.start for each in self.baseline.parameters])
        start[: len(self.observed.values)] = self.observed.values
        return start

    @cached_property
    def effects(self) -> EffectChanges:
        """What effects do to these lines."""
        return EffectChanges(self.observed.runs, usual_temperatures_k(self.reduced.runs))

    def of_any_temperature(self, effects: Sequence[Effect]) -> Iterator[list[ComplexArray]]:
        """What effects do to the amplitudes of all halves, for temperatures that nobody recorded: any waves at the
        orbit's frequency and twice that, in each half for itself."""
        unchanged = [np.zeros_like(each.amplitudes.table) for each in self.baseline.stretches]
        first = 0
        for run in self.observed.runs:
            orbital_hz = run.session.orbital_hz
            # Nobody recorded the temperature: at the orbit's frequency and twice that it could have been anything.
            waves = (
                () if temperatures(run.coarse.columns) else templates(run.coarse.t_s, (orbital_hz, 2.0 * orbital_hz))
            )
            for wave in waves:
                columns = {**run.coarse.columns, "temperature_c": wave}
                run_of_wave = replace(run, coarse=replace(run.coarse, columns=columns))
                warmed = EffectChanges([run_of_wave], np.full(2, -ABSOLUTE_ZERO_C))
                for effect in effects:
                    for changes in warmed.derivatives(effect, np.zeros(len(effect.parameters))):
                        for place, change in enumerate(changes, start=first):
                            yield [*unchanged[:place], change, *unchanged[place + 1 :]]
            first += len(run.halves)

    @cached_property
    def without_pulses(self) -> FlightData:
        """The same without the recorded samples that pulses cover."""
        return replace(self, recorded=self.recorded.without_pulses)

    @cached_property
    def by_level(self) -> FlightData:
        """The same with the noise of each recorded half as large as its own samples say."""
        return replace(self, levelled=True)

    def with_proposals(self, proposals: Sequence[Proposal]) -> FlightData:
        """These runs and sessions flown once more: like the recorded runs, of which only lines count."""
        run_of = {run.session.name: run for run in self.reduced.runs}
        likes = [run_of[str(each.settings["session"])] for each in proposals]
        imagined = [
            (like.run_id, flown_again(like, f"next {number}", each.settings))
            for number, (like, each) in enumerate(zip(likes, proposals, strict=True), start=len(self.imagined) + 1)
        ]
        return replace(self, imagined=(*self.imagined, *imagined))


def usual_temperatures_k(runs: Sequence[ReducedRun]) -> FloatArray:
    """Means of both sensors' temperatures over all samples that there are, (2,); NaN without a thermometer."""
    both = [(run.coarse.present, temperatures(run.coarse.columns)) for run in runs]
    recorded = [np.array(found)[:, present] for present, found in both if found]
    return np.mean(np.hstack(recorded), axis=1) if recorded else np.full(2, np.nan)


def run_scans(
    source: RunSource, runs: Sequence[ReducedRun], values: FloatArray, pulses_s: Mapping[str, FloatArray]
) -> tuple[RunScan, ...]:
    """What the baseline at `values` leaves of all runs' samples, without those that pulses cover, looked through.

    Kept for just these runs and pulses.
    """
    # The baseline is fitted to all runs: one more changes what it leaves of each.
    names = " ".join(sorted(run.run_id for run in runs))
    kept = kept_by(source, "samples", names.encode() + b"".join(pulses.tobytes() for pulses in pulses_s.values()))

    def scanned(run: ReducedRun) -> RunScan:
        def make() -> Packed:
            samples = without_pulses(source.samples(run.run_id), pulses_s.get(run.run_id))
            return packed_scan(scan(run, samples, values))

        return kept.once(run.run_id, make, unpacked_scan)

    return tuple(map(scanned, runs))


def packed_scan(scan: RunScan) -> Packed:
    """Everything."""
    pulses = scan.pulses
    head = {"run_id": scan.run_id, "peak": None if scan.peak is None else asdict(scan.peak)}
    return Packed(head, {**vars(pulses), "levels": scan.levels, "level_at_s": scan.level_at_s})


def unpacked_scan(kept: Packed) -> RunScan:
    """What `packed_scan` was given."""
    head, arrays = kept.head, kept.arrays
    pulses = Pulses(**{each.name: arrays[each.name] for each in fields(Pulses)})
    peak = None if head["peak"] is None else Peak(**head["peak"])
    return RunScan(head["run_id"], pulses, peak, arrays["levels"], arrays["level_at_s"])
