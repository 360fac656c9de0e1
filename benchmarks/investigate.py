"""Does an investigation find two hidden effects with fewer than half the runs of a full scan?

Each seed is a rig with a nature of its own and two effects of 8 sigma of the randomised full scan, drawn among those
that the scan shows and tells from every other (rho < 0.9). Outcomes are kept in a file of JSON lines, so that an
interrupted study goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from rigctl import runner
from rigctl.campaign.store.store import Store
from rigctl.composition import study_of
from rigctl.core.errors import RigError
from rigctl.files.campaign_file import read_campaign
from rigctl.files.rig_file import read_rig
from rigctl.investigate import Settings, investigate
from rigctl.workbench.study import Term
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.score import likeness
from simulators.keyed_random import generator

ROOT = Path(__file__).parents[1]
CAMPAIGN = ROOT / "campaigns" / "hidden-effect.toml"
SIGMA = 8.0
VISIBLE = 0.05
"""The least share of an effect that no fitted parameter imitates, for a scan to be said to show it."""

LIKE = 0.9
LARGEST = 30.0
"""In typical sizes: what would have to be larger to be seen, a rig does not have."""

TARGET = 0.9
KNOWN_TERMS = ("roll-gravity", "resonance")
"""What the campaign's model has."""

KNOWN = {"roll-gravity": {"rho1": 9.7e-5}}


def rig_text(seed: int, effects: dict[str, dict[str, float]]) -> str:
    """The shipped rig in nature `seed`, with these effects."""
    text = (ROOT / "campaigns" / "hidden-effect-rig.toml").read_text(encoding="utf-8")
    bare = text[: text.index("[world.effects.")].replace("[world]\nseed = 1", f"[world]\nseed = {seed}")
    tables = [
        "\n".join([f"[world.effects.{name}]", *(f'"{key}" = {value!r}' for key, value in sizes.items())])
        for name, sizes in {**KNOWN, **effects}.items()
    ]
    return bare + "\n\n".join(tables) + "\n"


def lengths(cache: Path) -> dict[str, dict[str, Any]]:
    """What may be hidden, by effect and parameter: those that the full scan of the shipped nature shows and tells.

    `sigma` is the parameter's standard uncertainty there with everything else fitted, `key` its name in the world.
    """
    if not cache.exists():
        cache.parent.mkdir(parents=True, exist_ok=True)
        cache.write_text(json.dumps(_lengths(), indent=1), encoding="utf-8")
    return dict(json.loads(cache.read_text(encoding="utf-8")))


def _lengths() -> dict[str, dict[str, Any]]:
    with tempfile.TemporaryDirectory() as scratch:
        rig, path = Path(scratch) / "rig.toml", Path(scratch) / "x.rig.sqlite"
        rig.write_text(rig_text(1, {}), encoding="utf-8")
        runner.start(read_campaign(CAMPAIGN), read_rig(rig), path, runner.Options(unattended=True))
        with Store.open(path) as store:
            attempt = Attempt(study_of(store), [Term(effect) for effect in KNOWN_TERMS])
    pairs = list(zip(attempt.candidates, attempt.scores, strict=True))
    found: dict[str, dict[str, Any]] = {}
    for candidate, score in pairs:
        rivals = (other for each, other in pairs if each.term.effect != candidate.term.effect)
        if not score.dimension or any(likeness(score.basis, other.basis) >= LIKE for other in rivals):
            continue
        for name, keep, sigma, typical in zip(
            candidate.names, score.keep, score.sigma, candidate.typical, strict=True
        ):
            if keep > VISIBLE and SIGMA * sigma < LARGEST * abs(typical):
                head = candidate.term.choice.get("head")
                key = f"{_bare(name)}[{head}]" if head else _bare(name)
                found[f"{candidate.term.effect} {key}"] = {
                    "effect": candidate.term.effect,
                    "key": key,
                    "sigma": float(sigma),
                }
    return found


def _bare(name: str) -> str:
    """A parameter's own name, without its effect before it and what it belongs to behind."""
    return name.partition("[")[0].rpartition(".")[2]


def hidden(seed: int, sigma_of: dict[str, dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Two effects of 8 sigma, one parameter each, signs at random."""
    rng = generator(seed, "investigate")
    effects = sorted({each["effect"] for each in sigma_of.values()})
    found = {}
    for effect in sorted(str(name) for name in rng.choice(effects, size=2, replace=False)):
        own = [each for each in sigma_of.values() if each["effect"] == effect]
        chosen = own[int(rng.integers(len(own)))]
        found[effect] = {chosen["key"]: float(rng.choice([-1.0, 1.0])) * SIGMA * chosen["sigma"]}
    return found


def trial(seed: int, sigma_of: dict[str, dict[str, Any]], most: int) -> dict[str, Any]:
    """One investigation and what became of it."""
    effects = hidden(seed, sigma_of)
    names = sorted(effects)
    began_s = time.perf_counter()
    with tempfile.TemporaryDirectory() as scratch:
        rig, store = Path(scratch) / "rig.toml", Path(scratch) / "x.rig.sqlite"
        rig.write_text(rig_text(seed, effects), encoding="utf-8")
        settings = Settings(runner.Options(unattended=True), lambda _: True, lambda _: None, max_runs=most)
        common = {"seed": seed, "hidden": effects}
        try:
            found = investigate(read_campaign(CAMPAIGN), read_rig(rig), store, settings)
        except RigError as error:
            return {**common, "good": False, "error": f"{type(error).__name__}: {error}"}
    good = set(names) == set(found.added) and found.verdict == "adequate"
    return {
        **common,
        "good": good,
        "added": sorted(found.added),
        "verdict": found.verdict,
        "runs": found.runs,
        "remains": found.remains,
        "seconds": round(time.perf_counter() - began_s, 1),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--max-runs", type=int, default=23, help="the full scan has 48")
    parser.add_argument("--keep", type=Path, help="JSON lines; what is there is not done again")
    given = parser.parse_args()
    sigma_of = lengths(ROOT / "out" / "investigate-sizes.json")
    print(f"drawn among {', '.join(sigma_of)}")
    done = [json.loads(line) for line in given.keep.read_text().splitlines()] if _there(given.keep) else []
    rows = {row["seed"]: row for row in done}
    for seed in range(given.first_seed, given.first_seed + given.seeds):
        if seed not in rows:
            rows[seed] = trial(seed, sigma_of, given.max_runs)
            if given.keep:
                with given.keep.open("a", encoding="utf-8") as out:
                    out.write(json.dumps(rows[seed]) + "\n")
        print(json.dumps(rows[seed]), flush=True)
    wanted = [rows[seed] for seed in range(given.first_seed, given.first_seed + given.seeds)]
    good = sum(row["good"] for row in wanted)
    runs = [row["runs"] for row in wanted if "runs" in row]
    print(
        f"both named and adequate: {good} of {len(wanted)}; runs {np.mean(runs):.1f} on average, at most {max(runs)}"
    )
    sys.exit(0 if good >= TARGET * len(wanted) else 1)


def _there(path: Path | None) -> bool:
    return path is not None and path.exists()


if __name__ == "__main__":
    main()
