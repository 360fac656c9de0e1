import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.experiments.rotating_platform.observe.cells import FAULTS
from rigctl.experiments.rotating_platform.observe.estimators import ESTIMATORS, OUTPUTS, weights
from rigctl.experiments.rotating_platform.observe.patterns import ROTATIONS, custom_pattern, named_pattern
from tests.experiments.rotating_platform.by_cells import demodulated

NAMES = sorted(ROTATIONS)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize(("period_s", "rate_hz"), [(60.0, 10.0), (300.0, 40.0)])
def test_cells_give_what_the_weights_do(name, estimator, period_s, rate_hz):
    sampled = named_pattern(name, period_s).sampled(rate_hz)
    rng = np.random.default_rng(1)
    channels = np.array([1.5, -0.7])[:, None] + 0.1 * rng.normal(size=(2, 3 * sampled.samples + 100))
    series = demodulated(sampled, *channels, estimator=estimator)
    table = channels[:, : 3 * sampled.samples].reshape(2, 3, sampled.samples)
    expected = np.einsum("ok,cpk->opc", weights(sampled, estimator), table)
    for output, wanted in zip(OUTPUTS, expected, strict=True):
        assert getattr(series, output) == pytest.approx(wanted, rel=1e-9, abs=1e-12)
    assert not series.refitted.any()
    assert not series.invalid.any()
    assert not series.faults.any()


def test_a_period_with_faults_is_refitted_to_what_is_left_and_counted():
    sampled = named_pattern("b", 60.0).sampled(10.0)
    t, c = np.tile(sampled.time_s, 4), np.tile(sampled.sign.astype(float), 4)
    truth = (3e-4, 2e-6, -1.2e-3, 5e-6)
    channel = c * (truth[0] + truth[1] * t) + truth[2] + truth[3] * t
    channel[600 + 250 : 600 + 300] = np.nan
    theta_deg = np.where(c < 0.0, 180.0, 0.0)
    theta_deg[1200 + 500 : 1200 + 600] = theta_deg[1800:2000] = 0.3
    series = demodulated(sampled, channel, theta_deg=theta_deg)
    assert FAULTS == ("gap", "saturated", "angle", "shifted")
    assert series.faults[:2, 0].tolist() == [[0, 0, 0, 0], [50, 0, 0, 0]]
    assert series.faults[2:, 0, 2].tolist() == [100, 100]
    assert series.refitted[:, 0].tolist() == [False, True, True, True]
    for output, value in zip(OUTPUTS, truth, strict=True):
        assert getattr(series, output)[1:, 0] == pytest.approx([value] * 3, rel=1e-6, abs=1e-12)
    # The period without faults is projected: b mixes the slopes.
    assert series.accel_slope[0, 0] == pytest.approx(truth[1] + 0.9 * truth[3], rel=1e-4)


@pytest.mark.parametrize("name", NAMES)
def test_what_is_left_of_a_period_with_faults_is_as_uncertain_as_it_scatters(name):
    """Its slopes scatter up to ten times as widely as those of others, and counted as one of them."""
    sampled, draws = named_pattern(name, 60.0).sampled(10.0), 1500
    noise = np.random.default_rng(4).standard_normal((draws, sampled.samples))
    noise[:, 250:400] = np.nan
    series = demodulated(sampled, noise.ravel(), estimator="projection")
    usual = np.sum(weights(sampled, "projection") ** 2, axis=1)
    assert series.refitted.all()
    for place, output in enumerate(OUTPUTS):
        expected = usual[place] * series.excess[place % 2, :, 0]
        scatter = np.var(getattr(series, output)[:, 0])
        assert scatter == pytest.approx(expected[0], rel=5.0 * np.sqrt(2.0 / draws)), output


def test_a_period_with_dwells_elsewhere_is_fitted_jointly():
    sampled = named_pattern("b", 60.0).sampled(10.0)
    sign = np.tile(sampled.sign, 3)
    sign[600:1200] = np.roll(sampled.sign, 2)
    t = np.tile(sampled.time_s, 3)
    course = {"theta_deg": np.where(sign < 0, 180.0, 0.0), "moving": (sign == 0).astype(float)}
    series = demodulated(sampled, 1e-3 * sign + 5e-4 + 1e-5 * t, **course)
    assert series.refitted[:, 0].tolist() == [False, True, False]
    assert series.faults[1, 0, 3] > 0
    assert series.accel_mean[1, 0] == pytest.approx(1e-3, rel=1e-9)
    assert series.accel_slope[1, 0] == pytest.approx(0.0, abs=1e-12)
    assert series.bias_slope[1, 0] == pytest.approx(1e-5, rel=1e-9)


@pytest.mark.parametrize(("left", "valid"), [(199, False), (200, True)])
def test_a_period_with_less_than_half_its_samples_is_invalid(left, valid):
    sampled = named_pattern("c_tm", 60.0).sampled(10.0)
    channel = np.ones(600)
    kept = np.flatnonzero(sampled.sign)
    channel[kept[left:]] = np.nan
    series = demodulated(sampled, channel, np.ones(600))
    assert series.invalid.tolist() == [[not valid, False]]
    assert series.refitted.tolist() == [[valid, False]]
    assert np.isnan(series.accel_mean[0, 0]) == (not valid)
    assert series.bias_mean[0, 1] == pytest.approx(1.0)


def test_a_period_that_lost_all_samples_of_one_sign_is_invalid():
    sampled = custom_pattern(60.0, [(1, 0.0, 10.0), (-1, 15.0, 55.0)], 5.0).sampled(10.0)
    channel = np.ones(600)
    channel[:100] = np.nan
    series = demodulated(sampled, channel)
    assert series.invalid.all()
    assert np.isnan(series.accel_mean).all()


@settings(deadline=None, max_examples=20)
@given(
    truth=st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4),
    lost=st.sets(st.integers(0, 299), max_size=90),
    name=st.sampled_from(NAMES),
)
def test_the_refit_is_exact_whatever_is_missing(truth, lost, name):
    sampled = named_pattern(name, 60.0).sampled(5.0)
    t, c = sampled.time_s, sampled.sign
    channel = c * (truth[0] + truth[1] * t) + truth[2] + truth[3] * t
    channel[list(lost)] = np.nan
    series = demodulated(sampled, channel, estimator="joint-ls")
    if not series.invalid.any():
        values = [getattr(series, output)[0, 0] for output in OUTPUTS]
        assert values == pytest.approx(truth, abs=1e-9)
