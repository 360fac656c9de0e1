"""A recording taken through the commands, as its owner would: import, compare, diagnose, model add, fit, history.

Each check below is one promise of the commands' JSON (what is named, its size, one account of noise, a ladder that
falls, a fit that keeps what diagnose promised). A check raises AssertionError with what is wrong.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from typer.testing import CliRunner

from rigctl.cli.application import app

ALPHA = 0.01
CHI2_TOLERANCE = 0.01
PARAMETER_TOLERANCE_SIGMA = 0.1
NUMBERS_ALIKE = 1e-6

Json = dict[str, Any]


@dataclass(frozen=True)
class Session:
    """What the commands said; ``again`` is a second diagnose, ``after`` compare with what it suggested."""

    reference: Json
    response: str
    compare: Json
    diagnose: Json
    again: Json
    after: Json
    fit: Json
    history: list[Json]

    @property
    def suggested(self) -> list[str]:
        return list(self.diagnose["suggested"])


def run(*arguments: str) -> str:
    """What a command prints; AssertionError with its last message where it ends with an error."""
    ended = CliRunner().invoke(app, list(arguments))
    message = ended.stderr.strip()[-300:] or repr(ended.exception)
    called = " ".join(arguments[: 2 if arguments[0] == "model" else 1])
    assert ended.exit_code == 0, f"rigctl {called} ends {ended.exit_code}: {message}"
    return str(ended.stdout)


def command(*arguments: str) -> Any:
    """The JSON document a command prints."""
    return json.loads(run(*arguments, "--json"))


def taken_through(bundle: Path, reference: Json | None = None) -> Session:
    """The whole session on one bundle, in a store of its own; ``reference`` is [reference] where not given."""
    written = tomllib.loads((bundle / "recording.toml").read_text())
    with TemporaryDirectory() as directory:
        store = str(Path(directory) / "foreign.rig.sqlite")
        run("import", str(bundle), "--store", store)
        compare = command("compare", store)
        diagnose, again = (command("diagnose", store, "--alpha", str(ALPHA)) for _ in range(2))
        if diagnose["suggested"]:
            run("model", "add", store, *diagnose["suggested"])
        return Session(
            reference=reference or written.get("reference", {}),
            response=written.get("table", {}).get("response", ""),
            compare=compare,
            diagnose=diagnose,
            again=again,
            after=command("compare", store),
            fit=command("fit", store),
            history=command("model", "history", store),
        )


def told(session: Session) -> str:
    return f"{session.diagnose['verdict']} {session.suggested}; known: {session.reference['known']}"


def known_effect_is_named(session: Session) -> None:
    """The verdict is one that the literature allows, every known effect is suggested, none known to be absent."""
    reference = session.reference
    assert session.diagnose["verdict"] in reference["verdicts"], told(session)
    for alternatives in reference.get("effects", []):
        assert set(alternatives) & set(session.suggested), told(session)
    if "effects" not in reference:
        assert set(session.suggested) <= set(reference.get("only", [])), told(session)
    assert not set(reference.get("absent", [])) & set(session.suggested), told(session)


def period_number(name: str) -> tuple[str, str]:
    """``periodic[day]#2.period`` is ``periodic[day]``'s second one; which is which, the sizes tell."""
    effect, _, parameter = name.partition("].")
    return effect.partition("#")[0].rstrip("]"), parameter


def fitted(session: Session, name: str, near: float) -> Json:
    """The parameter of that name; of several of a kind the nearest; of a group's, the only one that begins so."""
    parameters = session.fit["parameters"]
    if name in parameters and not name.endswith("].period"):
        return dict(parameters[name])
    stem = name.partition("[")[0] + "["
    alike = {
        key: stated
        for key, stated in parameters.items()
        if key.startswith(f"{name}.")
        or (name.endswith(".period") and key.startswith(stem) and key.endswith(".period"))
    }
    assert alike, f"{name} is not in the fit: {sorted(parameters)}"
    return dict(min(alike.values(), key=lambda stated: abs(stated["value"] - near)))


def published_values_are_found(session: Session) -> None:
    """Every published parameter, and every scatter between batches, within its published standard uncertainty."""
    reference = session.reference
    for name, published in reference.get("parameters", {}).items():
        found = fitted(session, name, published["value"])["value"]
        assert abs(found - published["value"]) <= published["sigma"], f"{name}: {found}, published {published}"
    for column, published in reference.get("batches", {}).items():
        told_of = session.fit["noise"][0]["batches"]
        assert abs(told_of[column] - published["value"]) <= published["sigma"], f"{column}: {told_of}, {published}"


def compare_and_diagnose_agree(session: Session) -> None:
    """compare fails the model where diagnose finds something, and passes it where not, before and after."""
    adequate = session.diagnose["verdict"] == "adequate"
    p_value = session.compare["p_value"]
    assert (p_value >= ALPHA) == adequate, f"compare p = {p_value:.2g}, diagnose {told(session)}"
    if session.diagnose["verdict"] in {"effect", "ambiguous"}:
        p_value = session.after["p_value"]
        assert p_value >= ALPHA, f"compare with {session.suggested}: p = {p_value:.2g}"


def alike(one: Any, other: Any) -> bool:
    """Equal, numbers to NUMBERS_ALIKE."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(alike(one[key], other[key]) for key in one)
    if isinstance(one, list):
        return len(one) == len(other) and all(map(alike, one, other))
    return math.isclose(one, other, rel_tol=NUMBERS_ALIKE) if isinstance(one, float) else bool(one == other)


def noise_is_one(session: Session) -> None:
    """compare, diagnose, fit and every version state one noise, before what was found is added and afterwards."""
    stated = [each["noise"] for each in (session.compare, session.diagnose, session.after, session.fit)]
    stated += [each["noise"] for each in session.history]
    assert stated[0], "no noise is stated"
    assert all(alike(entry, stated[0]) for entry in stated), f"the noise is stated differently: {stated}"


def told_twice_the_same(session: Session) -> None:
    """A second diagnosis says what the first did, and all that is suggested is significant in its ranking."""
    assert alike(session.again, session.diagnose)
    p_values = {each["effect"]: each["p_value_corrected"] for each in session.diagnose["ranking"]}
    assert all(p_values[effect] < ALPHA for effect in session.suggested), p_values


def falls(rungs: list[float], name: str) -> None:
    descends = all(after < before for before, after in pairwise(rungs))
    assert descends, f"{name} over the versions: {[round(rung, 4) for rung in rungs]}"


def errors_fall(session: Session) -> None:
    """From each version to the next the error falls, on the fit's readings and on held-out ones."""
    for name in ("error_fit", "error_held_out"):
        falls([rung[name] for rung in session.history], name)


def measures_fall(session: Session) -> None:
    """So do the raw rms and -2 log L, and the held-out log score rises."""
    falls([rung["rms"][session.response]["value"] for rung in session.history], "rms")
    falls([rung["minus_2_log_l"] for rung in session.history], "minus_2_log_l")
    falls([-rung["held_out_log_score"] for rung in session.history], "- held_out_log_score")


def chi2_of(comparison: Json) -> float:
    return sum(channel["chi2"] for channel in comparison["channels"])


def promise_is_kept(session: Session) -> None:
    """What was suggested is what was added: the same likelihood and parameters, and no warning."""
    joint = session.diagnose["joint_fit"]
    if not session.suggested:
        return
    last = session.history[-1]
    fall = chi2_of(session.compare) - chi2_of(session.after)
    assert abs(fall - joint["chi2_fall"]) <= CHI2_TOLERANCE * joint["chi2_fall"], f"{fall}, promised {joint}"
    assert abs(last["minus_2_log_l"] - joint["minus_2_log_l"]) <= CHI2_TOLERANCE * joint["chi2_fall"]
    for name, promised in joint["parameters"].items():
        found = session.fit["parameters"][name]
        if promised["sigma"]:
            off = abs(found["value"] - promised["value"]) / promised["sigma"]
            assert off <= PARAMETER_TOLERANCE_SIGMA, f"{name}: promised {promised}, fitted {found}"
    assert not session.fit.get("warnings"), session.fit["warnings"]


CHECKS: dict[str, Callable[[Session], None]] = {
    "named": known_effect_is_named,
    "value": published_values_are_found,
    "agree": compare_and_diagnose_agree,
    "noise": noise_is_one,
    "twice": told_twice_the_same,
    "ladder": errors_fall,
    "measures": measures_fall,
    "promise": promise_is_kept,
}
