"""The platform's coloured noise: its density from microhertz to Nyquist, and that it is one however it is taken."""

import itertools
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import sosfreqz
from scipy.stats import chi2, norm

from rigctl.core.arrays import FloatArray
from simulators.worlds.platform_noise import BLOCK, NoiseStream, PowerLaw, RisingNoise, shape

WHITE, RED, EXPONENT = 3.1925e-5, 9.052e-8, 1.6384
CHAIN = PowerLaw(WHITE, RED, EXPONENT)
RISING = RisingNoise(4.5e-16, 0.2, 100.0)
LONG = 1 << 22
RATE_HZ = 10.0


def two_sided(frequency_hz: FloatArray) -> FloatArray:
    """Eq. 1 of Lenoir et al. 2013 [V^2/Hz]."""
    return WHITE + RED / frequency_hz**EXPONENT


def filtered(density: PowerLaw | RisingNoise, rate_hz: float, frequency_hz: FloatArray) -> FloatArray:
    """The density the filter stands for, two-sided."""
    made = shape(density, rate_hz)
    _, response = sosfreqz(made.sections, worN=frequency_hz, fs=rate_hz)
    return np.asarray(np.abs(response) ** 2 * made.rms**2 / rate_hz)


@pytest.fixture(scope="module")
def periodogram() -> tuple[FloatArray, FloatArray]:
    """Five days at 10 Hz: frequencies, and the Hann periodogram over what eq. 1 lets expect (1 on average)."""
    record = NoiseStream(CHAIN, RATE_HZ, 7, "long").take(LONG)
    window = np.hanning(LONG + 1)[:-1]
    frequency_hz = np.arange(1, LONG // 2) * RATE_HZ / LONG
    power = np.abs(np.fft.rfft(window * record)[1:-1]) ** 2 / (RATE_HZ * np.sum(window**2))
    return frequency_hz, power / two_sided(frequency_hz)


@pytest.mark.parametrize("rate_hz", [10.0, 100.0, 200.0])
def test_the_filter_is_eq_1_from_a_microhertz_to_nyquist(rate_hz: float) -> None:
    frequency_hz = np.geomspace(1e-6, 0.4999 * rate_hz, 3000)
    made = filtered(CHAIN, rate_hz, frequency_hz)
    assert made == pytest.approx(two_sided(frequency_hz), rel=5e-4)


def test_below_the_knee_it_levels_off() -> None:
    made = filtered(CHAIN, RATE_HZ, np.array([1e-10, 1e-9, 1e-8]))
    assert made[0] == pytest.approx(made[2], rel=0.03)
    assert made[0] < two_sided(np.array([3e-8]))[0]


def test_five_days_have_the_density_of_eq_1_over_five_decades(periodogram: tuple[FloatArray, FloatArray]) -> None:
    frequency_hz, ratio = periodogram
    edges = np.unique(np.geomspace(8, len(ratio), 70).astype(int))
    assert frequency_hz[-1] / frequency_hz[edges[0]] > 1e5
    scores = []
    for low, high in itertools.pairwise(edges):
        # Neighbours of a Hann periodogram are correlated, 4/9 and 1/36: a mean of n has the variance 1.944/n.
        scores.append((ratio[low:high].mean() - 1.0) / np.sqrt(1.944 / (high - low)))
    wide = np.array([score for score, low in zip(scores, edges, strict=False) if low > 300])
    assert len(wide) > 40
    assert 1e-3 < chi2.sf(np.sum(wide**2), len(wide)) < 1.0 - 1e-3
    # Few bins make a skewed mean: the lowest decades only have to be possible.
    assert np.abs(scores).max() < 5.0
    tilt = np.polyfit(np.log10(edges[:-1]), scores, 1)[0]
    assert abs(tilt) < 4.0 / np.sqrt(np.sum((np.log10(edges[:-1]) - np.log10(edges[:-1]).mean()) ** 2))


def test_there_is_no_line_in_it(periodogram: tuple[FloatArray, FloatArray]) -> None:
    _, ratio = periodogram
    apart = ratio[20::3]
    assert apart.max() < np.log(len(apart)) + 7.0


def test_no_block_is_like_another() -> None:
    record = NoiseStream(PowerLaw(1.0, 0.0, 1.5), RATE_HZ, 3).take(64 * BLOCK).reshape(64, BLOCK)
    likeness = np.corrcoef(record)[np.triu_indices(64, 1)] * np.sqrt(BLOCK)
    assert np.abs(likeness).max() < norm.isf(1e-6 / len(likeness))
    assert likeness.std() == pytest.approx(1.0, rel=0.1)


@settings(max_examples=20, deadline=None)
@given(st.lists(st.integers(0, 3 * BLOCK), max_size=6))
def test_it_does_not_depend_on_how_it_is_taken(counts: list[int]) -> None:
    whole = NoiseStream(CHAIN, 200.0, 1, "a").take(sum(counts))
    stream = NoiseStream(CHAIN, 200.0, 1, "a")
    parts = [stream.take(count) for count in counts]
    assert [len(part) for part in parts] == counts
    assert np.array_equal(np.concatenate([np.empty(0), *parts]), whole)


def test_it_depends_on_its_key_alone() -> None:
    first, again, other, seed = (
        NoiseStream(CHAIN, RATE_HZ, *key).take(1000) for key in ((1, "a"), (1, "a"), (1, "b"), (2, "a"))
    )
    assert np.array_equal(first, again)
    for another in (other, seed):
        assert abs(np.corrcoef(first, another)[0, 1]) < 0.5
        assert not np.any(first == another)


def test_memory_does_not_grow_with_the_record() -> None:
    def peak_bytes(samples: int) -> int:
        stream = NoiseStream(CHAIN, RATE_HZ, 5)
        stream.take(1)
        tracemalloc.start()
        for _ in range(samples // 1000):
            stream.take(1000)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak

    short, long = peak_bytes(100_000), peak_bytes(1_000_000)
    assert long < 1.2 * short
    assert long < 8 * BLOCK * 8


def test_it_is_stationary_from_the_first_sample() -> None:
    """Differences over 10 s and over 2.7 h spread as much at the beginning as an hour later."""
    rate_hz, lags, later = 0.1, (1, 1000), 360
    streams = np.array([NoiseStream(CHAIN, rate_hz, 11, n).take(later + 1001) for n in range(1500)])
    for lag in lags:
        at_first, then = (np.mean((streams[:, k + lag] - streams[:, k]) ** 2) for k in (0, later))
        frequency_hz = (np.arange(400_000) + 0.5) * 0.5 * rate_hz / 400_000
        expected = 2.0 * np.sum(two_sided(frequency_hz) * 4.0 * np.sin(np.pi * frequency_hz * lag / rate_hz) ** 2)
        expected *= 0.5 * rate_hz / 400_000
        # A variance of 1500 numbers is known to 3.7 %.
        assert at_first == pytest.approx(expected, rel=0.15)
        assert then == pytest.approx(expected, rel=0.15)


def test_where_there_is_next_to_nothing_red_it_is_white() -> None:
    frequency_hz = np.geomspace(1e-6, 4.99, 300)
    for red in (0.0, 1e-14, 1e-12):
        made = filtered(PowerLaw(2.0, red, 1.5), RATE_HZ, frequency_hz)
        assert made == pytest.approx(2.0 + red * frequency_hz**-1.5, rel=5e-4)


def test_from_zero_takes_the_level_off_and_nothing_else() -> None:
    levels, starts = [], []
    for number in range(200):
        free = NoiseStream(CHAIN, RATE_HZ, 4, number).take(300)
        tied = NoiseStream(CHAIN, RATE_HZ, 4, number, from_zero=True).take(300)
        assert np.ptp(free - tied) < 1e-12
        levels.append(free.mean())
        starts.append(tied.mean())
    assert np.std(levels) > 0.05
    assert np.std(starts) < 5e-3


def test_the_pendulums_noise_rises_by_its_cap() -> None:
    frequency_hz = np.array([1e-4, 0.02, 0.2, 40.0])
    amplitude = np.sqrt(2.0 * filtered(RISING, 100.0, frequency_hz))
    assert amplitude[:3] == pytest.approx([3e-8, 3.03e-8, 5.94e-8], rel=0.01)
    assert 2e-6 < amplitude[3] < 3e-6
    record = NoiseStream(RISING, RATE_HZ, 1).take(1 << 18)
    low = np.abs(np.fft.rfft(record * np.hanning(len(record))))[20:2000] ** 2
    assert np.mean(low) / (RATE_HZ * 0.375 * len(record)) == pytest.approx(4.5e-16, rel=0.15)
