"""Does the recommended measurement separate the rivals? Asked and carried out in the simulated world.

    python benchmarks/blind_next.py --trials 40 [--keep FILE] [--workers 1] [--check]

Each seed is a rig with one hidden effect, of 6 to 15 sigma of a small scan that does not tell it from another. Where
the diagnosis is ambiguous, the runs that `rigctl next` recommends are made on the same rig, in the same mounting, and
all runs are diagnosed together. The analysis opens stores only; the truth lies beside them. A pair of rivals counts
as separated when the hidden effect is suggested and the other neither suggested nor said to be equivalent. Rates are
those of pairs by their promised lambda; outcomes are kept in a file of JSON lines, so that an interrupted study goes
on where it was.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from benchmarks.blind_trials import clopper_pearson
from benchmarks.investigate import KNOWN_TERMS, rig_text
from benchmarks.trials import add_workers, keep_trials, rows_in, workers_of
from rigctl import planning, runner
from rigctl.campaign.store.store import Store
from rigctl.composition import study_of, workbench_of
from rigctl.core.errors import RigError
from rigctl.files.campaign_file import parse_campaign
from rigctl.files.rig_file import read_rig
from rigctl.workbench.findings import Diagnosis
from rigctl.workbench.next.noncentrality import SEPARATING_LAMBDA
from rigctl.workbench.next.recommend import recommend
from rigctl.workbench.next.recommendation import Recommendation
from rigctl.workbench.study import Term
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.diagnose import diagnose
from rigctl.workbench.verdict.score import likeness
from simulators.keyed_random import generator

DESIGNS: dict[str, dict[str, Any]] = {
    "near": {"angles_deg": [-1.6, -0.8, 0.8, 1.6], "frequencies_hz": [0.3, 0.6], "approaches": [1, -1]},
    "one side": {"angles_deg": [-1.0, 1.0, 2.0, 5.0], "frequencies_hz": [0.3, 0.6], "approaches": [1, -1]},
    "far": {"angles_deg": [-20.0, 20.0], "frequencies_hz": [0.3, 0.4, 0.6], "approaches": [1, -1]},
    "coarse": {"angles_deg": [-1.6, 1.6, 30.0], "frequencies_hz": [0.4, 0.6], "approaches": [1, -1]},
}
"""Scans that are too small, each for other effects."""

LIKE, VISIBLE, PLAUSIBLE = 0.6, 0.02, 10.0
"""An effect is drawn where another has this canonical correlation with it, fitted parameters leave this of it, and a
sigma is no more than so many times its typical size."""

SIGMA = (6.0, 15.0)
ROOM = "\n[world.temperature]\ndaily_k = 3.0\n"
"""A room that warms by some 0.1 K in such a scan."""

BOUNDS = (SEPARATING_LAMBDA, 50.0, 100.0, np.inf)
TARGET = 0.95
ALPHA = 0.01

Sizes = Mapping[str, Sequence[Mapping[str, Any]]]


def campaign_text(design: str) -> str:
    """One of the scans as a campaign file."""
    lists = [f"{name} = {values}" for name, values in DESIGNS[design].items()]
    return "\n".join(
        [
            'experiment = "sensing-axis"',
            'rig = "rig.toml"',
            "[procedure]",
            'name = "scan"',
            'axes = ["X"]',
            'configurations = ["flag"]',
            *lists,
            "dwell_s = 20.0",
            "[model]",
            f"effects = {json.dumps(KNOWN_TERMS)}",
        ]
    )


def measured(directory: Path, design: str, seed: int, effects: Mapping[str, Mapping[str, float]]) -> Path:
    """The store of a scan of the rig in nature `seed`, with these effects."""
    rig = rig_text(seed, {name: dict(own) for name, own in effects.items()}) + ROOM
    (directory / "rig.toml").write_text(rig, encoding="utf-8")
    campaign = parse_campaign(campaign_text(design), directory / "campaign.toml")
    store = directory / "x.rig.sqlite"
    runner.start(campaign, read_rig(campaign.rig_path), store, runner.Options(unattended=True))
    return store


def drawable(design: str) -> list[dict[str, Any]]:
    """What may be hidden: parameters of effects that have a rival in this scan, with their standard uncertainties."""
    with (
        tempfile.TemporaryDirectory() as scratch,
        Store.open(measured(Path(scratch), design, 1, {}), readonly=True) as store,
    ):
        attempt = Attempt(study_of(store), [Term(effect) for effect in KNOWN_TERMS])
    pairs = list(zip(attempt.candidates, attempt.scores, strict=True))
    found = []
    for candidate, score in pairs:
        others = [other for each, other in pairs if each.term.effect != candidate.term.effect]
        if not any(likeness(score.basis, other.basis) > LIKE for other in others):
            continue
        rows = zip(candidate.names, score.keep, score.sigma, candidate.typical, strict=True)
        for name, keep, sigma, typical in rows:
            if keep > VISIBLE and sigma < PLAUSIBLE * typical:
                head = candidate.term.choice.get("head")
                key = name.partition("[")[0].rpartition(".")[2] + (f"[{head}]" if head else "")
                found.append({"effect": candidate.term.effect, "key": key, "sigma": float(sigma)})
    return found


def sizes(cache: Path) -> Sizes:
    """`drawable` of every scan, worked out once and kept."""
    if not cache.exists():
        cache.parent.mkdir(parents=True, exist_ok=True)
        cache.write_text(json.dumps({design: drawable(design) for design in DESIGNS}, indent=1), encoding="utf-8")
    return dict(json.loads(cache.read_text(encoding="utf-8")))


def trial(known: Sizes, seed: int) -> dict[str, Any]:
    """One scan, what was recommended after it, and what is said with these runs made too."""
    rng = generator(seed, "blind-next")
    design = str(rng.choice(sorted(DESIGNS)))
    effects = sorted({each["effect"] for each in known[design]})
    effect = str(rng.choice(effects))
    own = [each for each in known[design] if each["effect"] == effect]
    chosen = own[int(rng.integers(len(own)))]
    size = float(rng.uniform(*SIGMA))
    hidden = {effect: {chosen["key"]: float(rng.choice([-1.0, 1.0])) * size * chosen["sigma"]}}
    row = {"seed": seed, "design": design, "hidden": hidden, "sigma": round(size, 1)}
    began_s = time.perf_counter()
    with tempfile.TemporaryDirectory() as scratch:
        try:
            row |= asked_and_made(measured(Path(scratch), design, seed, hidden), effect)
        except RigError as error:
            row |= {"error": f"{type(error).__name__}: {error}"}
    return {**row, "seconds": round(time.perf_counter() - began_s, 1)}


def asked_and_made(path: Path, effect: str) -> dict[str, Any]:
    """Ask what to measure next, measure it, diagnose all of it."""
    with Store.open(path) as store:
        bench = workbench_of(store)
        terms = bench.current.terms
        before = diagnose(bench.study, terms, ALPHA)
        advice = recommend(bench.study, terms, before, allowed=planning.allowed_by(store))
        text = planning.campaign_text(store, advice.runs, "next", path, bench.current.effects)
    found = {"verdict": before.verdict, "said": [term.effect for term in before.suggested], "purpose": advice.purpose}
    promised = promises(advice, effect)
    if not promised:
        return found
    runner.extend(path, parse_campaign(text, path.with_name("next.toml")), runner.Options(unattended=True))
    with Store.open(path) as store:
        bench = workbench_of(store)
        after = diagnose(bench.study, terms, ALPHA)
    return found | {
        "runs": [dict(run.settings) for run in advice.runs],
        "verdict_after": after.verdict,
        "said_after": [term.effect for term in after.suggested],
        "pairs": [
            {"from": rival, "lambda": value, "separated": separated(after, effect, rival)}
            for rival, value in promised.items()
        ],
    }


def promises(advice: Recommendation, effect: str) -> dict[str, float]:
    """Lambda by which the runs are to tell an effect from each of its rivals."""
    if advice.purpose != "separate":
        return {}
    return {
        answer.question.other: answer.lambda_promised
        for answer in advice.answers
        if answer.question.term.effect == effect and answer.question.rival is not None
    }


def separated(after: Diagnosis, effect: str, rival: str) -> bool:
    """Whether an effect is named, and the rival is not, neither as found nor, where that is open, as just as good."""
    said = {term.effect for term in after.suggested}
    equal = {name for rank in after.ranking if rank.term.effect in said for name in rank.equivalent_to}
    return effect in said and rival not in said and (after.verdict == "effect" or rival not in equal)


def report(rows: Sequence[Mapping[str, Any]]) -> bool:
    """Print the rates; whether the target is missed beyond doubt."""
    errors = [row for row in rows if "error" in row]
    asked = [row for row in rows if "pairs" in row]
    print(f"{len(rows)} trials, {len(asked)} with the hidden effect among rivals, {len(errors)} ended in an error")
    for row in errors[:5]:
        print(f"  seed {row['seed']}: {row['error']}")
    pairs = [pair for row in asked for pair in row["pairs"]]
    for low, high in pairwise(BOUNDS):
        within = [pair["separated"] for pair in pairs if low <= pair["lambda"] < high]
        line("pairs", within, f"lambda {low:g} .. {high:g}")
    line(
        "pairs",
        [pair["separated"] for pair in pairs if pair["lambda"] < SEPARATING_LAMBDA],
        f"lambda below {SEPARATING_LAMBDA:g}",
    )
    kept = [row for row in asked if min(pair["lambda"] for pair in row["pairs"]) >= SEPARATING_LAMBDA]
    line("trials", [row["said_after"] == list(row["hidden"]) for row in kept], "exactly the hidden effect named")
    promise = [all(pair["separated"] for pair in row["pairs"]) for row in kept]
    line(
        "trials",
        promise,
        f"all its rivals told apart, lambda {SEPARATING_LAMBDA:g} and more (target {TARGET:g})",
    )
    return bool(promise) and clopper_pearson(sum(promise), len(promise))[1] < TARGET


def line(what: str, hits: Sequence[bool], of: str) -> None:
    if hits:
        low, high = clopper_pearson(sum(hits), len(hits))
        print(f"  {sum(hits)}/{len(hits)} {what} = {np.mean(hits):.3f} [{low:.3f}, {high:.3f}]  {of}")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--trials", type=int, default=40)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, default=Path("out/blind-next.jsonl"))
    add_workers(parser, 1)
    parser.add_argument("--check", action="store_true", help="exit 1 when the target is missed beyond doubt")
    given = parser.parse_args()
    known = sizes(Path("out/blind-next-sizes.json"))
    wanted = range(given.first_seed, given.first_seed + given.trials)
    done = {row["seed"] for row in rows_in(given.keep)}
    keep_trials(partial(trial, known), [seed for seed in wanted if seed not in done], given.keep, workers_of(given))
    rows = {row["seed"]: row for row in rows_in(given.keep)}
    missed = report([rows[seed] for seed in wanted])
    sys.exit("the promise is missed" if missed and given.check else 0)


if __name__ == "__main__":
    main()
