"""Does the workbench find what is hidden? Blind trials by seed, scored against the targets.

Each trial draws a nature with hidden effects, records a bundle, imports it, asks `diagnose`, and compares the answer
with the truth. Scores are kept in a file of JSON lines, so that an interrupted study goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy import stats

from benchmarks.blind_noise import SHAPES
from benchmarks.blind_sampler import Design, nulls_deg
from benchmarks.blind_world import KINDS, Foreign, Trial, Truth, draw, record, unit_sizes
from benchmarks.trials import add_workers, keep_trials, rows_in, workers_of
from rigctl.campaign.bundle.bundle import import_bundle
from rigctl.composition import study_of
from rigctl.core.errors import RigError
from rigctl.core.workers import Workers
from rigctl.workbench.findings import Diagnosis
from rigctl.workbench.study import Term
from rigctl.workbench.verdict.account import account_of
from rigctl.workbench.verdict.diagnose import diagnose
from rigctl.workbench.verdict.fit import fit

KNOWN = ("roll-gravity", "resonance")
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Asked:
    """How the trials of a study are made."""

    kind: str
    sigma: tuple[float, float]
    among: tuple[str, ...]
    colour: str | None
    alpha: float
    design: Design


def trial(asked: Asked, seed: int) -> dict[str, Any]:
    """One trial and its scores; an error of the workbench is a score of its own."""
    drawn = draw(seed, asked.kind, asked.design, sigma=asked.sigma, among=asked.among or None)  # type: ignore[arg-type]
    began_s = time.perf_counter()
    common = {"seed": seed, "kind": asked.kind, "sigma": drawn.truth.sigma, "hidden": sorted(drawn.truth.effects)}
    with tempfile.TemporaryDirectory() as scratch:
        bundle = Path(scratch) / "bundle"
        record(drawn, bundle, Foreign(colour=asked.colour))
        with import_bundle(bundle, Path(scratch) / "x.rig.sqlite") as store:
            study = study_of(store)
            known = tuple(Term(effect) for effect in KNOWN)
            try:
                account = account_of(study, [known], seed)
                found = diagnose(study, known, alpha=asked.alpha, seed=seed, account=account)
                fitted = fit(study, (*known, *found.suggested), account)
                scores = score(found, drawn.truth) | pulls(found, drawn, fitted)
            except (RigError, ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
                return {**common, "error": f"{type(error).__name__}: {error}"}
    return {**common, **scores, "seconds": round(time.perf_counter() - began_s, 1)}


def score(found: Diagnosis, truth: Truth) -> dict[str, Any]:
    """What was said beside what was hidden; None where a question does not arise."""
    hidden = set(truth.effects)
    said = [term.effect for term in found.suggested]
    first = found.ranking[0] if found.ranking else None
    same = {first.term.effect, *first.equivalent_to} if first else set()
    return {
        "verdict": found.verdict,
        "said": said,
        "false_alarm": found.verdict != "adequate" if truth.kind == "none" else None,
        "detected": found.verdict != "adequate" if truth.kind != "none" else None,
        "right_first": bool(same & hidden) if hidden else None,
        "exact": set(said) == hidden and found.verdict == "effect" if hidden else None,
        "named": _named(found, hidden) if hidden and not truth.unknown else None,
        "truth_in_set": hidden <= set().union(*_classes(found)) if hidden else None,
        "unknown_said": found.verdict == "unknown" if truth.unknown else None,
        "wrong_name": bool(said) if truth.unknown else None,
        "description": found.unexplained.description if found.unexplained else None,
        "unknown": truth.unknown,
    }


def _classes(found: Diagnosis) -> list[set[str]]:
    """For each suggested effect, what the answer says cannot be told from it, itself among them."""
    alike = [{rank.term.effect, *rank.equivalent_to} for rank in found.ranking]
    return [{term.effect}.union(*(each for each in alike if term.effect in each)) for term in found.suggested]


def _named(found: Diagnosis, hidden: set[str]) -> bool:
    """All that is hidden and nothing else, up to what the answer says cannot be told apart."""
    classes = _classes(found)
    return (
        found.verdict in ("effect", "ambiguous")
        and hidden <= set().union(*classes)
        and all(each & hidden for each in classes)
    )


def pulls(found: Diagnosis, drawn: Trial, fitted: Any) -> dict[str, Any]:
    """(estimate - truth) / sigma of the parameters that were hidden and found, of the nulls and of the gains."""
    truth = drawn.truth
    named = {term.effect for term in found.suggested} & set(truth.effects)
    hidden = [
        _pull(fitted.parameters, parameter, value)
        for effect in named
        for parameter, value in truth.effects[effect].items()
        if parameter not in ("amplitude", "frequency")
    ]
    gains = [
        (each.value - _gain(drawn, name)) / each.sigma
        for name, each in fitted.parameters.items()
        if name.startswith("gain[") and each.sigma > 0.0
    ]
    nulls = nulls_deg(drawn.nature, drawn.design)
    theta0 = [
        (fitted.parameters[name].value - value) / fitted.parameters[name].sigma
        for (axis, configuration, number), value in nulls.items()
        if (name := f"theta0[{axis},{configuration},{number}]") in fitted.parameters
    ]
    # A null or a gain that drifts is told at the recording's mean time and temperature, nature's at its own origin.
    theta0 = [] if "null-drift" in truth.effects else theta0
    gains = [] if {"gain-drift", "thermal-gain"} & set(truth.effects) else gains
    return {"pulls": [each for parts in hidden for each in parts], "theta0_pulls": theta0, "gain_pulls": gains}


def _pull(parameters: Any, parameter: str, value: float) -> list[float]:
    """Of a parameter and its members: `kT` is written for all axes, the model has `kT[X]` and `kT[Y]`."""
    of = [each for name, each in parameters.items() if name == parameter or name.split("[")[0] == parameter]
    return [(each.value - value) / each.sigma for each in of if each.sigma > 0.0]


def _gain(drawn: Trial, name: str) -> float:
    axis, configuration = name.removeprefix("gain[").removesuffix("]").split(",")
    sensor = drawn.nature.sensors[axis]
    return (sensor.pendulum if configuration == "pendulum" else sensor.flag).gain_v_per_m_s2


@dataclass(frozen=True)
class Target:
    """A rate to be reached: at least `rate`, or at most where `at_most`."""

    rate: float
    at_most: bool = False


def report(rows: Sequence[dict[str, Any]], alpha: float) -> list[str]:
    """Print rates with their Clopper-Pearson intervals; returns the targets that are missed beyond doubt."""
    targets = {
        "false_alarm": Target(1.5 * alpha, at_most=True),
        "detected": Target(0.95),
        "right_first": Target(0.95),
        "exact": Target(0.95),
        "named": Target(0.95),
        "truth_in_set": Target(0.98),
        "unknown_said": Target(0.85),
        "wrong_name": Target(0.10, at_most=True),
    }
    errors = [row for row in rows if "error" in row]
    print(f"{len(rows)} trials, {len(errors)} ended in an error")
    for row in errors[:5]:
        print(f"  seed {row['seed']}: {row['error']}")
    missed = ["errors"] if errors else []
    for question, target in targets.items():
        answers = [row[question] for row in rows if row.get(question) is not None]
        if not answers:
            continue
        low, high = clopper_pearson(sum(answers), len(answers))
        bound = "at most" if target.at_most else "at least"
        beyond = low > target.rate if target.at_most else high < target.rate
        missed += [question] if beyond else []
        print(
            f"  {question:13s} {sum(answers)}/{len(answers)} = {np.mean(answers):.3f} [{low:.3f}, {high:.3f}], "
            f"{bound} {target.rate:g}{'  MISSED' if beyond else ''}"
        )
    for name in ("pulls", "theta0_pulls", "gain_pulls"):
        values = np.array([value for row in rows for value in row.get(name, [])])
        if len(values) > 1:
            print(f"  {name:13s} mean {values.mean():+.2f}, rms {np.sqrt(np.mean(values**2)):.2f} of {len(values)}")
    return missed


def clopper_pearson(successes: int, trials: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Exact interval of a binomial rate."""
    tail = 0.5 * (1.0 - confidence)
    low = stats.beta.ppf(tail, successes, trials - successes + 1) if successes else 0.0
    high = stats.beta.ppf(1.0 - tail, successes + 1, trials - successes) if successes < trials else 1.0
    return float(low), float(high)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--kind", choices=KINDS, default="one")
    parser.add_argument("--sigma", type=float, nargs=2, default=(8.0, 20.0), metavar=("LEAST", "MOST"))
    parser.add_argument("--among", nargs="*", default=(), help="draw from these effects only")
    parser.add_argument(
        "--colour", choices=sorted(SHAPES), help="noise of another colour than the simulated ground's"
    )
    parser.add_argument("--alpha", type=float, default=0.01)
    add_workers(parser, 2)
    parser.add_argument("--keep", type=Path, default=None, help="default out/blind-KIND.jsonl")
    parser.add_argument("--check", action="store_true", help="exit 1 when a target is missed beyond doubt")
    given = parser.parse_args()
    asked = Asked(given.kind, tuple(given.sigma), tuple(given.among), given.colour, given.alpha, Design())
    missed = report(study(asked, given.first_seed, given.trials, given.keep, workers_of(given)), given.alpha)
    if given.check and missed:
        sys.exit(f"missed: {', '.join(missed)}")


def study(
    asked: Asked,
    first_seed: int,
    trials: int,
    keep: Path | None,
    workers: Workers,
    run: Callable[[Asked, int], dict[str, Any]] = trial,
) -> list[dict[str, Any]]:
    """The scores of all trials; those in `keep` are not done again."""
    path = keep or Path(f"out/blind-{asked.kind}.jsonl")
    setting = json.loads(json.dumps({"kind": asked.kind, "sigma": asked.sigma, "among": asked.among,
                                     "colour": asked.colour, "alpha": asked.alpha}))  # fmt: skip
    wanted = range(first_seed, first_seed + trials)
    missing = sorted(set(wanted) - {row["seed"] for row in rows_in(path) if row["asked"] == setting})
    unit_sizes(asked.design)
    keep_trials(partial(_noted, run, asked, setting), missing, path, workers)
    return [row for row in rows_in(path) if row["asked"] == setting and row["seed"] in wanted]


def _noted(
    run: Callable[[Asked, int], dict[str, Any]], asked: Asked, setting: dict[str, Any], seed: int
) -> dict[str, Any]:
    return {**run(asked, seed), "asked": setting}


if __name__ == "__main__":
    main()
