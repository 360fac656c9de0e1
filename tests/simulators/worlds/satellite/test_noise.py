"""Noise in orbit: the densities that were asked for, from the lowest line of a session to the Nyquist frequency."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.core.arrays import FloatArray
from simulators.worlds.satellite.settings import SatelliteSettings
from tests.simulators.worlds.satellite.flights import STEP_S, Flown, fly

DRAWS = 16


@pytest.fixture(scope="module")
def still() -> Flown:
    """Ten orbits of identical perfect sensors at the centre of mass: what differs between them is noise."""
    bounds = dict.fromkeys(
        ("off_centring_m", "centre_m", "scale", "theta_c_rad", "theta_d_rad", "eta_rad", "quadratic_s2_m"), 0.0
    )
    settings = SatelliteSettings.model_validate({"kind": "drag-free-satellite", "seed": 5, "bounds": bounds})
    return fly(settings, draws=tuple(range(DRAWS)))


def density(series: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Frequencies and the one-sided periodogram under a Hann window, averaged over records."""
    window = np.hanning(len(series[0]))
    scale = 2.0 * STEP_S / np.sum(window**2)
    found = [np.abs(np.fft.rfft(window * (one - one.mean()))) ** 2 * scale for one in series]
    return np.fft.rfftfreq(len(series[0]), STEP_S), np.mean(found, axis=0)


@pytest.mark.parametrize(
    ("lowest_hz", "highest_hz"), [(5e-5, 1.5e-4), (1.5e-4, 6e-4), (6e-4, 3e-3), (3e-3, 2e-2), (2e-2, 0.1), (0.1, 0.4)]
)
def test_the_x_sensors_noise_is_white_red_and_differentiated_read_out(
    still: Flown, lowest_hz: float, highest_hz: float
) -> None:
    f_hz, found = density([2.0 * still.different("x", draw) for draw in range(DRAWS)])
    band = (f_hz >= lowest_hz) & (f_hz < highest_hz)
    f_hz, found = f_hz[band], found[band]
    asked = 2.0 * (1.2e-12**2 * (1.0 + 5e-4 / f_hz) + (3e-11 * (2.0 * np.pi * f_hz) ** 2) ** 2)
    ratio = np.mean(found / asked)
    # A second difference falls short of a derivative by (pi f step)^2 / 3 in amplitude, four times that in power.
    short = np.mean((np.sinc(f_hz * STEP_S)) ** 4)
    expected = short if lowest_hz >= 0.02 else 1.0
    assert ratio == pytest.approx(expected, abs=5.0 * 1.5 / np.sqrt(DRAWS * band.sum()) + 5e-3)


@pytest.mark.parametrize("axis", ["y", "z"])
def test_the_other_axes_noise_is_white(still: Flown, axis: str) -> None:
    f_hz, found = density([2.0 * still.different(axis, draw) for draw in range(DRAWS)])
    band = (f_hz > 1e-4) & (f_hz < 1.9)
    assert np.mean(found[band]) == pytest.approx(2.0 * 5e-12**2, rel=0.01)


def test_two_masses_and_two_draws_share_no_noise(still: Flown) -> None:
    one, other = still.different("y", 0), still.different("y", 1)
    z = still.different("z", 0)
    for a, b in ((one, other), (one, z)):
        assert abs(np.corrcoef(a, b)[0, 1]) * np.sqrt(len(a)) < 5.0


def test_the_density_of_a_lossy_spring_adds_to_the_red_part(still: Flown) -> None:
    settings = SatelliteSettings.model_validate(
        {
            "kind": "drag-free-satellite",
            "seed": 5,
            "bounds": dict.fromkeys(("off_centring_m", "scale", "theta_d_rad", "quadratic_s2_m"), 0.0),
            "effects": {"spring-noise": {"kappa[1]": 1e-3, "quality": 100.0}},
        }
    )
    noisy = fly(settings, draws=tuple(range(DRAWS)))
    f_hz, found = density([2.0 * noisy.different("x", draw) for draw in range(DRAWS)])
    band = (f_hz > 2e-4) & (f_hz < 3e-4)
    spring = 4.0 * 1.380649e-23 * 290.0 * 1e-3 / (0.4**2 * 100.0 * 2.0 * np.pi * f_hz[band])
    asked = 2.0 * 1.2e-12**2 * (1.0 + 5e-4 / f_hz[band]) + spring
    assert np.mean(found[band] / asked) == pytest.approx(1.0, abs=5.0 * 1.5 / np.sqrt(DRAWS * band.sum()))
