"""Estimates against the exact values of a made-up instrument: without noise, and with it."""

import numpy as np
import pytest

from rigctl.experiments.inflight.model.baseline import PRIORS, Stretch, joint_estimate
from rigctl.experiments.inflight.model.equation import coefficients
from rigctl.experiments.inflight.model.paper import FittedRun, paper_estimate
from rigctl.experiments.inflight.model.parameters import NAMES
from rigctl.experiments.inflight.observe.series import stretch_amplitudes
from rigctl.experiments.inflight.observe.sessions import Line, session_of
from rigctl.experiments.inflight.observe.weights import level_weights, weights
from rigctl.experiments.inflight.result.unseen import unseen

NOISE, STEP_S = 1.2e-12, 5.0
TOLERANCE = np.array([1e-9, 1e-9, 1e-9, 3e-6, 3e-6, 2e-7, 1e-8, 1e-8, 1.0, 1.0])
"""Of both estimates without noise; the misses of a_c12 are products of the masses' differences in rotation."""


def reduced(flight, instrument, sky, name, lines, sigma):
    columns, conditions = flight.recorded(name, instrument, sky, step_s=STEP_S)
    session = session_of(name, conditions, flight.ORBIT_S, STEP_S)
    duration_s = len(columns["t_s"]) * STEP_S
    chosen = session.reduced_lines(duration_s) if lines == "observed" else session.fitted_lines()
    frequencies = [session.frequency_of(line) for line in chosen]
    rows, level = weights(columns["t_s"], frequencies), level_weights(columns["t_s"], frequencies)
    amplitudes = stretch_amplitudes(session, columns["t_s"], columns, rows, level)
    return session, chosen, amplitudes, np.full(len(chosen), sigma / np.sqrt(duration_s))


def estimates(flight, instrument, sky, noise=1.7e-12):
    runs, stretches = {}, []
    for name in flight.SESSIONS:
        session, _, amplitudes, sigma = reduced(flight, instrument, sky, name, "fitted", noise)
        runs[name] = FittedRun(session, amplitudes, np.stack([sigma, sigma], axis=1))
        session, lines, amplitudes, sigma = reduced(flight, instrument, sky, name, "observed", noise)
        stretches.append(Stretch(name, session, lines, amplitudes, sigma, (1e-12, 1e-13)))
    return paper_estimate(runs), joint_estimate(stretches)


@pytest.mark.parametrize("seed", [0, 4])
def test_without_noise_and_coupling_every_parameter_is_the_exact_one(flight, seed):
    instrument = flight.drawn(seed, eta=0.0)
    paper, joint = estimates(flight, instrument, flight.Sky())
    exact = np.array([flight.small_signal(instrument)[name] for name in NAMES])
    assert np.all(np.abs(paper.values - exact) < TOLERANCE), paper.values - exact
    assert np.all(np.abs(joint.values[:10] - exact) < TOLERANCE), joint.values[:10] - exact
    assert paper.sweeps <= 5
    # What E10 leaves at all lines together is a small part of the noise that was assumed.
    assert joint.chi2 < 0.1 * joint.dof


@pytest.mark.parametrize("name", ["ad11", "k2c_1", "k2c_2"])
def test_what_control_leaves_along_x_leaves_the_difference_alone(flight, name):
    """Where one mass is held at zero both work at another point of their curves than where the mean is."""
    instrument = flight.drawn(7, eta=0.0)
    known = flight.small_signal(instrument)
    shared = np.array([*(known[each] for each in NAMES), *(prior[0] for prior in PRIORS.values())])
    left = []
    for residual in (1e-12, 1e-9):
        session, lines, amplitudes, _ = reduced(
            flight, instrument, flight.Sky(residual=residual), name, "observed", 1.0
        )
        at_orbit = amplitudes.table[lines.index(Line(0, 1))]
        left.append(at_orbit @ coefficients(session, amplitudes, shared[:, None])[:, 0])
    # Otherwise 2 (k_1 - k_2) m_dx of it, 1.5e-4 here.
    assert abs(left[1] - left[0]) < 2e-6 * 1e-9


def test_the_cube_of_the_stimulus_does_not_pass_for_a_difference_in_gain(flight):
    """Two parabolas leave -(k_1^2 - k_2^2) m_cx^3 in 2 m_dx: 3/8 of it, over the stimulus, would be in a_d11."""
    published, kept, passed = [], [], []
    for seed in (1, 3, 6):
        instrument = flight.drawn(seed, eta=0.0)
        paper, joint = estimates(flight, instrument, flight.Sky())
        exact = flight.small_signal(instrument)["ad11"]
        published.append(abs(paper.values[NAMES.index("ad11")] - exact))
        kept.append(abs(joint.values[NAMES.index("ad11")] - exact))
        k_1, k_2 = instrument.quadratic[:, 0] / instrument.scale[:, 0] ** 2
        passed.append(abs(0.375 * (k_1**2 - k_2**2) * 5e-8**2))
    assert max(published) < 2e-7
    assert max(kept) < 2e-7
    assert max(passed) > 5e-7


def test_a_trackers_bias_and_the_coupling_move_a_c12_and_a_c13_by_what_is_stated(flight):
    instrument = flight.drawn(5)
    s_y, s_z = 1.3e-4, -0.9e-4
    sky = flight.Sky(unseen_attitude=np.array([0.0, -s_y, -s_z]))
    paper, joint = estimates(flight, instrument, sky)
    exact = flight.small_signal(instrument)
    eta_y, eta_z = instrument.coupling[:, 1].mean(), instrument.coupling[:, 2].mean()
    for found in (paper.values, joint.values):
        assert found[3] - exact["ac12_rad"] == pytest.approx(-s_z - eta_z, abs=1.5e-5)
        assert found[4] - exact["ac13_rad"] == pytest.approx(s_y - 0.5 * eta_y, abs=1.5e-5)
        moved = _moved(joint, np.array([s_y, s_z, eta_y, eta_z]))
        # Up to 2 nm.
        assert found[:3] - [exact[name] for name in NAMES[:3]] == pytest.approx(moved[:3], abs=1e-10)


def _moved(joint, angles):
    """What the budget says of these angles."""
    ten = slice(len(NAMES))
    stated = unseen(joint.values[ten], joint.covariance[ten, ten], {})
    return sum(each.effect * angle for each, angle in zip(stated, angles, strict=True))


def test_with_noise_errors_are_as_large_as_sigma_says(flight):
    instrument = flight.drawn(2, eta=0.0)
    exact = np.array([flight.small_signal(instrument)[name] for name in NAMES])
    pulls = []
    for seed in range(4):
        sky = flight.Sky(noise=NOISE, seed=seed)
        paper, joint = estimates(flight, instrument, sky, noise=NOISE * np.sqrt(2.0))
        sigmas = np.sqrt(np.diag(joint.covariance))[: len(NAMES)]
        pulls.append([(paper.values - exact) / paper.sigmas, (joint.values[: len(NAMES)] - exact) / sigmas])
    spread = np.sqrt(np.mean(np.square(pulls), axis=(0, 2)))
    assert np.all((spread > 0.75) & (spread < 1.35)), spread


def test_without_a_session_its_parameter_is_not_given(flight):
    instrument = flight.drawn(0, eta=0.0)
    runs = {}
    for name in flight.SESSIONS:
        session, _, amplitudes, sigma = reduced(flight, instrument, flight.Sky(), name, "fitted", 1.7e-12)
        if name != "k2c_2":
            runs[name] = FittedRun(session, amplitudes, np.stack([sigma, sigma], axis=1))
    found = dict(zip(NAMES, paper_estimate(runs).values, strict=True))
    assert np.isnan(found.pop("k2c_s2_m"))
    assert np.isfinite(list(found.values())).all()
