"""The acceleration without the bias, period by period, while a run is still being recorded."""

from __future__ import annotations

import math

import numpy as np

from rigctl.campaign.session.session import Session
from rigctl.core.arrays import FloatArray, Int8Array
from rigctl.experiments.rotating_platform.observe.demodulation import Demodulator, PeriodSums
from rigctl.experiments.rotating_platform.observe.estimates import estimates
from rigctl.experiments.rotating_platform.observe.estimators import Estimator
from rigctl.experiments.rotating_platform.observe.patterns import SampledPattern

PERIOD = "period"
"""The kind of event that keeps an estimate."""


class LiveEstimate:
    """Takes a run's rows as they come; each period that is complete is told, and kept as an event.

    Columns are z and y; `gains` their volts per m/s2. Samples taken while the platform was not where the
    table has it count as missing.
    """

    def __init__(
        self,
        session: Session,
        sampled: SampledPattern,
        estimator: Estimator,
        gains: tuple[float, float],
        full_scale_v: float | None,
        periods: int,
    ) -> None:
        self._session, self._sampled, self._estimator, self._gains = session, sampled, estimator, gains
        self._stream = Demodulator(sampled, 2, full_scale=full_scale_v)
        self._taken = 0
        self._done = 0
        self._periods = periods

    def __call__(self, rows: FloatArray, sign: Int8Array) -> None:
        """The next rows of the run, shape (n, 2), and cos(theta) of each as it was, 0 in motion, shape (n,)."""
        place = np.arange(self._taken, self._taken + len(rows)) % self._sampled.samples
        wanted = self._sampled.sign[place]
        self._taken += len(rows)
        self._tell(self._stream.feed([rows[:, 0], rows[:, 1]], off_stop=(wanted != 0) & (sign != wanted)))

    def _tell(self, sums: PeriodSums) -> None:
        found = estimates(self._sampled, sums, self._estimator)
        for accel_v, bias_v, faults in zip(found.accel_mean, found.bias_mean, found.faults, strict=True):
            self._done += 1
            accel_z, accel_y = (_number(v / gain) for v, gain in zip(accel_v, self._gains, strict=True))
            bias_z, bias_y = (_number(v / gain) for v, gain in zip(bias_v, self._gains, strict=True))
            self._session.event(
                PERIOD,
                period=self._done,
                accel_z_m_s2=accel_z,
                accel_y_m_s2=accel_y,
                bias_z_m_s2=bias_z,
                bias_y_m_s2=bias_y,
                samples_missing=int(faults.sum(axis=-1).max()),
            )
            told = "no estimate, too many samples are missing" if accel_z is None else f"a_z {accel_z:.4e} m/s2"
            self._session.tell(f"period {self._done} of {self._periods}: {told}")


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
