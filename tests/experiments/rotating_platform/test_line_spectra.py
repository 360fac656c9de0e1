"""Lines are looked for in what the fits of all periods leave: runs of which few periods are whole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.platform_sampler import SampledRun, sampled
from rigctl.campaign.recording import Header, RunRecord, RunSource
from rigctl.core.arrays import FloatArray
from rigctl.experiments.rotating_platform.study_data import RecordedRuns
from simulators.worlds.platform_settings import PlatformSettings

MOST_SIGMAS = 4.0


@dataclass(frozen=True)
class Spoilt:
    """A recording whose samples are lost for some seconds in these periods."""

    source: RunSource
    periods: tuple[int, ...]

    @property
    def header(self) -> Header:
        return self.source.header

    def runs(self, *, valid_only: bool = False) -> list[RunRecord]:
        return self.source.runs(valid_only=valid_only)

    def run(self, run_id: str) -> RunRecord | None:
        return self.source.run(run_id)

    def samples(self, run_id: str) -> dict[str, FloatArray]:
        found = dict(self.source.samples(run_id))
        for period in self.periods:
            lost = slice(1200 * period + 300, 1200 * period + 320)
            for name in ("q_a_v", "q_b_v"):
                found[name] = np.concatenate(
                    [found[name][: lost.start], np.full(20, np.nan), found[name][lost.stop :]]
                )
        return found


def test_two_whole_periods_are_no_comb_of_lines() -> None:
    """Their mean taken off leaves one difference twice: nothing at the harmonics of half their distance."""
    made = sampled(PlatformSettings(kind="rotating-platform", seed=4), [SampledRun("c_tm", 120.0, 5, v_z_v=1.0)])
    for spoilt in ((), (1, 3), (0, 2, 4), (1, 2, 3)):
        peaks = RecordedRuns(Spoilt(made, spoilt)).reduced(()).spectra.peaks
        assert max(peaks.values()) < MOST_SIGMAS, (spoilt, peaks)
