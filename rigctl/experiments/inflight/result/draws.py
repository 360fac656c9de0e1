"""Draws of the Monte Carlo: sessions reduced while they are simulated, and estimates from what is left of them."""

from __future__ import annotations

import io
import math
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.experiments.inflight.model.baseline import Stretch
from rigctl.experiments.inflight.model.joint import joint_estimate
from rigctl.experiments.inflight.model.observed import own_sigma
from rigctl.experiments.inflight.model.paper import FittedRun, paper_estimate
from rigctl.experiments.inflight.model.parameters import NAMES
from rigctl.experiments.inflight.observe.series import INDEX, SERIES, Amplitudes, central, raw_series
from rigctl.experiments.inflight.observe.sessions import STIMULUS, Line, Session
from rigctl.experiments.inflight.observe.weights import response, weights
from rigctl.experiments.inflight.result.monte_carlo import Draw
from rigctl.workbench.threads import one_thread

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
class _Rows:
    """Weights of all samples, (2 lines, samples) each in single precision: of the published estimate's lines, and of
    those observed."""

    sample_period_s: float
    published: FloatArray
    observed: FloatArray
    sigma: FloatArray
    """Of cosine and sine of the published lines in the noise the study expects, (lines, 2)."""

    @property
    def spread(self) -> FloatArray:
        """Standard uncertainty of one component of each observed line in noise of unit density, (lines,)."""
        square = np.array([np.dot(row, row) for row in self.observed])
        return np.asarray(np.sqrt(0.5 * (square[0::2] + square[1::2]) / (2.0 * self.sample_period_s)))


class NotWanted(Exception):
    """Nobody waits for a unit any more."""


@one_thread
def reduced(
    flown: Flown,
    telemetry: Iterable[FloatArray],
    columns: Sequence[str],
    draws: tuple[int, ...],
    unwanted: Callable[[], bool],
) -> bytes:
    """Some draws of a session, reduced as their telemetry comes, (samples, columns, draws) at a time.

    `ReducedUnit` reads it back. `NotWanted` as soon as it is `unwanted`.
    """
    prepared, session = rows_of(flown), flown.session
    groups = (prepared.published, prepared.observed)
    parts = [np.zeros((len(SERIES), len(rows), len(draws))) for rows in groups]
    totals = np.zeros((len(SERIES), len(draws)))
    filled = INDEX["force x" if session.moves_masses else "moved"]
    at = 0
    memory, products = np.zeros((len(SERIES), CHUNK, len(draws))), [part[:filled].copy() for part in parts]
    for chunk in telemetry:
        if unwanted():
            raise NotWanted
        t_s = session.sample_period_s * np.arange(at, at + len(chunk), dtype=np.float64)
        by_name = {name: chunk[:, place] for place, name in enumerate(columns)}
        series = raw_series(session, t_s[:, np.newaxis], by_name, memory[:, : len(chunk)]).T[:filled]
        for part, rows, product in zip(parts, groups, products, strict=True):
            part[:filled] += np.matmul(rows[:, at : at + len(chunk)].astype(np.float64), series, out=product)
        totals[:filled] += np.ones(len(chunk)) @ series
        at += len(chunk)
    means = totals / at
    for part, rows in zip(parts, groups, strict=True):
        # In single precision the weights of a line let a billionth of a level through; it is not wanted.
        part -= rows.sum(axis=1, dtype=np.float64)[:, np.newaxis] * means[:, np.newaxis]
    made = io.BytesIO()
    np.savez(
        made,
        parts=np.concatenate(parts, axis=1),
        means=means,
        draws=np.array(draws),
        sigma=prepared.sigma,
        spread=prepared.spread,
    )
    return made.getvalue()


def rows_of(flown: Flown) -> _Rows:
    """The weights of a session, made once for all of its draws: large, so those of one session at a time."""
    with _MAKING:
        if flown not in _HELD:
            _HELD.clear()
            _HELD[flown] = _rows(flown)
        return _HELD[flown]


_MAKING = threading.Lock()
_HELD: dict[Flown, _Rows] = {}


def _rows(flown: Flown) -> _Rows:
    session, step_s = flown.session, flown.session.sample_period_s
    t_s = step_s * np.arange(round(flown.duration_s / step_s), dtype=np.float64)
    published, observed = (
        weights(t_s, [session.frequency_of(line) for line in lines], single=True)
        for lines in (flown.published, flown.observed)
    )
    sigma = np.array([response(row, step_s, flown.density) for row in published])
    return _Rows(step_s, published, observed, sigma.reshape(-1, 2))


@dataclass(frozen=True, eq=False)
class ReducedUnit:
    """A reduced unit, read back: `parts` (series, 2 lines, draws), `means` (series, draws); `sigma` (lines, 2) of the
    published lines' parts, `spread` (lines,) of the observed ones."""

    parts: FloatArray
    means: FloatArray
    draws: tuple[int, ...]
    sigma: FloatArray
    spread: FloatArray

    @classmethod
    def from_bytes(cls, data: bytes) -> ReducedUnit:
        """What `reduced` has made."""
        with np.load(io.BytesIO(data), allow_pickle=False) as kept:
            return cls(kept["parts"], kept["means"], tuple(kept["draws"].tolist()), kept["sigma"], kept["spread"])

    def amplitudes(self, draw: int) -> Amplitudes:
        """Of one draw, at all lines."""
        place = self.draws.index(draw)
        parts = self.parts[:, :, place].T
        return central(np.asarray(parts[0::2] - 1j * parts[1::2]), self.means[:, place])


def estimated(
    draw: int, flown: Mapping[str, Flown], units: Mapping[str, ReducedUnit]
) -> dict[str, tuple[dict[str, float], dict[str, float]]]:
    """Values and sigmas by parameter of both estimates, "paper" and "joint", from a draw's reduced sessions."""
    fitted, stretches = {}, []
    for name, unit in units.items():
        session, observed = flown[name].session, flown[name].observed
        everything = unit.amplitudes(draw)
        count = len(flown[name].published)
        at_hz = np.array([session.frequency_of(line) for line in observed])
        sigma = np.sqrt(flown[name].density(at_hz)) * unit.spread
        fitted[name] = FittedRun(session, _at(everything, slice(0, count)), unit.sigma)
        stretches.append(_stretch(name, session, observed, _at(everything, slice(count, None)), sigma))
    paper, joint = paper_estimate(fitted), joint_estimate(stretches)
    return {
        "paper": (_named(paper.values), _named(paper.sigmas)),
        "joint": (_named(joint.values), _named(joint.sigmas)),
    }


def draw_of(number: int, estimates: Mapping[str, Any], truths: Mapping[str, Mapping[str, float]]) -> Draw:
    """A draw of the study with its score."""
    return Draw(
        number,
        {name: values for name, (values, _) in estimates.items()},
        {name: sigmas for name, (_, sigmas) in estimates.items()},
        truths,
    )


def _stretch(name: str, session: Session, lines: tuple[Line, ...], found: Amplitudes, sigma: FloatArray) -> Stretch:
    own = (math.nan, math.nan)
    if session.moves_masses and STIMULUS in lines:
        place = lines.index(STIMULUS)
        own = own_sigma(session, found.table[place], float(sigma[place]))
    return Stretch(name, session, lines, found, sigma, own)


def _at(found: Amplitudes, lines: slice) -> Amplitudes:
    return replace(found, table=found.table[lines])


def _named(values: FloatArray) -> dict[str, float]:
    return {name: float(value) for name, value in zip(NAMES, values, strict=True)}
