"""What the paper's first-order forms leave out, and that exact values are the derivatives they claim to be."""

import numpy as np
import pytest

from rigctl.experiments.inflight.parameters import NAMES, of_masses
from rigctl.experiments.inflight.truth import Instrument, exact_truth, paper_truth


def known(drawn):
    return Instrument(
        drawn.off_centring, drawn.scale, drawn.rotation, drawn.coupling, drawn.quadratic, drawn.parasitic, drawn.bias
    )


def test_exact_truth_is_what_the_small_signal_response_says(flight):
    drawn = flight.drawn(3)
    expected = flight.small_signal(drawn)
    assert exact_truth(known(drawn)) == pytest.approx([expected[name] for name in NAMES], rel=1e-9)


def test_truncation_alone_lands_on_the_published_spread(flight):
    """4000 draws: mean, standard deviation and median worst of 100 of |paper truth - exact truth|."""
    errors = []
    for seed in range(4000):
        instrument = known(flight.drawn(seed))
        errors.append(np.abs(paper_truth(instrument) - exact_truth(instrument)))
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
