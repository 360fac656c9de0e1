"""Lines that are there are found, and bumps, red and heavy-tailed noise are none."""

import numpy as np
import pytest
from scipy import stats

from rigctl.analysis.kept import Packed
from rigctl.analysis.line_scan import LineScan, scanned
from rigctl.analysis.lines import find_lines, p_of_alike_powers
from rigctl.analysis.noise import spectrum
from rigctl.analysis.sine_fit import HarmonicBasis

PERIOD_S, SAMPLES = 0.05, 800
DURATION_S = SAMPLES * PERIOD_S
BASES = {
    (samples, nu): HarmonicBasis(np.arange(samples) * PERIOD_S, nu)
    for samples in (600, SAMPLES)
    for nu in (0.3, 0.5, 0.6)
}


def white(rng, n):
    return coloured(rng, n, np.ones_like)


def red(rng, n):
    return coloured(rng, n, lambda f: 0.1 + np.maximum(f, 1e-4) ** -1.64)


def microseism(rng, n):
    return coloured(rng, n, lambda f: 1.0 + 50.0 / (1.0 + ((f - 0.4) / 0.02) ** 2) ** 2)


def heavy_tails(rng, n):
    return rng.standard_t(4, n)


def coloured(rng, n, density):
    f = np.fft.rfftfreq(8 * n, PERIOD_S)
    s = density(f)
    s[0] = 0.0
    z = (rng.normal(size=f.size) + 1j * rng.normal(size=f.size)) * np.sqrt(s * 8 * n / (4 * PERIOD_S))
    return np.fft.irfft(z, 8 * n)[:n]


def scan_of(rng, noise, runs=40, line=None, samples=SAMPLES):
    scan = LineScan()
    for k in range(runs):
        scan.add(*part(rng, noise, k, line, samples))
    return scan


def part(rng, noise, k, line=None, samples=SAMPLES):
    basis = BASES[samples, (0.3, 0.5, 0.6)[k % 3]]
    x = noise(rng, samples)
    if line is not None:
        frequency_hz, amplitude = line
        x = x + amplitude * np.cos(2 * np.pi * frequency_hz * basis.t_s + rng.uniform(0, 2 * np.pi))
    residuals = basis.fit(x).residuals
    run = scanned(basis, residuals, spectrum(residuals, basis).compact(basis.duration_s))
    return str(k), (("X", "Y")[k % 2], k // 2 % 2), run


def amplitude_of(ratio):
    """Of a line whose power is `ratio` times the noise's in one run, in noise of unit density."""
    return np.sqrt(2.0 * ratio / DURATION_S)


@pytest.mark.parametrize("noise", [white, red, microseism, heavy_tails])
def test_false_lines_are_no_more_than_nominal(noise):
    rng = np.random.default_rng(11)
    alpha, scans = 0.05, 20
    false = sum(bool(find_lines(scan_of(rng, noise), alpha)) for _ in range(scans))
    assert false <= stats.binom.ppf(0.999, scans, alpha)


def test_a_bump_would_be_called_a_line_by_its_power():
    scan = scan_of(np.random.default_rng(12), microseism)
    bins = [sums[1] / np.maximum(sums[0], 1.0) for sums in scan.groups.values()]
    near = np.abs(np.arange(bins[0].size) * scan.step_hz - 0.4) < 0.02
    assert np.mean([each[near].max() for each in bins]) > 5.0
    assert find_lines(scan) == []


def test_lines_are_found_as_often_as_by_one_who_knows_frequency_and_noise():
    """Power beside that of the sum of powers with the exact level, at the same threshold."""
    rng = np.random.default_rng(13)
    runs, ratio, alpha, scans = 40, 1.8, 0.01, 25
    trials = DURATION_S / PERIOD_S
    threshold = stats.gamma.isf(alpha / trials, runs)
    oracle = stats.ncx2.sf(2 * threshold, 2 * runs, 2 * runs * ratio)
    found = 0
    for _ in range(scans):
        frequency_hz = rng.uniform(3.0, 8.0)
        lines = find_lines(scan_of(rng, white, runs, (frequency_hz, amplitude_of(ratio))), alpha)
        found += any(abs(line.frequency_hz - frequency_hz) < 0.5 / DURATION_S for line in lines)
    assert found >= stats.binom.ppf(0.001, scans, 0.9 * oracle)


def test_amplitude_frequency_and_gain_are_those_of_the_line():
    rng = np.random.default_rng(14)
    amplitude = amplitude_of(8.0)
    pulls, off, ratios = [], [], []
    for _ in range(25):
        frequency_hz = rng.uniform(3.0, 8.0)
        line = find_lines(scan_of(rng, white, 40, (frequency_hz, amplitude)))[0]
        pulls.append((line.amplitude - amplitude) / line.sigma)
        off.append((line.frequency_hz - frequency_hz) * DURATION_S)
        ratios.append(line.held_out_error_ratio)
        assert line.p_value < 1e-6
    # The grid's scalloping costs up to two sigma of so strong a line.
    assert abs(np.mean(pulls)) < 2.0
    assert np.std(off) < 0.1
    assert np.mean(ratios) == pytest.approx(1 / 3, abs=0.15)


def test_a_slow_line_must_show_that_it_is_none_of_the_noises_bumps_and_a_strong_one_does():
    (line,) = find_lines(scan_of(np.random.default_rng(115), white, 40, (0.43, amplitude_of(30.0))))
    assert line.frequency_hz == pytest.approx(0.43, abs=0.5 / DURATION_S)


def test_aliases_are_said():
    (line,) = find_lines(scan_of(np.random.default_rng(16), white, 40, (6.5, amplitude_of(10.0))))
    assert line.aliases_hz[:3] == pytest.approx((13.5, 26.5, 33.5), abs=1.0 / DURATION_S)


def test_runs_of_two_lengths_join():
    rng = np.random.default_rng(17)
    scan = scan_of(rng, white, 20, (4.321, amplitude_of(4.0)), samples=600)
    for k in range(20, 40):
        scan.add(*part(rng, white, k, (4.321, amplitude_of(4.0))))
    (line,) = find_lines(scan)
    assert line.frequency_hz == pytest.approx(4.321, abs=0.5 / DURATION_S)
    assert line.amplitude == pytest.approx(amplitude_of(4.0), abs=6 * line.sigma)


def test_a_run_taken_out_leaves_what_was_there():
    rng = np.random.default_rng(18)
    parts = [part(rng, white, k) for k in range(6)]
    whole, without = LineScan(), LineScan()
    for run_id, group, run in parts:
        whole.add(run_id, group, run)
        if run_id != "2":
            without.add(run_id, group, run)
    whole.remove("2", parts[2][2])
    assert whole.runs == without.runs
    for key, sums in without.groups.items():
        np.testing.assert_allclose(whole.groups[key], sums, rtol=1e-9, atol=1e-9)


def test_a_kept_scan_is_the_same_bit_for_bit():
    scan = scan_of(np.random.default_rng(19), white, 6)
    again = LineScan.unpacked(Packed.from_bytes(scan.packed().to_bytes()))
    assert again.packed().to_bytes() == scan.packed().to_bytes()
    assert again.runs == scan.runs
    for key, sums in scan.groups.items():
        np.testing.assert_array_equal(again.groups[key], sums)


def test_nothing_is_found_in_nothing():
    assert find_lines(LineScan()) == []
    scan = LineScan()
    scan.add("1", ("X", 0), None)
    assert find_lines(scan) == []


def test_a_line_beyond_all_doubt_is_one_line():
    (line,) = find_lines(scan_of(np.random.default_rng(20), white, 40, (6.17, amplitude_of(1e4))))
    assert line.frequency_hz == pytest.approx(6.17, abs=0.1 / DURATION_S)
    assert line.amplitude == pytest.approx(amplitude_of(1e4), rel=0.2)
    assert line.p_value == 0.0


@pytest.mark.parametrize("counts", [(5,), (40,), (3, 8, 20)])
def test_powers_of_noise_are_as_alike_as_their_level_says(counts: tuple[int, ...]) -> None:
    draws = 20_000
    rng = np.random.default_rng(1)
    statistic = np.zeros(draws)
    for n in counts:
        powers = rng.exponential(size=(draws, n))
        statistic += n * np.log(powers.mean(axis=1)) - np.log(powers).sum(axis=1)
    p_values = np.array([p_of_alike_powers(float(each), counts) for each in statistic])
    for level in (0.01, 0.05):
        expected = level * draws
        assert abs(np.sum(p_values < level) - expected) < 4.0 * np.sqrt(expected * (1.0 - level))
