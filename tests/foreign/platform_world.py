"""A second world of the rotating platform, from the page on bias rejection alone: what chains read, without noise.

Frames, signs, patterns and effects are those of the page; the rest is this file's own: turns by another law and
always forward where the bench is built so, another order of the effects (each where nature has it: in the laboratory,
in the sensor, in the chain), the anti-alias filter run as a fast digital one. SI and radians; channels are the
readings ``z`` (sensor A) and ``y`` (sensor B).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import signal

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

CHANNELS = ("z", "y")
FULL_SCALE_V = 10.0
FILTER_SUBSTEPS = 64
TIDE_PERIOD_S = 12.0 * 3600.0
TURNS = {"a": 2, "b": 2, "c": 4, "c_tm": 6}
"""Turns in one period of each pattern."""


@dataclass(frozen=True)
class Run:
    """One acquisition of whole periods: the pattern, its timing, and the tilts commanded."""

    pattern: str
    period_s: float
    periods: int
    rate_hz: float
    turning_s: float
    external: str
    v_z: float
    external_period_s: float
    v_y: float
    start_s: float

    @property
    def turn_s(self) -> float:
        return self.turning_s / TURNS[self.pattern]

    @cached_property
    def time_s(self) -> Floats:
        """Samples sit in the middle of their intervals."""
        return np.asarray((np.arange(round(self.period_s * self.periods * self.rate_hz)) + 0.5) / self.rate_hz)

    @property
    def duration_s(self) -> float:
        return self.period_s * self.periods

    def dwells(self) -> list[tuple[float, float, int]]:
        """Start, stop and sign of cos(theta) of the dwells of one period."""
        tau, r = self.period_s, self.turn_s
        if self.pattern == "b":
            return [
                (0.0, tau / 4 - r / 2, 1),
                (tau / 4 + r / 2, 3 * tau / 4 - r / 2, -1),
                (3 * tau / 4 + r / 2, tau, 1),
            ]
        if self.pattern == "a":
            return [(r / 2, tau / 2 - r / 2, 1), (tau / 2 + r / 2, tau - r / 2, -1)]
        if self.pattern == "c":
            h = tau / 2
            a = (np.sqrt(5 * h**2 / 4 - r**2) - (h / 2 + r)) / 2
            b = a + h / 2
            ends = [0.0, h - b - r, h - b, h - a - r, h - a, h + a, h + a + r, h + b, h + b + r, tau]
            return [(ends[2 * k], ends[2 * k + 1], (-1) ** k) for k in range(5)]
        d = (tau - 6 * r) / 8
        found, start = [], r / 2
        for number, length in enumerate((d, 2 * d, d, d, 2 * d, d)):
            found.append((start, start + length, (-1) ** number))
            start += length + r
        return found

    @cached_property
    def turns(self) -> list[tuple[float, float, int]]:
        """Start and stop of every turn that touches the run, and the sign of cos(theta) after it."""
        dwells = [
            (start + n * self.period_s, stop + n * self.period_s, sign)
            for n in range(-1, self.periods + 1)
            for start, stop, sign in self.dwells()
        ]
        all_turns = [(one[1], other[0], other[2]) for one, other in pairwise(dwells) if one[2] != other[2]]
        return [turn for turn in all_turns if turn[1] > 0.0 and turn[0] < self.duration_s]

    def command_v(self, level_v: float, time_s: Floats) -> Floats:
        phase = (time_s + self.start_s) / self.external_period_s if self.external_period_s else 0.0 * time_s
        if self.external == "sine":
            return np.asarray(level_v * np.sin(2.0 * np.pi * phase))
        if self.external == "triangle":
            return np.asarray(level_v * signal.sawtooth(2.0 * np.pi * phase + np.pi / 2.0, 0.5))
        return np.full_like(time_s, level_v)


@dataclass(frozen=True)
class Platform:
    """What this bench is: scale factors, tilts and biases; the way it turns; and what acts on it (``effects``).

    ``gain_error`` is k of a chain, ``servo_gain_error`` k of the servo accelerometers, by channel; ``bias_m_s2`` at
    the output. ``mask_short_s``: the flag ``moving`` comes that much late and ends that much early.
    """

    assumed_gain_v: Mapping[str, float]
    assumed_servo_gain_v: Mapping[str, float]
    gain_error: Mapping[str, float]
    servo_gain_error: Mapping[str, float]
    rest_m_s2: Mapping[str, float]
    bias_m_s2: Mapping[str, float]
    forward: bool = False
    law: str = "cycloid"
    mask_short_s: float = 0.0
    temperature: Mapping[str, float] = field(default_factory=dict)
    supply_seed: int = 0
    effects: Mapping[str, float] = field(default_factory=dict)

    def acts(self, parameter: str) -> float:
        return self.effects.get(parameter, 0.0)

    def with_effects(self, effects: Mapping[str, float]) -> Platform:
        return replace(self, effects=dict(effects))


def progress(law: str, u: Floats) -> tuple[Floats, Floats, Floats]:
    """The part of a turn that is done at u = 0 .. 1, and its first two derivatives by u."""
    if law == "cycloid":
        x = 2.0 * np.pi * u
        return u - np.sin(x) / (2.0 * np.pi), 1.0 - np.cos(x), 2.0 * np.pi * np.sin(x)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2), 30.0 * (u * (1.0 - u)) ** 2, 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u)


def angle(run: Run, bench: Platform, time_s: Floats) -> tuple[Floats, Floats, Floats]:
    """Angle (cumulative, rad), rate and angular acceleration; times ascend."""
    first = 0 if run.turns[0][2] < 0 else 1
    theta = np.full_like(time_s, np.pi * first)
    rate, acceleration = np.zeros_like(time_s), np.zeros_like(time_s)
    for start, stop, sign in run.turns:
        way = np.pi if bench.forward or sign < 0 else -np.pi
        begin, end = np.searchsorted(time_s, (start, stop))
        done, speed, jerk = progress(bench.law, (time_s[begin:end] - start) / (stop - start))
        theta[begin:end] += way * done
        theta[end:] += way
        rate[begin:end] = way * speed / (stop - start)
        acceleration[begin:end] = way * jerk / (stop - start) ** 2
    return theta, rate, acceleration


def moving(run: Run, bench: Platform) -> Flags:
    """The flag as the controller sets it."""
    flag = np.zeros(len(run.time_s), dtype=bool)
    short = bench.mask_short_s
    for start, stop, _ in run.turns:
        flag |= (run.time_s >= start + short) & (run.time_s < stop - short)
    return flag


def after_turns(run: Run, bench: Platform, time_s: Floats) -> tuple[Floats, Floats, Floats]:
    """Seconds since the end of the last turn (inf before the first), its direction, turns completed."""
    _, stops, after = np.array(run.turns).T
    count = np.searchsorted(stops, time_s, side="right")
    last = np.maximum(count, 1) - 1
    ways = np.ones_like(after) if bench.forward else -after
    since, direction = np.where(count, time_s - stops[last], np.inf), np.where(count, ways[last], 0.0)
    return since, direction, count.astype(np.float64)


def temperature_c(run: Run, bench: Platform, time_s: Floats) -> Floats:
    """The room: the air conditioning's cycle and the day's."""
    t = time_s + run.start_s
    room = bench.temperature
    cycle = room.get("cycle_c", 0.0) * np.sin(2.0 * np.pi * t / room.get("cycle_s", 1.0) + room.get("phase", 0.0))
    day = room.get("day_c", 0.0) * np.sin(2.0 * np.pi * t / 86400.0 + room.get("day_phase", 0.0))
    return np.asarray(22.0 + room.get("offset_c", 0.0) + cycle + day)


def supply_v(run: Run, bench: Platform, time_s: Floats) -> Floats:
    """The supply of the electronics: 15 V, and steps of some 10 mV at times of its own."""
    random = np.random.default_rng([bench.supply_seed, round(run.start_s)])
    places = np.sort(random.uniform(0.0, run.duration_s, 6))
    levels = 15.0 + np.round(random.normal(0.0, 0.02, 7), 3)
    return np.asarray(levels[np.searchsorted(places, time_s)])


def laboratory(run: Run, bench: Platform, time_s: Floats) -> dict[str, Floats]:
    """Horizontal acceleration in the laboratory (Z, Y): commanded tilts, the rest, the tide."""
    t = 2.0 * np.pi * (time_s + run.start_s) / TIDE_PERIOD_S
    found = {}
    for channel, level_v in (("z", run.v_z), ("y", run.v_y)):
        at_y = channel == "y"
        command = np.full_like(time_s, level_v) if at_y else run.command_v(level_v, time_s)
        tilt = command / bench.assumed_servo_gain_v[channel] / (1.0 + bench.servo_gain_error[channel])
        tide = bench.acts(f"tide_cos[{channel}]") * np.cos(t) + bench.acts(f"tide_sin[{channel}]") * np.sin(t)
        found[channel] = tilt + bench.rest_m_s2[channel] + tide
    return found


def felt(run: Run, bench: Platform, time_s: Floats, channel: str) -> Floats:
    """What the sensor feels: the laboratory's acceleration along its axis, and that of its own motion."""
    late = bench.acts("delay_s")
    theta, rate, acceleration = angle(run, bench, time_s - late)
    outside = laboratory(run, bench, time_s)
    theta = theta + bench.acts("stop_rad") * (np.cos(theta) < 0.0)
    own, other = ("z", "y") if channel == "z" else ("y", "z")
    side = -1.0 if channel == "z" else 1.0
    cosine, sine = np.cos(theta), np.sin(theta)
    along = outside[own] * cosine + side * outside[other] * sine
    across = bench.acts(f"kx[{channel}]") * (outside[other] * cosine - side * outside[own] * sine)
    lever = rate**2 * bench.acts(f"r_cos[{channel}]") + acceleration * bench.acts(f"r_sin[{channel}]")
    return np.asarray(along + across - lever)


def reading(run: Run, bench: Platform, time_s: Floats, channel: str) -> Floats:
    """m_z or m_y: gain and its changes, bias and its changes, lines, the chain's own curve."""
    since, direction, count = after_turns(run, bench, time_s)
    warm = temperature_c(run, bench, time_s) - 22.0
    t = time_s + run.start_s
    gain = 1.0 + bench.gain_error[channel] + bench.acts(f"k1[{channel}]") * t
    gain = gain + bench.acts(f"per_v[{channel}]") * (supply_v(run, bench, time_s) - 15.0)
    fading = np.exp(-since / bench.effects.get("T_r", 1.0))
    bias = bench.bias_m_s2[channel] + bench.acts(f"b1[{channel}]") * warm
    bias = bias + (bench.acts(f"e[{channel}]") + bench.acts(f"e_signed[{channel}]") * direction) * fading
    bias = bias + bench.acts(f"creep[{channel}]") * (count % bench.effects.get("creep_turns", 1.0))
    phase = 2.0 * np.pi * bench.acts("line_hz") * t
    bias = bias + bench.acts(f"line[{channel}]") * np.sin(phase)
    m = gain * felt(run, bench, time_s, channel) + bias
    return np.asarray(m + bench.acts(f"K2[{channel}]") * m**2 + bench.acts(f"e_abs[{channel}]") * np.abs(m))


def sampled(run: Run, bench: Platform, channel: str) -> Floats:
    """The reading at the sample times; through the anti-alias filter where that is an effect of this bench."""
    if not bench.acts("filter"):
        return reading(run, bench, run.time_s, channel)
    fast = run.rate_hz * FILTER_SUBSTEPS
    before = round(10.0 * run.rate_hz) * FILTER_SUBSTEPS
    count = len(run.time_s) * FILTER_SUBSTEPS
    time_s = np.arange(-before, count) / fast
    m = np.clip(reading(run, bench, time_s, channel), *saturation(bench, channel))
    sections = signal.ellip(8, 0.1, 80.0, run.rate_hz / 2.0, output="sos", fs=fast)
    sections[0, :3] *= 10.0 ** (0.1 / 20.0)
    settled = signal.sosfilt_zi(sections) * m[0]
    through, _ = signal.sosfilt(sections, m, zi=settled)
    return np.asarray(np.interp(run.time_s, time_s, through))


def saturation(bench: Platform, channel: str) -> tuple[float, float]:
    """The range of the chain's output as acceleration."""
    limit = FULL_SCALE_V / bench.assumed_gain_v[channel]
    return -limit, limit


def readings(run: Run, bench: Platform) -> dict[str, Floats]:
    """Both channels, m/s2."""
    return {channel: sampled(run, bench, channel) for channel in CHANNELS}
