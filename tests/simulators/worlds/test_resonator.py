"""The sensor's response against its transfer function."""

from __future__ import annotations

import math

import numpy as np
import pytest

from simulators.worlds.resonator import Ideal, Lag, Resonator, response

W0 = 2.0 * math.pi * 3.5
Q = 10.0
STEP_S = 0.01


def transfer(w: float) -> complex:
    return W0**2 / (W0**2 - w**2 + 1j * w * W0 / Q)


def driven(frequency_hz: float, duration_s: float) -> tuple[np.ndarray, np.ndarray]:
    sensor = Resonator(W0**-2, 1.0 / (W0 * Q), STEP_S)
    half_steps = 0.5 * STEP_S * np.arange(1, 2 * round(duration_s / STEP_S) + 1)
    output = sensor.advance(np.sin(2.0 * math.pi * frequency_hz * half_steps))
    return half_steps[1::2], output


@pytest.mark.parametrize(("frequency_hz", "relative"), [(0.3, 1e-8), (0.6, 1e-8), (1.0, 2e-8), (3.5, 1e-5)])
def test_a_sine_comes_out_with_the_gain_and_phase_of_the_transfer_function(
    frequency_hz: float, relative: float
) -> None:
    times_s, output = driven(frequency_hz, 60.0)
    w = 2.0 * math.pi * frequency_hz
    last = times_s > 40.0
    columns = np.stack([np.sin(w * times_s), np.cos(w * times_s)], axis=1)
    in_phase, quadrature = np.linalg.lstsq(columns[last], output[last], rcond=None)[0]
    assert abs(complex(in_phase, quadrature) / transfer(w) - 1.0) < relative


def test_it_rings_down_at_its_own_frequency_and_rate() -> None:
    sensor = Resonator(W0**-2, 1.0 / (W0 * Q), STEP_S)
    sensor.begin(1.0)
    output = sensor.advance(np.zeros(2 * 200))
    decay, turn = math.exp(-0.5 * W0 / Q * STEP_S), W0 * math.sqrt(1.0 - 0.25 / Q**2) * STEP_S
    left = output[2:] - 2.0 * decay * math.cos(turn) * output[1:-1] + decay**2 * output[:-2]
    assert np.max(np.abs(output[:20])) > 0.9
    np.testing.assert_allclose(left, 0.0, atol=1e-14)


def test_it_stays_settled_under_a_constant_force() -> None:
    sensor = Resonator(W0**-2, 1.0 / (W0 * Q), STEP_S)
    sensor.begin(0.25)
    np.testing.assert_allclose(sensor.advance(np.full(500, 0.25)), 0.25, rtol=1e-13)


def test_chunks_give_the_same_bits_as_the_whole() -> None:
    force = np.random.default_rng(1).standard_normal(2000)
    whole = response(W0**-2, 1.0 / (W0 * Q), STEP_S)
    pieces = response(W0**-2, 1.0 / (W0 * Q), STEP_S)
    cut = np.split(force, [2, 200, 206, 1500])
    np.testing.assert_array_equal(whole.advance(force), np.concatenate([pieces.advance(part) for part in cut]))


def test_without_inertia_and_damping_it_follows_at_once() -> None:
    ideal = response(0.0, 0.0, STEP_S)
    assert isinstance(ideal, Ideal)
    np.testing.assert_array_equal(ideal.advance(np.arange(6.0)), [1.0, 3.0, 5.0])


@pytest.mark.parametrize("frequency_hz", [0.3, 2.0])
def test_a_pole_turns_and_shortens_a_sine(frequency_hz: float) -> None:
    tau_s, w = 0.05, 2.0 * math.pi * frequency_hz
    half_steps = 0.5 * STEP_S * np.arange(1, 2 * round(20.0 / STEP_S) + 1)
    output = Lag(tau_s, STEP_S).advance(np.sin(w * half_steps))
    times_s = half_steps[1::2]
    last = times_s > 10.0
    columns = np.stack([np.sin(w * times_s), np.cos(w * times_s)], axis=1)
    in_phase, quadrature = np.linalg.lstsq(columns[last], output[last], rcond=None)[0]
    # A force that is quadratic within a step is missed by the fourth power of its phase in a step.
    assert abs(complex(in_phase, quadrature) * (1.0 + 1j * w * tau_s) - 1.0) < 0.1 * (w * STEP_S) ** 4 + 1e-9
