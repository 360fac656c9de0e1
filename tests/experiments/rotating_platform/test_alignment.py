import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.result.alignment import (
    angle_scan,
    axes,
    flip,
    wobble_of,
)

G = 9.81
GAIN_A, GAIN_B = 846.73, 804.32
BIAS_Y, BIAS_Z = -14.33e-4, 10.54e-4
READINGS = {"V_as_printed": (1.0, 1.0), "mV": (1e-3, 1e-3), "divided_by_gain": (1.0 / 1010.9, 1.0 / 990.54)}
EVERY_15_DEG = np.radians(np.arange(0.0, 360.0, 15.0))


def test_wobbles_of_the_table(table):
    for row in table("wobble"):
        unit_a, unit_b = READINGS[row["bias_reading"]]
        bias_a, bias_b = row["sign_b_A"] * -224.50 * unit_a, -52.19 * unit_b
        found_a, found_b = wobble_of(BIAS_Z, bias_a, GAIN_A, G), wobble_of(BIAS_Y, bias_b, GAIN_B, G)
        assert found_a == pytest.approx(row["beta_A_rad"], rel=1e-5)
        # Ours is the sign of b_y = b_B / G_B - g beta_B.
        assert -row["sign_g_beta_B"] * found_b == pytest.approx(row["beta_B_rad"], rel=1e-5)


def test_wobbles_as_printed(table):
    expected = {row["id"]: row for row in table("expected")}
    found = wobble_of(BIAS_Z, 224.50 / 1010.9, GAIN_A, G)
    assert found == pytest.approx(expected["beta_A"]["value"], abs=expected["beta_A"]["abs_tolerance"])
    found = wobble_of(BIAS_Y, -52.19 / 990.54, GAIN_B, G)
    assert found == pytest.approx(expected["beta_B"]["value"], abs=expected["beta_B"]["abs_tolerance"])


@pytest.mark.parametrize("given", [True, False])
def test_sigmas_of_fits_are_the_scatter_of_what_they_find(given):
    rng = np.random.default_rng(3)
    along, truth = np.linspace(-1.0, 1.0, 8), np.array([0.964, 2.9e-4])
    sigma = 1e-7 * np.linspace(1.0, 3.0, 8) if given else np.full(8, 2e-7)
    fits = [
        flip(along, truth[0] * G * along + truth[1] + sigma * rng.normal(size=8), G, sigma if given else None)
        for _ in range(2000)
    ]
    values = np.array([fit.values for fit in fits])
    assert values.mean(axis=0) == pytest.approx(truth, abs=4.0 * values.std(axis=0).max() / math.sqrt(2000))
    covariance = np.mean([fit.covariance for fit in fits], axis=0)
    scatter = np.cov(values.T)
    # So many fits know each element of their covariance to that (Wishart).
    known = np.sqrt((np.outer(np.diag(scatter), np.diag(scatter)) + scatter**2) / len(fits))
    assert np.all(np.abs(covariance - scatter) < 4.0 * known)


@settings(deadline=None, max_examples=50)
@given(
    offset=st.floats(-2e-3, 2e-3),
    a_y=st.floats(1e-5, 1e-3),
    a_z=st.floats(-1e-3, 1e-3),
    gain=st.floats(0.9, 1.1),
    skew=st.floats(-0.1, 0.1),
)
def test_scans_find_offsets_amplitudes_and_the_angle_between_axes(offset, a_y, a_z, gain, skew):
    theta = EVERY_15_DEG
    # The y sensor is turned by `skew` towards larger phase.
    y = offset + gain * (a_y * np.cos(theta - skew) + a_z * np.sin(theta - skew))
    z = -offset - a_y * np.sin(theta) + a_z * np.cos(theta)
    scan_y, scan_z = angle_scan(theta, y), angle_scan(theta, z)
    found = axes(scan_y, scan_z)
    assert scan_y.value("offset") == pytest.approx(offset, abs=1e-12)
    assert (scan_z.value("cos"), scan_z.value("sin")) == pytest.approx((a_z, -a_y), abs=1e-12)
    assert found.amplitude_ratio.value == pytest.approx(gain, rel=1e-9)
    assert found.nonorthogonality_rad.value == pytest.approx(skew, abs=1e-9)


def test_the_axes_of_the_paper_are_no_right_angle(table):
    expected = {row["id"]: row for row in table("expected")}
    ratio, angle = (expected[name]["value"] for name in ("m0_m1_amplitude_ratio_eq6", "axes_nonorthogonality_eq6"))
    rng = np.random.default_rng(4)
    sigma, skew = 2e-8, math.radians(angle)
    y = BIAS_Y + ratio * 4.5e-4 * np.cos(EVERY_15_DEG - 2.3 - skew) + sigma * rng.normal(size=24)
    z = BIAS_Z + 4.5e-4 * np.cos(EVERY_15_DEG - 2.3 + 0.5 * math.pi) + sigma * rng.normal(size=24)
    found = axes(angle_scan(EVERY_15_DEG, y), angle_scan(EVERY_15_DEG, z))
    assert found.amplitude_ratio.value == pytest.approx(ratio, abs=4.0 * found.amplitude_ratio.sigma)
    assert found.nonorthogonality_rad.value == pytest.approx(skew, abs=4.0 * found.nonorthogonality_rad.sigma)
    # Amplitude and phase have the variance 2 sigma^2 / n of a sine fit each.
    one = sigma * math.sqrt(2.0 / 24.0) / 4.5e-4
    assert found.nonorthogonality_rad.sigma == pytest.approx(math.hypot(one, one / ratio), rel=0.4)
    assert found.amplitude_ratio.sigma == pytest.approx(math.hypot(ratio * one, one), rel=0.4)


def test_a_flip_gives_scale_factor_and_bias():
    sign = [1, -1, 1, -1]
    readings = np.array([0.2221 + s * GAIN_A * G for s in sign]) + np.array([1e-3, 0.0, -1e-3, 0.0])
    found = flip(sign, readings, G)
    assert found.value("gain_v_per_m_s2") == pytest.approx(GAIN_A, abs=1e-9)
    assert found.value("bias_v") == pytest.approx(0.2221, abs=1e-9)
    assert found.sigma("bias_v") == pytest.approx(1e-3 / 2.0)


@pytest.mark.parametrize(
    ("fit", "said"),
    [
        (lambda: flip([1, -1], np.ones(2), G), "2 values do not tell gain_v_per_m_s2 and bias_v"),
        (lambda: angle_scan(np.radians([0.0, 180.0, 0.0, 180.0]), np.ones(4)), "dwell at more angles"),
        (lambda: flip([1, 1, 1], np.ones(3), G), "axis up and down"),
        (lambda: flip([1, -1, 1], np.array([1.0, np.nan, 1.0]), G), "a value that is no number"),
        (lambda: flip([1, -1], np.array([1.0, -1.0]), G, np.array([0.1, 0.0])), "without an uncertainty"),
        (lambda: axes(*[angle_scan(EVERY_15_DEG, np.zeros(24))] * 2), "shows no acceleration"),
    ],
)
def test_what_does_not_tell_is_refused(fit, said):
    with pytest.raises(DataError, match=said):
        fit()


def test_two_directions_suffice_where_their_sigmas_are_known():
    found = flip([1, -1], np.array([1.1, -0.9]), 1.0, np.array([1e-3, 1e-3]))
    assert found.value("gain_v_per_m_s2") == pytest.approx(1.0)
    assert found.sigma("gain_v_per_m_s2") == pytest.approx(1e-3 / math.sqrt(2.0))


def test_sigmas_of_the_axes_are_their_scatter_for_uneven_angles_too():
    rng = np.random.default_rng(5)
    theta, sigma = np.radians([0.0, 20.0, 35.0, 50.0, 80.0, 120.0]), np.full(6, 1e-6)

    def scanned(amplitude, phase):
        return angle_scan(theta, amplitude * np.cos(theta - phase) + sigma * rng.normal(size=6), np.diag(sigma**2))

    found = [axes(scanned(2e-3, 0.7), scanned(1e-3, 0.7 - 0.5 * math.pi)) for _ in range(3000)]
    for name in ("amplitude_ratio", "nonorthogonality_rad"):
        values = [getattr(each, name).value for each in found]
        assert getattr(found[0], name).sigma == pytest.approx(np.std(values), rel=0.06)
