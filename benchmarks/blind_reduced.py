"""Rates near one per cent: blind trials on reduced observables, thousands of them.

    python benchmarks/blind_reduced.py --trials 1000 [--sizes 0 4 6 8] [--colours white flicker]
        [--design one-mounting | four-mountings] [--keep FILE]

One nature is sampled from the simulated world, reduced and fitted; each trial replaces its data by the fitted
prediction, noise of a colour, and one effect of the catalogue of a known size in sigma after refit (the model's own
derivative: this tests the statistics, `blind_trials.py` tests the physics). The noise is never told to the analysis.
Beside it stands an oracle that knows which effect to look for and the noise, at the same corrected threshold.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy import stats

from benchmarks.blind_noise import SHAPES, coloured
from benchmarks.blind_sampler import Design
from benchmarks.blind_world import draw, record
from benchmarks.trials import add_workers, keep_trials, rows_in, workers_of
from rigctl.campaign.bundle.bundle import import_bundle
from rigctl.composition import study_of
from rigctl.core.arrays import FloatArray
from rigctl.workbench.study import Candidate, Model, NotTestable, Observations, Study, Term
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.diagnose import diagnose
from rigctl.workbench.verdict.score import likeness
from rigctl.workbench.verdict.significance import CATALOGUE_SHARE

KNOWN = (Term("roll-gravity"), Term("resonance"))
DESIGNS = {
    "one-mounting": Design(
        axes=("X",),
        configurations=("flag",),
        angles_deg=(-30.0, -10.0, -1.6, -0.8, 0.8, 1.6, 10.0, 30.0),
        dwell_s=20.0,
    ),
    "four-mountings": Design(
        axes=("X", "Y"),
        configurations=("pendulum", "flag"),
        angles_deg=(-30.0, -20.0, -10.0, -3.0, -1.6, -0.8, 0.8, 1.6, 3.0, 10.0, 20.0, 30.0),
        dwell_s=20.0,
    ),
}
"""48 runs, and four times 72."""

LEVELS = (0.05, 0.01)


@dataclass
class Replaced:
    """A study with other data."""

    inner: Study
    value: FloatArray

    @property
    def experiment(self) -> str:
        return self.inner.experiment

    def effects(self) -> Mapping[str, str]:
        return self.inner.effects()

    def model(self, terms: Sequence[Term]) -> ReplacedModel:
        return ReplacedModel(self.inner.model(terms), self.value)

    def candidates(self, model: ReplacedModel, values: FloatArray) -> tuple[list[Candidate], list[NotTestable]]:
        return self.inner.candidates(model.inner, values)

    def lines(self, _: Model) -> tuple[()]:
        return ()

    def result(self, *_: Any) -> dict[str, Any]:
        return {}


class ReplacedModel:
    """A model of other data."""

    def __init__(self, inner: Model, value: FloatArray) -> None:
        self.inner = inner
        self.observations: Observations = replace(inner.observations, value=value)
        self.terms, self.parameters, self.units, self.owners = (
            inner.terms,
            inner.parameters,
            inner.units,
            inner.owners,
        )

    @property
    def local(self) -> Sequence[bool]:
        return self.inner.local

    def predict(self, values: FloatArray) -> FloatArray:
        return self.inner.predict(values)

    def jacobian(self, values: FloatArray) -> FloatArray:
        return self.inner.jacobian(values)


class Fixture:
    """The recording that all trials of a process stand on."""

    def __init__(self, design: str) -> None:
        self.dwell_s = DESIGNS[design].dwell_s
        with tempfile.TemporaryDirectory() as scratch:
            bundle = Path(scratch) / "bundle"
            record(draw(1, "none", DESIGNS[design]), bundle)
            with import_bundle(bundle, Path(scratch) / "x.rig.sqlite") as store:
                self.study = study_of(store)
                self.attempt = Attempt(self.study, KNOWN)
        given = self.attempt.model.observations
        self.quiet = self.attempt.model.predict(self.attempt.result.values)
        self.given = given
        self.means = np.flatnonzero(np.array([pool.dof <= 0.0 for pool in given.pools])[given.pool_of])
        self.sigma = given.sigma.copy()
        self.start_s = given.of_runs("start_s")[self.means]
        self.candidates = {c.term.effect: c for c in self.attempt.candidates if _plain(c)}

    @cache  # noqa: B019 - one fixture a process
    def covariance(self, colour: str) -> FloatArray:
        """Of the means between runs: of many stretches of this colour."""
        draws = np.array([self.between_runs(colour, np.random.default_rng([7, seed])) for seed in range(1500)])
        return np.asarray(np.cov(draws.T) + 1e-6 * np.eye(draws.shape[1]))

    def between_runs(self, colour: str, rng: np.random.Generator) -> FloatArray:
        """Noise of the means, in units of their sigma were it white."""
        step_s = 5.0
        offset_s = self.start_s - self.start_s.min()
        noise = coloured(colour, int(offset_s.max() / step_s) + 8, step_s, 1.0, 1.0 / 120.0, rng)
        width = max(int(self.dwell_s / step_s), 1)
        means = np.convolve(noise, np.ones(width) / width, mode="valid")
        found = means[np.rint(offset_s / step_s).astype(np.intp)] * np.sqrt(2.0 * step_s * width)
        if colour == "student-t":
            found = found * np.sqrt(4.0 / rng.chisquare(4.0, len(found))) / np.sqrt(2.0)
        return np.asarray(found)

    def noise(self, colour: str, rng: np.random.Generator) -> FloatArray:
        """All data's; the sigma of harmonics is an estimate, as in a reduction."""
        found = self.sigma * rng.standard_normal(len(self.sigma))
        for number, pool in enumerate(self.given.pools):
            rows = self.given.pool_of == number
            if pool.dof > 0.0:
                found[rows] /= np.sqrt(rng.chisquare(pool.dof) / pool.dof)
        found[self.means] = self.sigma[self.means] * self.between_runs(colour, rng)
        return found

    def whiten(self, colour: str, columns: FloatArray) -> FloatArray:
        """By the true noise."""
        scaled = columns / self.sigma[:, None]
        factor = np.linalg.cholesky(self.covariance(colour))
        scaled[self.means] = np.linalg.solve(factor, scaled[self.means])
        return scaled

    def free(self, colour: str, columns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Whitened columns and those outside what is fitted."""
        priors = self.attempt.jacobian[len(self.sigma) :]
        fitted = np.vstack([self.whiten(colour, self.attempt.model.jacobian(self.attempt.result.values)), priors])
        basis, _ = np.linalg.qr(fitted / np.linalg.norm(fitted, axis=0))
        white = np.vstack([self.whiten(colour, columns), np.zeros((len(priors), columns.shape[1]))])
        return white, white - basis @ (basis.T @ white)


def _plain(candidate: Candidate) -> bool:
    return not candidate.term.choice or candidate.term.choice.get("head") == "laser_2_mm"


@cache
def fixture(design: str) -> Fixture:
    return Fixture(design)


def trial(asked: tuple[str, str, float, int]) -> dict[str, Any]:
    """One trial: what was hidden, what was said, what the oracle would have said."""
    design, colour, size, seed = asked
    made = fixture(design)
    rng = np.random.default_rng([seed, int(10 * size), sorted(SHAPES).index(colour)])
    value = made.quiet + made.noise(colour, rng)
    found: dict[str, Any] = {"design": design, "colour": colour, "size": size, "seed": seed}
    if size:
        names = sorted(name for name, c in made.candidates.items() if _kept(made, colour, c) > 0.05)
        effect = str(rng.choice(names))
        candidate = made.candidates[effect]
        direction = rng.standard_normal(candidate.derivative.shape[1]) * candidate.typical
        signal = candidate.derivative @ direction[:, None]
        _, free = made.free(colour, signal)
        signal *= size / np.linalg.norm(free)
        noisy = (value - made.quiet)[:, None]
        _, own = made.free(colour, candidate.derivative)
        basis, s, _ = np.linalg.svd(own / np.linalg.norm(own, axis=0), full_matrices=False)
        basis = basis[:, s > 0.01 * s[0]]
        along = basis.T @ made.free(colour, noisy + signal)[0]
        value = value + signal[:, 0]
        rivals = [
            likeness(_basis(design, colour, effect), _basis(design, colour, name))
            for name in made.candidates
            if name != effect
        ]
        found |= {
            "effect": effect,
            "dimension": int(basis.shape[1]),
            "oracle": float(stats.chi2.sf(float(np.sum(along**2)), basis.shape[1])),
            "rho": max(rivals),
        }
    study = Replaced(made.study, value)
    diagnosis = diagnose(study, KNOWN, alpha=LEVELS[1] if size else LEVELS[0], seed=seed)
    if not size:
        found["alarm"] = [diagnosis.verdict != "adequate", False]
        if found["alarm"][0]:  # what is quiet at a wide level is quiet at a narrow one
            found["alarm"][1] = diagnose(study, KNOWN, alpha=LEVELS[1], seed=seed).verdict != "adequate"
    first = diagnosis.ranking[0]
    found |= {
        "verdict": diagnosis.verdict,
        "said": [term.effect for term in diagnosis.suggested],
        "first": [first.term.effect, *first.equivalent_to],
        "p_first": first.p_value_corrected,
        "n_eff": diagnosis.n_eff,
        "held_out": diagnosis.steps[-1].error_held_out,
        "unexplained": None if diagnosis.unexplained is None else diagnosis.unexplained.p_value,
    }
    return found


@cache
def _basis(design: str, colour: str, effect: str) -> FloatArray:
    made = fixture(design)
    _, free = made.free(colour, made.candidates[effect].derivative)
    left, s, _ = np.linalg.svd(free / np.linalg.norm(free, axis=0), full_matrices=False)
    return np.asarray(left[:, s > 0.01 * s[0]])


def _kept(made: Fixture, colour: str, candidate: Candidate) -> float:
    white, free = made.free(colour, candidate.derivative)
    return float(np.min(np.linalg.norm(free, axis=0) / np.linalg.norm(white, axis=0)))


def interval(hits: int, trials: int) -> tuple[float, float]:
    """Clopper-Pearson, 95 %."""
    low = stats.beta.ppf(0.025, hits, trials - hits + 1) if hits else 0.0
    high = stats.beta.ppf(0.975, hits + 1, trials - hits) if hits < trials else 1.0
    return float(low), float(high)


def report(rows: Sequence[Mapping[str, Any]]) -> str:
    """Rates by colour and size."""

    def rate(name: str, wanted: Callable[[Mapping[str, Any]], bool], of: Sequence[Mapping[str, Any]]) -> str:
        hits = sum(wanted(row) for row in of)
        low, high = interval(hits, len(of))
        return f"{name} {hits / max(len(of), 1):.3f} ({low:.3f} .. {high:.3f})"

    lines = []
    for colour in dict.fromkeys(row["colour"] for row in rows):
        for size in sorted({row["size"] for row in rows if row["colour"] == colour}):
            own = [row for row in rows if row["colour"] == colour and row["size"] == size]
            line = f"  {colour:15} {size:4g} sigma {len(own):5d}  "
            if not size:
                line += rate("false alarms at 5 %", lambda row: row["alarm"][0], own)
                line += rate("  at 1 %", lambda row: row["alarm"][1], own)
            else:
                apart = [row for row in own if row["rho"] < 0.9]
                line += rate("detected", lambda row: row["verdict"] != "adequate", own)
                line += rate("  oracle", _oracle_sees, own)
                line += rate("  first (rho < 0.9)", lambda row: row["effect"] == row["first"][0], apart)
                line += rate("  in the set", _in_set, own)
                line += rate("  exact", lambda row: row["said"] == [row["effect"]], apart)
            lines.append(line)
    return "\n".join(lines)


def _oracle_sees(row: Mapping[str, Any]) -> bool:
    return bool(row["oracle"] < 1.0 - (1.0 - CATALOGUE_SHARE * LEVELS[1]) ** (1.0 / row["n_eff"]))


def _in_set(row: Mapping[str, Any]) -> bool:
    return row["effect"] in {*row["said"], *row["first"]}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--sizes", type=float, nargs="+", default=[0.0])
    parser.add_argument("--colours", nargs="+", default=["white"], choices=sorted(SHAPES))
    parser.add_argument("--design", default="one-mounting", choices=sorted(DESIGNS))
    add_workers(parser, 2)
    parser.add_argument("--keep", type=Path, default=Path("out/blind-reduced.jsonl"))
    options = parser.parse_args()
    done = {(row["design"], row["colour"], row["size"], row["seed"]) for row in rows_in(options.keep)}
    wanted = [
        (options.design, colour, size, seed)
        for seed in range(1, options.trials + 1)
        for size in options.sizes
        for colour in options.colours
        if (options.design, colour, size, seed) not in done
    ]
    keep_trials(trial, wanted, options.keep, workers_of(options))
    print(report([row for row in rows_in(options.keep) if row["design"] == options.design]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
