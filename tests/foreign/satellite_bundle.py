"""A recording of the second satellite as another mission would hand it over: noise, lost samples, files.

Every sensor has a white level, a corner and a slope of its own; the slope is a ladder of relaxing states (Ornstein
and Uhlenbeck), the position read-out's rise a second difference. Nothing is made by Fourier transforms of a spectrum.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import signal

from tests.foreign.satellite_loop import Floats, drag_free_sensitivity
from tests.foreign.satellite_world import Noises, Run, Satellite, Telemetry, flown

READOUT_M_RTHZ = 3e-11
STATES_PER_E_FOLD = 1.0
UNITS = {"dy": "rad", "ac12": "m", "ac13": "m", "k2c_1": "m", "k2c_2": "m"}


@dataclass(frozen=True)
class Colour:
    """white^2 (1 + (corner / f)^slope), one-sided, (m/s2)^2/Hz."""

    white: float
    corner_hz: float
    slope: float

    def density(self, f_hz: Floats) -> Floats:
        return np.asarray(self.white**2 * (1.0 + (self.corner_hz / f_hz) ** self.slope))

    def samples(self, random: np.random.Generator, count: int, step_s: float) -> Floats:
        found = random.normal(0.0, self.white / np.sqrt(2.0 * step_s), count)
        span = np.log(20.0 * count)
        times = np.exp(np.linspace(np.log(0.05 * step_s), np.log(count * step_s), int(span * STATES_PER_E_FOLD) + 2))
        width = np.log(times[1] / times[0])
        two_sided = 0.5 * self.white**2 * self.corner_hz**self.slope
        scale = two_sided * (2.0 * np.pi) ** self.slope * np.sin(np.pi * self.slope / 2.0) / np.pi * width
        for time_s in times:
            variance, kept = scale * time_s ** (self.slope - 1.0), np.exp(-step_s / time_s)
            steps = random.normal(0.0, np.sqrt(variance * (1.0 - kept**2)), count)
            start = [kept * random.normal(0.0, np.sqrt(variance))]
            found = found + signal.lfilter([1.0], [1.0, -kept], steps, zi=start)[0]
        return np.asarray(found)


@dataclass(frozen=True)
class Noise:
    """Colours of both masses on x, levels (1/rtHz) of the rest."""

    x: tuple[Colour, Colour]
    across: float
    thrust: float
    torque: float
    tracker: float
    turning: float

    def difference(self, f_hz: Floats) -> Floats:
        """One-sided density of m_1x - m_2x, (m/s2)^2/Hz."""
        readout = 2.0 * (READOUT_M_RTHZ * (2.0 * np.pi * f_hz) ** 2) ** 2
        return np.asarray(self.x[0].density(f_hz) + self.x[1].density(f_hz) + readout)

    def own(self, session: str, f_hz: Floats) -> Floats:
        """Of the channel of the mass that moves: across it sensors only, on x also what drag-free leaves."""
        if session in ("ac12", "ac13"):
            return np.full_like(f_hz, 2.0 * self.across**2)
        return np.asarray(self.difference(f_hz) + (self.thrust * drag_free_sensitivity(f_hz)) ** 2)

    def drawn(self, random: np.random.Generator, run: Run, satellite: Satellite) -> Noises:
        count, step_s = len(run.time_s(satellite.orbit)), run.step_s

        def white(level: float) -> Floats:
            return np.asarray(random.normal(0.0, level / np.sqrt(2.0 * step_s), (3, count)))

        masses = np.array([white(self.across) for _ in range(2)])
        for mass in (0, 1):
            place = random.normal(0.0, READOUT_M_RTHZ / np.sqrt(2.0 * step_s), count + 2)
            masses[mass, 0] = self.x[mass].samples(random, count, step_s) + np.diff(place, 2) / step_s**2
        return Noises(masses, white(self.tracker), white(self.turning), white(self.thrust), white(self.torque))


@dataclass(frozen=True)
class Habits:
    """What another mission does its own way: thermometers (two, one for both, none), and what is lost on the way."""

    thermometers: int
    thermometer_k: float
    lost: float


def lost_samples(random: np.random.Generator, count: int, step_s: float, part: float) -> np.ndarray:
    """Bursts of up to 100 s, all together the given part of the session."""
    lost = np.zeros(count, dtype=bool)
    while lost.mean() < part:
        start = int(random.integers(count))
        lost[start : start + int(random.uniform(5.0, 100.0) / step_s) + 1] = True
    return lost


def run_columns(
    random: np.random.Generator, run: Run, satellite: Satellite, told: Telemetry, habits: Habits
) -> Iterator[tuple[str, Floats]]:
    count = run.samples(satellite.orbit)
    time_s = np.arange(count) * run.step_s
    lost = lost_samples(random, count, run.step_s, habits.lost)
    yield "t_s", time_s
    for mass in (0, 1):
        for axis, name in enumerate("xyz"):
            yield f"m{mass + 1}_{name}", np.where(lost, np.nan, told.measured[mass, axis])
    for first, second in ("xx", "xz", "yy", "zz", "xy", "yz"):
        yield f"t_{first}{second}", told.gradient[:, "xyz".index(first), "xyz".index(second)]
    for column, values in (("dw", told.turning), ("att", told.attitude), ("command", told.command)):
        for axis, name in enumerate("xyz"):
            yield f"{column}_{name}", values[axis]
    shown = 293.0 + told.temperature_k + random.normal(0.0, habits.thermometer_k, told.temperature_k.shape)
    if habits.thermometers == 2:
        yield "temperature_1_k", shown[0]
        yield "temperature_2_k", shown[1]
    if habits.thermometers == 1:
        yield "temperature_c", shown[0] - 273.15
    yield "battery_v", np.round(told.battery_v, 4)
    yield "since_manoeuvre_s", time_s - last_manoeuvre_s(run, time_s)


def last_manoeuvre_s(run: Run, time_s: Floats) -> Floats:
    moments = np.array(sorted(run.manoeuvres_s))
    return np.asarray(moments[np.searchsorted(moments, time_s, side="right") - 1])


def write(runs: list[Run], satellite: Satellite, noise: Noise, habits: Habits, seed: int, bundle: Path) -> None:
    """The bundle: what a mission would hand over, and nothing of the truth."""
    random = np.random.default_rng([24112026, seed])
    (bundle / "runs").mkdir(parents=True)
    (bundle / "recording.toml").write_text(recording_toml(satellite))
    with (bundle / "runs.csv").open("w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        names = ["run_id", "session", "orbits", "sample_period_s", "calibration_frequency_hz", "amplitude"]
        rows.writerow([*names, "amplitude_unit", "phase_rad", "start_s"])
        for number, run in enumerate(runs, start=1):
            name = f"c{number:02d}"
            told = flown(run, satellite, noise.drawn(random, run, satellite))
            np.savez(bundle / "runs" / f"{name}.npz", **dict(run_columns(random, run, satellite, told, habits)))
            stimulus = [run.frequency_hz, run.amplitude, UNITS.get(run.session, "m/s2"), run.phase_rad]
            shown = stimulus if run.frequency_hz else ["", "", "", ""]
            rows.writerow([name, run.session, run.orbits, run.step_s, *shown, run.start_s])


def recording_toml(satellite: Satellite) -> str:
    lines = [
        "format = 1",
        'experiment = "inflight-calibration"',
        'title = "a satellite elsewhere"',
        "",
        "[constants]",
    ]
    lines += [f"orbit_period_s = {satellite.orbit.period_s}", f"eccentricity = {satellite.orbit.eccentricity}"]
    lines += ["", "[channels.battery_v]", 'unit = "V"', 'kind = "voltage"']
    lines += ["", "[channels.since_manoeuvre_s]", 'unit = "s"', 'kind = "time"']
    return "\n".join(lines) + "\n"
