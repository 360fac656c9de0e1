import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.model.response import expected_sine, measured_sine, transfer
from rigctl.experiments.rotating_platform.observe.covariance import Q_FLEX_NOISE_V
from rigctl.experiments.rotating_platform.observe.estimators import ESTIMATORS, OUTPUTS
from rigctl.experiments.rotating_platform.observe.patterns import custom_pattern, named_pattern
from tests.experiments.rotating_platform import by_cells

HOUR_S = 3600.0
TILT = 1.0 / 825.0
STATIC, BIAS = 2.8757e-4, 10.54e-4
NAMES = {"paper": "projection", "joint_ls": "joint-ls"}


def demodulated(sampled, external, noise=0.0, estimator="projection"):
    """The outputs of a channel under an external signal, and of the signal itself."""
    periods = external.size // sampled.samples
    sign = np.tile(sampled.sign, periods)
    channel = sign * (external + STATIC) + BIAS + noise
    found = by_cells.demodulated(sampled, channel, estimator=estimator)
    truth = by_cells.demodulated(sampled, external + STATIC)
    outputs = [getattr(found, name)[:, 0] for name in OUTPUTS]
    return outputs, [truth.bias_mean[:, 0], truth.bias_slope[:, 0]]


def times(sampled, periods):
    return (np.arange(sampled.samples * periods) + 0.5) / sampled.sample_rate_hz


def triangle(time_s, period_s):
    """From 0 upwards, amplitude 1."""
    return 2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * time_s / period_s))


def test_sines_of_the_table(table):
    for row in table("fig8"):
        if row["noise"]:
            continue
        sampled = named_pattern(row["pattern"], 300.0).sampled(10.0)
        estimator = NAMES[row["estimator"]]
        external = TILT * np.sin(2.0 * np.pi * times(sampled, 100) / HOUR_S)
        (accel, _, bias, _), _ = demodulated(sampled, external, estimator=estimator)
        for found in (
            expected_sine(sampled, TILT, HOUR_S, estimator),
            measured_sine(sampled, accel, bias, HOUR_S),
        ):
            assert found.bias_pp == pytest.approx(row["bias_sin_pp"], rel=1e-5)
            assert found.accel_pp == pytest.approx(row["accel_sin_pp"], rel=1e-5)
            shifts = (found.shift.start_min, found.shift.centre_min, found.shift.end_min)
            printed = [row[f"bias_lag_{at}_min"] for at in ("window_start", "centre", "window_end")]
            # Half a period of the signal before is half a period after.
            turns = (np.array(shifts) - printed) / 60.0
            assert turns - np.rint(turns) == pytest.approx(0.0, abs=1e-6)
        assert np.ptp(bias) == pytest.approx(row["bias_ptp"], rel=1e-5)


def test_equation_16_is_the_pattern_without_rotation_time(table):
    expected = {row["id"]: row for row in table("expected")}
    found = expected_sine(named_pattern("a", 300.0, 0.0).sampled(10.0), TILT, HOUR_S)
    row = expected["h_pp_eq16"]
    assert found.bias_pp == pytest.approx(row["value"], abs=row["abs_tolerance"])
    row = expected["h_pp_times_gain_0.964"]
    assert 0.964 * found.bias_pp == pytest.approx(row["value"], abs=row["abs_tolerance"])
    assert found.shift.centre_min == pytest.approx(15.0)
    assert found.shift.start_min == pytest.approx(12.5)
    assert found.shift.end_min == pytest.approx(17.5)


def test_the_sine_is_found_in_noise(coloured):
    sampled = named_pattern("a", 300.0).sampled(10.0)
    external = TILT * np.sin(2.0 * np.pi * times(sampled, 100) / HOUR_S + 0.4)
    noise = coloured(Q_FLEX_NOISE_V.in_units_of(846.73), external.size, 10.0, seed=6)
    (accel, _, bias, _), _ = demodulated(sampled, external, noise)
    bias[7] = np.nan
    found = measured_sine(sampled, accel, bias, HOUR_S, phase_rad=0.4)
    exact = expected_sine(sampled, TILT, HOUR_S)
    # Four sigmas of what this noise leaves in a hundred periods.
    assert found.bias_pp == pytest.approx(exact.bias_pp, abs=1.7e-5)
    assert found.accel_pp == pytest.approx(exact.accel_pp, abs=4.3e-6)
    assert found.shift.centre_min == pytest.approx(15.0, abs=0.5)


@settings(deadline=None, max_examples=20)
@given(
    name=st.sampled_from(["a", "b", "c", "c_tm"]),
    estimator=st.sampled_from(ESTIMATORS),
    external_s=st.floats(400.0, 20_000.0),
    phase=st.floats(-3.0, 3.0),
)
def test_what_is_expected_of_a_sine_is_what_demodulation_gives(name, estimator, external_s, phase):
    sampled = named_pattern(name, 60.0).sampled(4.0)
    external = np.sin(2.0 * np.pi * times(sampled, 10) / external_s + phase)
    outputs, _ = demodulated(sampled, external, estimator=estimator)
    centre_s = (np.arange(10) + 0.5) * 60.0 + sampled.centre_s
    turn = np.exp(1j * (2.0 * np.pi * centre_s / external_s + phase))
    gain = transfer(sampled, 1.0 / external_s, estimator)
    rest, _ = demodulated(sampled, np.zeros_like(external), estimator=estimator)
    for output, still, factor in zip(outputs, rest, gain, strict=True):
        assert output - still == pytest.approx((factor * turn).imag, abs=1e-9)


def test_triangles_of_the_table(table, coloured):
    for row in table("fig7"):
        name = row["pattern"]
        sampled = named_pattern(name, 60.0).sampled(10.0)
        external = TILT * triangle(times(sampled, 240), HOUR_S)
        noise = coloured(Q_FLEX_NOISE_V.in_units_of(846.73), external.size, 10.0, seed=8)
        (_, accel_slope, bias, bias_slope), (_, true_slope) = demodulated(sampled, external, noise)
        # The bias wanders as its slow noise does, and with it what of it is in the slope of a.
        assert bias.mean() == pytest.approx(row["bias_mean"], abs=1e-4)
        assert np.median(np.abs(accel_slope)) == pytest.approx(row["accel_slope_median_abs"], rel=0.05)
        assert bias_slope.std(ddof=1) == pytest.approx(row["bias_slope_std"], rel=0.15)
        assert bias_slope.mean() == pytest.approx(row["bias_slope_mean"], rel=0.01, abs=5e-8)
        correlation = np.corrcoef(bias_slope, true_slope)[0, 1]
        wanted = row["corr_bias_slope_vs_true_accel_slope"]
        assert correlation == pytest.approx(wanted, abs=0.002 if name == "b" else 0.25)


def test_c_follows_a_triangle_and_b_mixes_its_slope_into_the_bias(table):
    slope = {row["id"]: row["value"] for row in table("expected")}["triangle_slope"]
    for name, mixed in (("b", 0.9), ("c", 0.003)):
        sampled = named_pattern(name, 60.0).sampled(10.0)
        (accel, accel_slope, _, bias_slope), (true, true_slope) = demodulated(
            sampled, TILT * triangle(times(sampled, 120), HOUR_S)
        )
        assert np.median(np.abs(accel_slope)) == pytest.approx(slope, abs=1e-10)
        assert bias_slope.std(ddof=1) == pytest.approx(mixed * slope, rel=0.05)
        assert abs(np.corrcoef(bias_slope, true_slope)[0, 1]) > 0.99
    assert np.mean(accel - true) == pytest.approx(0.0, abs=1e-9)


def test_what_does_not_tell_is_refused():
    sampled = named_pattern("c", 60.0).sampled(10.0)
    wave = np.sin(np.arange(50))
    with pytest.raises(DataError, match="5 valid periods of 60 s do not tell a sine of 900 s"):
        measured_sine(sampled, wave[:5], wave[:5], 900.0)
    with pytest.raises(DataError, match="50 valid periods of 60 s do not tell a sine of 60 s"):
        measured_sine(sampled, wave, wave, 60.0)
    with pytest.raises(DataError, match="50 valid periods of 60 s do not tell a sine of 90000 s"):
        measured_sine(sampled, wave, wave, 90_000.0)


def test_values_are_stamped_where_their_samples_are():
    early = custom_pattern(300.0, [(1, 0.0, 50.0), (-1, 60.0, 110.0)], 10.0).sampled(10.0)
    assert early.centre_s == pytest.approx(-95.0)
    external = TILT * np.sin(2.0 * np.pi * times(early, 60) / HOUR_S)
    (accel, _, bias, _), _ = demodulated(early, external)
    found, exact = measured_sine(early, accel, bias, HOUR_S), expected_sine(early, TILT, HOUR_S)
    assert found.shift.centre_min == pytest.approx(exact.shift.centre_min, abs=1e-9)
    assert exact.shift.centre_min - exact.shift.start_min == pytest.approx(55.0 / 60.0)
    assert exact.shift.end_min - exact.shift.centre_min == pytest.approx(245.0 / 60.0)
