"""Blind trials on the second worlds, scored.

    python -m tests.foreign.trials --kind sensing-axis --seeds 0:300 --out FILE

One line of JSON for each seed; seeds that stand in the file are not tried again. The analysis sees the bundle only;
what is hidden is compared with what was said afterwards. A summary of the whole file goes to stdout.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.stats import beta

from tests.foreign.isa_bundle import write
from tests.foreign.isa_trial import KNOWN, UNKNOWN, Trial, drawn
from tests.foreign.sessions import Session, taken_through

COMPANIONS = {"thermal-gain": {"thermal-bias"}, "gain-drift": {"bias-drift"}}
"""A changing gain acts on the static level too: where that is significant, both are right (the rig's page)."""
FITTED = {
    "bias_rate": "rate", "gain_rate": "rate", "null_rate": "rate", "line_v": "amplitude", "line_hz": "frequency",
}  # fmt: skip
"""Names of the fit where the world's differ."""

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


def fitted_name(parameter: str, axis: str, names: list[str]) -> str | None:
    """The fit's name for a parameter of the world: of the whole bench, of an axis, of a configuration, of a head."""
    stem, _, where = parameter.rstrip("]").partition("[")
    stem = FITTED.get(stem, stem)
    place = f"laser_{where}_mm" if where.isdigit() else f"{axis},{where}" if where else axis
    candidates = [name for name in (stem, f"{stem}[{place}]") if name in names]
    return candidates[0] if candidates else None


def pulls(trial: Trial, session: Session) -> dict[str, float]:
    """(fitted - true) / sigma of every parameter of the effects that were hidden and named."""
    found: dict[str, float] = {}
    parameters = session.fit["parameters"]
    for name in set(trial.hidden) & set(session.suggested) - {"mains-pickup"}:
        own = {re.sub(r"\[.*", "", parameter) for parameter in KNOWN[name]}
        for parameter, true in trial.parameters.items():
            if re.sub(r"\[.*", "", parameter) not in own:
                continue
            called = fitted_name(parameter, trial.design.axis, list(parameters))
            if called and parameters[called]["sigma"]:
                found[parameter] = (parameters[called]["value"] - true) / parameters[called]["sigma"]
    return found


def displaced(trial: Trial, session: Session) -> set[str]:
    """Effects of one head that were named with another one."""
    names = list(session.fit["parameters"])
    of_heads = {stem: name for name, (stem, *_) in KNOWN.items() if name.startswith("laser")}
    absent = {part for part in trial.parameters if fitted_name(part, trial.design.axis, names) is None}
    return {of_heads[part[:-3]] for part in absent if part[:-3] in of_heads}


def scored(trial: Trial, session: Session) -> Json:
    """What was said beside what is right."""
    alike = classes(session.diagnose)
    known = set(trial.hidden) & set(KNOWN)
    allowed = known.union(*(COMPANIONS.get(name, set()) for name in known))
    unknown = bool(set(trial.hidden) & set(UNKNOWN))
    missed = displaced(trial, session)
    named = [name for name in known - missed if any(name in members for members in alike.values())]
    invented = [name for name, members in alike.items() if not members & allowed]
    return {
        "hidden": {name: round(size, 1) for name, size in trial.hidden.items()},
        "true": trial.parameters,
        "verdict": session.diagnose["verdict"],
        "suggested": session.suggested,
        "alike": {name: sorted(members - {name}) for name, members in alike.items() if len(members) > 1},
        "all_named": len(named) == len(known),
        "invented": invented,
        "unknown_hidden": unknown,
        "unknown_said": session.diagnose["verdict"] == "unknown",
        "unexplained": session.diagnose["unexplained"],
        "compare_p": session.compare["p_value"],
        "errors": [[round(rung[name], 4) for name in ("error_fit", "error_held_out")] for rung in session.history],
        "pulls": pulls(trial, session),
    }


def tried(seed: int) -> Json:
    """One trial from its drawing to its score."""
    trial = drawn(seed)
    with TemporaryDirectory() as directory:
        bundle = Path(directory) / "elsewhere"
        write(trial.design, trial.bench, trial.noise, seed, bundle)
        begun = time.process_time()
        try:
            session = taken_through(bundle)
        except AssertionError as stopped:
            return {"seed": seed, "hidden": trial.hidden, "true": trial.parameters, "stopped": str(stopped)}
        seconds = time.process_time() - begun
    return {"seed": seed, **scored(trial, session), "processor_s": round(seconds, 2)}


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
    arguments.add_argument("--kind", choices=["sensing-axis"], required=True)
    arguments.add_argument("--seeds", required=True, help="A:B, B not included")
    arguments.add_argument("--out", type=Path, required=True)
    given = arguments.parse_args()
    first, last = map(int, given.seeds.split(":"))
    lines = given.out.read_text().splitlines() if given.out.exists() else []
    trials = [json.loads(line) for line in lines]
    done = {trial["seed"] for trial in trials}
    for seed in sorted(set(range(first, last)) - done):
        trials.append(tried(seed))
        with given.out.open("a") as file:
            file.write(json.dumps(trials[-1]) + "\n")
    sys.stdout.write(summary(trials) + "\n")


if __name__ == "__main__":
    main()
