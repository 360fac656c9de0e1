"""What a study of the rotating platform works on: the runs of a recording, reduced, and runs that are proposed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rigctl.campaign.recording import RunSource
from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.imagined import imagined_channels
from rigctl.experiments.rotating_platform.model.recorded_runs import Recorded
from rigctl.experiments.rotating_platform.observe.channel_runs import channel_runs
from rigctl.experiments.rotating_platform.observe.line_spectra import Spectra
from rigctl.experiments.rotating_platform.observe.recorded import chains
from rigctl.experiments.rotating_platform.observe.store_reduction import PlatformRun, reduction, scan
from rigctl.workbench.study import Proposal


@dataclass(frozen=True)
class ReducedRuns:
    """All valid runs with some lines taken off their samples; `left_out` says by run_id why one is not among them."""

    runs: tuple[PlatformRun, ...]
    channels: Recorded
    spectra: Spectra
    left_out: Mapping[str, str]


class RecordedRuns:
    """The runs of a recording, reduced once for each set of lines that are taken off their samples."""

    def __init__(self, source: RunSource) -> None:
        self.source = source
        self._by_lines: dict[tuple[float, ...], ReducedRuns] = {}

    def reduced(self, lines_hz: tuple[float, ...]) -> ReducedRuns:
        """All runs; `DataError` when there are none."""
        if lines_hz not in self._by_lines:
            self._by_lines[lines_hz] = self._reduced(lines_hz)
        return self._by_lines[lines_hz]

    def _reduced(self, lines_hz: tuple[float, ...]) -> ReducedRuns:
        reduced = reduction(self.source, lines_hz)
        channels, refused = channel_runs(reduced.runs)
        left_out = {**reduced.left_out, **refused}
        if not channels:
            why = next(iter(left_out.values()), "it has no modulated run")
            raise DataError(f"no valid run could be reduced: {why}")
        runs = tuple({each.run.run_id: each.run for each in channels}.values())
        spectra = scan(self.source, runs, lines_hz)
        recorded = Recorded(tuple(channels), chains(self.source.header).g_m_s2, peaks=spectra.peaks)
        return ReducedRuns(runs, recorded, spectra, left_out)


class PlatformData:
    """Recorded runs, and `proposals` as if they had been made after them."""

    def __init__(self, recorded: RecordedRuns, proposals: Sequence[Proposal] = ()) -> None:
        self.recorded = recorded
        self._proposals = tuple(proposals)
        self._extended: dict[tuple[float, ...], Recorded] = {}

    def channels(self, lines_hz: tuple[float, ...] = ()) -> Recorded:
        """All runs in both channels, with these lines taken off the samples of the recorded ones."""
        made = self.recorded.reduced(lines_hz).channels
        if not self._proposals:
            return made
        if lines_hz not in self._extended:
            further = imagined_channels(self._proposals, made.channels, chains(self.recorded.source.header))
            self._extended[lines_hz] = replace(
                made,
                channels=(*made.channels, *further),
                imagined=frozenset(each.run.run_id for each in further),
            )
        return self._extended[lines_hz]

    @cached_property
    def temperature_varies_within_runs(self) -> bool:
        """Whether the temperature is known everywhere and changes within at least one run."""
        channels = self.channels()
        varies = any(np.ptp(each.run.cells.state[:, 2]) > 0.0 for each in channels.channels)
        return varies and bool(np.isfinite(channels.chain["z"].temperature).all())

    @cached_property
    def times_are_known(self) -> bool:
        """Whether every run says when it began."""
        starts_s = [float(each.run.conditions.get("start_s", np.nan)) for each in self.channels().channels]
        return bool(np.isfinite(starts_s).all())
