"""A recording of the second platform as another laboratory would hand it over: noise, dropped samples, files.

The chain's noise is white and a ladder of relaxing states (Ornstein and Uhlenbeck), whose spectrum is a power law and
whose autocovariance is known in closed form; the pendulum's is a moving average of white noise. Nothing is made by
Fourier transforms of a spectrum.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import signal

from tests.foreign.platform_world import (
    CHANNELS,
    FULL_SCALE_V,
    Flags,
    Floats,
    Platform,
    Run,
    angle,
    moving,
    readings,
    supply_v,
    temperature_c,
)

STEP_V = 2.0 * FULL_SCALE_V / 2**16
COLUMN = {"z": "q_a_v", "y": "q_b_v"}
PENDULUM_TAPS = 401
STATES_PER_E_FOLD = 1.0


@dataclass(frozen=True)
class Noise:
    """Two-sided densities: a chain's white and flicker / f^exponent, (m/s2)^2/Hz; a pendulum's below 0.2 Hz.

    ``pendulum`` is in m/s2/rtHz, ``angle_rad`` the encoder's noise.
    """

    white: float
    flicker: float
    exponent: float
    pendulum: float
    angle_rad: float

    def states(self, run: Run) -> tuple[Floats, Floats]:
        """Relaxation times, s, and variances of the states whose spectra add up to flicker / f^exponent."""
        span = np.log(20.0 * run.duration_s * run.rate_hz)
        count = int(np.ceil(span * STATES_PER_E_FOLD)) + 1
        times = np.exp(np.linspace(np.log(0.05 / run.rate_hz), np.log(run.duration_s), count))
        width = np.log(times[1] / times[0])
        scale = self.flicker * (2.0 * np.pi) ** self.exponent * np.sin(np.pi * self.exponent / 2.0) / np.pi * width
        return times, np.asarray(scale * times ** (self.exponent - 1.0))

    def autocovariance(self, run: Run) -> Floats:
        """Of a chain's noise, at lags 0, 1, ... samples."""
        lag_s = np.arange(len(run.time_s)) / run.rate_hz
        times, variances = self.states(run)
        found = np.exp(-lag_s[:, None] / times) @ variances
        found[0] += self.white * run.rate_hz
        return np.asarray(found)

    def pendulum_taps(self, run: Run) -> Floats:
        """Rising as f^2 above 0.2 Hz to a hundred times, as a moving average of white noise."""
        f = np.linspace(0.0, run.rate_hz / 2.0, 512)
        level = self.pendulum * np.sqrt(run.rate_hz) * np.clip((f / 0.2) ** 2, 1.0, 100.0)
        return np.asarray(signal.firwin2(PENDULUM_TAPS, f, level, fs=run.rate_hz))

    def pendulum_autocovariance(self, run: Run) -> Floats:
        taps = self.pendulum_taps(run)
        found = np.zeros(len(run.time_s))
        found[:PENDULUM_TAPS] = np.correlate(taps, taps, "full")[PENDULUM_TAPS - 1 :]
        return found


@dataclass(frozen=True)
class Habits:
    """What another laboratory does its own way: what it records, and how."""

    wrapped_angle: bool
    with_temperature: bool
    with_biases: bool
    dropped: float


def chain_noise(random: np.random.Generator, noise: Noise, run: Run) -> Floats:
    times, variances = noise.states(run)
    samples = random.normal(0.0, np.sqrt(noise.white * run.rate_hz), len(run.time_s))
    for relaxation_s, variance in zip(times, variances, strict=True):
        kept = np.exp(-1.0 / (run.rate_hz * relaxation_s))
        steps = random.normal(0.0, np.sqrt(variance * (1.0 - kept**2)), len(run.time_s))
        start = [kept * random.normal(0.0, np.sqrt(variance))]
        samples = samples + signal.lfilter([1.0], [1.0, -kept], steps, zi=start)[0]
    return np.asarray(samples)


def noises(random: np.random.Generator, noise: Noise, run: Run, theta: Floats) -> dict[str, Floats]:
    """What both chains add, and the pendulum's motion as the turned sensors see it."""
    taps = noise.pendulum_taps(run)
    count = len(run.time_s) + PENDULUM_TAPS - 1
    outside = {channel: np.convolve(random.normal(size=count), taps, "valid") for channel in CHANNELS}
    cosine, sine = np.cos(theta), np.sin(theta)
    return {
        "z": outside["z"] * cosine - outside["y"] * sine + chain_noise(random, noise, run),
        "y": outside["y"] * cosine + outside["z"] * sine + chain_noise(random, noise, run),
    }


def dropped(random: np.random.Generator, run: Run, part: float) -> Flags:
    """Stretches of lost samples of some seconds, all together the given part of the run."""
    lost = np.zeros(len(run.time_s), dtype=bool)
    while lost.mean() < part:
        start = int(random.integers(len(lost)))
        lost[start : start + int(random.uniform(0.5, 6.0) * run.rate_hz)] = True
    return lost


def chain_v(m: Floats, gain_v: float) -> Floats:
    """Reading in V: range and steps of the converter."""
    return np.asarray(np.clip(np.round(m * gain_v / STEP_V) * STEP_V, -FULL_SCALE_V, FULL_SCALE_V))


def run_columns(
    random: np.random.Generator, run: Run, bench: Platform, noise: Noise, habits: Habits
) -> Iterator[tuple[str, Floats]]:
    theta, _, _ = angle(run, bench, run.time_s)
    added = noises(random, noise, run, theta)
    given = readings(run, bench)
    lost = dropped(random, run, habits.dropped)
    shown = np.degrees(theta) + np.degrees(random.normal(0.0, noise.angle_rad, len(theta)))
    yield "t_s", run.time_s
    yield "theta_deg", np.mod(shown, 360.0) if habits.wrapped_angle else shown
    for channel in CHANNELS:
        read = chain_v(given[channel] + added[channel], bench.assumed_gain_v[channel])
        yield COLUMN[channel], np.where(lost, np.nan, read)
    yield "dm1_y_v", np.full_like(theta, run.v_y)
    yield "dm1_z_v", run.command_v(run.v_z, run.time_s)
    yield "moving", moving(run, bench).astype(float)
    yield "supply_v", supply_v(run, bench, run.time_s)
    if habits.with_temperature:
        yield "temperature_c", np.round(temperature_c(run, bench, run.time_s), 3)


def write(runs: list[Run], bench: Platform, noise: Noise, habits: Habits, seed: int, bundle: Path) -> None:
    """The bundle: what a laboratory would hand over, and nothing of the truth."""
    random = np.random.default_rng([23112026, seed])
    (bundle / "runs").mkdir(parents=True)
    (bundle / "recording.toml").write_text(recording_toml(bench, habits))
    with (bundle / "runs.csv").open("w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        names = ["run_id", "pattern", "modulation_period_s", "sample_rate_hz", "external", "v_z_v"]
        rows.writerow([*names, "external_period_s", "start_s"])
        for number, run in enumerate(runs, start=1):
            name = f"r{number:02d}"
            np.savez(bundle / "runs" / f"{name}.npz", **dict(run_columns(random, run, bench, noise, habits)))
            own = run.external_period_s if run.external != "constant" else ""
            rows.writerow([name, run.pattern, run.period_s, run.rate_hz, run.external, run.v_z, own, run.start_s])


def recording_toml(bench: Platform, habits: Habits) -> str:
    lines = ["format = 1", 'experiment = "rotating-platform"', 'title = "a platform elsewhere"', "", "[constants]"]
    lines += ["g_m_s2 = 9.807"]
    for column, channel in (("q_a", "z"), ("q_b", "y")):
        lines.append(f"gain_{column}_v_per_m_s2 = {bench.assumed_gain_v[channel]}")
        if habits.with_biases:
            lines.append(f"bias_{column}_v = {bench.bias_m_s2[channel] * bench.assumed_gain_v[channel]!r}")
    for channel in ("y", "z"):
        lines.append(f"gain_dm1_{channel}_v_per_m_s2 = {bench.assumed_servo_gain_v[channel]}")
    for column in COLUMN.values():
        lines += ["", f"[channels.{column}]", 'unit = "V"', 'kind = "accelerometer"', f"full_scale = {FULL_SCALE_V}"]
    lines += ["", "[channels.supply_v]", 'unit = "V"', 'kind = "voltage"']
    return "\n".join(lines) + "\n"
