"""What a study of the null search works on: the runs of a recording, and imagined ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from rigctl.analysis.kept import Reduction
from rigctl.analysis.line_scan import LineScan
from rigctl.campaign.recording import RunSource
from rigctl.experiments.sensing_axis.imagined import imagined
from rigctl.experiments.sensing_axis.model.chain import Origins
from rigctl.experiments.sensing_axis.model.model import origins_of
from rigctl.experiments.sensing_axis.observe.observables import RunObservables
from rigctl.experiments.sensing_axis.observe.recorded import recorded_calibration
from rigctl.experiments.sensing_axis.observe.reduction import ACCEL
from rigctl.experiments.sensing_axis.observe.set_points import Limits
from rigctl.experiments.sensing_axis.observe.store_reduction import line_scan, reduction
from rigctl.files.package import HeadSettings
from rigctl.workbench.study import Proposal


class RecordedRuns:
    """The valid runs of a recording, reduced once for each set of lines that are fitted in their samples."""

    def __init__(self, source: RunSource) -> None:
        self.package, self.heads, self.g_m_s2 = recorded_calibration(source.header)
        self.rig_is_known = source.header.rig_toml is not None
        self._source = source
        self._reductions: dict[tuple[float, ...], Reduction[RunObservables]] = {}
        self._scans: dict[tuple[float, ...], LineScan] = {}

    def reduction(self, lines_hz: tuple[float, ...]) -> Reduction[RunObservables]:
        """The runs as observables, and what was left out."""
        if lines_hz not in self._reductions:
            self._reductions[lines_hz] = reduction(self._source, lines_hz)
        return self._reductions[lines_hz]

    def line_scan(self, lines_hz: tuple[float, ...]) -> LineScan:
        """The spectrum of what the fitted harmonics and these lines leave of the samples."""
        if lines_hz not in self._scans:
            self._scans[lines_hz] = line_scan(self._source, lines_hz)
        return self._scans[lines_hz]

    @cached_property
    def origins(self) -> Origins:
        """Where temperature, time and extra columns count from."""
        return origins_of(self.reduction(()).runs)

    @property
    def limits(self) -> Limits:
        """Of the set-points that this bench can be given."""
        channel = self._source.header.channels.get(ACCEL)
        full_scale_v = channel.full_scale if channel else None
        return Limits(self.package, self.heads, full_scale_v, known=self.rig_is_known)


@dataclass(frozen=True)
class ScanData:
    """Recorded runs, and `imagined` ones after them."""

    recorded: RecordedRuns
    imagined: tuple[RunObservables, ...] = ()

    def runs(self, lines_hz: tuple[float, ...] = ()) -> tuple[RunObservables, ...]:
        """All runs, with these lines fitted in the samples of the recorded ones."""
        return (*self.recorded.reduction(lines_hz).runs, *self.imagined)

    @property
    def origins(self) -> Origins:
        """Those of the recorded runs: imagined ones must not move them."""
        return self.recorded.origins if self.recorded.reduction(()).runs else origins_of(self.imagined)

    def with_proposals(self, proposals: Sequence[Proposal]) -> ScanData:
        """The recorded runs and those proposed, in the mounting that was used last."""
        return ScanData(self.recorded, tuple(imagined(proposals, self.runs(), self.recorded.limits)))

    def placed_heads(self, runs: Sequence[RunObservables]) -> dict[str, HeadSettings]:
        """Heads of which it is known where they stand: without a rig file the face they look at tells it."""
        heads = self.recorded.heads
        if self.recorded.rig_is_known:
            return dict(heads)
        faceless = {head for run in runs for head in run.lasers_m if head not in run.faces}
        return {name: head for name, head in heads.items() if name not in faceless}
