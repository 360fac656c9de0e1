"""Every effect of the rotating platform at a realistic size: what six runs say of it, and how far the error falls.

One effect at a time is hidden in the world of the blind trials, in their six runs, at a size one may meet on a bench;
where that is too small for these runs, the size is told that would have been seen, and a larger one is tried too.

    python -m benchmarks.platform_effects --out platform_effects.jsonl
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.blind_platform import IN_MODEL, design, nature
from benchmarks.platform_sampler import sampled
from benchmarks.trials import add_workers, keep_trials, workers_of
from rigctl.experiments.rotating_platform.study import PlatformStudy
from rigctl.workbench.findings import Diagnosis, Rank
from rigctl.workbench.verdict.diagnose import diagnose

INSEPARABLE = ("theta-locked-bias", "pendulum-reaction")
"""What no modulation shows."""


@dataclass(frozen=True)
class Case:
    """What is hidden, and by how much the masks of its runs are too short."""

    effect: str
    sizes: Mapping[str, float]
    mask_short_s: float = 0.0


CASES = (
    Case("theta-locked-bias", {"e1": 1e-5}),
    Case("pendulum-reaction", {"d": 1e-8}),
    Case("off-centre", {"r_sin": 0.05}, mask_short_s=0.5),
    Case("off-centre", {"r_sin": 0.05}),
    Case("recovery", {"e": 1e-6, "t_r": 5.0}),
    Case("recovery", {"e": 1e-5, "t_r": 30.0}),
    Case("recovery-signed", {"e": 1e-6, "t_r": 5.0}),
    Case("recovery-signed", {"e": 1e-5, "t_r": 30.0}),
    Case("thermal-bias", {"b1": 1e-5}),
    Case("thermal-bias", {"b1": 1e-4}),
    Case("gain-drift", {"k1": 1e-4 / 3600.0}),
    Case("line", {"amplitude": 1e-6, "frequency": 0.14}),
    Case("platform-repeatability", {"stop": 2e-5}),
    Case("platform-repeatability", {"stop": 1e-3}),
    Case("cross-axis", {"k": 0.0436}),
    Case("quadratic", {"K2": 3e-5}),
    Case("quadratic", {"K2": 1.0}),
    Case("gain-asymmetry", {"e": 1e-4}),
    Case("gain-asymmetry", {"e": 1e-2}),
    Case("clock-skew", {"r_sin": 0.05, "delay": 0.2}),
    Case("filter-ringing", {"r_sin": 0.05, "cutoff": 5.0}),
    Case("tide", {"amplitude": 1e-6, "period": 43200.0}),
    Case("tide", {"amplitude": 1e-5, "period": 43200.0}),
)


def asked(case: Case, seed: int, alpha: float) -> dict[str, Any]:
    """One case and what was said of it."""
    began_s = time.perf_counter()
    study = PlatformStudy(sampled(nature(seed, {case.effect: case.sizes}), design(case.mask_short_s)))
    found = diagnose(study, (), alpha)
    rank = next((each for each in found.ranking if each.term.effect == case.effect), None)
    return {
        "effect": case.effect,
        "sizes": dict(case.sizes),
        "mask_short_s": case.mask_short_s,
        "seed": seed,
        "said": said(case, found),
        "verdict": found.verdict,
        "suggested": [term.effect for term in found.suggested],
        "found": {} if rank is None else _numbers(case, rank),
        "held_out": [found.steps[0].error_held_out, found.steps[-1].error_held_out],
        "inseparable": [each.other for each in found.inseparable if each.effect == case.effect],
        "not_testable": found.not_testable.get(case.effect, ""),
        "seconds": round(time.perf_counter() - began_s, 1),
    }


def said(case: Case, found: Diagnosis) -> str:
    """In a word: named, ambiguous, nothing, inseparable, or wrong."""
    names = [term.effect for term in found.suggested]
    rivals = {name for rank in found.ranking if rank.term.effect in names for name in rank.equivalent_to}
    if names == [case.effect] and found.verdict == "effect":
        return "named"
    if case.effect in names and found.verdict == "ambiguous" and set(names) <= {case.effect, *rivals}:
        return f"ambiguous with {', '.join(sorted({*names, *rivals} - {case.effect}))}"
    if not names and found.verdict == "adequate":
        absorbed = any(
            each.effect == case.effect and each.other.startswith("baseline:") for each in found.inseparable
        )
        return "inseparable" if absorbed else "nothing"
    return f"wrong: {found.verdict} {', '.join(names)}"


def _numbers(case: Case, rank: Rank) -> dict[str, Any]:
    ours = IN_MODEL.get(case.effect, {})
    wanted = {ours.get(name, name) for name in case.sizes}
    return {
        "estimates": {
            name: [each.value, each.sigma, each.unit]
            for name, each in rank.parameters.items()
            if _own(name) in wanted
        },
        "detectable": {name: size for name, size in rank.detectable.items() if _own(name) in wanted},
        "equivalent_to": list(rank.equivalent_to),
        "held_out_error_ratio": rank.held_out_error_ratio,
    }


def _own(name: str) -> str:
    return name.partition("[")[0].rpartition(".")[2]


def line_of(score: Mapping[str, Any]) -> str:
    """A case in a line."""
    sizes = ", ".join(f"{name} {value:.3g}" for name, value in score["sizes"].items())
    numbers = score["found"] if score["said"] == "named" else {}
    sized = ", ".join(f"{name} {v:.4g} +- {s:.2g}" for name, (v, s, _) in numbers.get("estimates", {}).items())
    if score["said"] == "nothing":
        seen = score["found"].get("detectable", {}) if score["found"] else {}
        sized = ", ".join(f"{name} from {size:.2g}" for name, size in seen.items()) or score["not_testable"]
    before, after = score["held_out"]
    if score["effect"] == "line" and numbers:
        sized += f", its own spectrum held out {numbers['held_out_error_ratio']:.2g}"
    short = f", mask {score['mask_short_s']:g} s short" if score["mask_short_s"] else ""
    return f"{score['effect']:<23} {sizes}{short}: {score['said']}; {sized}; held out {before:.3g} -> {after:.3g}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--among", nargs="*", default=())
    parser.add_argument("--seed", type=int, default=2013)
    parser.add_argument("--alpha", type=float, default=0.01)
    add_workers(parser, 1)
    parser.add_argument("--out", type=Path, default=Path("platform_effects.jsonl"))
    given = parser.parse_args()
    cases = [case for case in CASES if not given.among or case.effect in given.among]
    ask = partial(asked, seed=given.seed, alpha=given.alpha)
    keep_trials(ask, cases, given.out, workers_of(given), lambda score: print(line_of(score), flush=True))


if __name__ == "__main__":
    main()
