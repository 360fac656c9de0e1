"""Do a meter's samples come when their time stamps say that they were taken?

A meter has a clock of its own, which may stand still, jump or drift. The host knows when it started a record, and
between which two instants it was told how many samples there are: a sample that should long be there and is not, or
one that is there before its time, has another time than its stamp.

Detectable: what puts samples more than `TIMING_S`, what the start took to be answered, and a period away from their
stamps. That is a drift of 1e-4 after 2000 s of one record. On the sensing-axis bench a drift that puts phases wrong
shows earlier, as the encoder is no sine of the drive's frequency any more (`sample_checks.SINE_WITHIN`: 1e-4 after
some 60 periods of the drive).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from rigctl.core.clock import Clock
from rigctl.core.errors import InstrumentError

TIMING_S = 0.2
"""What the link, the polling and a busy host take at most [s of the wall clock]."""


@dataclass(frozen=True)
class Pace:
    """When the samples of one record are due [rig s]; they may come `tolerance_s` earlier or later."""

    first_s: float
    period_s: float
    samples: int
    tolerance_s: float

    @classmethod
    def of_record(cls, clock: Clock, started_s: float, delay_s: float, period_s: float, samples: int) -> Pace:
        """Of a record begun at `started_s`, answered just now, whose first sample comes `delay_s` later."""
        # `TIMING_S` is of the wall clock, everything else here of the rig's; one that stands for no other is of both.
        speed = clock.speed if math.isfinite(clock.speed) else 1.0
        # Somewhere between the command and its answer the record began.
        tolerance_s = TIMING_S * speed + max(clock.now_s() - started_s, 0.0)
        return cls(started_s + delay_s, period_s, samples, tolerance_s)

    def require(self, meter: str, received: int, asked_s: float, answered_s: float) -> None:
        """`InstrumentError` unless so many samples can have come by a time between question and answer."""
        # Late by the time of the question: the count can be no older than that.
        if received < self.samples and asked_s > self._due_s(received) + self.tolerance_s:
            raise self._off(meter, received, asked_s - self._due_s(received), "late")
        # Early by the time of the answer: the count can be no newer.
        if received and answered_s < self._due_s(received - 1) - self.tolerance_s:
            raise self._off(meter, received - 1, self._due_s(received - 1) - answered_s, "early")

    def _due_s(self, sample: int) -> float:
        return self.first_s + sample * self.period_s

    def _off(self, meter: str, sample: int, off_s: float, how: str) -> InstrumentError:
        return InstrumentError(
            f"{meter}: sample {sample} comes {off_s:.3g} s or more too {how} for its time stamp, "
            f"{self.tolerance_s:.2g} s are allowed; has its clock jumped, or does it drift?",
            instrument=meter,
        )
