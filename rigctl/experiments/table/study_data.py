"""What a study of a table works on: its readings, the effects they could show, the baseline's fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from rigctl.campaign.recording import RunSource
from rigctl.core.arrays import FloatArray
from rigctl.core.readings import resolution
from rigctl.experiments.table.batches import Ratios, correlation, ratios_of, shared_offsets
from rigctl.experiments.table.candidates import Derivatives, Scans
from rigctl.experiments.table.catalogue import generic, why_not
from rigctl.experiments.table.model.form import TableEffect
from rigctl.experiments.table.model.start import POINTS_MAX, baseline_start
from rigctl.experiments.table.observe.readings import Readings, declares_noise, read
from rigctl.experiments.table.proposals import with_proposals
from rigctl.workbench.study import NoisePool, Observations, Proposal, Series

# Of the response: data that a baseline fits exactly leave this much.
_ROUNDING = 1e-13
_GRID_POINTS, _GRID_LEAST = 1500, 100


@dataclass(frozen=True)
class TableData:
    """Readings, some of them perhaps `imagined`, and the baseline's parameters as it alone is fitted, `start`."""

    readings: Readings
    start: FloatArray
    imagined: bool = False
    ratios: Ratios = field(default_factory=dict)
    """Of columns whose readings share offsets."""

    @classmethod
    def of(cls, source: RunSource) -> TableData:
        """The readings of a recording; `DataError` for a question they cannot be asked."""
        readings = read(source)
        data = cls(readings, baseline_start(readings))
        if not readings.spec.sigma and not declares_noise(source.header, readings.response.name):
            # Relative weights only, but of the right size: the fit's tolerances are in units of them.
            data = cls(replace(readings, sigma=data.scatter()), data.start)
        signal, slopes = data.baseline
        return replace(data, ratios=ratios_of(data.readings, readings.response.values - signal, slopes, data.generic))

    def with_proposals(self, proposals: Sequence[Proposal]) -> TableData:
        """These readings and some more, which mean nothing but where they are taken."""
        return replace(self, readings=with_proposals(self.readings, proposals), imagined=True)

    @cached_property
    def generic(self) -> dict[str, TableEffect]:
        """The catalogue made from the columns."""
        return generic(self.readings, self.baseline[1])

    def why_not(self, effect: str) -> str:
        """Why the readings cannot be asked about an effect of the catalogue, by its id; "" when they can."""
        if effect not in self._reasons:
            self._reasons[effect] = why_not(self.generic[effect], self.readings)
        return self._reasons[effect]

    @cached_property
    def _reasons(self) -> dict[str, str]:
        return {}

    @cached_property
    def scans(self) -> Scans:
        """The catalogue's scans; the more columns, the fewer points has each."""
        return Scans(min(max(_GRID_POINTS // max(len(self.readings.columns), 1), _GRID_LEAST), POINTS_MAX))

    @cached_property
    def derivatives(self) -> Derivatives:
        """What is made of the catalogue's other forms."""
        return Derivatives()

    @cached_property
    def baseline(self) -> tuple[FloatArray, FloatArray]:
        """What the baseline alone predicts, (n,), and its derivatives, (n, m), at `start`."""
        return self.readings.baseline(self.start)

    def scatter(self) -> FloatArray:
        """What the baseline alone leaves, rms, but never less than rounding; (n,)."""
        values = self.readings.response.values
        left = values - self.baseline[0]
        floor = _ROUNDING * float(np.abs(values).max())
        return np.full(left.size, max(float(np.sqrt(np.mean(left**2))), floor) or 1.0)

    @cached_property
    def observations(self) -> Observations:
        """Each row is a run."""
        readings = self.readings
        n = readings.response.values.size
        none = np.zeros(n, dtype=np.intp)
        offsets = shared_offsets(readings, self.ratios)
        pool = NoisePool(
            readings.response.name,
            0.0,
            readings.spec.order,
            stated=readings.spec.sigma is not None,
            resolution=resolution(readings.response.values),
        )
        grouped = [category for category in readings.categories.values() if category.names_groups]
        return Observations(
            run_ids=readings.labels,
            series=(Series(readings.response.name, "", readings.response.unit),),
            pools=(pool,),
            value=readings.response.values,
            sigma=readings.sigma,
            series_of=none,
            run_of=np.arange(n, dtype=np.intp),
            pool_of=none,
            group_of=none,
            block_of=readings.block_of,
            covariates={**readings.numbers, **{category.name: category.codes for category in grouped}},
            levels={category.name: category.levels for category in grouped},
            factors=correlation(offsets, n),
            offsets=offsets,
            excluded=readings.excluded,
        )
