"""Where the satellite is, and the gradient there: the amplitudes that the calibration's drivers come from."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from rigctl.core.arrays import FloatArray
from simulators.worlds.satellite.orbit import EARTH_M3_S2, EARTH_RADIUS_M, Place, oblateness, place
from tests.simulators.worlds.satellite.flights import F_ORB, ORBIT_S, STEP_S, line

T_S = STEP_S * np.arange(238_000)


@pytest.fixture(scope="module")
def orbit() -> Place:
    return place(T_S, ORBIT_S, 5e-3, 0.0)


AMPLITUDES = {
    # (component, harmonic): c - i s in 1/s2, of e = 5e-3 and 5950 s.
    ("xx", 1): 4.182e-9,
    ("xx", 2): 1.6727e-6,
    ("xx", 3): 2.93e-8,
    ("zz", 1): 1.2545e-8,
    ("zz", 2): -1.6725e-6,
    ("zz", 3): -2.93e-8,
    ("xz", 1): 4.182e-9j,
    ("xz", 2): -1.6726e-6j,
    ("xz", 3): -2.93e-8j,
    ("yy", 1): -1.673e-8,
    ("yy", 2): -1.3e-10,
}
DRIVERS = {"xx": 4.16e-9, "zz": 1.23e-8, "xz": 4.26e-9, "yy": 1.65e-8}


def component(orbit: Place, name: str) -> FloatArray:
    r = {"x": orbit.cosine, "y": 0.0 * orbit.cosine, "z": orbit.sine}
    return np.asarray(orbit.strength_s2 * (3.0 * r[name[0]] * r[name[1]] - (name[0] == name[1])))


@pytest.mark.parametrize(("name", "harmonic"), AMPLITUDES)
def test_the_gradient_has_the_lines_of_an_orbit_of_this_eccentricity(orbit: Place, name: str, harmonic: int) -> None:
    within = {("yy", 2): 5e-2, ("zz", 3): 2e-3, ("xz", 3): 2e-3}.get((name, harmonic), 1e-3)
    found = line(component(orbit, name), harmonic * F_ORB)
    assert abs(found - AMPLITUDES[name, harmonic]) < within * abs(AMPLITUDES[name, harmonic])


@pytest.mark.parametrize("name", DRIVERS)
def test_the_paper_s_drivers_follow_from_the_eccentricity(orbit: Place, name: str) -> None:
    assert abs(line(component(orbit, name), F_ORB)) == pytest.approx(DRIVERS[name], rel=0.04)


@given(st.floats(0.0, 0.49), st.floats(-50.0, 50.0))
def test_kepler_s_equation_is_solved_for_any_eccentricity(e: float, orbits: float) -> None:
    at = place(np.array([orbits * ORBIT_S]), ORBIT_S, e, 0.0)
    mean = 2.0 * np.pi * orbits
    anomaly = brentq(lambda x: x - e * np.sin(x) - mean, mean - 1.0, mean + 1.0, xtol=1e-13)
    r = 1.0 - e * np.cos(anomaly)
    assert at.cosine[0] == pytest.approx((np.cos(anomaly) - e) / r, abs=1e-9)
    assert at.sine[0] == pytest.approx(np.sqrt(1.0 - e**2) * np.sin(anomaly) / r, abs=1e-9)
    assert at.strength_s2[0] * r**3 == pytest.approx((2.0 * np.pi / ORBIT_S) ** 2, rel=1e-12)


@given(st.floats(0.0, np.pi), st.floats(0.0, 2.0 * np.pi), st.floats(0.0, 2.0 * np.pi))
def test_oblateness_is_the_second_derivative_of_its_potential(tilt: float, perigee: float, angle: float) -> None:
    j2, h = 1.08263e-3, 3e3
    a = (EARTH_M3_S2 * (ORBIT_S / (2.0 * np.pi)) ** 2) ** (1.0 / 3.0)
    pole = np.array([np.sin(tilt) * np.sin(perigee), np.cos(tilt), np.sin(tilt) * np.cos(perigee)])
    here = a * np.array([np.cos(angle), 0.0, np.sin(angle)])

    def potential(x: FloatArray) -> float:
        r = float(np.linalg.norm(x))
        return -EARTH_M3_S2 / r * j2 * (EARTH_RADIUS_M / r) ** 2 * (1.5 * (pole @ x / r) ** 2 - 0.5)

    at = Place(np.array([np.cos(angle)]), np.array([np.sin(angle)]), np.array([EARTH_M3_S2 / a**3]))
    found = oblateness(at, ORBIT_S, j2, tilt, perigee)[0]
    for value, (i, j) in zip(found, ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)), strict=True):
        u, v = h * np.eye(3)[i], h * np.eye(3)[j]
        expected = (
            potential(here + u + v) - potential(here + u - v) - potential(here - u + v) + potential(here - u - v)
        ) / (4.0 * h**2)
        assert value == pytest.approx(expected, abs=2e-12)
