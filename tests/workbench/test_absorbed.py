"""Which of parameters that imitate each other is held, whatever the last digit of their derivatives."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rigctl.analysis.least_squares import Parameter
from rigctl.workbench.study import Term
from rigctl.workbench.verdict.absorbed import absorbed_parameters
from rigctl.workbench.verdict.fitted_model import stated_noise
from tests.workbench.conftest import LinearModel


@pytest.mark.parametrize("delay_first", [True, False])
def test_an_effect_with_another_part_gives_way_whatever_the_last_digit(made_up: Any, delay_first: bool) -> None:
    rng = np.random.default_rng(1)
    given = made_up.observations(rng.normal(size=3 * len(made_up.observations(np.zeros(0)).run_ids)))
    level, alike, other = rng.normal(size=(3, len(given.value)))
    delay, resonance = [("tau", "time-skew")], [("damping", "resonance"), ("inv_w0_squared", "resonance")]
    names = [("level", ""), *(delay + resonance if delay_first else resonance + delay)]
    for _ in range(30):
        columns = {"level": level, "inv_w0_squared": other}
        for name in ("tau", "damping"):
            columns[name] = alike * (1.0 + 2e-16 * rng.integers(-2, 3, len(alike)))
        model = LinearModel(
            given,
            (Term("time-skew"), Term("resonance")),
            [Parameter(name, 0.0) for name, _ in names],
            ["1"] * len(names),
            [owner for _, owner in names],
            np.stack([columns[name] for name, _ in names], axis=1),
        )
        assert absorbed_parameters(model, stated_noise(model), frozenset(), {}) == {"damping"}
