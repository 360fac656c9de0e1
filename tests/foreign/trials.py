"""Blind trials on the second worlds, scored.

    python -m tests.foreign.trials --kind sensing-axis|platform|satellite|response --seeds 0:300 --out FILE

One line of JSON for each seed; seeds that stand in the file are not tried again. The analysis sees the bundle only;
what is hidden is compared with what was said afterwards. A summary of the whole file goes to stdout.
"""

from __future__ import annotations

import argparse
import sys
import time
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.stats import beta

from benchmarks.trials import add_workers, keep_trials, rows_in, workers_of
from tests.foreign.isa_score import SENSING_AXIS
from tests.foreign.kinds import Kind, Trial
from tests.foreign.platform_score import PLATFORM
from tests.foreign.response_score import RESPONSE
from tests.foreign.satellite_score import SATELLITE
from tests.foreign.sessions import Session, taken_through

KINDS = {"sensing-axis": SENSING_AXIS, "platform": PLATFORM, "satellite": SATELLITE, "response": RESPONSE}

Json = dict[str, Any]


def classes(diagnose: Json) -> dict[str, set[str]]:
    """For each suggested effect, those that cannot be told from it."""
    alike = {name: {name} for name in diagnose["suggested"]}
    for entry in diagnose["ranking"]:
        for name in alike:
            if entry["effect"] == name:
                alike[name] |= set(entry["equivalent_to"])
            elif name in entry["equivalent_to"]:
                alike[name].add(entry["effect"])
    return alike


def scored(kind: Kind, trial: Trial, session: Session) -> Json:
    """What was said beside what is right."""
    alike = classes(session.diagnose)
    known = set(trial.hidden) & set(kind.known)
    allowed = known.union(*(kind.companions.get(name, set()) for name in known))
    unknown = bool(set(trial.hidden) & set(kind.unknown))
    missed = kind.displaced(trial, session)
    named = [name for name in known - missed if any(name in members for members in alike.values())]
    invented = [name for name, members in alike.items() if not members & allowed]
    return {
        "hidden": {name: round(size, 1) for name, size in trial.hidden.items()},
        "true": dict(trial.parameters),
        "verdict": session.diagnose["verdict"],
        "suggested": session.suggested,
        "alike": {name: sorted(members - {name}) for name, members in alike.items() if len(members) > 1},
        "all_named": len(named) == len(known),
        "invented": invented,
        "unknown_hidden": unknown,
        "unknown_said": session.diagnose["verdict"] == "unknown",
        "unexplained": session.diagnose["unexplained"],
        "compare_p": session.compare["p_value"],
        "after_p": session.after["p_value"],
        "errors": [[round(rung[name], 4) for name in ("error_fit", "error_held_out")] for rung in session.history],
        "pulls": kind.pulls(trial, session),
    }


def tried(kind: Kind, seed: int) -> Json:
    """One trial from its drawing to its score."""
    trial = kind.drawn(seed)
    with TemporaryDirectory() as directory:
        bundle = Path(directory) / "elsewhere"
        kind.write(trial, seed, bundle)
        begun = time.process_time()
        try:
            session = taken_through(bundle)
        except AssertionError as stopped:
            return {
                "seed": seed,
                "hidden": dict(trial.hidden),
                "true": dict(trial.parameters),
                "stopped": str(stopped),
            }
        seconds = time.process_time() - begun
    return {"seed": seed, **scored(kind, trial, session), "processor_s": round(seconds, 2)}


def _tried(kind: str, seed: int) -> Json:
    return tried(KINDS[kind], seed)


def rate(count: int, of: int) -> str:
    """A rate with its 95 % interval (Clopper and Pearson)."""
    if of == 0:
        return "none tried"
    low = beta.ppf(0.025, count, of - count + 1) if count else 0.0
    high = beta.ppf(0.975, count + 1, of - count) if count < of else 1.0
    return f"{count} of {of} ({count / of:.0%}; {low:.0%} to {high:.0%})"


def summary(trials: list[Json]) -> str:
    """The targets of a blind trial, as measured."""
    ended = [trial for trial in trials if "stopped" not in trial]
    known = [trial for trial in ended if not trial["unknown_hidden"]]
    single = [trial for trial in known if len(trial["hidden"]) == 1]
    unknown = [trial for trial in ended if trial["unknown_hidden"]]
    all_pulls = np.array([pull for trial in ended for pull in trial["pulls"].values()])
    lines = [
        f"one effect named      {rate(sum(t['all_named'] for t in single), len(single))}",
        f"nothing invented      {rate(sum(not t['invented'] for t in known), len(known))}",
        f"unknown said          {rate(sum(t['unknown_said'] for t in unknown), len(unknown))}",
        f"a name beside it      {rate(sum(bool(t['invented']) for t in unknown), len(unknown))}",
        f"unknown said wrongly  {rate(sum(t['unknown_said'] for t in known), len(known))}",
        f"stopped               {len(trials) - len(ended)} of {len(trials)}",
    ]
    if all_pulls.size:
        lines.append(f"pulls                 mean {all_pulls.mean():.2f}, rms {np.sqrt((all_pulls**2).mean()):.2f}")
        lines[-1] += f" of {all_pulls.size}"
    return "\n".join(lines)


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--kind", choices=sorted(KINDS), required=True)
    arguments.add_argument("--seeds", required=True, help="A:B, B not included")
    arguments.add_argument("--out", type=Path, required=True)
    add_workers(arguments, 1)
    given = arguments.parse_args()
    first, last = map(int, given.seeds.split(":"))
    done = {trial["seed"] for trial in rows_in(given.out)}
    keep_trials(partial(_tried, given.kind), sorted(set(range(first, last)) - done), given.out, workers_of(given))
    sys.stdout.write(summary(rows_in(given.out)) + "\n")


if __name__ == "__main__":
    main()
