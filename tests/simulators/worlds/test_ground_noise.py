"""The ground's spectrum, measured."""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import welch

from simulators.worlds.bench_settings import GroundNoiseSettings
from simulators.worlds.ground_noise import GroundNoise

STEP_S = 0.01
DEFAULT = GroundNoiseSettings()
NO_BUMP = GroundNoiseSettings(bump_asd_m_s2_rthz=0.0)
ONLY_BUMP = GroundNoiseSettings(asd_m_s2_rthz=0.0)


def stream(settings: GroundNoiseSettings, seed: int = 3) -> GroundNoise:
    return GroundNoise(settings, STEP_S, np.random.default_rng(seed))


def density(settings: GroundNoiseSettings, resolution_s: float) -> tuple[np.ndarray, np.ndarray, int]:
    """Frequencies, one-sided density averaged over components, and the number of averages."""
    rows = stream(settings).take(600_000)
    frequencies, psd = welch(rows, fs=1.0 / STEP_S, nperseg=round(resolution_s / STEP_S), axis=0)
    return frequencies, psd.mean(axis=1), 3 * round(600_000 * STEP_S / resolution_s)


def test_the_white_level_is_what_was_asked_for() -> None:
    frequencies, psd, averages = density(NO_BUMP, 20.0)
    band = (frequencies > 0.1) & (frequencies < 40.0)
    assert abs(psd[band].mean() / 1e-12 - 1.0) < 5.0 / math.sqrt(averages * band.sum())


def test_the_bump_has_its_frequency_height_and_width() -> None:
    frequencies, psd, averages = density(ONLY_BUMP, 200.0)
    peak = DEFAULT.bump_asd_m_s2_rthz**2
    near = np.abs(frequencies - 0.2) < 0.004
    assert abs(psd[near].mean() / peak - 1.0) < 0.05 + 5.0 / math.sqrt(averages * near.sum())
    variance = np.sum(psd) * (frequencies[1] - frequencies[0])
    # |H|^4 of a Lorentzian of half width d has area pi d / 2; its own half width is d sqrt(sqrt(2) - 1).
    half_width = 0.5 * DEFAULT.bump_width_hz / math.sqrt(math.sqrt(2.0) - 1.0)
    cycles = 6000.0 * DEFAULT.bump_width_hz
    assert abs(variance / (peak * math.pi * half_width / 2.0) - 1.0) < 5.0 / math.sqrt(3 * cycles)


def test_from_0p3_hz_up_the_bump_adds_less_than_five_per_cent() -> None:
    frequencies, psd, averages = density(DEFAULT, 100.0)
    for drive_hz in (0.3, 0.5, 0.6):
        near = np.abs(frequencies - drive_hz) < 0.025
        statistics = 5.0 / math.sqrt(averages * near.sum())
        assert abs(math.sqrt(psd[near].mean()) / 1e-6 - 1.0) < 0.05 + 0.5 * statistics


def test_it_is_stationary_from_the_first_row() -> None:
    first = np.array([stream(ONLY_BUMP, seed).take(1)[0] for seed in range(300)])
    later = stream(ONLY_BUMP).take(600_000)
    assert abs(first.var() / later.var() - 1.0) < 5.0 * math.sqrt(2.0 / 900) + 0.2


def test_components_are_independent() -> None:
    rows = stream(NO_BUMP).take(20_000)
    correlation = np.corrcoef(rows.T)[np.triu_indices(3, 1)]
    assert np.max(np.abs(correlation)) < 5.0 / math.sqrt(20_000)


def test_rows_do_not_depend_on_how_many_are_taken_at_a_time() -> None:
    whole, pieces = stream(DEFAULT), stream(DEFAULT)
    taken = np.concatenate([pieces.take(n) for n in (1, 99, 700, 3, 1197)])
    np.testing.assert_array_equal(whole.take(2000), taken)
