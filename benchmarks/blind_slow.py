"""A slow change of the mean, or slow noise? How often a drift is found, and found where there is none.

    python benchmarks/blind_slow.py [--design one-mounting | four-mountings] [--odds 3] [--draws 160] [--sigma 6]

The recordings of `blind_reduced.py`; `--odds` is how much likelier than all correlated noise white noise is taken to
be beforehand. Printed are shares of draws with p < 2e-4 for bias-drift, before and after the bootstrap.
"""

from __future__ import annotations

import argparse
import os
import sys

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from benchmarks.blind_noise import SHAPES
from benchmarks.blind_reduced import DESIGNS, KNOWN, Fixture, Replaced, fixture
from rigctl.workbench.verdict import noise_pool
from rigctl.workbench.verdict.search import Search
from rigctl.workbench.verdict.significance import p_of_scored

EFFECT, LEVEL = "bias-drift", 2e-4


def p_values(made: Fixture, colour: str, sigma: float, seed: int) -> tuple[float, float]:
    """Of the drift in one draw, without and with the bootstrap."""
    rng = np.random.default_rng([seed, int(10 * sigma), sorted(SHAPES).index(colour)])
    value = made.quiet + made.noise(colour, rng)
    if sigma:
        signal = made.candidates[EFFECT].derivative[:, :1]
        _, free = made.free(colour, signal)
        value = value + signal[:, 0] * rng.choice([-1.0, 1.0]) * sigma / np.linalg.norm(free)
    search = Search(Replaced(made.study, value), KNOWN, 0.01, seed, lambda _: None)
    attempt = search.attempt(KNOWN)
    scored = next(each for each in attempt.scored if each.candidate.term.effect == EFFECT)
    return scored.score.p_value, p_of_scored(attempt, scored)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--design", default="four-mountings", choices=sorted(DESIGNS))
    parser.add_argument("--odds", type=float, default=noise_pool.WHITE_ODDS)
    parser.add_argument("--draws", type=int, default=160)
    parser.add_argument("--sigma", type=float, default=6.0)
    parser.add_argument("--colours", nargs="+", default=["white", "flicker", "f^-1.64"], choices=sorted(SHAPES))
    given = parser.parse_args()
    noise_pool.WHITE_ODDS = given.odds
    made = fixture(given.design)
    print(
        f"{given.design}, odds of white noise {given.odds:g}: share of draws with p < {LEVEL:g}, with the bootstrap"
    )
    for colour in given.colours:
        for sigma in (0.0, given.sigma):
            found = np.array([p_values(made, colour, sigma, seed) for seed in range(given.draws)])
            raw, confirmed = (found < LEVEL).mean(axis=0)
            print(f"  {colour:10} {sigma:4g} sigma  {raw:.3f}  {confirmed:.3f}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
