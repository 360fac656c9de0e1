"""The sensor and its electronics: from force along its axis to volts, along one train of trigger edges."""

from __future__ import annotations

import math

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.keyed_random import generator
from simulators.worlds.bench_settings import BenchSettings
from simulators.worlds.ground_noise import GroundNoise
from simulators.worlds.mounting import Mounting
from simulators.worlds.resonator import response
from simulators.worlds.specific_force import SpecificForce
from simulators.worlds.stages import Stages
from simulators.worlds.temperature import Room

_STEP_S = 0.01
"""Longest step of integration: a hundredth of the drive's fastest period."""

_SETTLE_S = 15.0
_SETTLE_RING_DOWNS = 16.0
"""How long before the first edge the sensor's story begins: e^-16 of its beginning is left."""


class Electronics:
    """Gain, bias and their drifts: volts of a settled force.

    A bias is an acceleration at the input (IEEE Std 1293): what drifts in the gain multiplies it like any other.
    """

    def __init__(self, settings: BenchSettings, mounting: Mounting, room: Room) -> None:
        axis = mounting.axis
        self._room = room
        self._gain = settings.sensors[axis].response(mounting.configuration).gain_v_per_m_s2
        self._bias_v = bias_v(settings, axis)
        self._gain_per_k = settings.size("thermal-gain", "kT", axis)
        self._gain_rate = settings.size("gain-drift", "rate", axis)
        self._bias_v_per_k = settings.size("thermal-bias", "bT", axis)
        self._bias_rate_v_s = settings.size("bias-drift", "rate", axis)

    def volts(self, felt_m_s2: FloatArray, times_s: FloatArray) -> FloatArray:
        """The output for what the sensor feels at each time."""
        gain, bias = self._gain_and_bias(times_s)
        return gain * felt_m_s2 + bias

    def felt_m_s2(self, volts: float, at_s: float) -> float:
        """What the sensor feels when its output is `volts`."""
        gain, bias = self._gain_and_bias(np.array([at_s]))
        return float((volts - bias[0]) / gain[0])

    def _gain_and_bias(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        warmer_k = self._room.warmer_k(times_s)
        drift = (1.0 + self._gain_per_k * warmer_k) * (1.0 + self._gain_rate * times_s)
        added_v = self._bias_v_per_k * warmer_k + self._bias_rate_v_s * times_s
        return drift * self._gain, drift * self._bias_v + added_v


def bias_v(settings: BenchSettings, axis: str) -> float:
    """An axis' own bias, drawn for it unless the settings give one."""
    given = settings.sensors[axis].bias_v
    if given is not None:
        return given
    return settings.bias_sigma_v * float(generator(settings.seed, "bias", axis).standard_normal())


class SensorRecord:
    """The sensor's output along a train: integrated once, as far as anybody has asked.

    The grid of integration passes through the edges as the sensor's own clock sees them (`time-skew` late).
    What was before `since_s` is forgotten: the stages stood as they did then.
    """

    def __init__(
        self,
        settings: BenchSettings,
        stages: Stages,
        room: Room,
        mounting: Mounting,
        first_s: float,
        period_s: float,
        key: tuple[int | str, ...],
        since_s: float,
    ) -> None:
        self._since_s = since_s
        self._force = SpecificForce(settings, stages, mounting)
        self._electronics = Electronics(settings, mounting, room)
        self._range_v = settings.range_v
        self._first_s = first_s
        self._skew_s = settings.size("time-skew", "tau")
        self._line_v = settings.size("mains-pickup", "amplitude")
        self._line_hz = settings.size("mains-pickup", "frequency")
        self._line_phase = generator(*key, "line").uniform(-math.pi, math.pi)
        # Rounding must not make a step more of a whole number.
        self._step_s = period_s / math.ceil(period_s / _STEP_S - 1e-9)
        inv_w0_squared, damping = settings.resonance(mounting.axis, mounting.configuration)
        self._response = response(inv_w0_squared, damping, self._step_s)
        # An oscillation falls by e in 2 Q / w0.
        ring_downs_s = _SETTLE_RING_DOWNS * 2.0 * inv_w0_squared / damping if damping > 0.0 else 0.0
        lead_s = self._step_s * math.ceil(max(_SETTLE_S, ring_downs_s) / self._step_s)
        self._begin_s = first_s - self._skew_s - lead_s
        self._ground = GroundNoise(settings.ground, self._step_s, generator(*key, "ground"))
        self._last_ground = self._ground.take(1)
        static, varying = self._along_axis(np.array([self._begin_s]), self._last_ground)
        self._response.begin(float(varying[0]))
        self._felt = np.empty(1024)
        self._felt[0] = static[0] + varying[0]
        self._known = 1

    def output_v(self, times_s: FloatArray) -> FloatArray:
        """Volts at the given times, any order, from the beginning of the train on."""
        own_s = times_s - self._skew_s
        felt = self._interpolated((own_s - self._begin_s) / self._step_s)
        volts = self._electronics.volts(felt, own_s)
        # Picked up behind the sensor: a line does not come late with it.
        phase = 2.0 * math.pi * self._line_hz * (times_s - self._first_s) + self._line_phase
        return np.clip(volts + self._line_v * np.sin(phase), -self._range_v, self._range_v)

    def _along_axis(self, times_s: FloatArray, ground_m_s2: FloatArray) -> tuple[FloatArray, FloatArray]:
        return self._force.along_axis(np.maximum(times_s, self._since_s), ground_m_s2)

    def _interpolated(self, places: FloatArray) -> FloatArray:
        """What the sensor feels at fractional places of the grid, by the cubic through four neighbours."""
        # The edges are points of the grid; only other readings need the cubic.
        nearest = np.rint(places)
        if np.abs(places - nearest).max() < 1e-6:
            index = nearest.astype(np.intp)
            self._integrate_to(int(index.max()))
            return self._felt[index]
        index = np.floor(places).astype(np.intp)
        self._integrate_to(int(index.max()) + 2)
        u = places - index
        before, here, after, beyond = (self._felt[index + k] for k in (-1, 0, 1, 2))
        return (
            -u * (u - 1.0) * (u - 2.0) / 6.0 * before
            + (u + 1.0) * (u - 1.0) * (u - 2.0) / 2.0 * here
            - (u + 1.0) * u * (u - 2.0) / 2.0 * after
            + (u + 1.0) * u * (u - 1.0) / 6.0 * beyond
        )

    def _integrate_to(self, index: int) -> None:
        steps = index + 1 - self._known
        if steps <= 0:
            return
        if index >= len(self._felt):
            self._felt = np.resize(self._felt, 2 * index)
        ends = self._ground.take(steps)
        starts = np.concatenate([self._last_ground, ends[:-1]])
        ground = np.empty((2 * steps, 3))
        ground[0::2], ground[1::2] = 0.5 * (starts + ends), ends
        times_s = self._begin_s + self._step_s * (self._known - 0.5 + 0.5 * np.arange(2.0 * steps))
        static, varying = self._along_axis(times_s, ground)
        # One value for all times while the turntable stands.
        static_at_ends = static[1::2] if len(static) > 1 else static
        self._felt[self._known : index + 1] = self._response.advance(varying) + static_at_ends
        self._last_ground = ends[-1:]
        self._known = index + 1
