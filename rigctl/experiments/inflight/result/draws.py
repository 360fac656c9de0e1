"""Draws of the Monte Carlo: sessions reduced while they are simulated, and estimates from what is left of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from rigctl.analysis.kept import Packed
from rigctl.core.arrays import FloatArray
from rigctl.core.threads import one_thread
from rigctl.experiments.inflight.model.baseline import joint_estimate
from rigctl.experiments.inflight.model.observed import stretch_of
from rigctl.experiments.inflight.model.paper import FittedRun, paper_estimate
from rigctl.experiments.inflight.model.parameters import NAMES
from rigctl.experiments.inflight.observe.published import PublishedWeights, Streamed, published_weights
from rigctl.experiments.inflight.observe.series import INDEX, SERIES, Amplitudes, central, raw_series
from rigctl.experiments.inflight.observe.sessions import EQUIVALENCE, QUADRATIC, Line, Session
from rigctl.experiments.inflight.observe.weights import response, spread
from rigctl.experiments.inflight.result.equivalence import calibrated_of
from rigctl.experiments.inflight.result.missions import TEST_CHUNK, reduced_tests, run_of, tested
from rigctl.experiments.inflight.result.monte_carlo import Draw

CHUNK = 512
"""Samples that are made and reduced at a time: sixteen draws of them stay near the processor."""


@dataclass(frozen=True)
class ExpectedNoise:
    """The noise a study expects of one sensor along x: one-sided amplitude densities, white above the corner."""

    white_m_s2_rthz: float
    corner_hz: float
    readout_m_rthz: float

    def density(self, step_s: float, f_hz: FloatArray) -> FloatArray:
        """One-sided density of m_1x - m_2x, (m/s2)^2/Hz.

        Read-out noise is that of positions, which become accelerations by differences over `step_s`.
        """
        white = self.white_m_s2_rthz**2 * (1.0 + self.corner_hz / f_hz)
        twice = (2.0 * np.sin(math.pi * step_s * f_hz) / step_s) ** 2
        # Twice: the difference of two sensors.
        return np.asarray(2.0 * (white + (self.readout_m_rthz * twice) ** 2))


@dataclass(frozen=True)
class Flown:
    """A session of all draws, as the analysis knows it."""

    session: Session
    duration_s: float
    noise: ExpectedNoise

    @property
    def published(self) -> tuple[Line, ...]:
        """The lines of the published estimate."""
        return self.session.fitted_lines()

    @property
    def observed(self) -> tuple[Line, ...]:
        """The lines that are observed in a stretch so long."""
        return self.session.reduced_lines(self.duration_s)

    def density(self, f_hz: FloatArray) -> FloatArray:
        """Of the expected noise."""
        return self.noise.density(self.session.sample_period_s, f_hz)


@dataclass(frozen=True, eq=False)
class _Weights:
    """Of the published estimate's lines, and of those observed. `sigma` (lines, 2) is that of cosine and sine of the
    published lines in the noise the study expects, `spread` (lines,) that of one component of each observed line in
    noise of unit density."""

    published: PublishedWeights
    observed: PublishedWeights
    sigma: FloatArray
    spread: FloatArray


def chunk_of(flown: Flown) -> int:
    """Samples at a time."""
    return TEST_CHUNK if flown.session.name in EQUIVALENCE else CHUNK


@one_thread
def reduced(
    flown: Flown,
    telemetry: Iterable[FloatArray],
    columns: Sequence[str],
    draws: tuple[int, ...],
    going_on: Callable[[], None],
) -> Packed:
    """Some draws of a session, reduced as their telemetry comes, (samples, columns, draws) at a time.

    Arrays: `parts` (series, 2 lines, draws) of the published and then the observed lines, `means` (series, draws),
    `draws`, and `sigma` and `spread` as `_Weights` has them; those of a session of the test as `reduced_tests` says.
    `going_on` raises when nobody waits any more.
    """
    if flown.session.name in EQUIVALENCE:
        return reduced_tests(flown.session, flown.duration_s, telemetry, columns, draws, going_on)
    prepared, session = weights_of(flown), flown.session
    # Series from here on are nil: forces always, what is moved unless the session moves masses.
    filled, at = INDEX["force x" if session.moves_masses else "moved"], 0
    sums = Streamed((prepared.published, prepared.observed), CHUNK, (filled, len(draws)))
    memory = np.zeros((len(SERIES), CHUNK, len(draws)))
    for chunk in telemetry:
        going_on()
        t_s = session.sample_period_s * np.arange(at, at + len(chunk), dtype=np.float64)
        by_name = {name: chunk[:, place] for place, name in enumerate(columns)}
        raw_series(session, t_s[:, np.newaxis], by_name, memory[:, : len(chunk)])
        sums.add(at, memory[:filled, : len(chunk)])
        at += len(chunk)
    found = np.concatenate(sums.parts(), axis=1), sums.means()
    parts, means = (np.concatenate([each, np.zeros((len(SERIES) - filled, *each.shape[1:]))]) for each in found)
    return Packed(
        {},
        {
            "parts": parts,
            "means": means,
            "draws": np.array(draws),
            "sigma": prepared.sigma,
            "spread": prepared.spread,
        },
    )


@lru_cache(maxsize=1)
def weights_of(flown: Flown) -> _Weights:
    """The weights of a session, made once for all of its draws."""
    session, step_s = flown.session, flown.session.sample_period_s
    count = round(flown.duration_s / step_s)
    published, observed = (
        published_weights(0.0, step_s, count, [session.frequency_of(line) for line in lines])
        for lines in (flown.published, flown.observed)
    )
    # Line by line: the rows of forty orbits are a hundred megabytes.
    pairs = (published.rows(slice(place, place + 2)) for place in range(0, 2 * len(published.lines_hz), 2))
    sigma = np.array([response(row, step_s, flown.density) for pair in pairs for row in pair])
    return _Weights(published, observed, sigma.reshape(-1, 2), spread(observed.squares(), step_s))


def estimated(
    draw: int, flown: Mapping[str, Flown], units: Mapping[str, Packed], truths: Mapping[str, Mapping[str, float]]
) -> Draw:
    """Both estimates of a draw and their sigmas, from its sessions as `reduced` left them, beside its truths."""
    fitted, stretches, levels, tests = {}, [], [], []
    for name, unit in units.items():
        if name in EQUIVALENCE:
            tests.append(run_of(unit, flown[name].session, draw))
            continue
        session, observed = flown[name].session, flown[name].observed
        everything = _amplitudes(unit, draw)
        if name not in QUADRATIC:
            levels.append((everything.mean_square, everything.apart))
        count = len(flown[name].published)
        at_hz = np.array([session.frequency_of(line) for line in observed])
        sigma = np.sqrt(flown[name].density(at_hz)) * unit.arrays["spread"]
        published, rest = (replace(everything, table=part) for part in np.split(everything.table, [count]))
        fitted[name] = FittedRun(session, published, unit.arrays["sigma"])
        # Of the own channel the same noise is expected: what limits it is its gain.
        stretches.append(stretch_of(name, session, observed, rest, sigma, sigma))
    paper, joint = paper_estimate(fitted), joint_estimate(stretches)
    # Where the mean of both masses was held and nothing injected: there the calibrated slopes are the sensors'.
    calibrated, level = calibrated_of(joint.values, joint.covariance, {}), min(levels)[1]
    return Draw(
        draw,
        {"paper": _named(paper.values), "joint": {name: joint.value(name) for name in NAMES}},
        {"paper": _named(paper.sigmas), "joint": {name: joint.sigma(name) for name in NAMES}},
        truths,
        tested(tests, calibrated, level, truths["exact_truth"]) if tests else {},
        joint.covariance[: len(NAMES), : len(NAMES)].tolist(),
    )


def _amplitudes(unit: Packed, draw: int) -> Amplitudes:
    """Of one draw, at all lines."""
    place = unit.arrays["draws"].tolist().index(draw)
    parts = unit.arrays["parts"][:, :, place].T
    return central(np.asarray(parts[0::2] - 1j * parts[1::2]), unit.arrays["means"][:, place])


def _named(values: FloatArray) -> dict[str, float]:
    return {name: float(value) for name, value in zip(NAMES, values, strict=True)}
