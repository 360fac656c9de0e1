"""Blind trials on the rotating platform: is what is hidden in its world found, and nothing else?

Each trial draws a nature with at most one hidden effect, of a size in sigma of these runs, samples six runs of it
without instruments, writes them as a bundle, imports that and asks `diagnose`. Scores are kept as JSON lines, so that
an interrupted study goes on where it was; shares come with their Clopper-Pearson intervals.

    python -m benchmarks.blind_platform --trials 100 --kind one --out platform.jsonl
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy import stats

from benchmarks.platform_sampler import SampledRun, record, sampled
from benchmarks.trials import add_workers, keep_trials, rows_in, workers_of
from rigctl.campaign.bundle.bundle import import_bundle
from rigctl.composition import study_of
from rigctl.core.errors import RigError
from rigctl.experiments.rotating_platform.model.model import PlatformModel, slopes_at_zero
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS
from rigctl.experiments.rotating_platform.study import PlatformStudy
from rigctl.workbench.placed import placed
from rigctl.workbench.study import Term
from rigctl.workbench.study_base import own_model
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.diagnose import diagnose
from simulators.worlds.platform_settings import PlatformSettings

CONFIDENCE = 0.95
TEMPERATURE = {"mean_c": 22.0, "daily_k": 0.3, "cycle_k": 0.3, "cycle_s": 5000.0, "drift_k_per_day": 0.0}

UNITS: dict[str, dict[str, float]] = {
    "off-centre": {"r_cos": 1e-3, "r_sin": 1e-3},
    "recovery": {"e": 1e-6, "t_r": 8.0},
    "recovery-signed": {"e": 1e-6, "t_r": 8.0},
    "thermal-bias": {"b1": 1e-5},
    "gain-drift": {"k1": 1e-8},
    "line": {"amplitude": 1e-7, "frequency": 0.14321},
    "platform-repeatability": {"stop": 1e-5},
    "cross-axis": {"k": 1e-3},
    "quadratic": {"K2": 1.0},
    "gain-asymmetry": {"e": 1e-3},
    "clock-skew": {"r_sin": 1e-3, "delay": 0.2},
    "filter-ringing": {"r_sin": 1e-2, "cutoff": 5.0},
    "tide": {"amplitude": 1e-6, "period": 43200.0},
}
"""Each effect in a direction of its amplitudes and with its times; the size drawn multiplies the amplitudes."""

IN_MODEL = {"tide": {"amplitude": "a_sin"}}
"""Parameters that the model calls otherwise than nature."""

TIMES = ("t_r", "frequency", "delay", "cutoff", "period")
LINE_SIGMA_M_S2 = 7e-8
"""About one sigma of an amplitude whose phase is free in every run: 4.5e-11 (m/s2)2/Hz in 15 ks of samples."""


@dataclass(frozen=True)
class Truth:
    """What is hidden, and how large it is in sigma."""

    seed: int
    effect: str | None
    sigma: float
    sizes: dict[str, float]


def design(mask_short_s: float) -> list[SampledRun]:
    """Two patterns, two periods, four tilts, and one run with the pendulum tilted the other way too."""
    return [
        SampledRun("c", 60.0, 40, v_z_v=0.0, mask_short_s=mask_short_s),
        SampledRun("b", 60.0, 40, v_z_v=1.0, mask_short_s=mask_short_s),
        SampledRun("c", 300.0, 16, v_z_v=0.5, mask_short_s=mask_short_s),
        SampledRun("b", 300.0, 16, v_z_v=1.5, mask_short_s=mask_short_s),
        SampledRun("c", 60.0, 40, v_z_v=0.5, v_y_v=1.0, mask_short_s=mask_short_s),
        SampledRun("c", 60.0, 40, v_z_v=1.5, v_y_v=-1.0, mask_short_s=mask_short_s),
    ]


def draw(seed: int, kind: str, sigma: tuple[float, float], among: Sequence[str]) -> tuple[Truth, float]:
    """What is hidden in a trial, and by how much its masks are too short [s]."""
    rng = np.random.default_rng([seed, 2013])
    names = list(among) or list(UNITS)
    effect = names[int(rng.integers(len(names)))] if kind == "one" else None
    short_s = 0.3 if effect == "off-centre" or rng.random() < 0.2 else 0.0
    if effect is None:
        return Truth(seed, None, 0.0, {}), short_s
    wanted = float(rng.uniform(*sigma))
    scale = wanted * one_sigma(effect, short_s)
    sizes = {n: v if n in TIMES else scale * v for n, v in UNITS[effect].items()}
    return Truth(seed, effect, wanted, sizes), short_s


@lru_cache(maxsize=64)
def one_sigma(effect: str, short_s: float) -> float:
    """How many of its units are one sigma in these runs, everything else fitted anew."""
    if effect == "line":
        return LINE_SIGMA_M_S2 / UNITS["line"]["amplitude"]
    study, attempt = _clean(short_s)
    names = IN_MODEL.get(effect, {})
    given = {names.get(n, n): v for n, v in UNITS[effect].items()}
    own = study.catalogue[effect]
    term = Term(effect, {n: given[n] for n in own.scans})
    model, one = own_model(attempt.model, PlatformModel), placed(own, term, CHANNELS, ())
    amplitudes, columns = slopes_at_zero(model, attempt.result.values, one, attempt.noise.sigma)
    direction = columns @ np.array([given.get(each.argument, 0.0) for each in amplitudes])
    free = attempt.projector.free(attempt.padded(attempt.noise.whiten(direction[:, None])))
    return 1.0 / float(np.linalg.norm(free))


@lru_cache(maxsize=4)
def _clean(short_s: float) -> tuple[PlatformStudy, Attempt]:
    study = PlatformStudy(sampled(nature(1, {}), design(short_s)))
    return study, Attempt(study, ())


def nature(seed: int, effects: Mapping[str, Mapping[str, float]]) -> PlatformSettings:
    return PlatformSettings.model_validate(
        {"kind": "rotating-platform", "seed": seed, "temperature": TEMPERATURE, "effects": effects}
    )


def trial(asked: tuple[str, tuple[float, float], tuple[str, ...], float], seed: int) -> dict[str, Any]:
    """One trial and its score; an error of the workbench is a score of its own."""
    kind, sigma, among, alpha = asked
    truth, short_s = draw(seed, kind, sigma, among)
    began_s = time.perf_counter()
    world = nature(1000 + seed, {truth.effect: truth.sizes} if truth.effect else {})
    with tempfile.TemporaryDirectory() as scratch:
        record(world, design(short_s), Path(scratch) / "bundle")
        try:
            with import_bundle(Path(scratch) / "bundle", Path(scratch) / "s.rig.sqlite") as store:
                found = diagnose(study_of(store), (), alpha)
        except RigError as error:
            return {**asdict(truth), "kind": kind, "error": str(error)}
    named = [term.effect for term in found.steps[-1].terms]
    alike = [[name, *rank.equivalent_to] for name in named for rank in found.ranking if rank.term.effect == name]
    return {
        **asdict(truth),
        "kind": kind,
        "mask_short_s": short_s,
        "verdict": found.verdict,
        "named": named,
        "suggested": [term.effect for term in found.suggested],
        "alike": alike,
        "estimates": {
            name: [each.value, each.sigma]
            for rank in found.ranking
            if rank.term.effect == truth.effect
            for name, each in rank.parameters.items()
        },
        "seconds": round(time.perf_counter() - began_s, 1),
    }


def right(score: Mapping[str, Any]) -> bool:
    """Whether exactly what is hidden was said: one effect and it, or one that may be it or one of its rivals."""
    if "error" in score:
        return False
    if score["effect"] is None:
        return not score["suggested"] and score["verdict"] == "adequate"
    if score["verdict"] == "ambiguous":
        return len(score["named"]) == 1 and score["effect"] in score["alike"][0]
    return bool(score["named"] == [score["effect"]] and score["verdict"] == "effect")


def share(count: int, of: int) -> str:
    """A share with its interval."""
    if not of:
        return "none"
    tail = 0.5 * (1.0 - CONFIDENCE)
    low = stats.beta.ppf(tail, count, of - count + 1) if count else 0.0
    high = stats.beta.ppf(1.0 - tail, count + 1, of - count) if count < of else 1.0
    return f"{count}/{of} = {count / of:.3f} ({low:.3f} to {high:.3f})"


def report(scores: Sequence[Mapping[str, Any]]) -> list[str]:
    """Shares, in all and by effect."""
    lines = []
    for kind in dict.fromkeys(score["kind"] for score in scores):
        own = [score for score in scores if score["kind"] == kind]
        lines.append(f"{kind}: right {share(sum(map(right, own)), len(own))}")
        names = sorted({score["effect"] for score in own if score["effect"]})
        for name in names:
            of = [score for score in own if score["effect"] == name]
            among = sum(any(name in alike for alike in score.get("alike", ())) for score in of)
            alone = sum(score.get("verdict") == "effect" and right(score) for score in of)
            told = f"alone {alone}/{len(of)}, among what is said {among}/{len(of)}"
            lines.append(f"  {name}: right {share(sum(map(right, of)), len(of))}, {told}")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=50)
    parser.add_argument("--kind", choices=("none", "one"), default="one")
    parser.add_argument("--sigma", type=float, nargs=2, default=(8.0, 15.0))
    parser.add_argument("--among", nargs="*", default=())
    parser.add_argument("--alpha", type=float, default=0.01)
    parser.add_argument("--seed", type=int, default=1, help="of the first trial")
    add_workers(parser, 1)
    parser.add_argument("--out", type=Path, default=Path("blind_platform.jsonl"))
    given = parser.parse_args()
    asked = (given.kind, tuple(given.sigma), tuple(given.among), given.alpha)
    key = json.dumps(asked)
    done = {score["seed"] for score in rows_in(given.out) if score["asked"] == key}
    wanted = [seed for seed in range(given.seed, given.seed + given.trials) if seed not in done]

    def shown(score: Mapping[str, Any]) -> None:
        print("." if right(score) else f"\n{score}", end="", flush=True)

    keep_trials(partial(_noted, asked, key), wanted, given.out, workers_of(given), shown)
    print("\n" + "\n".join(report([score for score in rows_in(given.out) if score["asked"] == key])))


def _noted(asked: Any, key: str, seed: int) -> dict[str, Any]:
    return {**trial(asked, seed), "asked": key}


if __name__ == "__main__":
    main()
