"""What is known of a place that was scanned for comes from the data, and not from the scan."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from rigctl.analysis.least_squares import Parameter, Prior
from rigctl.core.arrays import FloatArray
from rigctl.workbench.study import Model, Observations, Term
from rigctl.workbench.verdict.fitted_model import FittedModel, Uncertainty, fit_with_given_noise
from rigctl.workbench.verdict.profiled import profiled

T_S = np.tile(np.linspace(0.05, 1.0, 48), 3)
SIZE, TIME_S = 2.0, 0.6
SCAN_S = (0.1, 0.2, 0.4, 0.8, 1.6)
SIGMA = 0.25


def shape(time_s: float) -> FloatArray:
    return np.asarray(np.exp(-T_S / time_s))


@dataclass
class Decay:
    """A level, and what dies away from a size with a time of its own, of which the readings see little."""

    observations: Observations
    start_s: float
    terms: tuple[Term, ...] = field(init=False)
    units = ("1", "1", "s")
    owners = ("", "decay", "decay")
    local = (False, False, False)

    def __post_init__(self) -> None:
        self.terms = (Term("decay", {"time": self.start_s}),)

    @property
    def parameters(self) -> list[Parameter]:
        near = Prior(self.start_s, 0.3 * self.start_s)
        return [Parameter("level", 0.0), Parameter("size", 0.0), Parameter("time", self.start_s, prior=near)]

    def predict(self, values: FloatArray) -> FloatArray:
        return np.asarray(values[0] + values[1] * shape(max(float(values[2]), 1e-3)))

    def jacobian(self, values: FloatArray) -> FloatArray:
        time_s = max(float(values[2]), 1e-3)
        died = shape(time_s)
        return np.stack([np.ones_like(died), died, values[1] * died * T_S / time_s**2], axis=1)


@dataclass
class Notch:
    """A size told in proportion to a time, which other readings know to lie beside 0.1 s if they know it."""

    observations: Observations
    terms = (Term("notch", {"time": 0.1}),)
    units = ("1", "s")
    owners = ("notch", "notch")
    local = (False, False)
    parameters = (Parameter("size", 0.0), Parameter("time", 0.1002, prior=Prior(0.1, 0.03)))
    width = 1e-3

    def predict(self, values: FloatArray) -> FloatArray:
        size, log = float(values[0]), np.log(float(values[1]) / 0.1) / self.width
        return np.array([size * float(values[1]), *np.full(143, np.exp(-0.5 * log**2))])

    def jacobian(self, values: FloatArray) -> FloatArray:
        size, time_s = map(float, values)
        log = np.log(time_s / 0.1) / self.width
        slope = -log / self.width / time_s * np.exp(-0.5 * log**2)
        return np.vstack([[time_s, size], np.tile([0.0, slope], (143, 1))])


class Scans:
    """A study that knows where the time is looked for."""

    def within(self, term: Term) -> Mapping[str, tuple[float, float]]:
        return {"time": (0.05, 3.2)}


def fitted(made_up: Any, seed: int) -> FittedModel:
    value = 1.0 + SIZE * shape(TIME_S) + np.random.default_rng([seed, 14]).normal(0.0, SIGMA, len(T_S))
    given = made_up.observations(value / SIGMA)
    fits = [fit_with_given_noise(_model(given, start_s), {}) for start_s in SCAN_S]
    return min(fits, key=lambda each: each.result.chi2)


def _model(given: Observations, start_s: float) -> Model:
    return Decay(given, start_s)


def pulls(found: FittedModel, covariance: FloatArray) -> FloatArray:
    true = np.array([1.0 / SIGMA, SIZE / SIGMA, TIME_S])
    return np.asarray((found.result.values - true) / np.sqrt(np.diag(covariance)))


@pytest.fixture(scope="module")
def sixty(made_up: Any) -> list[tuple[FittedModel, Uncertainty]]:
    """Fits, and what is known of their places."""
    fits = [fitted(made_up, seed) for seed in range(60)]
    return [(each, profiled(each, Scans())) for each in fits]  # type: ignore[arg-type]


def test_nothing_is_better_known_than_it_is_where_the_data_leave_a_place_open(
    sixty: list[tuple[FittedModel, Uncertainty]],
) -> None:
    """Rms of 60 pulls each, known to 9 %; by the curvature at the minimum, with the prior, it is half too large."""
    honest = np.array([pulls(each, known.covariance) for each, known in sixty])
    at_the_minimum = np.array([pulls(each, each.result.covariance) for each, _ in sixty])
    rms, curvature = (np.sqrt(np.mean(each**2, axis=0)) for each in (honest, at_the_minimum))
    assert curvature[2] > 1.27
    assert rms.max() < 1.27
    # Skewed likelihoods have tails beyond what 68 % of draws show.
    assert rms.min() > 0.5


def test_an_interval_holds_the_truth_in_two_of_three(sixty: list[tuple[FittedModel, Uncertainty]]) -> None:
    held = []
    for _, known in sixty:
        low, high = known.intervals.get(2, (np.nan, np.nan))
        if np.isfinite(low):
            held.append(low <= TIME_S <= high)
    assert len(held) > 40
    # Three standard deviations of a share of so many.
    assert np.mean(held) == pytest.approx(0.683, abs=3.0 * np.sqrt(0.217 / len(held)))


@pytest.mark.parametrize(("depth", "is_known"), [(0.1, False), (0.5, True)])
def test_a_narrow_minimum_is_no_knowledge_where_chi_square_goes_on_flat_beside_it(
    made_up: Any, depth: float, is_known: bool
) -> None:
    """Chi-square falls by 143 depth^2 beside 0.1 s; everywhere else the size makes up for the time."""
    readings = np.array([10.0, *np.full(143, depth)])
    found = fit_with_given_noise(Notch(made_up.observations(readings)), {})
    assert found.result.chi2 < 0.1
    size, time_s = np.sqrt(np.diag(found.result.covariance))
    assert time_s < 1e-4
    honest = profiled(found, Scans())  # type: ignore[arg-type]
    if is_known:
        assert honest.intervals == {}
        assert np.sqrt(np.diag(honest.covariance)) == pytest.approx([size, time_s])
    else:
        # From 0.05 to 3.2 s: the logarithm of each time is as likely as of another.
        away_size, away_s = np.sqrt(np.diag(honest.covariance))
        assert away_size > 5.0 * size
        assert away_s > 0.5
