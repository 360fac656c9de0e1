"""Pulls of fitted amplitudes: divided by the sigma taken from residuals they must follow Student's t."""

import numpy as np
import pytest
from scipy import stats

from rigctl.analysis.noise import pooled_psd, spectrum
from rigctl.analysis.sine_fit import HarmonicBasis
from rigctl.core.errors import DataError

PERIOD_S = 0.05


def white(f):
    return np.ones_like(f)


def ar1(f):
    return 1.0 / np.abs(1.0 - 0.95 * np.exp(-2j * np.pi * f * PERIOD_S)) ** 2


def power_law(f):
    return 1e-3 + np.maximum(f, 1e-4) ** -1.64


def microseism(f):
    return 1.0 + 200.0 * np.exp(-0.5 * ((f - 0.2) / 0.015) ** 2)


def colour(density, samples, rng, longer=8):
    """Cut from a record `longer` times as long, so that it holds noise below 1/T and does not close on itself."""
    n = samples * longer
    f = np.fft.rfftfreq(n, PERIOD_S)
    s = density(f)
    s[0] = 0.0
    z = (rng.normal(size=f.size) + 1j * rng.normal(size=f.size)) * np.sqrt(s * n / (4 * PERIOD_S))
    return np.fft.irfft(z, n)[:samples]


def spectra_of(density, basis, rng, runs=1):
    return [spectrum(basis.fit(colour(density, basis.samples, rng)).residuals, basis) for _ in range(runs)]


def exact_level(density, basis):
    """T times the variance of each part of the fundamental's amplitude, from the fit's own transfer function."""
    linear = basis.fit(np.eye(basis.samples)).amplitudes[0]
    weights = np.fft.rfft(np.stack([linear.real, linear.imag]), 16 * basis.samples)
    step_hz = 1.0 / (16 * basis.duration_s)
    s = density(np.arange(weights.shape[1]) * step_hz)
    s[0] = 0.0
    return basis.duration_s * np.abs(weights) ** 2 @ s * step_hz


def check_pulls(pulls, dof, *, bias=0.0):
    """Hold mean and variance of t-distributed pulls to 4 sigma of their number, and the shape by a KS test.

    `bias` is what the method itself may misjudge the variance by.
    """
    pulls = np.asarray(pulls)
    expected = dof / (dof - 2)
    spread = np.sqrt((stats.t.stats(dof, moments="k") + 2.0) / pulls.size)
    assert pulls.mean() == pytest.approx(0.0, abs=4.0 / np.sqrt(pulls.size))
    assert pulls.var() / expected == pytest.approx(1.0, abs=4.0 * spread + bias)
    assert stats.kstest(pulls, stats.t(dof).cdf).pvalue > 1e-3


def pulls_of(basis, amplitudes, levels):
    variance = basis.variance_factors * [level.psd for level in levels] / basis.duration_s
    return np.stack([amplitudes.real, amplitudes.imag], axis=1).ravel() / np.sqrt(np.repeat(variance, 2))


class TestOneRun:
    @pytest.mark.parametrize("density", [white, ar1, power_law])
    @pytest.mark.parametrize("duration_s", [20.0, 18.7])
    def test_pulls_follow_student_t(self, density, duration_s):
        basis = HarmonicBasis(np.arange(round(duration_s / PERIOD_S)) * PERIOD_S, 0.5)
        rng = np.random.default_rng(21)
        pulls, dof = [], []
        for _ in range(120):
            fit = basis.fit(colour(density, basis.samples, rng))
            bins = spectrum(fit.residuals, basis)
            levels = [bins.level(h * 0.5) for h in (1, 2, 3)]
            pulls.append(pulls_of(basis, fit.amplitudes, levels))
            dof.append([level.dof for level in levels])
        pulls, dof = np.array(pulls), np.mean(dof, axis=0)
        for h in range(3):
            check_pulls(pulls[:, 2 * h : 2 * h + 2].ravel(), dof[h], bias=0.08)

    def test_white_noise_levels_scatter_as_their_degrees_of_freedom_say(self):
        basis = HarmonicBasis(np.arange(400) * PERIOD_S, 0.5)
        rng = np.random.default_rng(5)
        levels = [spectra_of(white, basis, rng)[0].level(1.0) for _ in range(300)]
        psd, dof = np.array([level.psd for level in levels]), levels[0].dof
        assert psd.mean() == pytest.approx(1.0, abs=4 * np.sqrt(2 / dof / 300))
        assert psd.var() * dof / 2.0 == pytest.approx(1.0, abs=0.35)

    def test_the_slope_of_the_noise_does_not_bias_its_level(self):
        basis = HarmonicBasis(np.arange(400) * PERIOD_S, 0.5)
        rng = np.random.default_rng(6)
        levels = [spectra_of(power_law, basis, rng)[0].level(0.5) for _ in range(200)]
        mean, exact = np.mean([level.psd for level in levels]), exact_level(power_law, basis)
        assert mean == pytest.approx(exact.mean(), rel=0.12)
        assert exact == pytest.approx(exact.mean(), rel=0.12)

    def test_bins_under_fitted_lines_say_nothing_and_the_rest_is_unbiased(self):
        basis = HarmonicBasis(np.arange(400) * PERIOD_S, 0.5)
        bins = [spectra_of(white, basis, np.random.default_rng(k))[0] for k in range(200)]
        frequencies = bins[0].frequency_hz
        for line_hz in (0.5, 1.0, 1.5):
            assert np.abs(frequencies - line_hz).min() > 0.9 / 20.0
        mean = np.mean([each.psd for each in bins], axis=0)
        assert mean[:3] == pytest.approx(1.0, abs=4 / np.sqrt(200 * bins[0].weight[0]))
        assert mean.mean() == pytest.approx(1.0, abs=0.02)

    def test_lines_between_bins_take_their_share_of_both_neighbours(self):
        basis = HarmonicBasis(np.arange(390) * PERIOD_S, 0.5)
        rng = np.random.default_rng(8)
        bins = [spectra_of(white, basis, rng)[0] for _ in range(400)]
        partial = (bins[0].weight > 0.25) & (bins[0].weight < 0.9)
        assert partial.sum() >= 2
        mean = np.mean([each.psd for each in bins], axis=0)[partial]
        assert mean == pytest.approx(1.0, abs=4 / np.sqrt(400 * bins[0].weight[partial].min()))

    def test_missing_samples_leave_the_level_unbiased(self):
        rng = np.random.default_rng(9)
        kept = rng.random(400) > 0.1
        basis = HarmonicBasis((np.arange(400) * PERIOD_S)[kept], 0.5)
        levels = []
        for _ in range(200):
            noise = colour(white, 400, rng)[kept]
            levels.append(spectrum(basis.fit(noise).residuals, basis).level(0.5).psd)
        assert np.mean(levels) == pytest.approx(1.0, abs=0.12)

    def test_a_perfect_record_has_no_noise(self):
        basis = HarmonicBasis(np.arange(400) * PERIOD_S, 0.5)
        assert spectrum(np.zeros(400), basis).level(0.5).psd == 0.0

    def test_refuses_what_does_not_fit_or_is_too_short(self):
        t_s = np.arange(400) * PERIOD_S
        with pytest.raises(DataError, match="one channel"):
            spectrum(np.zeros((400, 2)), HarmonicBasis(t_s, 0.5))
        exact = HarmonicBasis(np.arange(9) * 0.5, 0.25)
        with pytest.raises(DataError, match="no spectral bins"):
            spectrum(np.zeros(9), exact).level(0.25)

    def test_times_on_no_grid_have_a_level_all_the_same(self):
        rng = np.random.default_rng(10)
        t_s = (np.arange(400) + rng.uniform(-0.4, 0.4, 400)) * PERIOD_S
        basis = HarmonicBasis(t_s, 0.5)
        assert not basis.uniform
        levels = [spectrum(basis.fit(rng.normal(size=400)).residuals, basis).level(0.5) for _ in range(100)]
        expected = 2.0 * basis.sample_period_s
        spread = np.sqrt(2.0 / levels[0].dof / 100)
        assert np.mean([level.psd for level in levels]) / expected == pytest.approx(1.0, abs=4 * spread)


class TestPool:
    def bases(self):
        t_s = np.arange(400) * PERIOD_S
        return [HarmonicBasis(t_s, nu) for nu in (0.3, 0.5, 0.6)]

    def test_other_runs_show_the_noise_beside_a_narrow_bump(self):
        bases, rng = self.bases(), np.random.default_rng(31)
        pulls, dof, alone = [], [], []
        for _ in range(80):
            fits = [(basis, basis.fit(colour(microseism, 400, rng))) for basis in bases * 4]
            spectra = [spectrum(fit.residuals, basis) for basis, fit in fits]
            level = pooled_psd(spectra).level(0.3)
            alone.append(spectra[0].level(0.3).psd / level.psd)
            dof.append(level.dof)
            for basis, fit in fits[::3]:
                pulls.append(pulls_of(basis, fit.amplitudes, [level, level, level])[:2])
        check_pulls(np.ravel(pulls), np.mean(dof), bias=0.08)
        assert np.median(alone) > 2.0

    def test_the_band_narrows_as_runs_are_added(self):
        bases, rng = self.bases(), np.random.default_rng(32)
        few = pooled_psd(spectra_of(microseism, bases[1], rng, runs=1)).level(0.3)
        many = pooled_psd(spectra_of(microseism, bases[1], rng, runs=60)).level(0.3)
        assert many.dof > 100.0 > few.dof
        assert many.psd == pytest.approx(exact_level(microseism, bases[0]).mean(), rel=4 * np.sqrt(2 / many.dof))
        assert few.psd > 2.0 * many.psd

    def test_order_of_runs_does_not_matter(self):
        rng = np.random.default_rng(33)
        spectra = [bins for basis in self.bases() for bins in spectra_of(ar1, basis, rng, runs=2)]
        forward, backward = pooled_psd(spectra).level(0.5), pooled_psd(spectra[::-1]).level(0.5)
        assert forward.psd == pytest.approx(backward.psd, rel=1e-6)

    def test_bins_of_one_frequency_merge_without_loss(self):
        rng = np.random.default_rng(34)
        t_s = np.arange(400) * PERIOD_S
        spectra = spectra_of(ar1, HarmonicBasis(t_s, 0.5), rng, runs=3)
        spectra += spectra_of(ar1, HarmonicBasis(t_s[:390], 0.5), rng, runs=2)
        pool = pooled_psd(spectra)
        assert np.unique(pool.frequency_hz).size == pool.frequency_hz.size
        assert pool.weight.sum() == pytest.approx(sum(each.weight.sum() for each in spectra))
        assert pool.weight @ pool.psd == pytest.approx(sum(each.weight @ each.psd for each in spectra))
        again = pooled_psd([pool])
        np.testing.assert_array_equal(again.psd, pool.psd)

    def test_nothing_to_pool_is_refused(self):
        with pytest.raises(DataError, match="no spectra"):
            pooled_psd([])


class TestDc:
    def test_flat_noise_lets_the_runs_give_the_sigma_of_the_mean(self):
        basis, rng = HarmonicBasis(np.arange(400) * PERIOD_S, 0.5), np.random.default_rng(41)
        noises = [colour(white, 400, rng) for _ in range(200)]
        fits = [basis.fit(noise) for noise in noises]
        variance = pooled_psd([spectrum(fit.residuals, basis) for fit in fits]).mean_variance(20.0)
        means = np.array([float(fit.dc) for fit in fits])
        assert means.var() / variance == pytest.approx(1.0, abs=4 * np.sqrt(2 / 200))

    def test_of_red_noise_the_variance_is_a_lower_bound(self):
        basis, rng = HarmonicBasis(np.arange(400) * PERIOD_S, 0.5), np.random.default_rng(42)
        fits = [basis.fit(colour(power_law, 400, rng, longer=64)) for _ in range(60)]
        variance = pooled_psd([spectrum(fit.residuals, basis) for fit in fits]).mean_variance(20.0)
        assert np.var([float(fit.dc) for fit in fits]) > 2.0 * variance
