"""A fit that may have several minima ends in the best of those that are known."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from rigctl.analysis.least_squares import Parameter
from rigctl.core.arrays import FloatArray
from rigctl.workbench.other_minima import OtherMinimum
from rigctl.workbench.verdict.fitted_model import _of_the_best_minimum
from rigctl.workbench.verdict.noise import Noise
from rigctl.workbench.verdict.whitened_fit import whitened_least_squares


class Mirrored:
    """y = (a^2, 0.1 (a + 1), b): both a = 1 and a = -1 are minima, the second is deeper. While a is positive another
    value of b is said to be worth a look."""

    observations = SimpleNamespace(value=np.array([1.0, 0.0, 2.0]))

    def predict(self, values: FloatArray) -> FloatArray:
        a, b = values
        return np.array([a**2, 0.1 * (a + 1.0), b])

    def jacobian(self, values: FloatArray) -> FloatArray:
        return np.array([[2.0 * values[0], 0.0], [0.1, 0.0], [0.0, 1.0]])

    def elsewhere(self, values: FloatArray) -> list[OtherMinimum]:
        a, b = map(float, values)
        beside = [OtherMinimum({1: b + 5.0}, 1, likelier=False)] if a > 0.0 else []
        return [OtherMinimum({0: -a}, 0, likelier=False), *beside]


def test_a_minimum_that_is_gone_where_the_fit_has_moved_is_passed_over() -> None:
    noise = Noise(np.full(3, 0.01), np.full(3, np.inf), (), ())
    parameters = [Parameter("a", 0.9), Parameter("b", 0.0)]
    model = Mirrored()
    found = whitened_least_squares(model, noise, parameters)  # type: ignore[arg-type]
    assert found.values[0] > 0.0
    best = _of_the_best_minimum(model, noise, parameters, found)  # type: ignore[arg-type]
    assert best.values == pytest.approx([-1.0, 2.0])
