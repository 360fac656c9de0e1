"""Blind trials of the satellite: how its second world's parameters are called in a fit."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from tests.foreign.kinds import Kind
from tests.foreign.satellite_bundle import write
from tests.foreign.satellite_trial import KNOWN, UNKNOWN, Trial, drawn

FITTED = {
    "lambda[d]": "lambda_d", "lambda[c]": "lambda_c", "kappa[d]": "kappa_d", "kappa[c]": "kappa_c",
    "beta[x]": "beta", "beta[y]": "beta_y", "beta[z]": "beta_z", "charging[d]": "charging_d", "rate[d]": "rate_d",
    "field1_cos[d]": "once_cos_d", "field1_sin[d]": "once_sin_d", "field2_cos[d]": "twice_cos_d",
    "field2_sin[d]": "twice_sin_d", "skew_s": "delay", "precession": "perigee_rate",
    **{f"{ours}[{mass}]": f"{theirs}_{mass}" for mass in (1, 2) for ours, theirs in (
        ("stiffness", "stiffness"), ("loss", "loss"), ("cubic", "cubic"), ("K3", "k3"),
    )},
}  # fmt: skip
"""Names of the fit; what only one sensor's, or a half sum that is not fitted, would say is not compared."""
SHARED = {"lambda": "lambda_c", "kappa": "kappa_c", "beta": "beta_y"}
"""A coefficient fitted without these stands for sensors, or axes, that are alike."""


def fitted_name(trial: Trial, effect: str, parameter: str, names: Collection[str]) -> str | None:
    called = FITTED.get(parameter, parameter)
    further = SHARED.get(parameter.partition("[")[0])
    if further and not {further, f"{effect}.{further}"} & set(names) and not alike(trial, parameter):
        return None
    candidates = [name for name in (f"{effect}.{called}", called) if name in names]
    return candidates[0] if candidates else None


def alike(trial: Trial, parameter: str) -> bool:
    """Whether one thermometer stands for both sensors: then their half sum does nothing."""
    return trial.habits.thermometers == 1 and not parameter.startswith("beta")


def written(trial: Trial, seed: int, bundle: Path) -> None:
    write(trial.runs, trial.satellite, trial.noise, trial.habits, seed, bundle)


SATELLITE = Kind(
    drawn=drawn,
    write=written,
    known=KNOWN,
    unknown=UNKNOWN,
    fitted_name=fitted_name,
    unpulled=frozenset({"glitches", "gravity-j2"}),
)
