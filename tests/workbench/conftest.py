"""A made-up experiment: linear in everything, so that what the statistics promise can be checked in seconds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
from scipy import stats
from threadpoolctl import threadpool_limits

from rigctl.analysis.least_squares import Parameter
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ProcedureError
from rigctl.workbench.study import Candidate, Line, NoisePool, NotTestable, Observations, Series, Term

ANGLES_DEG = (-60.0, -40.0, -20.0, -5.0, 5.0, 20.0, 40.0, 60.0)
FREQUENCIES_HZ = (0.3, 0.5, 0.6)
RUNS = 2 * len(ANGLES_DEG) * len(FREQUENCIES_HZ)


@dataclass
class LinearModel:
    observations: Observations
    terms: tuple[Term, ...]
    parameters: Sequence[Parameter]
    units: Sequence[str]
    owners: Sequence[str]
    design: FloatArray

    @property
    def local(self) -> Sequence[bool]:
        return [False] * len(self.owners)

    def predict(self, values: FloatArray) -> FloatArray:
        return self.design @ values

    def jacobian(self, values: FloatArray) -> FloatArray:
        return self.design


@dataclass
class Synthetic:
    """Runs over angles, frequencies and directions: two series of known noise, a mean whose noise its scatter tells.

    `columns` are the effects; models with one of the `refused` cannot be fitted. Only the first `runs` are there.
    """

    value: FloatArray
    blocks: int = 4
    order: str | None = "start_s"
    experiment: str = "synthetic"
    columns: dict[str, FloatArray] = field(default_factory=dict)
    refused: frozenset[str] = frozenset()
    further: Mapping[str, FloatArray] = field(default_factory=dict)
    runs: int = RUNS

    def effects(self) -> Mapping[str, str]:
        return {name: name for name in self.columns}

    def model(self, terms: Sequence[Term]) -> LinearModel:
        if unfit := self.refused & {term.effect for term in terms}:
            raise ProcedureError(f"{min(unfit)} cannot be fitted to these runs: make others")
        given = observations(self.value, self.blocks, self.order)
        base = baseline(given)
        columns = [*base.T, *(column for term in terms for column in self.columns[term.effect].T)]
        names = [f"b{i}" for i in range(base.shape[1])]
        owners = [""] * base.shape[1]
        for term in terms:
            width = self.columns[term.effect].shape[1]
            names += [f"{term.effect}.{i}" if width > 1 else term.effect for i in range(width)]
            owners += [term.effect] * width
        given = replace(given, covariates={**given.covariates, **self.further})
        return LinearModel(
            first(given, self.runs),
            tuple(terms),
            [Parameter(name, 0.0) for name in names],
            ["1"] * len(names),
            owners,
            np.stack(columns, axis=1)[given.run_of < self.runs],
        )

    def candidates(self, model: LinearModel, values: FloatArray) -> tuple[list[Candidate], list[NotTestable]]:
        inside = {term.effect for term in model.terms}
        found = [
            Candidate(
                Term(name),
                tuple(f"{name}.{i}" for i in range(g.shape[1])),
                ("1",) * g.shape[1],
                g[np.tile(np.arange(RUNS), 3) < self.runs],
                np.ones(g.shape[1]),
            )
            for name, g in self.columns.items()
            if name not in inside
        ]
        return found, []

    def lines(self, model: LinearModel) -> Sequence[Line]:
        return ()

    def result(self, model: LinearModel, values: FloatArray, covariance: FloatArray) -> dict[str, Any]:
        return {}


def conditions() -> dict[str, FloatArray]:
    """48 runs in an order that is random, as procedures have it."""
    grid = [(a, f, d) for a in ANGLES_DEG for f in FREQUENCIES_HZ for d in (-1.0, 1.0)]
    order = np.random.default_rng(5).permutation(len(grid))
    theta, frequency, approach = np.array(grid)[order].T
    start = 60.0 * np.arange(len(grid))
    temperature = 20.0 + 0.3 * np.sin(start / 900.0 + 1.0) + 1e-4 * start
    return {
        "theta_deg": theta,
        "frequency_hz": frequency,
        "approach": approach,
        "start_s": start,
        "temperature_c": temperature,
    }


def observations(value: FloatArray, blocks: int = 4, order: str | None = "start_s") -> Observations:
    around = conditions()
    runs = len(around["theta_deg"])
    series = (Series("v", "nu in-phase", "V"), Series("v", "nu quadrature", "V"), Series("v", "DC", "V"))
    pools = (NoisePool("nu", 60.0), NoisePool("quadrature", 60.0), NoisePool("DC", 0.0, order))
    which = np.repeat(np.arange(3), runs)
    return Observations(
        tuple(f"r{i}" for i in range(runs)),
        series,
        pools,
        value,
        np.ones(3 * runs),
        which,
        np.tile(np.arange(runs), 3),
        which,
        np.zeros(3 * runs, dtype=np.intp),
        (np.arange(runs) * blocks) // runs,
        around,
        "theta_deg",
        "frequency_hz",
    )


def first(given: Observations, runs: int) -> Observations:
    """The observations as they were after so many runs."""
    kept = given.run_of < runs
    of_data = ("value", "sigma", "series_of", "run_of", "pool_of", "group_of")
    return replace(
        given,
        run_ids=given.run_ids[:runs],
        block_of=given.block_of[:runs],
        covariates={name: values[:runs] for name, values in given.covariates.items()},
        **{name: getattr(given, name)[kept] for name in of_data},
    )


def baseline(given: Observations) -> FloatArray:
    """Two of the in-phase amplitude (a shift, a gain), a level of the mean."""
    theta = np.radians(given.of_runs("theta_deg"))
    w2 = (given.of_runs("frequency_hz") / 0.5) ** 2
    nu, dc = given.series_of == 0, given.series_of == 2
    return np.stack([nu * w2 * np.sin(theta), nu * w2 * np.cos(theta), dc * 1.0], axis=1)


def catalogue() -> dict[str, FloatArray]:
    """Effects like a rig's, as columns (n, d)."""
    c = conditions()
    theta, w = np.radians(c["theta_deg"]), c["frequency_hz"] / 0.5
    zero = np.zeros_like(theta)

    def over(nu: FloatArray, quadrature: FloatArray, dc: FloatArray) -> FloatArray:
        return np.concatenate([nu, quadrature, dc])[:, None]

    warm, late = c["temperature_c"] - c["temperature_c"].mean(), c["start_s"] - c["start_s"].mean()
    s = w**2 * np.sin(theta)
    return {
        "roll": over(np.cos(theta), zero, zero),
        "pitch": over(np.sin(theta), zero, zero),
        "lag": over(zero, w * s, zero),
        "resonance": np.hstack([over(w**2 * s, zero, zero), over(zero, w * s, zero)]),
        "square": over(zero, zero, s**2),
        "warm-bias": over(zero, zero, warm),
        "warm-gain": over(warm * s, zero, zero),
        "late-bias": over(zero, zero, late / late.std()),
        "late-gain": over(late / late.std() * s, zero, zero),
        "hysteresis": over(w**2 * np.cos(theta) * c["approach"], zero, zero),
        "tilt": np.hstack([over(zero, zero, np.cos(theta)), over(zero, zero, np.sin(theta))]),
        "recoil": over(w**2 * np.cos(theta), zero, zero),
    }


def sized(effect: FloatArray, sigmas: float) -> FloatArray:
    """The effect's data at so many sigma after refitting the baseline in white noise, first column only."""
    given = observations(np.zeros(len(effect)))
    base = np.linalg.qr(baseline(given))[0]
    column = effect[:, 0]
    free = column - base @ (base.T @ column)
    return sigmas * column / np.linalg.norm(free)


Noise = Callable[[np.random.Generator, FloatArray], FloatArray]


def study(
    seed: int,
    hidden: Mapping[str, float] | None = None,
    noise: Noise | None = None,
    foreign: FloatArray | float = 0.0,
    effects: Mapping[str, FloatArray] | None = None,
    **options: Any,
) -> Synthetic:
    """White noise and hidden effects by seed, sizes in sigma; `noise(rng, start_s)` is further noise of the mean."""
    rng = np.random.default_rng(seed)
    columns = {**catalogue()} if effects is None else {**effects}
    start_s = conditions()["start_s"]
    n = 3 * len(start_s)
    value = rng.standard_normal(n) + baseline(observations(np.zeros(n))) @ rng.normal(0, 30, 3) + foreign
    if noise is not None:
        value[-len(start_s) :] += noise(rng, start_s)
    for name, sigmas in (hidden or {}).items():
        value += sized(columns[name], sigmas) * rng.choice([-1.0, 1.0])
    return Synthetic(value, columns=columns, **options)


@dataclass(frozen=True)
class MadeUp:
    """The experiment's parts, for tests."""

    study = staticmethod(study)
    catalogue = staticmethod(catalogue)
    conditions = staticmethod(conditions)
    observations = staticmethod(observations)
    baseline = staticmethod(baseline)
    sized = staticmethod(sized)


@pytest.fixture(scope="session")
def made_up() -> MadeUp:
    """A made-up experiment."""
    return MadeUp()


@pytest.fixture(scope="session")
def at_least() -> Callable[[int, int, float], bool]:
    """Whether so many successes of so many trials speak against no rate below the one promised.

    False when a true rate as promised would give so few in less than one case in a thousand.
    """

    def plausible(successes: int, trials: int, rate: float) -> bool:
        return bool(stats.binom.cdf(successes, trials, rate) > 1e-3)

    return plausible


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> Iterator[None]:
    """Small matrices are faster on one thread."""
    with threadpool_limits(limits=1, user_api="blas"):
        yield
