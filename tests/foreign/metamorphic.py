"""What is found must not depend on how a table is written: random tables, changed in ways that mean nothing.

    python -m tests.foreign.metamorphic --tables 500 --out FILE [--first SEED] [--apart]

Each table is diagnosed as it is and changed: rows and columns in another order, other words, other names of columns,
other units (all at once; `--apart` one by one, to see which of them matters), read back from a store of any name, a
term called `#2`, and the time counted from another zero. Verdict, suggested set, sizes in the same units, the error
on held-out readings and p-values must be the same to 1e-6, p-values corrected for trials to 1e-4. One line of JSON
for each table; what stands in the file is not tried again. The status is 1 where something differed.
"""

from __future__ import annotations

import argparse
import math
import re
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.trials import add_workers, keep_trials, rows_in, workers_of
from rigctl.campaign.bundle.bundle import import_bundle, write_bundle
from rigctl.campaign.recording import RunSource
from rigctl.core.errors import RigError
from rigctl.experiments.table.study import TableStudy
from rigctl.workbench.findings import Diagnosis
from rigctl.workbench.study import Term
from rigctl.workbench.verdict.account import account_of
from rigctl.workbench.verdict.compare import compared
from rigctl.workbench.verdict.diagnose import diagnose
from tests.foreign.metamorphic_table import CHANGES, CONSTANT, RESPONSE, Powers, Table, clock_shifted, drawn

SAME = 1e-6
DRAWN_SAME = 1e-4
"""Of p-values corrected for trials: the trials are counted on draws of noise in single precision."""

SCANNED = ("periodic", "exponential", "step")
Json = dict[str, Any]


@dataclass(frozen=True)
class Said:
    """The answer about one table, by roles and in the first table's units."""

    verdict: str
    suggested: frozenset[str]
    adequacy: float
    p_values: Mapping[str, float]
    corrected: Mapping[str, float]
    sizes: Mapping[str, tuple[float, float]]
    """Value and sigma; the latter NaN where words are counted from one of them."""
    held_out: float = math.nan
    """The error of the model without what was found on held-out readings."""


def said_of(table: Table, source: RunSource | None = None, terms: Sequence[Term] = ()) -> Said:
    """A table from its readings to the verdict; `terms` are in the model already."""
    study = TableStudy(source or table.recording())
    account = account_of(study, [terms])
    found = diagnose(study, terms, account=account)
    attempt = account.attempt(study, terms)
    said = _by_roles(table, found, compared(attempt, account, 1).p_value)
    return replace(said, held_out=attempt.held_out.error())


def _by_roles(table: Table, found: Diagnosis, adequacy: float) -> Said:
    roles = {name: role for role, name in table.names.items()}

    def role_of(effect: str) -> str:
        called = re.sub(r"[A-Za-z_][A-Za-z_0-9]*(?=[\],]| by )", lambda name: roles.get(name[0], name[0]), effect)
        # A product is called by its factors as they stand in the file.
        return re.sub(r"(?<=interaction\[)\w+,\w+", lambda pair: ",".join(sorted(pair[0].split(","))), called)

    sizes: dict[str, tuple[float, float]] = {}
    if found.joint_fit is not None:
        values = {role_of(name): (each.value, each.sigma) for name, each in found.joint_fit.parameters.items()}
        sizes = _in_units(table, values)
    return Said(
        found.verdict,
        frozenset(role_of(term.effect) for term in found.suggested),
        adequacy,
        {role_of(rank.term.effect): rank.p_value for rank in found.ranking},
        {role_of(rank.term.effect): rank.p_value_corrected for rank in found.ranking},
        sizes,
    )


def _in_units(table: Table, values: Mapping[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    """Sizes in the units of the table as it was drawn; of words those beside the mean over all of them."""
    sizes: dict[str, tuple[float, float]] = {}
    by_words: dict[str, dict[str, float]] = {}
    for name, (value, sigma) in values.items():
        unit = table.size(_powers(table, name))
        effect, _, rest = name.partition("].")
        role = re.search(r"(\w+)\]?$", effect)
        if name.startswith(("level", "slope", "group")) and role is not None:
            word, _, first = rest.partition("-")
            labels = table.labels[role[1]]
            if word not in labels:  # the first of its kind: every word has a number of its own
                word = rest
            of_words = by_words.setdefault(effect + "]", {})
            of_words[str(labels.index(word))] = value / unit
            if first:
                of_words[str(labels.index(first))] = 0.0
        else:
            sizes[name] = (value / unit, sigma / unit)
    for effect, of_words in by_words.items():
        mean = float(np.mean(list(of_words.values())))
        for word, value in of_words.items():
            sizes[f"{effect}.{word}"] = (value - mean, math.nan)
    _constants_beside_logarithms(table, sizes)
    # A constant goes up by what the first word goes down.
    return {name: each for name, each in sizes.items() if not by_words or name not in table.units}


def _constants_beside_logarithms(table: Table, sizes: dict[str, tuple[float, float]]) -> None:
    """Constants as they would be beside p ln C of the table as it was drawn: p ln(k C) has p ln k more."""
    logarithms = [(name, re.match(r"log\[(\w+)\]", name)) for name in sizes]
    for name, column in [(name, found[1]) for name, found in logarithms if found is not None]:
        moved = sizes[name][0] * math.log(table.scale.get(column, 1.0))
        if CONSTANT in sizes:
            # It is known otherwise there.
            sizes[CONSTANT] = (sizes[CONSTANT][0] + moved, math.nan)


def _powers(table: Table, parameter: str) -> Powers:
    """Of what the parameter of a fit is a product."""
    if parameter in table.units:
        return table.units[parameter]
    parameter = _of_its_kind(parameter)
    kind, _, inside = parameter.partition("[")
    columns = re.split(r",| by ", inside.partition("]")[0])
    suffix = parameter.rpartition("].")[2] if "]." in parameter else ""
    suffix = suffix.rpartition(".")[2]
    if kind == "drift":
        return {RESPONSE: 1, str(table.order): -1}
    if kind == "group":
        return table.units[columns[0]]
    scanned = {"period": 1, "at": 1, "rate": -1}
    if suffix in scanned:
        return {columns[0]: scanned[suffix]}
    exponent = {"linear": 1, "power2": 2, "power3": 3, "inverse": -1, "sqrt": 0.5, "slope": 1, "interaction": 1}
    power = {"slope": 1, "curvature": 2}.get(suffix, 0) if kind == "turning" else exponent.get(kind, 0)
    powers: dict[str, float] = {RESPONSE: 1}
    for column in columns if kind == "interaction" else columns[:1]:
        powers[column] = powers.get(column, 0) - power
    return powers


def _of_its_kind(parameter: str) -> str:
    """Without the number of the second and later ones of a kind."""
    return re.sub(r"#\d+", "", parameter)


def differences(first: Said, second: Said) -> list[str]:
    """What is not the same in two answers, in words."""
    found = []
    for what in ("verdict", "suggested"):
        one, other = getattr(first, what), getattr(second, what)
        if one != other:
            found.append(f"{what}: {_shown(one)} became {_shown(other)}")
    # It is one of them where something is found.
    if not _same_p(first.adequacy, second.adequacy, DRAWN_SAME):
        found.append(f"compare: p {first.adequacy:.8g} became {second.adequacy:.8g}")
    if not _same_p(first.held_out, second.held_out, SAME):
        found.append(f"held out: {first.held_out:.8g} became {second.held_out:.8g}")
    for what, tolerance in (("p_values", SAME), ("corrected", DRAWN_SAME)):
        ones, others = getattr(first, what), getattr(second, what)
        found += [f"{what}: {name} in one only" for name in sorted(ones.keys() ^ others.keys())]
        found += [
            f"{what}: {name} {ones[name]:.8g} became {others[name]:.8g}"
            for name in sorted(ones.keys() & others.keys())
            if not _same_p(ones[name], others[name], tolerance)
        ]
    found += [f"size: {name} in one only" for name in sorted(first.sizes.keys() ^ second.sizes.keys())]
    for name in sorted(first.sizes.keys() & second.sizes.keys()):
        (value, sigma), (other, other_sigma) = first.sizes[name], second.sizes[name]
        # A size that is nil within its sigma has no digits of its own.
        scale = max(abs(value), sigma if math.isfinite(sigma) else max(abs(v) for v, _ in first.sizes.values()))
        if abs(value - other) > SAME * scale:
            found.append(f"size: {name} {value:.9g} became {other:.9g}")
        if math.isfinite(sigma) and abs(sigma - other_sigma) > SAME * sigma:
            found.append(f"sigma: {name} {sigma:.9g} became {other_sigma:.9g}")
    return found


def _shown(value: object) -> str:
    return ", ".join(sorted(value)) or "nothing" if isinstance(value, frozenset) else str(value)


def _same_p(one: float, other: float, tolerance: float) -> bool:
    if one <= 0.0 or other <= 0.0 or not math.isfinite(one) or not math.isfinite(other):
        return one == other or (math.isnan(one) and math.isnan(other))
    # Of very small ones the logarithm is what can be known.
    return abs(math.log(one / other)) <= tolerance * max(1.0, abs(math.log(one)))


def stored(table: Table) -> Said:
    """Through a bundle and a store with another name."""
    with TemporaryDirectory() as directory:
        bundle = Path(directory) / "bundle"
        write_bundle(table.recording(), bundle)
        with import_bundle(bundle, Path(directory) / "another name.rig.sqlite") as store:
            return said_of(table, store)


def numbered_two(table: Table) -> list[str]:
    """What differs when the first of a kind in the model is called the second."""
    study = TableStudy(table.recording())
    scanned = [term for term in diagnose(study, ()).suggested if term.effect.startswith(SCANNED)]
    if not scanned:
        return []
    answers = []
    for called, other in (("", "#2"), ("#2", "")):
        said = said_of(table, None, [Term(scanned[0].effect.partition("#")[0] + called, scanned[0].choice)])
        base = scanned[0].effect.partition("#")[0]
        base = re.sub(r"\[(\w+)\]", lambda name: f"[{_role(table, name[1])}]", base)
        answers.append(_renumbered(said, base + called, base + other))
    return differences(answers[0], answers[1])


def _role(table: Table, name: str) -> str:
    return next(role for role, each in table.names.items() if each == name)


def _renumbered(said: Said, own: str, next_one: str) -> Said:
    """With the given term called first and one more of its kind second."""

    def called(name: str) -> str:
        for effect, new in ((own, "first"), (next_one, "second")):
            if name == effect or name.startswith(effect + "."):
                return new + name[len(effect) :]
        return name

    return Said(
        said.verdict,
        frozenset(map(called, said.suggested)),
        said.adequacy,
        {called(name): p_value for name, p_value in said.p_values.items()},
        {called(name): p_value for name, p_value in said.corrected.items()},
        {called(name): size for name, size in said.sizes.items()},
    )


def from_zero(said: Said, zero: float) -> Said:
    """Without what must depend on the `zero` that the clock t counts from: amplitudes and phases there, constants.

    Constants do where something goes with the time: they are values at its zero.
    """
    sizes = dict(said.sizes)
    for name in said.sizes:
        effect, _, parameter = _of_its_kind(name).partition("].")
        if re.match(r"step\[t\b", name) and parameter == "at":
            sizes[name] = (sizes[name][0] - zero, sizes[name][1])
            continue
        phase = re.match(r"(periodic|exponential)\[t\b", effect) and parameter not in ("period", "rate")
        constant = "[" not in name and any(re.search(r"\bt\b|drift", each) for each in said.suggested)
        if phase or constant:
            del sizes[name]
    return replace(said, sizes=sizes)


def tried(seed: int, *, apart: bool = False) -> Json:
    """One table with all changes: what differed, by change."""
    begun = time.process_time()
    table = drawn(seed)
    random = np.random.default_rng([15, seed])
    said = said_of(table)
    differed: dict[str, list[str]] = {}
    changed = table
    for name, change in CHANGES.items():
        changed = change(table if apart else changed, random)
        if apart:
            differed[name] = _differed(said, changed)
    if not apart:
        differed["rewritten"] = _differed(said, changed)
        differed["stored"] = differences(said, stored(table))
        differed["numbered"] = numbered_two(table)
    if table.order:
        shifted = clock_shifted(table, random)
        zero = float(shifted.numbers["t"][0] - table.numbers["t"][0])
        differed["clock"] = differences(from_zero(said, 0.0), from_zero(said_of(shifted), zero))
    return {
        "seed": seed,
        "hidden": table.hidden,
        "rows": table.rows,
        "verdict": said.verdict,
        "suggested": sorted(said.suggested),
        "differed": {name: found for name, found in differed.items() if found},
        "processor_s": round(time.process_time() - begun, 2),
    }


def _differed(said: Said, changed: Table) -> list[str]:
    try:
        return differences(said, said_of(changed))
    except RigError as stopped:
        return [f"stopped: {stopped}"]


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--tables", type=int, default=500)
    arguments.add_argument("--first", type=int, default=0, help="seed of the first")
    arguments.add_argument("--apart", action="store_true", help="one change at a time")
    arguments.add_argument("--out", type=Path, required=True)
    add_workers(arguments, 1)
    given = arguments.parse_args()
    done = {trial["seed"] for trial in rows_in(given.out)}
    wanted = [seed for seed in range(given.first, given.first + given.tables) if seed not in done]
    keep_trials(partial(tried, apart=given.apart), wanted, given.out, workers_of(given))
    trials = rows_in(given.out)
    failed = [trial for trial in trials if trial["differed"]]
    for trial in failed:
        for change, found in trial["differed"].items():
            sys.stdout.write(f"{trial['seed']} ({trial['hidden']}), {change}: {found[0]}; {len(found)} in all\n")
    sys.stdout.write(f"{len(trials) - len(failed)} of {len(trials)} tables say the same however they are written\n")
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
