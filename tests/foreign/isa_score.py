"""Blind trials of the sensing axis: how its second world's parameters are called in a fit."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from tests.foreign.isa_bundle import write
from tests.foreign.isa_trial import KNOWN, UNKNOWN, Trial, drawn
from tests.foreign.kinds import Kind
from tests.foreign.sessions import Session

COMPANIONS = {"thermal-gain": {"thermal-bias"}, "gain-drift": {"bias-drift"}}
"""A changing gain acts on the static level too: where that is significant, both are right (the rig's page)."""
FITTED = {
    "bias_rate": "rate", "gain_rate": "rate", "null_rate": "rate", "line_v": "amplitude", "line_hz": "frequency",
}  # fmt: skip
"""Names of the fit where the world's differ."""


def fitted_name(trial: Trial, effect: str, parameter: str, names: Collection[str]) -> str | None:
    """Of the whole bench, of an axis, of a configuration, of a head."""
    stem, _, where = parameter.rstrip("]").partition("[")
    stem, axis = FITTED.get(stem, stem), trial.design.axis
    place = f"laser_{where}_mm" if where.isdigit() else f"{axis},{where}" if where else axis
    candidates = [name for name in (stem, f"{stem}[{place}]") if name in names]
    return candidates[0] if candidates else None


def displaced(trial: Trial, session: Session) -> set[str]:
    """Effects of one head that were named with another one."""
    names = list(session.fit["parameters"])
    of_heads = {stem: name for name, (stem, *_) in KNOWN.items() if name.startswith("laser")}
    absent = {part for part in trial.parameters if fitted_name(trial, "", part, names) is None}
    return {of_heads[part[:-3]] for part in absent if part[:-3] in of_heads}


def written(trial: Trial, seed: int, bundle: Path) -> None:
    write(trial.design, trial.bench, trial.noise, seed, bundle)


SENSING_AXIS = Kind(
    drawn=drawn,
    write=written,
    known=KNOWN,
    unknown=UNKNOWN,
    fitted_name=fitted_name,
    companions=COMPANIONS,
    unpulled=frozenset({"mains-pickup"}),
    displaced=displaced,
)
