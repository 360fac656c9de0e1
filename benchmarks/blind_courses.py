"""What slow noise hides: do the runs that `rigctl next` proposes show it, more often than as many of the scan?

    python benchmarks/blind_courses.py [--draws 12] [--effects bias-drift thermal-bias] [--colour flicker]

A simulated rig on which one slow effect acts is scanned; to the means of its runs comes slow noise from one stretch
that goes through all of them. Where a diagnosis says that slow noise may hide the effect, the proposed course of runs
is made on the same rig, and so are as many runs more of the scan. In both the noise goes on as it was. Counted is how
often the effect is then suggested. World, noise and analysis share no code.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from benchmarks.blind_next import KNOWN_TERMS, ROOM
from benchmarks.blind_noise import SHAPES, coloured
from benchmarks.blind_reduced import Replaced
from benchmarks.blind_trials import clopper_pearson
from benchmarks.investigate import CAMPAIGN, rig_text
from rigctl import planning, runner
from rigctl.campaign.store.store import Store
from rigctl.composition import study_of
from rigctl.core.arrays import FloatArray
from rigctl.files.campaign_file import parse_campaign
from rigctl.files.rig_file import read_rig
from rigctl.workbench.findings import Diagnosis
from rigctl.workbench.next.recommend import recommend
from rigctl.workbench.study import Course, Observations, Proposal, Scheduled, Study, Term
from rigctl.workbench.verdict.diagnose import diagnose

SIZES: dict[str, dict[str, float]] = {"bias-drift": {"rate": 8e-8}, "thermal-bias": {"bT": 3e-4}}
"""What acts: over a scan of half an hour about as large as the slow noise walks."""

SIGMA_V, KNEE_HZ, STEP_S = 2e-5, 1.0 / 120.0, 5.0
LONGEST_S = 1e5
TERMS = tuple(Term(effect) for effect in KNOWN_TERMS)


@dataclass
class Noisy(Replaced):
    """A study with other data that can be asked about runs to come."""

    def options(self) -> Sequence[Proposal]:
        return _scheduled(self.inner).options()

    def extended(self, proposals: Sequence[Proposal]) -> Study:
        return _scheduled(self.inner).extended(proposals)

    def courses(self) -> Sequence[Course]:
        return _scheduled(self.inner).courses()


def _scheduled(study: Study) -> Scheduled:
    assert isinstance(study, Scheduled)
    return study


@dataclass
class Rig:
    """A scanned rig on which `effects` act, and what further campaigns made of it."""

    directory: Path
    effects: Mapping[str, Mapping[str, float]]
    seed: int = 1
    campaign: str = field(default_factory=lambda: CAMPAIGN.read_text(encoding="utf-8"))
    _further: dict[str, Path] = field(default_factory=dict)

    def __post_init__(self) -> None:
        text = rig_text(self.seed, {name: dict(own) for name, own in self.effects.items()}) + ROOM
        (self.directory / "rig.toml").write_text(text, encoding="utf-8")
        campaign = self.campaign.replace("hidden-effect-rig.toml", "rig.toml")
        parsed = parse_campaign(campaign, self.directory / "campaign.toml")
        self.scan = self.directory / "scan.rig.sqlite"
        runner.start(parsed, read_rig(parsed.rig_path), self.scan, runner.Options(unattended=True))

    def with_runs(self, runs: Sequence[Proposal]) -> Path:
        """The store of the scan with these runs made after it, once for each list of runs."""
        key = repr([dict(run.settings) for run in runs])
        if key not in self._further:
            path = self.directory / f"further-{len(self._further)}.rig.sqlite"
            for end in ("", ".truth.toml"):
                shutil.copy(f"{self.scan}{end}", f"{path}{end}")
            with Store.open(path) as store:
                text = planning.campaign_text(store, runs, "next", path, KNOWN_TERMS)
            campaign = parse_campaign(text, path.with_name("next.toml"))
            runner.extend(path, campaign, runner.Options(unattended=True))
            self._further[key] = path
        return self._further[key]


def noisy(study: Study, colour: str, seed: int) -> Noisy:
    """The study with noise of its means that goes on in whatever is measured later; the same seed, the same noise."""
    given: Observations = study.model(TERMS).observations
    means = np.flatnonzero(np.array([pool.dof <= 0.0 for pool in given.pools])[given.pool_of])
    rng = np.random.default_rng([seed, sorted(SHAPES).index(colour)])
    noise = coloured(colour, int(LONGEST_S / STEP_S), STEP_S, 1.0, KNEE_HZ, rng)
    value = given.value.copy()
    value[means] += SIGMA_V * _means(noise, given.of_runs("start_s")[means])
    return Noisy(study, value)


def _means(noise: FloatArray, start_s: FloatArray, dwell_s: float = 20.0) -> FloatArray:
    """Over runs that begin at these times, in units of their sigma were it white."""
    width = int(dwell_s / STEP_S)
    means = np.convolve(noise, np.ones(width) / width, mode="valid")
    return np.asarray(means[np.rint(start_s / STEP_S).astype(np.intp)] * np.sqrt(2.0 * STEP_S * width))


def shown(path: Path, colour: str, seed: int, effect: str) -> tuple[bool, Diagnosis, Noisy]:
    """Whether a diagnosis of a store, with this noise, suggests the effect."""
    with Store.open(path, readonly=True) as store:
        study = noisy(study_of(store), colour, seed)
        found = diagnose(study, TERMS, seed=seed)
    return effect in {term.effect for term in found.suggested}, found, study


def trial(rig: Rig, colour: str, seed: int, effect: str) -> dict[str, Any]:
    """What is said of the scan, what is proposed, and what is said of either when it has been made."""
    with Store.open(rig.scan, readonly=True) as store:
        study = noisy(study_of(store), colour, seed)
        before = diagnose(study, TERMS, seed=seed)
        said = {term.effect for term in before.suggested}
        hidden = {each.term.effect for each in before.hidden_in_slow_noise}
        row: dict[str, Any] = {"seed": seed, "found": effect in said, "hidden": effect in hidden}
        row |= {"named": sorted(said | hidden)}
        if not hidden:
            return row
        advice = recommend(study, TERMS, before)
        row |= {"course": advice.course, "runs": len(advice.runs), "takes_h": round(advice.takes_s / 3600.0, 1)}
        if advice.course is None:
            return row
        same = [each.runs for each in study.courses() if each.kind == "more of the same"]
        repeats = next(each for each in same if len(each) == len(advice.runs))
        row |= {"lambda": {a.question.term.effect: round(a.lambda_promised, 1) for a in advice.answers}}
    for name, runs in (("after", advice.runs), ("repeated", repeats)):
        found, after, _ = shown(rig.with_runs(runs), colour, seed, effect)
        row |= {name: found, f"{name}_said": [term.effect for term in after.suggested]}
    return row


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--draws", type=int, default=12)
    parser.add_argument("--effects", nargs="+", default=sorted(SIZES), choices=sorted(SIZES))
    parser.add_argument("--colour", default="flicker", choices=sorted(SHAPES))
    given = parser.parse_args()
    for effect in given.effects:
        with tempfile.TemporaryDirectory() as scratch:
            rig = Rig(Path(scratch), {effect: SIZES[effect]})
            rows = []
            for seed in range(given.draws):
                rows.append(trial(rig, given.colour, seed, effect))
                print(rows[-1], flush=True)
        asked = [row for row in rows if "after" in row]
        found = sum(row["found"] for row in rows)
        print(
            f"{effect}, {given.colour}: {found} of {len(rows)} shown by the scan, a course proposed in {len(asked)}"
        )
        for name in ("after", "repeated"):
            hits = sum(row[name] for row in asked)
            if asked:
                low, high = clopper_pearson(hits, len(asked))
                print(f"  {name}: shown in {hits} of {len(asked)} [{low:.2f}, {high:.2f}]")
    return 0


if __name__ == "__main__":
    sys.exit(main())
