"""One draw of the Monte Carlo after another: sessions reduced while they are simulated, estimates from what is left.

A unit of work is one session of as many draws as the ensemble flies at once. What it needs can be pickled, so that it
may run in a thread here or in a process elsewhere; what comes of it is the same.
"""

from __future__ import annotations

import io
import math
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from procedures.inflight.calibration import MonteCarlo
from rigctl.core.interfaces import FloatArray, SatelliteEnsemble
from rigctl.experiments.inflight.model.baseline import Stretch
from rigctl.experiments.inflight.model.joint import joint_estimate
from rigctl.experiments.inflight.model.paper import FittedRun, paper_estimate
from rigctl.experiments.inflight.model.parameters import NAMES
from rigctl.experiments.inflight.observe.observed import own_sigma
from rigctl.experiments.inflight.observe.series import INDEX, SERIES, Amplitudes, central, raw_series
from rigctl.experiments.inflight.observe.sessions import STIMULUS, Line, Session, session_of
from rigctl.experiments.inflight.observe.weights import response, weights
from rigctl.experiments.inflight.result.monte_carlo import Draw
from rigctl.workbench.threads import one_thread

CHUNK = 512
"""Samples that are made and reduced at a time: sixteen draws of them stay near the processor."""


@dataclass(frozen=True)
class Unit:
    """A session of some draws of an ensemble."""

    ensemble: SatelliteEnsemble
    study: MonteCarlo
    orbit_period_s: float
    name: str
    run: int
    draws: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class _Rows:
    """Weights of all samples, (2 lines, samples) each in single precision: of the published estimate's lines, and of
    those observed."""

    session: Session
    published: FloatArray
    observed: FloatArray
    sigma: FloatArray
    """Of cosine and sine of the published lines in the noise the study expects, (lines, 2)."""

    @property
    def spread(self) -> FloatArray:
        """Standard uncertainty of one component of each observed line in noise of unit density, (lines,)."""
        square = np.array([np.dot(row, row) for row in self.observed])
        return np.asarray(np.sqrt(0.5 * (square[0::2] + square[1::2]) / (2.0 * self.session.sample_period_s)))


class NotWanted(Exception):
    """Nobody waits for a unit any more."""


def _never() -> bool:
    return False


@one_thread
def reduce_unit(unit: Unit, unwanted: Callable[[], bool] = _never) -> bytes:
    """Simulate a unit and reduce it: `ReducedUnit` reads it back. `NotWanted` as soon as it is `unwanted`."""
    prepared = rows_of(unit)
    session, groups = prepared.session, (prepared.published, prepared.observed)
    parts = [np.zeros((len(SERIES), len(rows), len(unit.draws))) for rows in groups]
    totals = np.zeros((len(SERIES), len(unit.draws)))
    filled = INDEX["force x" if session.moves_masses else "moved"]
    at = 0
    asked = unit.study.session(unit.name, unit.orbit_period_s)
    memory, products = np.zeros((len(SERIES), CHUNK, len(unit.draws))), [part[:filled].copy() for part in parts]
    for chunk in unit.ensemble.telemetry(unit.draws, unit.run, asked, CHUNK):
        if unwanted():
            raise NotWanted
        t_s = session.sample_period_s * np.arange(at, at + len(chunk), dtype=np.float64)
        columns = {name: chunk[:, place] for place, name in enumerate(unit.ensemble.columns)}
        series = raw_series(session, t_s[:, np.newaxis], columns, memory[:, : len(chunk)]).T[:filled]
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
        draws=np.array(unit.draws),
        sigma=prepared.sigma,
        spread=prepared.spread,
    )
    return made.getvalue()


def rows_of(unit: Unit) -> _Rows:
    """The weights of a unit's session, made once for all of its draws: large, so those of one session at a time."""
    key = (unit.study, unit.name, unit.orbit_period_s, unit.ensemble.sample_period_s)
    with _MAKING:
        if key not in _HELD:
            _HELD.clear()
            _HELD[key] = _rows(*key)
        return _HELD[key]


_MAKING = threading.Lock()
_HELD: dict[tuple[MonteCarlo, str, float, float], _Rows] = {}


def _rows(study: MonteCarlo, name: str, orbit_period_s: float, step_s: float) -> _Rows:
    session = flown(study, name, orbit_period_s, step_s)
    duration_s = study.session(name, orbit_period_s).duration_s
    t_s = step_s * np.arange(round(duration_s / step_s), dtype=np.float64)
    published, observed = (
        weights(t_s, [session.frequency_of(line) for line in lines], single=True)
        for lines in (session.fitted_lines(), session.reduced_lines(duration_s))
    )
    expected = partial(_density, study, step_s)
    sigma = np.array([response(row, step_s, expected) for row in published])
    return _Rows(session, published, observed, sigma.reshape(-1, 2))


def flown(study: MonteCarlo, name: str, orbit_period_s: float, step_s: float) -> Session:
    """A session as the analysis knows it."""
    return session_of(name, study.conditions(name, step_s), orbit_period_s, step_s)


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
        """What `reduce_unit` has made."""
        with np.load(io.BytesIO(data), allow_pickle=False) as kept:
            return cls(kept["parts"], kept["means"], tuple(kept["draws"].tolist()), kept["sigma"], kept["spread"])

    def amplitudes(self, draw: int) -> Amplitudes:
        """Of one draw, at all lines."""
        place = self.draws.index(draw)
        parts = self.parts[:, :, place].T
        return central(np.asarray(parts[0::2] - 1j * parts[1::2]), self.means[:, place])


def estimated(
    draw: int, study: MonteCarlo, orbit_period_s: float, step_s: float, units: Mapping[str, ReducedUnit]
) -> dict[str, tuple[dict[str, float], dict[str, float]]]:
    """Values and sigmas by parameter of both estimates, "paper" and "joint", from a draw's reduced sessions."""
    fitted, stretches = {}, []
    for name, unit in units.items():
        session = flown(study, name, orbit_period_s, step_s)
        everything = unit.amplitudes(draw)
        published = session.fitted_lines()
        observed = session.reduced_lines(study.session(name, orbit_period_s).duration_s)
        first, rest = slice(0, len(published)), slice(len(published), None)
        at_hz = np.array([session.frequency_of(line) for line in observed])
        sigma = np.sqrt(_density(study, step_s, at_hz)) * unit.spread
        fitted[name] = FittedRun(session, _at(everything, first), unit.sigma)
        stretches.append(_stretch(name, session, observed, _at(everything, rest), sigma))
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


def _density(study: MonteCarlo, step_s: float, f_hz: FloatArray) -> FloatArray:
    """One-sided density of m_1x - m_2x that the study expects, (m/s2)^2/Hz.

    Read-out noise is that of positions, which become accelerations by differences over `step_s`.
    """
    white = study.expected_m_s2_rthz**2 * (1.0 + study.expected_corner_hz / f_hz)
    twice = (2.0 * np.sin(math.pi * step_s * f_hz) / step_s) ** 2
    return np.asarray(2.0 * (white + (study.expected_readout_m_rthz * twice) ** 2))


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
