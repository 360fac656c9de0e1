"""The columns of runs.csv; a run as one number per sensor: the mean of its samples, and its uncertainty."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigctl.campaign import layout
from rigctl.campaign.layout import Field, Layout
from rigctl.campaign.recording import RunSource
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from tumble_test.positions import AXES, OUTS

COLUMNS = Layout(
    fields={
        "mounting": Field(layout.whole_number, required=True),
        "out": Field(layout.one_of(*OUTS), required=True),
        "clocking_deg": Field(layout.angle_deg, required=True),
        "angle_deg": Field(layout.angle_deg, required=True),
        "approach": Field(layout.sign),
        "sweep": Field(layout.whole_number),
        **layout.COMMON_FIELDS,
    },
)

STRETCHES = 8
"""A record's mean scatters at least as the means of its stretches say."""


@dataclass(frozen=True)
class Reduced:
    """One position: by sensor the mean output and its standard uncertainty within the run [V]; the run's length."""

    run_id: str
    conditions: Mapping[str, Any]
    mean_v: Mapping[str, float]
    sigma_v: Mapping[str, float]
    duration_s: float

    @property
    def seat(self) -> tuple[str, float, int]:
        """How the case was mounted: axis out, clocking in degrees, number."""
        given = self.conditions
        return str(given["out"]), float(given["clocking_deg"]), int(given["mounting"])

    def number(self, name: str) -> float:
        """A condition; NaN where it is missing or no number."""
        value = self.conditions.get(name)
        return float(value) if isinstance(value, int | float) else np.nan


def reduced_run(run_id: str, conditions: Mapping[str, Any], samples: Mapping[str, FloatArray]) -> Reduced:
    """Means and sigmas of a run; `DataError` when no sigma can be had of it."""
    mean_v, sigma_v = {}, {}
    for name in AXES:
        if (column := samples.get(f"{name}_v")) is None:
            continue
        known = column[np.isfinite(column)]
        if len(known) < 2 * STRETCHES:
            raise DataError(f"{name}_v has {len(known)} samples, too few for a sigma; record longer")
        means = [part.mean() for part in np.array_split(known, STRETCHES)]
        mean_v[name], sigma_v[name] = float(known.mean()), float(np.std(means, ddof=1) / np.sqrt(STRETCHES))
    if not mean_v:
        raise DataError("it has no column x_v, y_v or z_v")
    return Reduced(run_id, conditions, mean_v, sigma_v, float(samples["t_s"][-1] - samples["t_s"][0]))


def reduction(source: RunSource) -> tuple[list[Reduced], dict[str, str]]:
    """The valid runs, reduced; by run_id why one is left out."""
    runs, left_out = [], {}
    for record in source.runs(valid_only=True):
        try:
            runs.append(reduced_run(record.run_id, record.conditions, source.samples(record.run_id)))
        except DataError as error:
            left_out[record.run_id] = str(error)
    return runs, left_out
