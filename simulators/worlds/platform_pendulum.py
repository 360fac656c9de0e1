"""The servo-controlled pendulum under the platform: horizontal acceleration that follows two voltages."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.wiring import VoltageLine
from simulators.worlds.platform_settings import PlatformSettings, ServoSettings

INPUTS = {"dm1_y_v": "y", "dm1_z_v": "z"}
"""Offset inputs of the servo accelerometer, and the tilt each commands."""


class Pendulum:
    """The servo nulls its accelerometer: tilt times g is what the command asks for, less bias and misalignment."""

    def __init__(self, settings: PlatformSettings, inputs: Mapping[str, VoltageLine]) -> None:
        self._settings = settings
        self._inputs = {INPUTS[name]: line for name, line in inputs.items()}

    def accel_m_s2(self, axis: str, times_s: FloatArray) -> FloatArray:
        """External horizontal acceleration along the laboratory's y or z, its noise left out."""
        servo = self._servo(axis)
        command_v = self._inputs[axis].sample(times_s)
        level = (command_v - servo.bias_v) / servo.scale_v_per_m_s2 - self._settings.g_m_s2 * servo.misalignment_rad
        amplitude = self._settings.size("tide", "amplitude", axis)
        if amplitude:
            level += amplitude * np.sin(2.0 * math.pi * times_s / self._settings.size("tide", "period", axis))
        return level

    def _servo(self, axis: str) -> ServoSettings:
        return self._settings.servo_y if axis == "y" else self._settings.servo_z
