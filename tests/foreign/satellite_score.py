"""Blind trials of the satellite: how its second world's parameters are called in a fit."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from tests.foreign.kinds import Kind
from tests.foreign.satellite_bundle import write
from tests.foreign.satellite_trial import KNOWN, UNKNOWN, Trial, drawn


def fitted_name(trial: Trial, effect: str, parameter: str, names: Collection[str]) -> str | None:
    candidates = [name for name in (f"{effect}:{parameter}", parameter) if name in names]
    return candidates[0] if candidates else None


def written(trial: Trial, seed: int, bundle: Path) -> None:
    write(trial.runs, trial.satellite, trial.noise, trial.habits, seed, bundle)


SATELLITE = Kind(drawn=drawn, write=written, known=KNOWN, unknown=UNKNOWN, fitted_name=fitted_name)
