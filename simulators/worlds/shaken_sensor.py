"""Nature where one accelerometer sits on an oscillating stage: motion, guide, sensor in time, lasers, noise.

The sensor is integrated in time: what acts along its axis bends, drives the proof mass on its spring, and passes the
electronics' pole. Nothing here knows a frequency response.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from functools import partial
from typing import Any, Literal

import numpy as np
from pydantic import Field

from rigctl.core.arrays import FloatArray
from simulators.benches import BareBench, WorldDeclaration, WorldTable, no_such_action
from simulators.clock import SimulationClock
from simulators.keyed_random import normal_at_times
from simulators.motion import MotionAxis
from simulators.wiring import Signal, TriggerLine
from simulators.worlds.bench_settings import TemperatureSettings
from simulators.worlds.resonator import Lag, response
from simulators.worlds.temperature import Room

COLUMN = "accel_v"
DIRECTIONS = {"forward": 1.0, "reversed": -1.0}
_STEP_S = 1e-3
"""Longest step of integration: a fiftieth of a period of 20 Hz."""
_RING_DOWNS = 16.0
"""Time constants before a reading at which the sensor's story begins: e^-16 of its beginning is left."""


class ShakenSensor(WorldTable):
    """The sensor: `frequency_hz` 0 is one that follows at once, `lag_s` is the electronics' pole.

    `late_s`: its output reaches the meter so much later. `asymmetry`: the gain differs by this with the direction.
    `white_m_s2_rthz` is the one-sided density of its noise.
    """

    gain_v_per_m_s2: float = Field(gt=0.0)
    bias_v: float = 0.0
    frequency_hz: float = Field(default=0.0, ge=0.0, le=1e5)
    q: float = Field(default=0.7, gt=0.5)
    lag_s: float = Field(default=0.0, ge=0.0, le=10.0)
    late_s: float = Field(default=0.0, ge=0.0, le=0.1)
    cubic_s4_m2: float = 0.0
    asymmetry: float = 0.0
    gain_per_k: float = 0.0
    white_m_s2_rthz: float = Field(default=2e-6, ge=0.0)


class ShakenHead(WorldTable):
    """A laser head before the carriage: its beam is tilted, its scale is off by `scale_error`."""

    tilt_deg: float = Field(default=0.0, gt=-30.0, lt=30.0)
    scale_error: float = 0.0
    noise_um: float = Field(default=0.05, ge=0.0)


class ShakenSettings(WorldTable):
    """The `[world]` table; `pitch_rad_per_m` is by how much the guide pitches with the position."""

    kind: Literal["shaken-sensor"]
    seed: int
    g_m_s2: float = Field(default=9.81, gt=0.0)
    sensor: ShakenSensor
    lasers: dict[str, ShakenHead] = Field(min_length=1)
    pitch_rad_per_m: float = 0.0
    range_v: float = Field(default=10.0, gt=0.0)
    remount_s: float = Field(default=600.0, ge=0.0)
    temperature: TemperatureSettings = TemperatureSettings()


class ShakenBench(BareBench):
    """The carriage with sensor and lasers, as its instruments find it."""

    nature: ShakenSettings

    def __init__(self, nature: ShakenSettings, clock: SimulationClock, pace: TriggerLine) -> None:
        self.nature, self._clock, self._pace = nature, clock, pace
        self._carriage = MotionAxis()
        self.axes: Mapping[str, MotionAxis] = {"linear": self._carriage}
        self.sensors: Collection[str] = ("X",)
        self.heads: Collection[str] = nature.lasers
        self.world = self
        self._room, self._run = Room(nature.temperature), 0
        self.temperature_c = self._room.temperature_c
        self._seated: dict[str, Any] | None = None

    def announce_run(self, number: int) -> None:
        """A run begins, the key of its randomness."""
        self._run = number

    def operate(self, action: Mapping[str, Any]) -> float:
        """Seat the sensor along the motion or against it."""
        match dict(action):
            case {"remount": {"axis": str(), "configuration": str(direction), "mounting": int()} as seated}:
                if direction not in DIRECTIONS:
                    raise ValueError(f"no direction '{direction}'; there are {', '.join(DIRECTIONS)}")
                self._seated = dict(seated)
                return self._clock.now_s() + self.nature.remount_s
            case {"level": _}:
                return self._clock.now_s()
            case _:
                raise no_such_action(action, "remount, level")

    def stands(self) -> list[dict[str, Any]]:
        """The mounting, as the action that would make it again."""
        return [] if self._seated is None else [{"remount": self._seated}]

    def volts(self, column: str) -> Signal:
        """The sensor's output."""
        if column != COLUMN:
            raise ValueError(f"no sensor gives '{column}'; there is {COLUMN}")
        return self._volts

    def displacement_mm(self, head: str) -> Signal:
        """What a laser head reads of the carriage."""
        if head not in self.nature.lasers:
            raise ValueError(f"no laser head '{head}'; there are: {', '.join(self.nature.lasers)}")
        return partial(self._displacement_mm, head)

    def _displacement_mm(self, head: str, times_s: FloatArray) -> FloatArray:
        times_s, own = np.asarray(times_s, dtype=np.float64), self.nature.lasers[head]
        along_mm = self._carriage.sample(times_s)[0] / math.cos(math.radians(own.tilt_deg))
        noise = normal_at_times(times_s, self.nature.seed, "laser", head, self._run)
        return np.asarray((1.0 + own.scale_error) * along_mm + 1e-3 * own.noise_um * noise)

    def _volts(self, times_s: FloatArray) -> FloatArray:
        times_s, sensor = np.asarray(times_s, dtype=np.float64), self.nature.sensor
        sense = 0.0 if self._seated is None else DIRECTIONS[self._seated["configuration"]]
        force = self._followed(times_s - sensor.late_s, sense) + self._noise_m_s2(times_s)
        warm = 1.0 + sensor.gain_per_k * self._room.warmer_k(times_s)
        gain = sensor.gain_v_per_m_s2 * (1.0 + sensor.asymmetry * sense) * warm
        return np.asarray(np.clip(sensor.bias_v + gain * force, -self.nature.range_v, self.nature.range_v))

    def _followed(self, times_s: FloatArray, sense: float) -> FloatArray:
        """What acts along the axis, behind the spring and the pole, at these times."""
        sensor = self.nature.sensor
        w0 = 2.0 * math.pi * sensor.frequency_hz
        lasting_s = max(2.0 * sensor.q / w0 if w0 else 0.0, sensor.lag_s)
        if lasting_s == 0.0:
            return self._along(times_s, sense)
        step_s = min(_STEP_S, 0.02 / sensor.frequency_hz if w0 else math.inf)
        count = math.ceil((np.ptp(times_s) + 2.0 * _RING_DOWNS * lasting_s) / step_s) + 3
        begin_s = float(times_s.min()) - 2.0 * _RING_DOWNS * lasting_s
        halves = begin_s + 0.5 * step_s * np.arange(2.0 * count + 1.0)
        # Middles and ends of steps, as the integrators want them.
        course = self._along(halves, sense)
        spring = response(w0**-2, 1.0 / (w0 * sensor.q), step_s) if w0 else response(0.0, 0.0, step_s)
        spring.begin(float(course[0]))
        ends = np.concatenate([course[:1], spring.advance(course[1:])])
        if sensor.lag_s:
            pole = Lag(sensor.lag_s, step_s)
            pole.begin(float(ends[0]))
            middles = _middles(ends)
            ends = np.concatenate([ends[:1], pole.advance(np.stack([middles, ends[1:]], axis=1).ravel())])
        return _cubic(ends, (times_s - begin_s) / step_s)

    def _along(self, times_s: FloatArray, sense: float) -> FloatArray:
        """Acceleration and gravity along the sensing axis, bent by the sensor [m/s2]."""
        position_mm, _, acceleration_mm_s2 = self._carriage.sample(times_s)
        pitch_rad = self.nature.pitch_rad_per_m * 1e-3 * position_mm
        force = sense * (1e-3 * acceleration_mm_s2 + self.nature.g_m_s2 * np.sin(pitch_rad))
        return np.asarray(force + self.nature.sensor.cubic_s4_m2 * force**3)

    def _noise_m_s2(self, times_s: FloatArray) -> FloatArray:
        train = self._pace.train
        # The filter before the meter lets through half of what it samples.
        band_hz = 0.5 / (train.period_s if train is not None else 0.02)
        white = normal_at_times(times_s, self.nature.seed, "sensor", self._run)
        return np.asarray(self.nature.sensor.white_m_s2_rthz * math.sqrt(band_hz) * white)


def _middles(ends: FloatArray) -> FloatArray:
    """Values in the middle between equidistant ones, by the cubic through four neighbours."""
    padded = np.concatenate([ends[:1], ends, ends[-1:]])
    return np.asarray((9.0 * (padded[1:-2] + padded[2:-1]) - padded[:-3] - padded[3:]) / 16.0)


def _cubic(values: FloatArray, places: FloatArray) -> FloatArray:
    """Equidistant values at fractional places, by the cubic through four neighbours."""
    index = np.clip(np.floor(places).astype(np.intp), 1, len(values) - 3)
    u = places - index
    before, here, after, beyond = (values[index + k] for k in (-1, 0, 1, 2))
    return np.asarray(
        -u * (u - 1.0) * (u - 2.0) / 6.0 * before
        + (u + 1.0) * (u - 1.0) * (u - 2.0) / 2.0 * here
        - (u + 1.0) * u * (u - 2.0) / 2.0 * after
        + (u + 1.0) * u * (u - 1.0) / 6.0 * beyond
    )


WORLD = WorldDeclaration("shaken-sensor", ShakenSettings, ShakenBench)
