"""What the anti-alias filter leaves of a turn: an elliptic filter's answer to a force that acts while turning."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.signal import ellip, lfilter

from rigctl.core.arrays import ComplexArray, FloatArray
from simulators.motion import Stop
from simulators.worlds.platform_turntable import Turntable

ORDER, RIPPLE_DB, STOP_DB = 8, 0.1, 80.0
NODES = 4097
DECAY = 40.0
"""Time constants of the slowest pole after which nothing is left: e^-40."""


class RingingFilter:
    """Elliptic, order 8, 0.1 dB, 80 dB, with its pass band up to `cutoff_hz`; gain 1 at DC.

    It is a sum of one-pole filters, each solved exactly for a force that is linear between nodes along a turn and
    zero outside it: after the turn only decaying exponentials remain.
    """

    def __init__(self, cutoff_hz: float, turntable: Turntable, force: Callable[[FloatArray, FloatArray], FloatArray]):
        zeros, poles, gain = ellip(ORDER, RIPPLE_DB, STOP_DB, 2.0 * math.pi * cutoff_hz, analog=True, output="zpk")
        # Of even order it begins at the bottom of its ripple: brought back to 1 at DC.
        at_dc = gain * np.prod(-zeros) / np.prod(-poles)
        self._direct = float(np.real(gain / at_dc))
        self._poles: ComplexArray = poles
        others = [np.prod(pole - np.delete(poles, i)) for i, pole in enumerate(poles)]
        self._residues: ComplexArray = (
            np.array([np.prod(pole - zeros) for pole in poles]) / np.array(others) * gain / at_dc
        )
        self._tail_s = DECAY / float(np.min(-poles.real))
        self._turntable = turntable
        self._force = force
        self._solved: dict[tuple[float, float], tuple[FloatArray, FloatArray, ComplexArray]] = {}

    def answer(self, own_s: FloatArray) -> FloatArray:
        """The filtered force at times of the platform."""
        out = np.zeros(own_s.shape)
        motions = self._turntable.motions(own_s, self._tail_s)
        wanted = {(stop.began_s, stop.start_s): stop for stop in motions}
        # Turns whose answer has died away are dropped: a record has days of them.
        self._solved = {key: self._solved.get(key) or self._solve(stop) for key, stop in wanted.items()}
        for (began_s, ended_s), (times_s, filtered, states) in self._solved.items():
            during = (own_s >= began_s) & (own_s < ended_s)
            out[during] += np.interp(own_s[during], times_s, filtered)
            after = (own_s >= ended_s) & (own_s < ended_s + self._tail_s)
            decay = np.exp(np.multiply.outer(own_s[after] - ended_s, self._poles))
            out[after] += np.real(decay @ (self._residues * states))
        return out

    def _solve(self, stop: Stop) -> tuple[FloatArray, FloatArray, ComplexArray]:
        """Node times, the filtered force there, and the state of each pole at the end."""
        times_s, speed, acceleration = self._turntable.motion(stop, NODES)
        force = self._force(speed, acceleration)
        step_s = float(times_s[1] - times_s[0])
        filtered = self._direct * force.astype(np.complex128)
        ends = np.empty(len(self._poles), dtype=np.complex128)
        for index, (pole, residue) in enumerate(zip(self._poles, self._residues, strict=True)):
            kept = np.exp(pole * step_s)
            # Weights of a linear force's new and old value over one step.
            by_new = (kept - 1.0 - pole * step_s) / (pole**2 * step_s)
            by_old = (kept - 1.0) / pole - by_new
            drive = by_old * force[:-1] + by_new * force[1:]
            state = np.concatenate([[0.0], lfilter([1.0], [1.0, -kept], drive)])
            filtered += residue * state
            ends[index] = state[-1]
        return times_s, np.real(filtered), ends
