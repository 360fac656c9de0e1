"""Where the stages really are, in SI units, from the motion their controllers commanded."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.keyed_random import generator, uniform_of_integers
from simulators.motion import MotionAxis
from simulators.worlds.bench_settings import BenchSettings


class Stages:
    """The rotation stage [deg] that stands on the linear stage [mm], as sensor and cube feel them."""

    def __init__(self, settings: BenchSettings, rotation: MotionAxis, linear: MotionAxis) -> None:
        self._rotation = rotation
        self._linear = linear
        self._salt = int(generator(settings.seed, "encoder").integers(2**63))
        self._angle = settings.angle
        self._e1 = settings.size("encoder-eccentricity", "e1")
        self._e2 = settings.size("encoder-eccentricity", "e2")
        # A stage stands at one angle for whole runs.
        self._standing_rad = lru_cache(maxsize=8)(self._standing_at)
        self._hysteresis = settings.size("cable-hysteresis", "h")

    def travel(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Position [m] and acceleration [m/s2] along lab x."""
        position_mm, _, acceleration_mm_s2 = self._linear.sample(times_s)
        return 1e-3 * position_mm, 1e-3 * acceleration_mm_s2

    def angle_deg(self, time_s: float) -> float:
        """What the rotation stage's encoder believes."""
        return float(self._rotation.sample(np.array([time_s]))[0][0])

    def angle_rad(self, times_s: FloatArray) -> FloatArray:
        """True angle of the turntable; one value when it stands still all the time, else one per time."""
        recorded_deg = self._rotation.sample(times_s)[0]
        if recorded_deg.min() == recorded_deg.max():
            true = self._standing_rad(float(recorded_deg[0]))
        else:
            true = self._true_rad(recorded_deg)
        return true + self._hysteresis * self._rotation.directions(times_s) if self._hysteresis else true

    def _standing_at(self, recorded_deg: float) -> FloatArray:
        return self._true_rad(np.array([recorded_deg]))

    def _true_rad(self, recorded_deg: FloatArray) -> FloatArray:
        recorded = np.deg2rad(recorded_deg)
        eccentric = self._e1 * np.cos(recorded) + self._e2 * np.sin(recorded)
        return recorded + eccentric + self._encoder_error_rad(recorded_deg)

    def _encoder_error_rad(self, recorded_deg: FloatArray) -> FloatArray:
        steps = recorded_deg / self._angle.resolution_deg
        below = np.floor(steps)
        fraction = steps - below
        # An angle is always wrong by the same, as a scale is.
        left = uniform_of_integers(self._salt, below.astype(np.int64))
        right = uniform_of_integers(self._salt, below.astype(np.int64) + 1)
        step_rad = math.radians(self._angle.resolution_deg)
        return self._angle.error_steps * step_rad * ((1.0 - fraction) * left + fraction * right)
