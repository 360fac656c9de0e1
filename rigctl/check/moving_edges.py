"""How long after an edge a stage latches its position: ten edges while it moves slowly and is asked where it is.

A capture says where the stage was at each edge, a question where it was at some time between question and answer. The
same motion joins the two.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigctl.check.asking import Tell
from rigctl.check.hands import Hands
from rigctl.check.trigger import EDGES, LOOK_EVERY_S, PERIOD_S, WIRING
from rigctl.core.arrays import FloatArray
from rigctl.core.clock import Clock
from rigctl.core.errors import RigError
from rigctl.core.findings import Finding, differs, ok, unknown
from rigctl.core.interfaces import CountsEdges, LinearStage, PacedRecorder, PacingRecorder
from rigctl.rig import Rig

AMPLITUDE_MM, FREQUENCY_HZ = 1.0, 0.1
"""The edges come about the middle of a stroke, at some 0.6 mm/s; frequency of the wall clock."""
DEGREE_OF_STROKE = 4
"""Of the polynomial through a fifth of a stroke: it leaves 2 nm of the sine."""
START_U_S = 5e-3
"""How well the time of the pacing instrument's first edge is known: an exchange with it."""
ITEM = "delay"


@dataclass(frozen=True)
class Delay:
    """From an edge to the latched position: bounds, and how far single ones are from a smooth motion (rms)."""

    low_s: float
    high_s: float
    jitter_s: float


def delay_between(edges_s: FloatArray, latched_mm: FloatArray, looks: FloatArray) -> Delay | None:
    """The delay after edges that came at `edges_s` and latched `latched_mm`, shape (n,).

    Rows of `looks` are times of question and answer [s], and the position that was answered [mm]. None where the
    stage did not go steadily one way, or nobody looked while it was between the first position and the last.
    """
    middle_s = edges_s.mean()
    stroke = np.polynomial.Polynomial.fit(edges_s - middle_s, latched_mm, DEGREE_OF_STROKE)
    finely_s = np.linspace(edges_s[0], edges_s[-1], 10_001)
    positions_mm = stroke(finely_s - middle_s)
    steps_mm = np.diff(positions_mm)
    if not (np.all(steps_mm > 0.0) or np.all(steps_mm < 0.0)):
        return None
    if steps_mm[0] < 0.0:
        positions_mm, finely_s = positions_mm[::-1], finely_s[::-1]
    between = looks[(looks[:, 2] > positions_mm[0]) & (looks[:, 2] < positions_mm[-1])]
    if not len(between):
        return None
    # When the stage would have been there, had the positions been latched at the edges.
    without_s = np.interp(between[:, 2], positions_mm, finely_s)
    low_s, high_s = float(np.max(between[:, 0] - without_s)), float(np.min(between[:, 1] - without_s))
    left_mm = latched_mm - stroke(edges_s - middle_s)
    rms_mm = math.sqrt(float(left_mm @ left_mm) / (len(edges_s) - DEGREE_OF_STROKE - 1))
    speed_mm_s = abs(latched_mm[-1] - latched_mm[0]) / (edges_s[-1] - edges_s[0])
    return Delay(min(low_s, high_s), max(low_s, high_s), rms_mm / float(speed_mm_s))


class MovingEdges:
    """Tries every stage that latches its position at edges and does not tell when."""

    def __init__(self, rig: Rig, hands: Hands, tell: Tell) -> None:
        self._clock: Clock = rig.clock
        self._rig = rig
        self._hands = hands
        self._tell = tell
        self._speed = max(rig.clock.speed, 1.0) if math.isfinite(rig.clock.speed) else 1.0

    def try_all(self) -> None:
        """A finding for each such stage; what fails with one keeps nobody from the next."""
        pacing = [each for each in self._rig.by_role("readout") if isinstance(each, PacingRecorder)]
        stages = [each for each in self._rig.by_role("linear") if isinstance(each, LinearStage)]
        for stage in stages if len(pacing) == 1 else ():
            if isinstance(stage, PacedRecorder) and not isinstance(stage, CountsEdges):
                self._try(stage, pacing[0])

    def _try(self, stage: LinearStage, readout: PacingRecorder) -> None:
        try:
            self._tell(stage.name, self._found(stage, readout))
        except RigError as error:
            what, _, mend = str(error).rpartition("; ")
            failed = readout if str(error).startswith(f"{readout.name}:") else stage
            self._tell(failed.name, differs("trigger", ITEM, what or mend, f"{mend}; see {WIRING}"))

    def _found(self, stage: LinearStage, readout: PacingRecorder) -> Finding:
        if not stage.is_homed() or not self._hands.confirm(
            f"MOVES: {stage.name} goes {AMPLITUDE_MM:g} mm to either side, slowly, while ten edges come."
        ):
            return unknown("trigger", ITEM, "not tried", "`rigctl check --trigger --move`")
        found = self._delay(stage, readout)
        if found is None:
            return unknown("trigger", ITEM, "it did not go steadily one way meanwhile", "try again, and watch it")
        return self._judged(stage, found)

    def _delay(self, stage: LinearStage, readout: PacingRecorder) -> Delay | None:
        assert isinstance(stage, PacedRecorder)
        period_s, frequency_hz = PERIOD_S * self._speed, FREQUENCY_HZ / self._speed
        low_mm, high_mm = stage.limits.position_min_mm + AMPLITUDE_MM, stage.limits.position_max_mm - AMPLITUDE_MM
        centre_mm = min(max(stage.position().value, low_mm), high_mm)
        stage.oscillate(centre_mm, AMPLITUDE_MM, frequency_hz, 1.0 / frequency_hz)
        try:
            ends_s = self._clock.now_s() + 0.25 / frequency_hz - 0.5 * EDGES * period_s
            stage.arm(EDGES, period_s)
            self._clock.sleep_s(max(ends_s - self._clock.now_s(), 0.0))
            first_s = readout.start(EDGES, period_s) + readout.first_sample_after_s
            looks = self._looks(stage, first_s + (EDGES + 1) * period_s)
            readout.fetch()
        finally:
            stage.rest()
        latched_mm = stage.collect()[:, 0]
        edges_s = first_s + period_s * np.arange(EDGES, dtype=np.float64)
        return delay_between(edges_s, latched_mm, looks)

    def _looks(self, stage: LinearStage, until_s: float) -> FloatArray:
        looks = []
        while (asked_s := self._clock.now_s()) < until_s:
            position_mm = stage.position().value
            looks.append((asked_s, self._clock.now_s(), position_mm))
            self._clock.sleep_s(LOOK_EVERY_S * self._speed)
        return np.array(looks)

    def _judged(self, stage: LinearStage, found: Delay) -> Finding:
        assert isinstance(stage, PacedRecorder)
        said_s = stage.channels()[0].latency_s
        told = (
            f"latched {1e3 * found.low_s:.3g} to {1e3 * found.high_s:.3g} ms after it, "
            f"jitter {1e3 * found.jitter_s:.2g} ms at most; latency_s says {1e3 * said_s:g} ms"
        )
        off_s = max(found.low_s - said_s, said_s - found.high_s)
        if off_s <= START_U_S * self._speed:
            return ok("trigger", ITEM, told)
        middle_s = 0.5 * (found.low_s + found.high_s)
        return differs("trigger", ITEM, told, f"write latency_s = {middle_s:.2g}, or look at the wire: {WIRING}")
