"""Whether flag and angle of a run, and the period that runs.csv tells, can be those of one modulation."""

from __future__ import annotations

import math

import numpy as np

from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.observe.cells import FAR, Cells

# What a clock may be off by: what is more is another period.
_SAME_PERIOD = 5e-3
# Of the turns, as gaps hide some.
_MOST = 0.9
_LIKE_PI = 0.05


def check_turns(cells: Cells, pattern: str, period_s: float) -> None:
    """Raise `DataError` for a run that never turns by its flag, never rests at half a turn, or turns otherwise.

    A `custom` pattern may repeat itself within its period, a named one does not.
    """
    turned = cells.since < FAR
    if not turned.any() and (cells.off_stop or (cells.sign != cells.sign[0]).any()):
        raise DataError("moving is never 1 although theta_deg turns; write 1 while the platform turns")
    largest_deg = float(np.degrees(np.arccos(np.clip(cells.geometry[:, 0], -1.0, 1.0))).max())
    if turned.any() and (cells.sign > 0).all():
        radians = abs(largest_deg / math.pi - 1.0) < _LIKE_PI
        raise DataError(
            f"theta_deg never comes near 180 while the platform rests, at most {largest_deg:.3g}"
            + (": it looks like radians; write degrees" if radians else "; record dwells at 0 and at 180")
        )
    found_s = repeats_after_s(cells)
    # A run that was cut short may show less than two periods: then nothing is held against it.
    times = period_s / found_s
    nearest = max(round(times), 1) if pattern == "custom" and math.isfinite(times) else 1
    if abs(times / nearest - 1.0) > max(_SAME_PERIOD, 1.5 / cells.samples):
        raise DataError(
            f"modulation_period_s is {period_s:g}, the platform turns every {found_s:.4g} s; "
            "correct modulation_period_s in runs.csv"
        )


def repeats_after_s(cells: Cells) -> float:
    """After how long the turns come again to the same stops [s]; NaN where they do not, or gaps hide too many."""
    follows = np.flatnonzero(cells.since < FAR)
    at = (cells.period * cells.samples + cells.first - cells.since)[follows]
    ends, first = np.unique(at, return_index=True)
    stops = cells.sign[follows][first]
    for turns in range(1, ends.size // 2 + 1):
        apart = ends[turns:] - ends[:-turns]
        usual = float(np.median(apart))
        alike = (stops[turns:] == stops[:-turns]) & (np.abs(apart - usual) <= max(_SAME_PERIOD * usual, 1.0))
        if alike.mean() >= _MOST:
            return usual / cells.sample_rate_hz
    return math.nan
