"""A channel on a clock of its own: offset and rate from the drive's sine, with uncertainties that hold."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from rigctl.analysis.clock_fit import RATE_U, AlignedFit, fit_on_own_clock, sign_is_known
from rigctl.core.errors import DataError

HZ, REFERENCE = 0.6, -5.0j
"""The drive, and the displacement's amplitude: 5 sin(w t)."""
W = 2.0 * np.pi * HZ


def fitted(
    amplitude: float = 5.0,
    offset_s: float = 0.0,
    rate: float = 0.0,
    noise: float = 0.0,
    clock_u_s: float | None = None,
    seed: int = 1,
    second: float = 0.0,
    start_s: float = 0.02,
) -> AlignedFit:
    """A channel that sees `amplitude` sin(w t), and `second` cos(2 w t), on its own times."""
    own_s = start_s + 0.01 * np.arange(5990)
    middle_s = 0.5 * (own_s[0] + own_s[-1])
    rig_s = own_s + offset_s + rate * (own_s - middle_s)
    values = amplitude * np.sin(W * rig_s) + second * np.cos(2.0 * W * rig_s)
    values += noise * np.random.default_rng(seed).standard_normal(values.size)
    return fit_on_own_clock(own_s, values, HZ, REFERENCE, 3, clock_u_s)


@pytest.mark.parametrize("rate", [0.0, 4e-5, -1e-3])
@pytest.mark.parametrize("offset_s", [0.0, 0.013, -0.3])
@pytest.mark.parametrize("amplitude", [5.0, -5.0, 0.01])
def test_without_noise_offset_rate_and_amplitude_are_those_that_were_there(
    amplitude: float, offset_s: float, rate: float
) -> None:
    found = fitted(amplitude, offset_s, rate, second=1e-3)
    assert found.clock.offset_s == pytest.approx(offset_s, abs=1e-7 + 1e-9 / abs(amplitude))
    assert found.clock.rate == pytest.approx(rate, abs=1e-7)
    assert found.amplitudes[0] == pytest.approx(amplitude, rel=1e-6)
    # cos 2wt is -(what goes as x^2 = sin^2): turned with twice the fundamental's angle.
    assert found.amplitudes[1] == pytest.approx(-1e-3, abs=1e-8)


def test_a_record_that_begins_late_has_the_same_offset() -> None:
    early, late = (fitted(offset_s=0.01, rate=4e-5, start_s=start_s) for start_s in (0.0, 7.0))
    assert late.clock.offset_s == pytest.approx(early.clock.offset_s, abs=1e-7)


def test_uncertainties_of_offset_and_rate_are_those_that_repeats_show() -> None:
    pulls = []
    for seed in range(60):
        clock = fitted(0.5, 0.01, 3e-5, noise=0.02, seed=seed).clock
        pulls.append([(clock.offset_s - 0.01) / clock.offset_u_s, (clock.rate - 3e-5) / clock.rate_u])
    for column in np.array(pulls).T:
        # Two-sided at 1e-4 each: once in ten thousand suites by chance.
        low, high = stats.chi2(60).ppf([5e-5, 1 - 5e-5])
        assert low < np.sum(column**2) < high


def test_a_channel_that_does_not_see_the_drive_keeps_to_what_was_known_before() -> None:
    clocks = [fitted(1e-6, 0.0, 0.0, noise=0.02, clock_u_s=5e-3, seed=seed).clock for seed in range(20)]
    assert all(abs(clock.offset_s) < 2e-3 for clock in clocks)
    assert all(abs(clock.rate) < 0.5 * RATE_U for clock in clocks)
    assert clocks[0].offset_u_s == pytest.approx(5e-3, rel=0.05)


def test_the_sign_of_a_small_amplitude_is_that_of_the_times_known_before() -> None:
    for amplitude in (2e-3, -2e-3):
        for offset_s in (0.03, -0.03):
            assert fitted(amplitude, offset_s, clock_u_s=0.02).amplitudes[0].real == pytest.approx(
                amplitude, rel=1e-6
            )


def test_a_record_too_short_is_told() -> None:
    own_s = 0.01 * np.arange(100)
    with pytest.raises(DataError, match="shorter than one period"):
        fit_on_own_clock(own_s, np.sin(own_s), HZ, REFERENCE, 3)


def test_times_known_too_badly_to_tell_the_sign_are_refused() -> None:
    # A quarter of the period is 0.417 s.
    assert sign_is_known(HZ, None)
    assert sign_is_known(HZ, 0.138)
    assert not sign_is_known(HZ, 0.14)
    with pytest.raises(DataError, match=r"tell no sign at 0.6 Hz; drive it more slowly"):
        fitted(clock_u_s=0.14)
