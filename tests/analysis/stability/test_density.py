"""The spectral density's fit beside noise whose density is known, over many seeds."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.analysis.stability.coefficients import FLICKER_FLOOR, coefficients
from rigctl.analysis.stability.density import Density, PowerLaw, density
from rigctl.analysis.stability.segments import parts, welch
from rigctl.core.errors import DataError

RATE_HZ, SAMPLES, ROUND = 50.0, 8192, 65536


def made(rng: np.random.Generator, white: float, flicker: float, walk: float) -> np.ndarray:
    """A stretch of noise of the one-sided density white + flicker / f + walk / f^2, from Fourier amplitudes."""
    frequency = np.fft.rfftfreq(ROUND, 1.0 / RATE_HZ)[1:]
    psd = white + flicker / frequency + walk / frequency**2
    pulses = rng.normal(size=frequency.size) + 1j * rng.normal(size=frequency.size)
    amplitudes = np.concatenate([[0.0], pulses * np.sqrt(psd * RATE_HZ * ROUND / 4.0)])
    return np.asarray(np.fft.irfft(amplitudes, ROUND)[:SAMPLES])


@pytest.mark.parametrize("truth", [(2e-6, 0.0, 0.0), (2e-6, 4e-7, 0.0), (2e-6, 0.0, 2e-7), (1e-7, 1e-6, 1e-7)])
def test_the_terms_scatter_about_the_truth_as_their_sigmas_say(truth: tuple[float, float, float]) -> None:
    seeds, rng = 80, np.random.default_rng(11)
    found = [density(made(rng, *truth), RATE_HZ) for _ in range(seeds)]
    # One false line in a hundred records.
    assert sum(len(each.lines) for each in found) <= 5
    assert sum(each.p_value < 0.01 for each in found) <= 5
    for place, h in enumerate(truth):
        terms = [each.terms[place] for each in found]
        if h == 0.0:
            # Held at zero, half of the time; the bound is passed once in twenty.
            assert sum(term.upper < h for term in terms) == 0
            assert sum(term.value > 3.0 * term.sigma for term in terms) <= 2
            continue
        pulls = np.array([(term.value - h) / term.sigma for term in terms])
        # Of 80 pulls the mean has a sigma of 0.11, the spread one of 0.08.
        assert abs(pulls.mean()) < 0.45, (place, pulls.mean())
        assert 0.65 < pulls.std() < 1.35, (place, pulls.std())


def test_two_lines_in_noise_are_found_with_their_amplitudes() -> None:
    rng = np.random.default_rng(4)
    time = np.arange(SAMPLES) / RATE_HZ
    strong, weak = 0.5 * np.cos(2 * np.pi * 3.217 * time + 1.0), 1.5e-3 * np.sin(2 * np.pi * 11.03 * time)
    found = density(9.8 + made(rng, 2e-6, 4e-7, 0.0) + strong + weak, RATE_HZ)
    assert [line.frequency_hz for line in found.lines] == pytest.approx([3.217, 11.03], abs=1e-3)
    for line, truth in zip(found.lines, (0.5, 1.5e-3), strict=True):
        assert abs(line.amplitude - truth) < 4.0 * line.sigma
    assert found.p_value > 0.001
    assert abs(found.terms[0].value - 2e-6) < 4.0 * found.terms[0].sigma


def test_what_is_no_sum_of_the_three_is_told() -> None:
    rng = np.random.default_rng(9)
    samples = np.convolve(rng.normal(size=SAMPLES + 20), np.hanning(21), "valid")
    found = density(samples, RATE_HZ)
    assert found.p_value < 1e-3
    assert found.scale > 1.0


def test_degrees_of_freedom_of_means_of_bins_are_those_of_their_scatter() -> None:
    rng, bins = np.random.default_rng(2), 8
    means = []
    for _ in range(60):
        found = welch(rng.normal(size=4096), 1.0, 4096 // parts(4096))
        inner = found.psd[8:-8]
        means += list(inner[: inner.size // bins * bins].reshape(-1, bins).mean(axis=1))
    dof = found.dof(bins)
    scatter = 2.0 * np.mean(means) ** 2 / np.var(means)
    # 840 means: their variance is known to 5 %.
    assert dof == pytest.approx(scatter, rel=0.2)


def test_coefficients_are_those_of_the_standards() -> None:
    """Of white noise N^2 / tau, flicker (0.664 B)^2, random walk K^2 tau / 3 is the Allan variance."""
    frequency = np.arange(0.5e-4, 40.0, 1e-4)
    tau = 3.0
    transfer = 2.0 * np.sin(np.pi * frequency * tau) ** 4 / (np.pi * frequency * tau) ** 2
    terms = tuple(PowerLaw(exponent, 1e-6, 1e-7, 2e-6) for exponent in (0, -1, -2))
    n, b, k = coefficients(terms, "accelerometer", "V")
    expected = (n.value**2 / tau, (FLICKER_FLOOR * b.value) ** 2, k.value**2 * tau / 3.0)
    for term, variance in zip(terms, expected, strict=True):
        integral = float(np.sum(term.value * frequency**term.exponent * transfer)) * 1e-4
        assert integral == pytest.approx(variance, rel=3e-3)
    assert (n.sigma / n.value, n.unit, k.unit) == (pytest.approx(0.05), "V/sqrt(Hz)", "V sqrt(Hz)")


@pytest.mark.parametrize(
    ("unit", "names"),
    [
        ("m/s2", ["velocity random walk", "bias instability", "acceleration random walk"]),
        ("deg/s", ["angle random walk", "bias instability", "rate random walk"]),
        ("degC", ["white noise", "flicker", "random walk"]),
    ],
)
def test_names_are_those_of_the_sensor(unit: str, names: list[str]) -> None:
    terms = tuple(PowerLaw(exponent, 1.0, 0.1, 2.0) for exponent in (0, -1, -2))
    assert [each.name for each in coefficients(terms, "", unit)] == names


def test_what_has_no_density_is_refused() -> None:
    with pytest.raises(DataError, match="too few"):
        density(np.zeros(200), 1.0)
    with pytest.raises(DataError, match="all samples are the same"):
        density(np.full(500, 3.3), 1.0)


def test_the_fit_is_the_same_in_any_unit() -> None:
    samples = made(np.random.default_rng(3), 2e-6, 4e-7, 0.0)

    def relative(found: Density, scale: float) -> list[float]:
        return [term.value / scale**2 for term in found.terms]

    assert relative(density(samples * 1e-9, RATE_HZ), 1e-9) == pytest.approx(relative(density(samples, RATE_HZ), 1.0))
