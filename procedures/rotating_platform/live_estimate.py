"""The acceleration without the bias, period by period, while a run is still being recorded."""

from __future__ import annotations

import math

from rigctl.campaign.session.session import Session
from rigctl.experiments.rotating_platform.observe.cells import Cells, Columns
from rigctl.experiments.rotating_platform.observe.cutter import CellStream
from rigctl.experiments.rotating_platform.observe.estimates import estimates, outside_guard
from rigctl.experiments.rotating_platform.observe.estimators import Estimator
from rigctl.experiments.rotating_platform.observe.patterns import SampledPattern
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS, READINGS, chains

PERIOD = "period"
"""The kind of event that keeps an estimate."""


class LiveEstimate:
    """Takes a run's columns as they come; each period that is complete is told, and kept as an event.

    The run is cut into the same cells as for its result. A period whose dwells are not those of the table is fitted
    jointly.
    """

    def __init__(self, session: Session, sampled: SampledPattern, estimator: Estimator, periods: int) -> None:
        self._session, self._sampled, self._estimator, self._periods = session, sampled, estimator, periods
        pattern, believed = sampled.pattern, chains(session.store.header)
        self._guards_s = {"guard_s": pattern.guard_s, "lead_s": pattern.lead_s}
        self._stream = CellStream(believed, pattern.period_s, sampled.sample_rate_hz, **self._guards_s)
        self._rows_to_come = periods * sampled.samples
        self._done = 0
        self._estimated = dict.fromkeys(CHANNELS, 0)

    def __call__(self, columns: Columns) -> None:
        """The next samples of the run, as they are recorded."""
        self._stream.take(columns)
        self._rows_to_come -= columns["t_s"].size
        if self._rows_to_come <= 0:
            # Cells look ahead to the next turn, and after the last sample there is none.
            self._stream.end()
        cells = self._stream.cells()
        if cells is not None:
            self._tell(cells)

    @property
    def missing(self) -> str:
        """Of which channels there is not one estimate, in words; empty when each has some."""
        without = [READINGS[channel] for channel, estimated in self._estimated.items() if not estimated]
        return f"no period has enough samples of {' and '.join(without)}" if without else ""

    def _tell(self, cells: Cells) -> None:
        series = estimates(cells, outside_guard(cells, **self._guards_s), self._sampled, self._estimator)
        for accel, bias, faults in zip(series.accel_mean, series.bias_mean, series.faults, strict=True):
            self._done += 1
            for channel, value in zip(CHANNELS, accel, strict=True):
                self._estimated[channel] += math.isfinite(value)
            accel_m_s2, bias_m_s2 = (dict(zip(CHANNELS, map(_number, each), strict=True)) for each in (accel, bias))
            self._session.event(
                PERIOD,
                period=self._done,
                accel_z_m_s2=accel_m_s2["z"],
                accel_y_m_s2=accel_m_s2["y"],
                bias_z_m_s2=bias_m_s2["z"],
                bias_y_m_s2=bias_m_s2["y"],
                samples_missing=int(faults.sum(axis=-1).max()),
            )
            accel_z = accel_m_s2["z"]
            what = "no estimate, too many samples are missing" if accel_z is None else f"a_z {accel_z:.4e} m/s2"
            self._session.tell(f"period {self._done} of {self._periods}: {what}")


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
