"""A significant shape without physics in words and numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from rigctl.workbench.findings import Unexplained
from rigctl.workbench.study import OF_SIGNAL, SIGNAL, Observations
from rigctl.workbench.verdict.generic import Best
from rigctl.workbench.verdict.score import Score
from rigctl.workbench.verdict.shapes import Shape

_BY_POWER = {-1: "falling as 1/w", 0: "whatever the frequency", 1: "growing as w", 2: "growing as w^2"}


def described(given: Observations, best: Best, score: Score) -> Unexplained:
    """The shape that describes what is left; `score` is that of its `described_columns` in the residuals."""
    shape, series = best.described_by, given.series[best.described_by.series]
    # The last column, a constant beside the shape, is not part of what is described.
    estimate, sigmas = (each[: 2 if shape.harmonic else 1] for each in (score.estimate, score.sigma))
    size = float(np.linalg.norm(estimate))
    sigma = float(np.sqrt(np.sum(np.where(np.isfinite(sigmas), sigmas, 0.0) ** 2)))
    details: dict[str, Any] = {
        "harmonic_of_angle": shape.harmonic,
        "frequency_power": shape.power,
        "covariate": shape.covariate,
        "size": size,
        "sigma": sigma,
        "unit": series.unit,
        "sign": 0 if shape.harmonic else int(np.sign(estimate[0])),
    }
    sign = "" if shape.harmonic or estimate[0] > 0 else "-"
    words = [f"{series.name} is off by {sign}{size:.3g} ± {sigma:.2g} {series.unit}".replace("  ", " ").rstrip()]
    if shape.harmonic:
        details["phase_deg"] = float(np.degrees(np.arctan2(estimate[1], estimate[0])))
        times = "" if shape.harmonic == 1 else f"{shape.harmonic} "
        words.append(f"as cos({times}{given.angle} - {details['phase_deg']:.0f} deg)")
    words += _conditions(given, shape)
    return Unexplained(series.channel, series.component, ", ".join(words), best.p_value_corrected, details)


def _conditions(given: Observations, shape: Shape) -> list[str]:
    """How it goes with the frequency and with a covariate."""
    # A template has its own way with the frequency.
    plain = given.frequency is not None and (shape.series, shape.covariate) not in given.templates
    words = [_BY_POWER[shape.power]] if plain else []
    if shape.covariate:
        name, _, degree = shape.covariate.removeprefix(OF_SIGNAL).partition("^")
        name = f"the {SIGNAL}" if name == SIGNAL else name
        powers = {"": name, "2": f"the square of {name}", "3": f"the cube of {name}"}
        shown = powers.get(degree, f"power {degree} of {name}")
        words += ["in proportion to the signal"] if shape.covariate.startswith(OF_SIGNAL) else []
        words.append(f"with {shown} (size per standard deviation of it)")
    return words
