"""What is drawn, and what a calibration should find: the truths, and how far the paper's formulas are from exact."""

from __future__ import annotations

import numpy as np
import pytest

from simulators.worlds.satellite.instrument import drawn, operating_point, truths
from tests.simulators.worlds.satellite.flights import Flown, quiet

SETTINGS = quiet()
DRAWS = 4000

# Of paper less exact truth: mean, standard deviation, median of the worst of 100.
TRUNCATION = {
    "ad11": (1.5e-6, 1.5e-6, 7.8e-6),
    "ad12_rad": (2.8e-7, 2.6e-7, 1.3e-6),
    "ad13_rad": (2.8e-7, 2.6e-7, 1.3e-6),
    "k2d_s2_m": (34.0, 31.0, 123.0),
    "k2c_s2_m": (68.0, 61.0, 245.0),
}


@pytest.fixture(scope="module")
def differences() -> dict[str, np.ndarray]:
    both = [truths(SETTINGS, draw) for draw in range(DRAWS)]
    return {
        name: np.abs([one["paper_truth"][name] - one["exact_truth"][name] for one in both])
        for name in both[0]["exact_truth"]
    }


@pytest.mark.parametrize("name", TRUNCATION)
def test_what_the_paper_s_formulas_leave_out_has_the_size_of_its_table_2(
    differences: dict[str, np.ndarray], name: str
) -> None:
    found = differences[name]
    worst = np.median(found.reshape(-1, 100).max(axis=1))
    assert (found.mean(), found.std(), worst) == pytest.approx(TRUNCATION[name], rel=0.12)


def test_a_draw_is_a_function_of_seed_and_number() -> None:
    assert np.array_equal(drawn(SETTINGS, 3).scale, drawn(SETTINGS, 3).scale)
    assert not np.array_equal(drawn(SETTINGS, 3).scale, drawn(SETTINGS, 4).scale)
    assert not np.array_equal(drawn(SETTINGS, 3).scale, drawn(quiet(seed=18), 3).scale)


def test_what_is_drawn_fills_its_bounds() -> None:
    many = [drawn(SETTINGS, draw) for draw in range(1000)]
    for values, bound in (
        ([one.delta_m for one in many], 20e-6),
        ([one.centre_m for one in many], 2e-3),
        ([0.5 * (one.theta_rad[0] + one.theta_rad[1]) for one in many], 2.5e-3),
        ([0.5 * (one.theta_rad[0] - one.theta_rad[1]) for one in many], 1.5e-3),
        ([0.5 * (one.parasitic_m_s2[0] - one.parasitic_m_s2[1]) for one in many], 1.4e-8),
    ):
        assert 0.99 * bound < np.abs(values).max() <= bound
        assert np.std(values) == pytest.approx(bound / np.sqrt(3.0), rel=0.05)


def test_the_loop_holds_the_masses_where_the_truth_takes_them_to_be(at_rest: Flown) -> None:
    """From what is measured follows what is applied: the exact truth's operating point."""
    for draw in range(3):
        instrument = drawn(SETTINGS, draw)
        applied = operating_point(instrument, SETTINGS)
        for k, matrix in enumerate(instrument.matrices):
            parasitic = instrument.parasitic_m_s2[k]
            expected = (
                instrument.bias_m_s2[k]
                + matrix @ (applied[k] - parasitic)
                + instrument.couplings[k] @ parasitic
                + instrument.quadratic_s2_m[k] * applied[k] ** 2
            )
            measured = [at_rest.column(f"m{k + 1}_{axis}", draw).mean() for axis in "xyz"]
            assert measured == pytest.approx(expected, abs=2e-12)
