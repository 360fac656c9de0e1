"""Read-out noise that comes in where 200 s are dropped: told from a single recording as from a known spectrum."""

import numpy as np
import pytest

from rigctl.experiments.inflight.model.observed import observed, run_noises
from rigctl.experiments.inflight.observe.edge import fast_noise
from rigctl.experiments.inflight.observe.reduction import reduce_run
from rigctl.experiments.inflight.observe.weights import response, weights

STEP_S = 0.5
WHITE, BLUE = 1.2e-12, 1e-9
"""Density of one sensor [m/s2/sqrt(Hz)]; second differences of noise of this standard deviation [m/s2]."""


def density(f_hz):
    """Of m_1 - m_2, one-sided."""
    return 2.0 * (WHITE**2 + 2.0 * STEP_S * BLUE**2 * (2.0 * np.sin(np.pi * f_hz * STEP_S)) ** 4)


def test_a_single_recording_tells_what_comes_in_at_the_edge(flight):
    instrument = flight.drawn(5, eta=0.0)
    samples, conditions = flight.recorded(
        "dx+dz", instrument, flight.Sky(noise=WHITE, blue=BLUE, seed=2), step_s=STEP_S
    )
    run = reduce_run("a", conditions, samples, flight.ORBIT_S)
    (fitted,) = observed([run]).fitted_runs().values()
    rows = weights(samples["t_s"], [run.session.frequency_of(line) for line in run.whole.lines])
    expected = np.array([response(row, STEP_S, density) for row in rows]).reshape(-1, 2)
    of_the_line = np.sqrt(density(np.array([run.session.frequency_of(line) for line in run.whole.lines])))
    alone = of_the_line * run.whole.spread
    # The edge matters here, or nothing would be tested.
    assert np.max(expected[:, 0] / alone) > 2.0
    # What enters there is known by thousands of bins, the density at the line by the bins between the lines.
    at_line = np.sqrt(run_noises([run], observed([run]).values)[0].dof / 2.0)
    share = np.max(alone / expected[:, 0]) ** 2
    assert fitted.sigma[:, 0] == pytest.approx(expected[:, 0], rel=0.02 + 4.0 * share / at_line, abs=0.0)
    assert fitted.sigma[:, 1] == pytest.approx(expected[:, 1], rel=4.0 / at_line, abs=0.0)


def test_stimuli_are_no_noise():
    """A line of ten thousand times the noise, below where noise counts as fast, leaves nothing there."""
    t_s = STEP_S * np.arange(119000)
    rows = weights(t_s, [73 / 59500.0])
    quiet = dict.fromkeys(("m1_y", "m2_y", "m1_z", "m2_z"), np.zeros(len(t_s)))
    noise = WHITE / np.sqrt(2.0 * STEP_S) * np.random.default_rng(1).standard_normal((2, len(t_s)))
    line = 5e-8 * np.cos(2.0 * np.pi * 73 / 59500.0 * t_s)
    with_line, without = (
        fast_noise(rows, {"m1_x": noise[0] + each, "m2_x": noise[1], **quiet}, STEP_S, 73 / 59500.0)[:, 0, 0]
        for each in (line, 0.0)
    )
    assert with_line == pytest.approx(without, rel=0.02, abs=0.0)


def test_samples_too_slow_tell_nothing():
    rows = weights(8.0 * np.arange(7000), [0.01])
    columns = dict.fromkeys(("m1_x", "m2_x", "m1_y", "m2_y", "m1_z", "m2_z"), np.ones(7000))
    assert not fast_noise(rows, columns, 60.0, 0.01).any()
