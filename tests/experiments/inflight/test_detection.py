"""Densities, peaks, averages and filters against those of scipy.signal, which the program does without."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from rigctl.experiments.inflight.observe.detection import SPECTRUM_S, density_of, peaks_of
from rigctl.experiments.inflight.observe.grid import Grid, bell, thinned
from rigctl.experiments.inflight.observe.published import band_pass

STEP_S = 0.25


@pytest.mark.parametrize("count", [701, 4096, 6000, 40_001])
def test_the_density_is_welchs_with_a_median(count: int) -> None:
    series = np.random.default_rng(count).standard_normal(count).cumsum()
    present = np.arange(count) % 5 > 0
    series[~present] = 0.0
    f_hz, density = density_of(series, present, STEP_S)
    length = min(round(SPECTRUM_S / STEP_S), count)
    expected_hz, expected = signal.welch(series, 1.0 / STEP_S, nperseg=length, average="median")
    np.testing.assert_allclose(f_hz, expected_hz, rtol=1e-14)
    np.testing.assert_allclose(density, expected / present.mean(), rtol=1e-10)


@given(st.integers(3, 400), st.integers(1, 50), st.floats(0.0, 2.5), st.integers(0, 2**32 - 1))
def test_peaks_are_the_highest_of_those_that_lie_together(
    count: int, apart: int, threshold: float, seed: int
) -> None:
    sigmas = np.abs(np.random.default_rng(seed).standard_normal(count))
    expected, _ = signal.find_peaks(sigmas, height=threshold, distance=apart)
    np.testing.assert_array_equal(peaks_of(sigmas, threshold, apart), expected)


@given(st.integers(1, 20), st.integers(0, 500), st.integers(0, 2**32 - 1))
def test_what_is_thinned_is_under_the_bell(every: int, more: int, seed: int) -> None:
    count = 12 * every + 8 + more
    column = np.random.default_rng(seed).standard_normal(count)
    grid = Grid(STEP_S * np.arange(count), {"m1_x": column}, np.ones(count, dtype=bool))
    thin = thinned(grid, every * STEP_S)
    kernel = bell(STEP_S, every * STEP_S)
    whole = np.convolve(column, kernel, mode="valid")
    # Only where the bell has met samples at all places; the first such is a whole number of steps into it.
    first = -(len(kernel) - 1) % every
    np.testing.assert_allclose(thin.columns["m1_x"], whole[first::every], rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(
        thin.t_s, STEP_S * (first + every * np.arange(len(thin.t_s)) + 0.5 * (len(kernel) - 1)), atol=1e-9
    )


@pytest.mark.parametrize("highest_hz", [4e-3, 0.3, 0.89])
def test_the_band_pass_is_that_of_butterworth(highest_hz: float) -> None:
    f_hz = np.array([1e-4, 2e-4, 1e-3, 0.02, 0.4, 1.3])
    chain = band_pass(2e-4, highest_hz, 1.0 / STEP_S)
    zeros, poles, gain = signal.butter(2, 1e-4, "highpass", fs=1.0 / STEP_S, output="zpk")
    _, expected = signal.freqz_zpk(zeros, poles, gain, f_hz, fs=1.0 / STEP_S)
    if 2.0 * highest_hz < 0.45 / STEP_S:
        zeros, poles, gain = signal.butter(2, 2.0 * highest_hz, "lowpass", fs=1.0 / STEP_S, output="zpk")
        expected = expected * signal.freqz_zpk(zeros, poles, gain, f_hz, fs=1.0 / STEP_S)[1]
    # Poles that are 1e-4 from 1 are known to 1e-12 of that.
    np.testing.assert_allclose(chain.response(2j * np.pi * f_hz * STEP_S), expected, rtol=1e-11)
