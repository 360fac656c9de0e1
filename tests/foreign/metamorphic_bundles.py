"""What is found in runs must not depend on how a recording is written: the second worlds' bundles, rewritten.

    python -m tests.foreign.metamorphic_bundles --bundles 20 --out FILE [--kind KIND] [--first SEED] [--apart]

A recording of each experiment is diagnosed as it is and rewritten: its runs in another order, with other run_ids,
mountings with other numbers, columns in another order (all four at once; `--apart` one by one), by way of a store of
another name. Verdict, suggested set, sizes and p-values must agree as those of tables do (metamorphic.py). A line of
JSON for each recording; what stands in the file is not tried again. The status is 1 where something differed.
"""

from __future__ import annotations

import argparse
import re
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.trials import add_workers, keep_trials, rows_in, workers_of
from rigctl.campaign.bundle.bundle import import_bundle, read_bundle, write_bundle
from rigctl.campaign.recording import Recording, RunSource
from rigctl.core.errors import RigError
from rigctl.experiments.inflight.study import InflightStudy
from rigctl.experiments.rotating_platform.study import PlatformStudy
from rigctl.experiments.sensing_axis.study import SensingAxisStudy
from rigctl.workbench.study import Study
from rigctl.workbench.verdict.account import account_of
from rigctl.workbench.verdict.compare import compared
from rigctl.workbench.verdict.diagnose import diagnose
from tests.foreign.metamorphic import Said, differences
from tests.foreign.trials import KINDS

Json = dict[str, Any]
STUDIES: Mapping[str, Callable[[RunSource], Study]] = {
    "sensing-axis": SensingAxisStudy,
    "platform": PlatformStudy,
    "satellite": InflightStudy,
}


@dataclass(frozen=True)
class Written:
    """A recording, and what its runs and mountings were called before."""

    recording: Recording
    run_ids: Mapping[str, str] = field(default_factory=dict)
    mountings: Mapping[int, int] = field(default_factory=dict)

    def first_name(self, name: str) -> str:
        """An effect or a parameter as it is called in the first recording: theta0[Z,flag,2], bias_z[r01]."""

        def label(found: re.Match[str]) -> str:
            inside = self.run_ids.get(found[1], found[1])
            place, comma, number = inside.rpartition(",")
            known = comma and number.isdecimal() and int(number) in self.mountings
            return f"[{place},{self.mountings[int(number)]}]" if known else f"[{inside}]"

        return re.sub(r"\[([^\]]*)\]", label, name)


Change = Callable[[Written, np.random.Generator], Written]


def runs_shuffled(given: Written, random: np.random.Generator) -> Written:
    """The runs in another order."""
    records = given.recording.records
    return replace(
        given, recording=replace(given.recording, records=[records[i] for i in random.permutation(len(records))])
    )


def runs_renamed(given: Written, random: np.random.Generator) -> Written:
    """Other run_ids, in another alphabetical order."""
    old = [record.run_id for record in given.recording.records]
    new = [f"{letter}{number}" for number, letter in enumerate(random.choice(list("bdfhkmpqz"), len(old)))]
    called = dict(zip(old, new, strict=True))
    records = [
        replace(record, run_id=called[record.run_id], key=called[record.run_id]) for record in given.recording.records
    ]
    columns = {called[run_id]: samples for run_id, samples in given.recording.columns.items()}
    return replace(
        given,
        recording=replace(given.recording, records=records, columns=columns),
        run_ids={name: given.run_ids.get(first, first) for first, name in called.items()},
    )


def mountings_renumbered(given: Written, random: np.random.Generator) -> Written:
    """Other numbers for the same mountings, in another order; nothing where there are none."""
    records = given.recording.records
    old = sorted({int(record.conditions["mounting"]) for record in records if "mounting" in record.conditions})
    called = dict(zip(old, map(int, random.choice(90, len(old), replace=False) + 1), strict=True))
    changed = [
        replace(record, conditions={**record.conditions, "mounting": called[int(record.conditions["mounting"])]})
        if called
        else record
        for record in records
    ]
    first = {number: given.mountings.get(one, one) for one, number in called.items()}
    return replace(given, recording=replace(given.recording, records=changed), mountings=first)


def columns_reordered(given: Written, random: np.random.Generator) -> Written:
    """Columns of runs.csv and of the samples in another order."""

    def mixed(columns: Mapping[str, Any]) -> dict[str, Any]:
        names = list(columns)
        return {names[i]: columns[names[i]] for i in random.permutation(len(names))}

    recording = given.recording
    return replace(
        given,
        recording=replace(
            recording,
            header=replace(recording.header, channels=mixed(recording.header.channels)),
            records=[replace(record, conditions=mixed(record.conditions)) for record in recording.records],
            columns={run_id: mixed(samples) for run_id, samples in recording.columns.items()},
        ),
    )


CHANGES: Mapping[str, Change] = {
    "order": runs_shuffled,
    "run_ids": runs_renamed,
    "mountings": mountings_renumbered,
    "columns": columns_reordered,
}
"""After which everything is the same."""


def said_of(kind: str, given: Written, store: str) -> Said:
    """The answer about a recording in a store of this name, in the first recording's names."""
    with TemporaryDirectory() as directory:
        bundle = Path(directory) / "bundle"
        write_bundle(given.recording, bundle)
        with import_bundle(bundle, Path(directory) / f"{store}.rig.sqlite") as source:
            study = STUDIES[kind](source)
            account = account_of(study, [()])
            found = diagnose(study, (), account=account)
            adequacy = compared(account.attempt(study, ()), account, 1).p_value
    joint = found.joint_fit.parameters if found.joint_fit else {}
    called = given.first_name
    return Said(
        found.verdict,
        frozenset(called(term.effect) for term in found.suggested),
        adequacy,
        {called(_named(rank.term)): rank.p_value for rank in found.ranking},
        {called(_named(rank.term)): rank.p_value_corrected for rank in found.ranking},
        {called(name): (each.value, each.sigma) for name, each in joint.items()},
    )


def _named(term: Any) -> str:
    head = term.choice.get("head")
    return f"{term.effect} of {head}" if head else str(term.effect)


def drawn(kind: str, seed: int) -> Written:
    """The recording of one blind trial of the second world."""
    world = KINDS[kind]
    with TemporaryDirectory() as directory:
        bundle = Path(directory) / "bundle"
        world.write(world.drawn(seed), seed, bundle)
        return Written(read_bundle(bundle))


def shortened(given: Written, runs: int) -> Written:
    """The first runs of a recording."""
    records = given.recording.records[:runs]
    columns = {record.run_id: given.recording.columns[record.run_id] for record in records}
    return replace(given, recording=replace(given.recording, records=records, columns=columns))


def tried(kind: str, seed: int, given: Written, *, apart: bool = False) -> Json:
    """A recording with all changes: what differed, by change."""
    begun = time.process_time()
    random = np.random.default_rng([16, seed])
    said = said_of(kind, given, "first")
    rewritten: dict[str, Written] = {}
    changed = given
    for name, change in CHANGES.items():
        changed = change(given if apart else changed, random)
        rewritten[name] = changed
    if not apart:
        rewritten = {"rewritten": changed}
    differed = {name: _differed(kind, said, each) for name, each in rewritten.items()}
    return {
        "kind": kind,
        "seed": seed,
        "verdict": said.verdict,
        "suggested": sorted(said.suggested),
        "differed": {name: found for name, found in differed.items() if found},
        "processor_s": round(time.process_time() - begun, 2),
    }


def _tried(kind_and_seed: tuple[str, int], *, apart: bool) -> Json:
    return tried(*kind_and_seed, drawn(*kind_and_seed), apart=apart)


def _differed(kind: str, said: Said, changed: Written) -> list[str]:
    try:
        return differences(said, said_of(kind, changed, "another name"))
    except RigError as stopped:
        return [f"stopped: {stopped}"]


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--bundles", type=int, default=20, help="of each kind")
    arguments.add_argument("--first", type=int, default=0, help="seed of the first")
    arguments.add_argument("--kind", nargs="+", choices=list(STUDIES), default=list(STUDIES))
    arguments.add_argument("--apart", action="store_true", help="one change at a time")
    arguments.add_argument("--out", type=Path, required=True)
    add_workers(arguments, 1)
    given = arguments.parse_args()
    done = {(trial["kind"], trial["seed"]) for trial in rows_in(given.out)}
    wanted = [(kind, seed) for kind in given.kind for seed in range(given.first, given.first + given.bundles)]
    missing = [each for each in wanted if each not in done]
    keep_trials(partial(_tried, apart=given.apart), missing, given.out, workers_of(given))
    trials = rows_in(given.out)
    failed = [trial for trial in trials if trial["differed"]]
    for trial in failed:
        for change, found in trial["differed"].items():
            shown = "; ".join(found[:4])
            sys.stdout.write(f"{trial['kind']} {trial['seed']}, {change}: {shown}; {len(found)} in all\n")
    alike = len(trials) - len(failed)
    sys.stdout.write(f"{alike} of {len(trials)} recordings say the same however they are written\n")
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
