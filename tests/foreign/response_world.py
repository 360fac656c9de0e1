"""An accelerometer shaken along its axis, written from docs/frequency-response.md alone: samples of every run.

The carriage moves as x = A sin(w t + phase). The sensor meets the acceleration and what gravity lets in; its output
passes what lies behind it, harmonic by harmonic.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

G_M_S2 = 9.803
QUALITY = 8.0
TILT_RAD = float(np.radians(5.0))


@dataclass(frozen=True)
class Design:
    """One value for each run; `direction` of the sensing axis along the stage is 1 or -1."""

    frequency_hz: Floats
    amplitude_m: Floats
    direction: Floats
    temperature_c: Floats
    humidity_percent: Floats
    start_s: Floats
    phase_rad: Floats
    duration_s: float
    rate_hz: float

    @property
    def time_s(self) -> Floats:
        """Of the samples, from the beginning of a run."""
        return np.asarray(np.arange(round(self.duration_s * self.rate_hz)) / self.rate_hz)

    @property
    def middle_s(self) -> Floats:
        return self.start_s + 0.5 * self.duration_s


@dataclass(frozen=True)
class Sensor:
    """Its gain, its zero and the effects that act on it, by their parameters' names."""

    gain: float
    zero_v: float
    effects: Mapping[str, float] = field(default_factory=dict)

    def with_effects(self, effects: Mapping[str, float]) -> Sensor:
        return replace(self, effects=dict(effects))


def accel_v(design: Design, sensor: Sensor) -> Floats:
    """What the sensor gives without noise, (runs, samples)."""
    given = sensor.effects.get
    w = 2.0 * np.pi * design.frequency_hz
    # Amplitude of the force along the axis; its cube adds to it and to the third harmonic.
    acceleration = design.amplitude_m * w**2
    force = acceleration * design.direction - design.direction * G_M_S2 * given("pi1", 0.0) * design.amplitude_m
    force = force * (1.0 + design.direction * given("epsilon", 0.0))
    cube = given("K3", 0.0) * force**3
    slow = 1.0 + given("kT", 0.0) * (design.temperature_c - design.temperature_c.mean())
    slow = slow + given("gain_rate", 0.0) * (design.middle_s - design.middle_s.mean())
    slow = slow + given("gain_per_percent", 0.0) * (design.humidity_percent - design.humidity_percent.mean())
    samples = np.full((len(w), len(design.time_s)), sensor.zero_v)
    for order, amplitude in ((1, force + 0.75 * cube), (3, 0.25 * cube)):
        # The acceleration goes as -x: -sin(w t + phase) = cos(w t + phase + pi / 2).
        turned = behind(order * w, sensor.effects) * np.exp(1j * order * (design.phase_rad + 0.5 * np.pi))
        wave = np.exp(1j * order * w[:, None] * design.time_s) * turned[:, None]
        samples = samples + sensor.gain * (slow * amplitude)[:, None] * wave.real
    return np.asarray(samples)


def behind(w: Floats, effects: Mapping[str, float]) -> NDArray[np.complex128]:
    """The response of what lies behind the force, at angular frequencies."""
    given, s = effects.get, 1j * w
    passed = np.exp(-s * given("skew_s", 0.0)) / (1.0 + s * given("lag_s", 0.0))
    passed = passed / (1.0 + s**2 * given("inv_w0_squared", 0.0) + s * given("damping", 0.0))
    # A part of the sensor that resonates by itself, in no catalogue.
    own = s * given("part_rad_s", 1.0) / QUALITY
    return np.asarray(passed * (1.0 + given("part", 0.0) * own / (given("part_rad_s", 1.0) ** 2 + s**2 + own)))


def motion_m(design: Design) -> Floats:
    """The carriage, (runs, samples)."""
    phase = 2.0 * np.pi * design.frequency_hz[:, None] * design.time_s + design.phase_rad[:, None]
    return np.asarray(design.amplitude_m[:, None] * np.sin(phase))


def head_m(design: Design) -> Floats:
    """What a head reads whose beam is tilted, (runs, samples)."""
    return np.asarray(motion_m(design) / np.cos(TILT_RAD))
