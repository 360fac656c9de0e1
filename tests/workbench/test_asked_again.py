"""A model asked twice in a row at the same values works once, and never answers for another or for elsewhere."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from rigctl.core.arrays import FloatArray
from rigctl.workbench.asked_again import once_in_a_row


@dataclass(eq=False)
class Scaled:
    by: float
    worked: list[float] = field(default_factory=list)

    @once_in_a_row
    def jacobian(self, values: FloatArray) -> FloatArray:
        self.worked.append(float(values[0]))
        return self.by * values


def test_asked_again_at_the_same_values_it_works_once() -> None:
    model = Scaled(2.0)
    for value in (1.0, 1.0, 3.0, 3.0, 1.0):
        assert model.jacobian(np.array([value])) == pytest.approx(2.0 * value)
    assert model.worked == [1.0, 3.0, 1.0]


def test_another_model_answers_for_itself() -> None:
    one, other = Scaled(2.0), Scaled(5.0)
    at = np.array([1.5])
    assert [float(model.jacobian(at)[0]) for model in (one, other, one)] == [3.0, 7.5, 3.0]


def test_a_model_in_the_place_of_one_that_is_gone_answers_for_itself() -> None:
    at = np.array([1.5])
    for by in range(100):
        # Each takes the memory of the one before.
        assert float(Scaled(float(by)).jacobian(at)[0]) == 1.5 * by


def test_values_that_were_changed_in_place_are_others() -> None:
    model, values = Scaled(2.0), np.array([1.0])
    assert float(model.jacobian(values)[0]) == 2.0
    values[0] = 4.0
    assert float(model.jacobian(values)[0]) == 8.0


def test_what_is_kept_cannot_be_written_to() -> None:
    with pytest.raises(ValueError, match="read-only"):
        Scaled(2.0).jacobian(np.array([1.0]))[0] = 0.0
