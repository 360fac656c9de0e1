"""Blind trials of the rotating platform: how its second world's parameters are called in a fit."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from tests.foreign.kinds import Kind
from tests.foreign.platform_bundle import write
from tests.foreign.platform_trial import KNOWN, UNKNOWN, Trial, drawn

FITTED = {
    "T_r": "t_r", "e_signed": "e", "e_abs": "e", "kx": "k", "delay_s": "delay",
    "tide_cos": "a_cos", "tide_sin": "a_sin",
}  # fmt: skip
"""Names of the fit where the world's differ."""


def fitted_name(trial: Trial, effect: str, parameter: str, names: Collection[str]) -> str | None:
    stem, bracket, channel = parameter.partition("[")
    called = FITTED.get(stem, stem) + bracket + channel
    candidates = [name for name in (f"{effect}.{called}", called) if name in names]
    return candidates[0] if candidates else None


def written(trial: Trial, seed: int, bundle: Path) -> None:
    write(trial.runs, trial.bench, trial.noise, trial.habits, seed, bundle)


PLATFORM = Kind(
    drawn=drawn,
    write=written,
    known=KNOWN,
    unknown=UNKNOWN,
    fitted_name=fitted_name,
    unpulled=frozenset({"line"}),
)
