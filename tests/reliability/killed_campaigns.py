"""Campaigns of every procedure, killed with SIGKILL at any time, up to three times, and resumed: nothing is lost.

In one process, on a virtual clock, what comes out is the undisturbed campaign bit for bit; over wires, on the wall
clock, its result within its uncertainty.
"""

from __future__ import annotations

import functools
import json
import math
import re
import signal
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rigctl import results
from rigctl.campaign.store.store import Store
from rigctl.core.errors import DataError, RigError
from tests.reliability.campaigns import SMALL_CAMPAIGNS, SmallCampaign
from tests.reliability.commands import Outcome, Process, here, until
from tests.reliability.served import served

PROMISE = (
    "A campaign that is killed and resumed has lost and altered no finished run, and ends in the undisturbed result: "
    "bit for bit on a virtual clock, within its uncertainty over wires"
)

KILLS_AT_MOST = 3
WORLDS = 3
"""Seeds of nature, so that one undisturbed campaign serves many trials."""
SERVED_EVERY = 5
SERVED = ("null-search", "six-mountings", "scan", "quick-check", "bias-rejection")
"""Their results do not depend on when they are measured. A sine tilt's do: what it comes to over a run is another at
another phase, and a turn that the wall clock delays costs one of its two periods."""
CLOCK_SPEED = 50.0
SIGMAS = 4.5
ENDS_S = 60.0
STORE = "x.rig.sqlite"
FURTHER = "further"
"""The kind that is killed while it goes on in a finished store."""
KINDS = (*sorted(SMALL_CAMPAIGNS.keys() - {"monte-carlo"}), FURTHER)
RARE, RARE_EVERY = "monte-carlo", 30

Runs = dict[str, tuple[Any, ...]]
Numbers = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """What is killed; `further` is the campaign that goes on in the store of `small`."""

    kind: str
    small: SmallCampaign
    world: int
    further: str = ""

    def write(self, work: Path, rig_text: str) -> None:
        """All files, and the finished store of a kind that needs one."""
        self.small.write(work, rig_text)
        if self.further:
            _ran(here(work, "run", "campaign.toml", "--store", STORE, "--yes"))
            (work / "campaign.toml").write_text(self.further, encoding="utf-8")

    @property
    def rig_text(self) -> str:
        """The rig with this nature, and hands that are quick."""
        hands = "remount_s = 1.0\nlevel_s = 1.0\n" if self.small.name in _MOUNTED else ""
        return re.sub(r"^seed = \d+", f"seed = {self.world}\n{hands}", self.small.rig_text, count=1, flags=re.M)


@dataclass(frozen=True)
class Undisturbed:
    """What came out, and how long the command took."""

    runs: Runs
    result: Numbers
    lasted_s: float


_MOUNTED = {"null-search", "six-mountings", "scan", "angle-scan", "quick-check"}


def trial(seed: int, work: Path) -> dict[str, Any]:
    """One campaign, killed once to three times."""
    random = np.random.default_rng(seed)
    over_wires = seed % SERVED_EVERY == 0
    kind = _kind(seed, over_wires=over_wires)
    world = 1 + int(random.integers(WORLDS))
    undisturbed, case = _undisturbed(kind, world), _case(kind, world)
    with ExitStack() as stack:
        if over_wires:
            text = case.rig_text.replace('clock = "virtual"', f'clock = "real"\nclock_speed = {CLOCK_SPEED}', 1)
            text = re.sub(r"^clock_speed = 1.0.*\n", "", text, flags=re.M)
            stack.enter_context(served(work, text))
            (work / "campaign.toml").write_text(case.small.text, encoding="utf-8")
        else:
            case.write(work, case.rig_text)
        killed = _killed(work, random, undisturbed.lasted_s * (4.0 if over_wires else 1.0))
        outcome = _go_on(work).ended(ENDS_S)
    told = {"kind": kind, "served": over_wires, "world": world, "killed_at": killed.at}
    if (broken := outcome.broken()) or outcome.status:
        return {**told, "failed": broken or f"exit status {outcome.status}: {outcome.message}"}
    runs, result = _runs(work), _result(work)
    identical = runs == undisturbed.runs
    found = {
        "lost": len(killed.runs.keys() - runs.keys()),
        "altered": sum(runs[key] != run for key, run in killed.runs.items() if key in runs),
        "identical": identical,
        "result_difference": _difference(undisturbed.result, result),
    }
    return {**told, **found, "failed": _judged(found, undisturbed, result, over_wires=over_wires)}


def _kind(seed: int, *, over_wires: bool) -> str:
    if over_wires:
        return SERVED[seed // SERVED_EVERY % len(SERVED)]
    return RARE if seed % RARE_EVERY == 1 else KINDS[seed % len(KINDS)]


def _judged(found: dict[str, Any], undisturbed: Undisturbed, result: Numbers, *, over_wires: bool) -> str:
    if found["lost"] or found["altered"]:
        return f"{found['lost']} finished runs lost, {found['altered']} altered"
    if over_wires:
        beyond = [name for name, sigmas in _deviations(undisturbed.result, result) if sigmas > SIGMAS]
        return f"beyond {SIGMAS} sigma of the undisturbed result: {beyond[0]}" if beyond else ""
    if not found["identical"]:
        return "runs differ from the undisturbed ones"
    return f"the result differs: {found['result_difference']}" if found["result_difference"] else ""


@functools.cache
def _undisturbed(kind: str, world: int) -> Undisturbed:
    case = _case(kind, world)
    with tempfile.TemporaryDirectory() as directory:
        work = Path(directory)
        case.write(work, case.rig_text)
        began_s = time.monotonic()
        _ran(_go_on(work).ended(ENDS_S))
        return Undisturbed(_runs(work), _result(work), time.monotonic() - began_s)


def _case(kind: str, world: int) -> Case:
    if kind != FURTHER:
        small = SMALL_CAMPAIGNS[kind]
        if kind == "calibration":  # long enough for a result
            small = replace(small, text=small.text.replace("orbits = 5.0", "orbits = 6.0"))
        return Case(kind, small, world)
    scan = SMALL_CAMPAIGNS["scan"]
    first = replace(scan, text=scan.text.replace("-10.0, -1.0", "-1.0"))
    further = scan.text.replace('name = "scan"', 'name = "scan"\nmounting = "same"').replace("-10.0", "5.0")
    return Case(kind, first, world, further)


def _ran(outcome: Outcome) -> None:
    if outcome.status:
        raise RigError(f"undisturbed: {outcome.message}")


# Killing


@dataclass(frozen=True)
class Killed:
    """Seconds or numbers of runs after which it was killed, and the runs that were finished then."""

    at: list[str]
    runs: Runs


def _killed(work: Path, random: np.random.Generator, lasts_s: float) -> Killed:
    at, finished = [], {}
    for _ in range(int(random.integers(1, KILLS_AT_MOST + 1))):
        process = _go_on(work)
        if random.random() < 0.5:
            after_s = float(random.uniform(0.0, lasts_s))
            until(lambda: not process.running(), after_s)  # noqa: B023 - called at once
            at.append(f"{after_s:.3f} s")
        else:
            wanted = _count(work) + int(random.integers(1, 4))
            until(lambda: not process.running() or _count(work) >= wanted, ENDS_S)  # noqa: B023 - called at once
            at.append(f"{wanted} runs")
        seen = _runs(work)
        process.signal(signal.SIGKILL)
        process.ended(ENDS_S)
        finished = {**finished, **seen, **_runs(work)}
    return Killed(at, finished)


def _go_on(work: Path) -> Process:
    """`run` or `resume`, whichever the store is ready for."""
    if _begun(work):
        return Process(work, "resume", STORE, "--yes", "--json")
    return Process(work, "run", "campaign.toml", "--store", STORE, "--yes", "--json")


def _begun(work: Path) -> bool:
    if not (work / STORE).exists():
        return False
    with Store.open(work / STORE, readonly=True) as store:
        goes_on = 'mounting = "same"' in (work / "campaign.toml").read_text(encoding="utf-8")
        return bool(store.documents("campaign")) or not goes_on


def _count(work: Path) -> int:
    try:
        with Store.open(work / STORE, readonly=True) as store:
            return len(store.runs())
    except DataError:
        return 0


def _runs(work: Path) -> Runs:
    """Every finished run by its key: conditions, and samples bit for bit."""
    if not (work / STORE).exists():
        return {}
    with Store.open(work / STORE, readonly=True) as store:
        return {
            run.key: (
                json.dumps(run.conditions, sort_keys=True),
                run.valid,
                {name: column.tobytes() for name, column in store.samples(run.run_id).items()},
            )
            for run in store.runs()
        }


# Results


def _result(work: Path) -> Numbers:
    """Everything that is told of a store, flat, but the numbers of its runs."""
    try:
        told = json.loads(json.dumps(results.of(work / STORE), default=str))
    except RigError as error:
        told = {"none": str(error).replace(str(work), "")}
    return {name: _without_numbers_of_runs(value) for name, value in _flat(told) if not name.endswith("run_id")}


def _without_numbers_of_runs(value: Any) -> Any:
    return re.sub(r"\brun \d+", "run", value) if isinstance(value, str) else value


def _flat(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict | list):
        pairs = value.items() if isinstance(value, dict) else enumerate(value)
        for key, inner in pairs:
            yield from _flat(inner, f"{name}.{key}")
    else:
        yield name, value


def _difference(one: Numbers, other: Numbers) -> str:
    """The first name under which two results differ, with both values; "" when they are the same."""
    for name in one | other:
        ours, theirs = one.get(name), other.get(name)
        if ours != theirs and not (_is_nan(ours) and _is_nan(theirs)):
            return f"{name}: {ours} -> {theirs}"
    return ""


def _is_nan(value: Any) -> bool:
    return isinstance(value, float) and math.isnan(value)


def _deviations(one: Numbers, other: Numbers) -> Iterator[tuple[str, float]]:
    """Every value with an uncertainty: how many standard uncertainties of their difference two results are apart."""
    for name, value in one.items():
        for sigma_name, unit in _sigma_names(name):
            sigmas = [result[sigma_name] for result in (one, other) if result.get(sigma_name)]
            if len(sigmas) == 2 and isinstance(other.get(name), float):
                yield name, abs(value - other[name]) / (unit * math.hypot(*sigmas))


def _sigma_names(name: str) -> list[tuple[str, float]]:
    """Where the uncertainty of a value stands, and its unit in that of the value."""
    if name.endswith(".value"):
        return [(name.removesuffix("value") + "sigma", 1.0)]
    if name.endswith(".theta0_deg"):
        return [(name.removesuffix("deg") + "sigma_arcsec", 1.0 / 3600.0)]
    return []
