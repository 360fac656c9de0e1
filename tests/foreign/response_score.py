"""Blind trials of the shaken accelerometer: how its second world's parameters are called in a fit."""

from __future__ import annotations

from collections.abc import Collection

from tests.foreign.kinds import Kind
from tests.foreign.response_trial import KNOWN, UNKNOWN, Trial, drawn, write

FITTED = {"skew_s": "tau", "lag_s": "tau", "gain_rate": "rate"}
"""Names of the fit where the world's differ."""


def fitted_name(trial: Trial, effect: str, parameter: str, names: Collection[str]) -> str | None:
    called = FITTED.get(parameter, parameter)
    candidates = [name for name in (f"{effect}.{called}", called) if name in names]
    return candidates[0] if candidates else None


RESPONSE = Kind(drawn=drawn, write=write, known=KNOWN, unknown=UNKNOWN, fitted_name=fitted_name)
