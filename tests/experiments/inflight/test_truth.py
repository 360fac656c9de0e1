"""What the paper's first-order forms leave out, for the ensemble that is simulated."""

import numpy as np
import pytest

from rigctl.experiments.inflight.model.parameters import NAMES, of_masses
from simulators.worlds.satellite.instrument import drawn, exact_truth, paper_truth
from simulators.worlds.satellite.settings import SatelliteSettings

SETTINGS = SatelliteSettings(kind="drag-free-satellite", seed=11)


def values(truth):
    return np.array([truth[name] for name in NAMES])


def test_exact_truth_is_what_the_small_signal_response_says(flight):
    """The simulator's arithmetic against that of these tests, which linearise another instrument's equations."""
    one = drawn(SETTINGS, 3)
    same = flight.Instrument(
        one.delta_m,
        one.scale,
        one.theta_rad,
        one.eta_rad,
        one.quadratic_s2_m,
        one.parasitic_m_s2,
        one.bias_m_s2,
    )
    expected = values(flight.small_signal(same))
    # Beside the parasitic forces the gradient holds the masses apart: 1e-11 of 1e-8 m/s2.
    assert values(exact_truth(one, SETTINGS)) == pytest.approx(expected, rel=2e-5)


def test_truncation_alone_lands_on_the_published_spread():
    """4000 draws: mean, standard deviation and median worst of 100 of |paper truth - exact truth|."""
    errors = []
    for draw in range(4000):
        instrument = drawn(SETTINGS, draw)
        errors.append(np.abs(values(paper_truth(instrument)) - values(exact_truth(instrument, SETTINGS))))
    found = dict(zip(NAMES, np.array(errors).T, strict=True))
    for name, mean, std, worst in [
        ("ad11", 1.5e-6, 1.5e-6, 7.8e-6),
        ("ad12_rad", 2.8e-7, 2.6e-7, 1.3e-6),
        ("ad13_rad", 2.8e-7, 2.6e-7, 1.3e-6),
        ("k2d_s2_m", 34.0, 31.0, 123.0),
        ("k2c_s2_m", 68.0, 61.0, 245.0),
    ]:
        own = found[name]
        assert own.mean() == pytest.approx(mean, rel=0.06)
        assert own.std() == pytest.approx(std, rel=0.08)
        assert np.median(own.reshape(-1, 100).max(axis=1)) == pytest.approx(worst, rel=0.12)


def test_masses_quadratic_factors_give_back_the_pair():
    a, k2d, k2c = 8e-3, 3000.0, -9000.0
    k_1, k_2 = of_masses(k2d, k2c, a)
    assert 0.5 * (1 - a**2) * ((1 + a) * k_1 - (1 - a) * k_2) == pytest.approx(k2d, rel=1e-12)
    assert 0.5 * (k_1 + k_2) == pytest.approx(k2c, rel=1e-12)
