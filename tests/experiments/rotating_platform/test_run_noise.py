import numpy as np
import pytest

from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.observe.patterns import named_pattern
from rigctl.experiments.rotating_platform.observe.run_noise import Scatter, likelihood, run_noise

NO_BINS = Scatter(np.zeros((0, 600)), np.zeros(0), np.zeros(0))


def test_a_run_that_is_fitted_to_its_last_number_tells_nothing_of_its_noise():
    sampled = named_pattern("a", 60.0).sampled(10.0)
    rounding = 1e-19 * np.random.default_rng(1).standard_normal((4, 2))
    nothing = likelihood(sampled, 1, rounding, 8, NO_BINS)
    assert nothing.transforms == 0.0
    with pytest.raises(DataError, match="too short to tell their noise"):
        run_noise(nothing, [], 60.0)
    something = likelihood(sampled, 1, 1e-6 * np.random.default_rng(2).standard_normal((4, 2)), 6, NO_BINS)
    assert run_noise(nothing, [something], 60.0).white > 0.0
