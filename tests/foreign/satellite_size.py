"""How large an effect is in a recording of the second satellite, in sigma: from the world and its noise alone.

The observables are the complex amplitudes of the page at its lines, by its band-pass and joint least squares: of the
difference of both masses less what the common acceleration makes of it, and of the moved mass's own channel. Their
noise is the density there over the session's length; what the baseline can imitate is projected out, its gains of
moved masses as well as they are known.
"""

from __future__ import annotations

import numpy as np
from scipy import signal

from tests.foreign.satellite_bundle import Noise
from tests.foreign.satellite_loop import Floats
from tests.foreign.satellite_world import MOVED_AXIS, SATELLITE_FORCE, Run, Satellite, Telemetry, flown

GAIN_PRIOR = 1e-2
DROPPED_S = 200.0
RELATIVE_RANK = 1e-9


def lines_hz(run: Run, satellite: Satellite) -> list[float]:
    """The page's lines of that session, without doubles."""
    n, f = satellite.orbit.frequency_hz, run.frequency_hz
    found = [k * n for k in range(1, 5)]
    beside = {"dy": range(-3, 4), "ac12": range(-3, 4), "ac13": range(-3, 4)}.get(run.session, range(-2, 3))
    if run.session in SATELLITE_FORCE:
        found += [f + j * n for j in beside] + [2.0 * f, 2.0 * f - n, 2.0 * f + n, 3.0 * f]
    elif run.session in MOVED_AXIS:
        found += [f + j * n for j in beside] if run.session.startswith("ac") else [f, 2.0 * f, 3.0 * f]
    elif run.session == "dy":
        found += [f + j * n for j in beside]
    return sorted({round(line, 12) for line in found if line > 0.5 * n})


def band_pass(lines_hz: Floats, step_s: float) -> Floats:
    """Second-order Butterworth, from half the lowest line to twice the highest where sampling leaves that."""
    passed = signal.butter(2, 0.5 * min(lines_hz), "highpass", fs=1.0 / step_s, output="sos")
    if 2.0 * max(lines_hz) < 0.45 / step_s:
        passed = np.vstack([passed, signal.butter(2, 2.0 * max(lines_hz), "lowpass", fs=1.0 / step_s, output="sos")])
    return np.asarray(passed)


def difference(told: Telemetry) -> Floats:
    return np.asarray(told.measured[0, 0] - told.measured[1, 0])


def own_channel(run: Run, told: Telemetry) -> Floats:
    """What shows the motion of the mass that is moved."""
    if run.session in ("k2c_1", "k2c_2"):
        return np.asarray(told.measured[0 if run.session == "k2c_1" else 1, 0])
    axis = MOVED_AXIS[run.session]
    return np.asarray(told.measured[0, axis] - told.measured[1, axis])


class Session:
    """One run without noise, and the weights that take its observables from samples."""

    def __init__(self, run: Run, satellite: Satellite, noise: Noise) -> None:
        self.run, self.satellite = run, satellite
        self.plain = flown(run, satellite)
        self.time_s = np.arange(run.samples(satellite.orbit)) * run.step_s
        self.lines = np.array(lines_hz(run, satellite))
        length_s = run.orbits * satellite.orbit.period_s
        self.filter = band_pass(self.lines, run.step_s)
        self.lines_weights = self.rows(self.lines, np.sqrt(noise.difference(self.lines) / length_s))
        self.own_weights = np.empty((0, len(self.time_s) - self.dropped))
        if run.session in MOVED_AXIS:
            stimulus = np.array([run.frequency_hz])
            self.own_weights = self.rows(stimulus, np.sqrt(noise.own(run.session, stimulus) / length_s))

    @property
    def dropped(self) -> int:
        return round(DROPPED_S / self.run.step_s)

    def passed(self, series: Floats) -> Floats:
        """The page's chain: less its mean, band-passed, without its beginning; samples last."""
        series = series - series.mean(axis=-1, keepdims=True)
        return np.asarray(signal.sosfilt(self.filter, series, axis=-1)[..., self.dropped :])

    def rows(self, lines: Floats, sigmas: Floats) -> Floats:
        """Weights on passed samples of a joint least squares of these lines, in their sigmas."""
        angle = 2.0 * np.pi * lines[:, None] * self.time_s
        shapes = np.stack([np.cos(angle), np.sin(angle)], axis=1).reshape(-1, len(self.time_s))
        basis = self.passed(shapes)
        return np.asarray(np.linalg.solve(basis @ basis.T, basis) / np.repeat(sigmas, 2)[:, None])

    def at_lines(self, series: Floats) -> Floats:
        return np.asarray(self.lines_weights @ self.passed(series).T)

    def at_stimulus(self, series: Floats) -> Floats:
        return np.asarray(self.own_weights @ self.passed(series).T)

    def observed(self, told: Telemetry) -> Floats:
        """The whitened observables, against those without noise and effects."""
        first, second = self.satellite.masses
        gains = (first.gains @ first.turn - second.gains @ second.turn) / 2.0
        before, after = self.plain.measured.mean(axis=0), told.measured.mean(axis=0)
        common = 2.0 * gains[0] @ (after - before)
        common += (first.quadratic[0] - second.quadratic[0]) * (after[0] ** 2 - before[0] ** 2)
        seen = self.at_lines(difference(told) - difference(self.plain) - common)
        if not len(self.own_weights):
            return seen
        moved = own_channel(self.run, told) - own_channel(self.run, self.plain)
        return np.concatenate([seen, self.at_stimulus(moved)])

    def regressors(self) -> Floats:
        """What each of the ten parameters does to the observables; the same order in every run."""
        run, told = self.run, self.plain
        common, t = told.measured.mean(axis=0), told.gradient
        moved = run.stimulus(self.time_s) if run.session in MOVED_AXIS else np.zeros_like(self.time_s)
        is_in = {name: moved * (run.session == name) for name in MOVED_AXIS}
        series = [
            t[:, 0, 0], t[:, 0, 2], t[:, 0, 1] + told.turning[2],
            t[:, 0, 0] * is_in["ac12"], (t[:, 2, 2] - t[:, 0, 0]) * is_in["ac13"],
            *(2.0 * common), 2.0 * common[0] ** 2,
            told.measured[0, 0] ** 2 * (run.session == "k2c_1"), told.measured[1, 0] ** 2 * (run.session == "k2c_2"),
        ]  # fmt: skip
        seen = self.at_lines(np.array(series))
        return np.vstack([seen, np.zeros((len(self.own_weights), seen.shape[1]))])

    def nuisances(self) -> tuple[Floats, Floats]:
        """Columns of this run alone, and their priors: the moved mass's line, its gain."""
        if not len(self.own_weights):
            return np.empty((2 * len(self.lines), 0)), np.empty(0)
        angle = 2.0 * np.pi * self.run.frequency_hz * self.time_s
        line = self.at_lines(np.array([np.cos(angle), np.sin(angle)]))
        gain = self.at_stimulus(own_channel(self.run, self.plain))
        columns = np.zeros((len(line) + len(gain), 3))
        columns[: len(line), :2], columns[len(line) :, 2] = line, gain
        return columns, np.array([np.inf, np.inf, GAIN_PRIOR])


class Sight:
    """What a recording of these runs with this noise can show."""

    def __init__(self, runs: list[Run], satellite: Satellite, noise: Noise) -> None:
        self.satellite, self.noise = satellite, noise
        self.sessions = [Session(run, satellite, noise) for run in runs]
        shared = np.vstack([session.regressors() for session in self.sessions])
        own = [session.nuisances() for session in self.sessions]
        columns, priors, begun = [shared], [np.full(shared.shape[1], np.inf)], 0
        for block, sigma in own:
            placed = np.zeros((len(shared), block.shape[1]))
            placed[begun : begun + len(block)] = block
            columns.append(placed)
            priors.append(sigma)
            begun += len(block)
        design = np.hstack(columns)
        known = np.diag(1.0 / np.concatenate(priors))
        design = np.vstack([design, known])
        scale = np.linalg.norm(design, axis=0)
        design = design[:, scale > 0.0] / scale[scale > 0.0]
        vectors, values, _ = np.linalg.svd(design, full_matrices=False)
        self.basis = vectors[:, values > RELATIVE_RANK * values[0]]

    def size(self, effects: dict[str, float]) -> float:
        """The effects' change of the observables, in sigma, after the baseline has refitted."""
        other = self.satellite.with_effects(effects)
        changes = np.concatenate([each.observed(flown(each.run, other)) for each in self.sessions])
        change = np.concatenate([changes, np.zeros(len(self.basis) - len(changes))])
        return float(np.linalg.norm(change - self.basis @ (self.basis.T @ change)))

    def event_size(self, size: float, ratio: float) -> float:
        """One glitch of that size, by its matched filter in the difference less the common acceleration."""
        run = self.sessions[0].run
        first, second = self.satellite.masses
        shown = size * (ratio - 2.0 * (first.gain_error[0] - second.gain_error[0]) / 2.0)
        f = np.linspace(1e-4, 0.5 / run.step_s, 2000)
        spectrum = np.abs(1.0 / (1.0 / 3.0 + 2j * np.pi * f) - 1.0 / (1.0 + 2j * np.pi * f))
        return float(abs(shown) * np.sqrt(4.0 * np.trapezoid(spectrum**2 / self.noise.difference(f), f)))
