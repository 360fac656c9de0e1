"""Nature on the dividing head in time: attitude, gravity, servo loops, noise. Shares no code with the model.

Attitudes are rotation matrices, exact at any angle. Each sensor is a closed servo loop: its proof mass follows
the force along its true axes as a damped oscillator, and what it reads is bent by its torquer and hinge.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from functools import partial
from typing import Any, Literal

import numpy as np
from pydantic import Field
from scipy.signal import bilinear, lfilter

from rigctl.core.arrays import FloatArray
from simulators.benches import BareBench, WorldDeclaration, WorldTable, no_such_action
from simulators.clock import SimulationClock
from simulators.keyed_random import generator
from simulators.motion import MotionAxis
from simulators.wiring import Signal, TriggerLine
from simulators.worlds.bench_settings import TemperatureSettings
from simulators.worlds.rotations import about_x, rotation
from simulators.worlds.temperature import Room

Name = Literal["x", "y", "z"]
Bend = Literal["k2", "k3", "k4", "k_ip", "k_io", "k_pp", "k_oo", "k_po", "k_oq", "asymmetry"]

CASE = dict(zip("xyz", np.eye(3), strict=True))
STANDARD_G_M_S2 = 9.80665
SINGLE_PERIOD_S = 0.02
SLOW_HZ, SLOW_WAVES = (1e-5, 0.05), 120
"""The noise that goes on from run to run: between which frequencies, and as how many waves."""


class SensorSettings(WorldTable):
    """One sensor, along the case's axis of its name, in the units of data sheets: g is 9.80665 m/s2.

    `bends_ug` are ug per g, g2, g3 or g4. `turned_urad` is the rotation vector from the case's axes to the sensor's.
    `white_ug_rthz` is one-sided; `slow_ug` is the rms in each decade of noise that goes as 1/f.
    """

    scale_v_per_g: float = Field(gt=0.0)
    bias_mg: float = 0.0
    bends_ug: dict[Bend, float] = {}
    hysteresis_ug: float = 0.0
    bias_ug_per_k: float = 0.0
    scale_ppm_per_k: float = 0.0
    bias_ug_per_day: float = 0.0
    scale_ppm_per_day: float = 0.0
    turned_urad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    white_ug_rthz: float = Field(default=2.0, ge=0.0)
    slow_ug: float = Field(default=0.05, ge=0.0)
    loop_hz: float = Field(default=20.0, gt=0.1, lt=1e3)
    loop_q: float = Field(default=0.7, gt=0.1, lt=10.0)


class HeadSettings(WorldTable):
    """The dividing head: cosine and sine of its angle's errors and of its axis' rise; the scatter of its stops."""

    first_urad: tuple[float, float] = (0.0, 0.0)
    second_urad: tuple[float, float] = (0.0, 0.0)
    backlash_urad: float = 0.0
    scatter_urad: float = Field(default=0.0, ge=0.0)
    tilt_urad: float = 0.0
    wobble_urad: tuple[float, float] = (0.0, 0.0)


class TumbleSettings(WorldTable):
    """The `[world]` table of a tumble rig; `seat_urad` is how well a case is seated, about each axis."""

    kind: Literal["tumble-test"]
    seed: int
    g_m_s2: float = Field(default=9.81, gt=0.0)
    sensors: dict[Name, SensorSettings] = Field(min_length=1)
    head: HeadSettings = HeadSettings()
    seat_urad: float = Field(default=20.0, ge=0.0)
    remount_s: float = Field(default=900.0, ge=0.0)
    temperature: TemperatureSettings = TemperatureSettings(mean_c=22.0, drift_k_per_day=0.0)


class TumbleBench(BareBench):
    """The case on the head, as its instruments find it; the stage of role "rotation" turns the head."""

    nature: TumbleSettings

    def __init__(self, nature: TumbleSettings, clock: SimulationClock, pace: TriggerLine) -> None:
        self.nature, self._clock, self._pace = nature, clock, pace
        self.axes: Mapping[str, MotionAxis] = {"rotation": MotionAxis()}
        self.sensors: Collection[str] = nature.sensors
        self.world = self
        self._room, self._run = Room(nature.temperature), 0
        self.temperature_c = self._room.temperature_c
        self._seated: dict[str, Any] | None = None
        self._plate_from_case = np.eye(3)

    def announce_run(self, number: int) -> None:
        """A run begins, the key of its randomness."""
        self._run = number

    def operate(self, action: Mapping[str, Any]) -> float:
        """Seat the case with one of its axes along the turning axis; the head's base stays as level as it is."""
        match dict(action):
            case {"remount": {"axis": str(out), "configuration": str(clocking), "mounting": int(number)}}:
                self._seat(out, math.radians(float(clocking.removesuffix(" deg"))), number)
                self._seated = {"axis": out, "configuration": clocking, "mounting": number}
                return float(self._clock.now_s() + self.nature.remount_s)
            case {"level": _}:
                return self._clock.now_s()
            case _:
                raise no_such_action(action, "remount, level")

    def stands(self) -> list[dict[str, Any]]:
        """The mounting, as the action that would make it again."""
        return [] if self._seated is None else [{"remount": self._seated}]

    def volts(self, column: str) -> Signal:
        """The output of a sensor: x_v, y_v, z_v."""
        for name, sensor in self.nature.sensors.items():
            if column == f"{name}_v":
                return partial(self._volts, name, sensor)
        raise ValueError(f"no sensor gives '{column}'; there are {', '.join(f'{n}_v' for n in self.nature.sensors)}")

    def _seat(self, out: str, clocking_rad: float, number: int) -> None:
        """Turn the case so that the axis after `out` is axis 2 of the plate, clock it, and be off by a little."""
        if out[:1] not in {"+", "-"} or out[1:] not in CASE:
            raise ValueError(f"no axis '{out}'; there are +x, -x, +y, -y, +z, -z")
        along, following = (1.0 if out[0] == "+" else -1.0) * CASE[out[1:]], np.roll(CASE[out[1:]], 1)
        upright = np.stack([along, following, np.cross(along, following)])
        drawn = generator(self.seed, "seat", number).standard_normal(3)
        self._plate_from_case = rotation(1e-6 * self.nature.seat_urad * drawn) @ about_x(clocking_rad) @ upright

    def _volts(self, name: str, sensor: SensorSettings, times_s: FloatArray) -> FloatArray:
        times_s = np.asarray(times_s, dtype=np.float64)
        a_i, a_p, a_o, rising = self._settled(name, sensor, times_s)
        warm_k, days = self._room.warmer_k(times_s), times_s / 86400.0
        along = {"k2": a_i**2, "k3": a_i**3, "k4": a_i**4, "k_oq": a_i * np.abs(a_i), "asymmetry": np.abs(a_i)}
        across = {"k_ip": a_i * a_p, "k_io": a_i * a_o, "k_pp": a_p**2, "k_oo": a_o**2, "k_po": a_p * a_o}
        bent = sum((size * (along | across)[form] for form, size in sensor.bends_ug.items()), np.zeros(a_i.shape))
        drifting = sensor.bias_ug_per_k * warm_k + sensor.bias_ug_per_day * days
        wandering = drifting + self._noise_ug(name, sensor, times_s)
        reads_g = a_i + 1e-3 * sensor.bias_mg + 1e-6 * (bent + wandering + sensor.hysteresis_ug * rising)
        scale = 1.0 + 1e-6 * (sensor.scale_ppm_per_k * warm_k + sensor.scale_ppm_per_day * days)
        return np.asarray(sensor.scale_v_per_g * scale * reads_g)

    def _felt_g(self, name: str, sensor: SensorSettings, times_s: FloatArray) -> FloatArray:
        """Gravity's reaction along input, pendulous and output axis [g], and whether the first rises, (4, n)."""
        turned, head = self.axes["rotation"], self.nature.head
        nominal, direction = np.deg2rad(turned.sample(times_s)[0]), turned.directions(times_s)
        waves = np.stack([np.cos(nominal), np.sin(nominal), np.cos(2.0 * nominal), np.sin(2.0 * nominal)])
        stop = head.scatter_urad * generator(self.seed, "stop", self._run).standard_normal()
        errs = np.array([*head.first_urad, *head.second_urad]) @ waves + stop - head.backlash_urad * direction
        angle, rise = nominal + 1e-6 * errs, 1e-6 * (head.tilt_urad + np.array(head.wobble_urad) @ waves[:2])
        up = np.stack([np.sin(rise), np.cos(rise) * np.sin(angle), np.cos(rise) * np.cos(angle)])
        onward = np.stack([np.zeros(angle.shape), up[2], -up[1]])
        own = rotation(1e-6 * np.array(sensor.turned_urad))
        axes = np.stack([own @ np.roll(CASE[name], step) for step in range(3)]) @ self._plate_from_case.T
        slope = (axes @ onward)[0]
        rising = np.where(np.abs(slope) < 1e-3, 0.0, np.sign(slope)) * direction
        return np.vstack([self.nature.g_m_s2 / STANDARD_G_M_S2 * (axes @ up), rising])

    def _settled(self, name: str, sensor: SensorSettings, times_s: FloatArray) -> FloatArray:
        """As the servo loop follows it: step by step through a turn and its ring-down, at rest at once."""
        found, ended_s = self._felt_g(name, sensor, times_s), self.axes["rotation"].end_s
        w, q = 2.0 * math.pi * sensor.loop_hz, sensor.loop_q
        rings_s = 30.0 * max(q, 1.0 / q) / w
        moved = times_s < ended_s + rings_s
        if moved.any():
            step_s = 0.02 / sensor.loop_hz
            grid_s = np.arange(times_s[moved].min() - rings_s, times_s[moved].max() + 2.0 * step_s, step_s)
            course = self._felt_g(name, sensor, grid_s)[:3]
            # x'' + (w/q) x' + w^2 x = w^2 u
            b, a = bilinear([w * w], [1.0, w / q, w * w], fs=1.0 / step_s)
            followed = course[:, :1] + lfilter(b, a, course - course[:, :1], axis=1)
            found[:3, moved] = [np.interp(times_s[moved], grid_s, each) for each in followed]
        return found

    def _noise_ug(self, name: str, sensor: SensorSettings, times_s: FloatArray) -> FloatArray:
        random, decades = generator(self.seed, "slow", name), math.log10(SLOW_HZ[1] / SLOW_HZ[0])
        exponents = decades * (np.arange(SLOW_WAVES) + random.random(SLOW_WAVES)) / SLOW_WAVES
        frequency_hz = SLOW_HZ[0] * 10.0**exponents
        phases = 2.0 * np.pi * (np.outer(times_s, frequency_hz) + random.random(SLOW_WAVES))
        slow = sensor.slow_ug * math.sqrt(2.0 * decades / SLOW_WAVES) * np.cos(phases).sum(axis=1)
        # The anti-alias filter before a meter lets through half of what it samples.
        train = self._pace.train
        band_hz = 0.5 / (train.period_s if train is not None else SINGLE_PERIOD_S)
        white = generator(self.seed, name, self._run, *times_s[:1].tolist()).standard_normal(times_s.shape)
        return np.asarray(slow + sensor.white_ug_rthz * math.sqrt(band_hz) * white)


WORLD = WorldDeclaration("tumble-test", TumbleSettings, TumbleBench)
