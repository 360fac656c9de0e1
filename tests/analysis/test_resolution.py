"""The step of a channel is found however fast its signal is, and bounds what a fit of it can know."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.analysis.resolution import amplitude_floor, quantum
from rigctl.analysis.sine_fit import HarmonicBasis


@given(
    step=st.floats(1e-9, 1e-2),
    steps=st.floats(20.0, 1e5),
    offset=st.floats(-1e5, 1e5),
    seed=st.integers(0, 2**32 - 1),
)
def test_the_step_is_found_though_no_two_samples_are_one_apart(
    step: float, steps: float, offset: float, seed: int
) -> None:
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, 500)
    counts = np.rint(steps * np.sin(phases) + offset)
    assert quantum(counts * step) == pytest.approx(step, rel=1e-3)


@given(seed=st.integers(0, 2**32 - 1), size=st.floats(1e-9, 1e3))
def test_a_channel_that_counts_in_nothing_has_the_step_of_floats(seed: int, size: float) -> None:
    samples = size * np.random.default_rng(seed).standard_normal(500)
    assert quantum(samples) == np.spacing(np.abs(samples).max())


def test_a_handful_of_values_is_counted_by_their_smallest_difference() -> None:
    assert quantum(np.tile([0.1, 0.1, 0.2, 0.4], 50)) == pytest.approx(0.1)


def test_one_that_never_changes_tells_nothing_finer_than_floats() -> None:
    assert quantum(np.full(100, 3e-9)) == np.spacing(1.0)


@pytest.mark.parametrize("rate_hz", [50.0, 47.3, 200.0])
@pytest.mark.parametrize("largest_m", [4e-7, 5e-3])
def test_without_noise_the_floor_covers_what_rounding_does_to_an_amplitude(rate_hz: float, largest_m: float) -> None:
    """A head of 100 nm that sees millimetres, always at the same phases: its spectrum shows next to nothing."""
    rng = np.random.default_rng(7)
    step, pulls = 1e-7, []
    t_s = np.arange(round(40.0 * rate_hz)) / rate_hz
    basis = HarmonicBasis(t_s, 0.5, 3)
    for _ in range(60):
        amplitude, phase = rng.uniform(1e-7, largest_m), rng.uniform(0.0, 2.0 * np.pi)
        truth = amplitude * np.sin(2.0 * np.pi * 0.5 * t_s + phase)
        fit = basis.fit(np.rint(truth / step) * step)
        errors = fit.amplitudes - basis.fit(truth).amplitudes
        sigmas = np.sqrt(amplitude_floor(np.rint(truth / step) * step, fit.residuals, basis)[1:])
        pulls += [*(errors.real / sigmas), *(errors.imag / sigmas)]
    # Their rms is at most 1 but for its own scatter, and none is a discovery.
    assert np.sqrt(np.mean(np.square(pulls))) < 1.0 + 3.0 / np.sqrt(2.0 * len(pulls))
    assert np.max(np.abs(pulls)) < 4.5
