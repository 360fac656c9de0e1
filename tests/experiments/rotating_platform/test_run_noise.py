import numpy as np
import pytest

from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.observe.patterns import named_pattern
from rigctl.experiments.rotating_platform.observe.run_noise import (
    EXPONENTS,
    RunNoise,
    Scatter,
    joint_covariance,
    likelihood,
    run_noise,
)

NO_BINS = Scatter(np.zeros((0, 600)), np.zeros(0), np.zeros(0))


def everything_fitted(groups):
    return np.eye(4 * groups).reshape(4, groups, 4 * groups)


def test_a_run_that_is_fitted_to_its_last_number_tells_nothing_of_its_noise():
    sampled = named_pattern("a", 60.0).sampled(10.0)
    rounding = 1e-19 * np.random.default_rng(1).standard_normal((4, 6))
    nothing = likelihood(sampled, 1, rounding, everything_fitted(6), NO_BINS)
    assert nothing.transforms == 0.0
    with pytest.raises(DataError, match="too short to tell their noise"):
        run_noise(nothing, [], 60.0)
    something = likelihood(sampled, 1, 1e6 * rounding, everything_fitted(6)[:, :, :6], NO_BINS)
    assert run_noise(nothing, [something], 60.0).white > 0.0


def test_a_steep_spectrum_is_found_although_tapers_leak_and_lines_are_taken_off():
    """As densities at the places alone are looked at, it comes out too high at low frequencies."""
    sampled, groups = named_pattern("c", 60.0).sampled(2.0), 40
    truth = RunNoise(1.0, np.where(np.isclose(EXPONENTS, 1.6), 5.0, 0.0), 100.0)
    factor = np.linalg.cholesky(joint_covariance(truth, sampled, 1, range(groups)))
    line = np.linalg.qr(np.stack([np.ones(groups), np.arange(groups)], axis=1))[0]
    fitted = np.zeros((4, groups, 8))
    for output in range(4):
        fitted[output, :, 2 * output : 2 * output + 2] = line
    rng, frequency = np.random.default_rng(1), np.array([2e-3, 1e-2])
    ratios = []
    for _ in range(160):
        series = (factor @ rng.standard_normal(4 * groups)).reshape(4, groups)
        noise = run_noise(likelihood(sampled, 1, series - (series @ line) @ line.T, fitted, NO_BINS), [], 60.0)
        ratios.append(truth(frequency) / noise(frequency))
    error = np.std(ratios, axis=0) / np.sqrt(160)
    assert (np.abs(np.mean(ratios, axis=0) - 1.0) < 3.0 * error).all()


def test_what_is_fitted_to_one_output_alone_makes_the_noise_no_flatter():
    """The slow bias of short runs, all but taken off: spread over all outputs it hid a third of the power there."""
    sampled, groups, runs = named_pattern("c", 60.0).sampled(2.0), 10, 12
    truth = RunNoise(1.0, np.where(np.isclose(EXPONENTS, 1.4), 2.0, 0.0), 100.0)
    factor = np.linalg.cholesky(joint_covariance(truth, sampled, 1, range(groups)))
    place = np.arange(groups) / groups
    slow = np.linalg.qr(np.stack([place**0, place, np.sin(2.0 * place), np.cos(9.0 * place)], axis=1))[0]
    fitted = np.zeros((4, groups, 4))
    fitted[2] = slow
    rng, frequency = np.random.default_rng(3), np.array([4e-3, 1.0 / 60.0])
    ratios = []
    for _ in range(24):
        told = []
        for _ in range(runs):
            series = (factor @ rng.standard_normal(4 * groups)).reshape(4, groups)
            series[2] -= slow @ (slow.T @ series[2])
            told.append(likelihood(sampled, 1, series, fitted, NO_BINS))
        ratios.append(np.log(run_noise(told[0], told[1:], 60.0)(frequency) / truth(frequency)))
    error = np.std(ratios, axis=0) / np.sqrt(len(ratios))
    # A line of a steep spectrum is more than its share of the power: some per cent at a quarter of the modulation.
    assert (np.abs(np.mean(ratios, axis=0)) < 0.1 + 3.0 * error).all()


def test_a_run_of_a_few_periods_has_its_channels_level():
    """Alone, three periods give the level to a factor of some two, and whatever is small there looks large."""
    sampled = named_pattern("b", 300.0).sampled(2.0)
    truth = RunNoise(1.0, np.where(np.isclose(EXPONENTS, 1.6), 2.0, 0.0), 100.0)
    rng = np.random.default_rng(2)

    def drawn(groups, level):
        factor = np.linalg.cholesky(joint_covariance(truth, sampled, 1, range(groups)))
        line = np.linalg.qr(np.stack([np.ones(groups), np.arange(groups)], axis=1))[0]
        fitted = np.zeros((4, groups, 8))
        for output in range(4):
            fitted[output, :, 2 * output : 2 * output + 2] = line
        series = np.sqrt(level) * (factor @ rng.standard_normal(4 * groups)).reshape(4, groups)
        return likelihood(sampled, 1, series - (series @ line) @ line.T, fitted, NO_BINS)

    at_hz = np.array([1.0 / 300.0])
    others = [drawn(24, 1.0) for _ in range(6)]
    short = [run_noise(drawn(3, 1.0), others, 300.0) for _ in range(30)]
    ratios = np.array([noise(at_hz)[0] / truth(at_hz)[0] for noise in short])
    assert np.abs(np.log(ratios)).max() < np.log(2.0)
    # What differs in noise is not forced on one level: nine times the power, of a run long enough to tell.
    noisy = run_noise(drawn(24, 9.0), others, 300.0)
    assert noisy(at_hz)[0] / truth(at_hz)[0] > 6.0
