import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.observe.covariance import Q_FLEX_NOISE_V, PowerLawNoise
from rigctl.experiments.rotating_platform.observe.noise_fit import fit_noise
from rigctl.experiments.rotating_platform.observe.spectrum import TAPERS, expected, noise_spectrum

RATE_HZ = 10.0


def records(coloured, density, samples, count, seed=7):
    """Pieces of one long record: what lies below one over their length is in them."""
    noise = coloured(density, samples * count * 2, RATE_HZ, seed=seed, longer=2)
    return noise.reshape(2 * count, samples)[::2]


@pytest.mark.parametrize("exponent", [0.0, 1.0, 1.6384, 2.2])
def test_bands_show_what_is_expected_of_a_power_law_down_to_the_lowest(coloured, exponent):
    pieces = records(coloured, lambda f: f**-exponent, 2048, 150)
    found = [noise_spectrum(piece, RATE_HZ) for piece in pieces]
    ratio = np.mean([each.density for each in found], axis=0) / expected(found[0], exponent)
    scatter = np.std([each.density for each in found], axis=0, ddof=1) / expected(found[0], exponent)
    pulls = (ratio - 1.0) / (scatter / math.sqrt(150))
    assert np.abs(pulls).max() < 4.5
    assert np.mean(pulls**2) < 2.0
    # Without the window the lowest bins would be off by much more.
    naive = expected(found[0], exponent)[:6] * found[0].frequency_hz[:6] ** exponent
    if exponent > 1.5:
        assert np.abs(naive - 1.0).max() > 0.3


def test_a_band_has_the_degrees_of_freedom_that_are_said(coloured):
    pieces = records(coloured, np.ones_like, 1024, 400)
    found = [noise_spectrum(piece, RATE_HZ) for piece in pieces]
    density = np.array([each.density for each in found])
    dof = 2.0 * density.mean(axis=0) ** 2 / density.var(axis=0, ddof=1)
    assert dof == pytest.approx(found[0].dof, rel=0.4)
    whole = density @ found[0].weight / found[0].weight.sum()
    assert whole.mean() ** 2 / whole.var(ddof=1) == pytest.approx(found[0].weight.sum(), rel=0.25)


@settings(deadline=None, max_examples=30)
@given(
    samples=st.integers(256, 3000), level=st.floats(-1e3, 1e3), drift=st.floats(-1.0, 1.0), scale=st.floats(1e-3, 1e3)
)
def test_level_and_drift_are_no_noise(samples, level, drift, scale):
    noise = np.random.default_rng(samples).normal(size=samples)
    plain = noise_spectrum(noise, RATE_HZ)
    moved = noise_spectrum(level + drift * np.arange(samples) + scale * noise, RATE_HZ)
    assert moved.density == pytest.approx(scale**2 * plain.density, rel=1e-4)
    assert moved.stop[:-1].tolist() == moved.first[1:].tolist()
    assert moved.first[0] == 1
    assert moved.frequency_hz[-1] < RATE_HZ / 2


def test_bins_are_means_over_sine_tapers():
    rng = np.random.default_rng(3)
    n = 300
    samples = rng.normal(size=n)
    t = np.arange(1, n + 1)
    left = samples - np.polyval(np.polyfit(t, samples, 1), t)
    found = noise_spectrum(samples, RATE_HZ)
    for k in (1, 2, 7):
        rows = [math.sqrt(2 / (n + 1)) * np.sin(np.pi * j * t / (n + 1)) for j in range(1, min(k, TAPERS) + 1)]
        turn = np.exp(-2j * np.pi * k * t / (n + 1))
        density = np.mean([abs((row * left) @ turn) ** 2 for row in rows]) / RATE_HZ
        assert found.density[k - 1] == pytest.approx(density, rel=1e-9)
        assert found.frequency_hz[k - 1] == pytest.approx(k * RATE_HZ / (n + 1))


def test_the_noise_of_the_paper_is_found_with_true_uncertainties(coloured):
    true = Q_FLEX_NOISE_V
    pulls = []
    for piece in records(coloured, true, 2**15, 40, seed=9):
        fit = fit_noise(noise_spectrum(piece, RATE_HZ))
        white, coefficient, exponent, _ = fit.sigmas
        pulls.append(
            [
                (fit.noise.white - true.white) / white,
                math.log(fit.noise.coefficient / true.coefficient) * fit.noise.coefficient / coefficient,
                (fit.noise.exponent - true.exponent) / exponent,
            ]
        )
    assert np.abs(np.mean(pulls, axis=0)).max() < 3.0 / math.sqrt(40)
    # One that stopped on its way would be off by tens of sigmas.
    assert np.abs(pulls).max() < 4.5
    assert np.std(pulls, axis=0) == pytest.approx(np.ones(3), abs=0.25)


@pytest.mark.parametrize(
    ("noise", "shown"),
    [
        (PowerLawNoise(2.0, 0.0, 0.0), (True, False)),
        (PowerLawNoise(0.0, 2.0, 1.64), (False, True)),
        (PowerLawNoise(1.0, 0.1, 1.0), (True, True)),
    ],
)
def test_what_a_record_does_not_show_is_left_out(coloured, noise, shown):
    fit = fit_noise(noise_spectrum(coloured(noise, 2**15, RATE_HZ, seed=2), RATE_HZ))
    assert (fit.noise.white > 0.0, fit.noise.coefficient > 0.0) == shown
    white, coefficient, exponent, pendulum = fit.sigmas
    assert (math.isfinite(white), math.isfinite(coefficient), math.isfinite(exponent)) == (*shown, shown[1])
    assert math.isnan(pendulum)
    for value, sigma, true in zip(
        (fit.noise.white, fit.noise.coefficient, fit.noise.exponent),
        fit.sigmas[:3],
        (noise.white, noise.coefficient, noise.exponent),
        strict=True,
    ):
        assert value == pytest.approx(true, abs=4.0 * sigma if math.isfinite(sigma) else 0.0)


def test_a_pendulum_that_rises_above_a_fifth_of_a_hertz_is_not_taken_for_white_noise(coloured):
    """The bench's own: a tenth of the chain's white noise above two hertz."""
    chain, floor = Q_FLEX_NOISE_V, 3.2e-10

    def density(frequency):
        return chain(frequency) + floor * np.clip(frequency / 0.2, 1.0, 10.0) ** 4

    fits = [fit_noise(noise_spectrum(piece, RATE_HZ)) for piece in records(coloured, density, 2**17, 8, seed=5)]
    pulls = [
        ((fit.noise.white - chain.white) / fit.sigmas[0], (fit.pendulum - floor) / fit.sigmas[3]) for fit in fits
    ]
    assert np.abs(np.mean(pulls, axis=0)).max() < 3.0 / math.sqrt(8)
    assert np.abs(pulls).max() < 4.0


def test_the_exact_spectrum_gives_its_parameters_back():
    spectrum = noise_spectrum(np.random.default_rng(1).normal(size=2**14), RATE_HZ)
    true = PowerLawNoise(3e-5, 9e-8, 1.7)
    exact = true.white + true.coefficient * expected(spectrum, true.exponent)
    fit = fit_noise(type(spectrum)(**{**vars(spectrum), "density": exact}))
    assert (fit.noise.white, fit.noise.coefficient, fit.noise.exponent) == pytest.approx((3e-5, 9e-8, 1.7), rel=1e-4)


def test_a_few_lost_samples_do_no_harm():
    rng = np.random.default_rng(4)
    samples = rng.normal(size=20_000)
    samples[rng.choice(20_000, 100, replace=False)] = np.nan
    spectrum = noise_spectrum(samples, RATE_HZ)
    assert spectrum.filled == pytest.approx(0.005)
    assert fit_noise(spectrum).noise.white == pytest.approx(1.0 / RATE_HZ, rel=0.05)


def test_records_that_tell_no_noise_are_refused():
    with pytest.raises(DataError, match=r"255 samples, 0 % of them missing.*at least 256"):
        noise_spectrum(np.ones(255), RATE_HZ)
    holed = np.ones(1000)
    holed[:20] = np.nan
    with pytest.raises(DataError, match="1000 samples, 2 % of them missing"):
        noise_spectrum(holed, RATE_HZ)
    flat = noise_spectrum(np.zeros(1000), RATE_HZ)
    with pytest.raises(DataError, match=r"bands of a spectrum, \d+ of them without power"):
        fit_noise(flat)
