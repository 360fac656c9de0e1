"""Effects of nature in orbit: each does what its formula says, by the difference to a flight without it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from benchmarks.inflight_plain import gradient
from rigctl.core.arrays import FloatArray
from simulators.worlds.satellite.effect_ids import EFFECTS
from simulators.worlds.satellite.forcing import Injection, temperature_k
from simulators.worlds.satellite.instrument import Instrument, drawn, operating_point
from simulators.worlds.satellite.orbit import oblateness, place
from simulators.worlds.satellite.settings import SatelliteSettings
from tests.simulators.worlds.satellite.flights import F_ORB, ORBIT_S, STEP_S, Flown, fly, line, quiet

SAMPLES = 47_600
T_S = STEP_S * np.arange(SAMPLES)
N = 2.0 * np.pi / ORBIT_S
F_LOW = 15.0 / (2.0 * ORBIT_S)
F_HIGH = 107.0 / (2.0 * ORBIT_S)
DRAW = 3
NOTHING = Injection()
WARM = {"orbit_k": 0.1, "twice_k": 0.05, "twice_phase_rad": 1.0}
LIGHT_M_S = 299792458.0


@dataclass(frozen=True)
class Change:
    """A flight with an effect beside one without."""

    settings: SatelliteSettings
    without: Flown
    made: Flown

    def of(self, name: str) -> FloatArray:
        return self.made.column(name, 0) - self.without.column(name, 0)

    @property
    def twice_different(self) -> FloatArray:
        """Of m_1x - m_2x."""
        return self.of("m1_x") - self.of("m2_x")

    @property
    def instrument(self) -> Instrument:
        return drawn(self.settings, DRAW)


def flown(settings: SatelliteSettings, injection: Injection, hold: str) -> Flown:
    return fly(settings, injection, draws=(DRAW,), samples=SAMPLES, hold=hold)


@cache
def without(injection: Injection, hold: str) -> Flown:
    made = flown(quiet(temperature=WARM), injection, hold)
    made.telemetry.flags.writeable = False
    return made


def changed(effects: dict[str, dict[str, float]], injection: Injection = NOTHING, hold: str = "both") -> Change:
    settings = quiet(effects=effects, temperature=WARM)
    return Change(settings, without(injection, hold), flown(settings, injection, hold))


def assert_like(found: FloatArray, expected: FloatArray, within: float = 0.03) -> None:
    """Up to gains that are off by a per cent; to the largest value."""
    assert np.abs(found - expected).max() < within * np.abs(expected).max()


def of_gradient(change: FloatArray, instrument: Instrument) -> FloatArray:
    """What a change of the gradient, (n, 3, 3), does to m_1x - m_2x."""
    return np.asarray((change @ instrument.delta_m)[:, 0])


def turned(angle: FloatArray) -> FloatArray:
    """How an attitude, (n, 3), changes the gradient, at every hundredth sample; (n, 3, 3)."""
    return np.array(
        [
            gradient(N * t, 5e-3, N, a) - gradient(N * t, 5e-3, N, np.zeros(3))
            for t, a in zip(T_S[::100], angle[::100], strict=True)
        ]
    )


def test_bias_goes_with_the_temperature() -> None:
    change = changed({"thermal-bias": {"lambda[1]": 4e-9, "lambda[2]": 1e-9}})
    assert_like(change.twice_different, 3e-9 * temperature_k(change.settings, T_S))


def test_gain_goes_with_the_temperature() -> None:
    change = changed({"thermal-gain": {"kappa[1]": 1e-3}})
    own = change.without.column("m1_x") - change.instrument.bias_m_s2[0, 0]
    assert_like(change.twice_different, 1e-3 * own * temperature_k(change.settings, T_S))


def test_the_masses_part_with_the_temperature() -> None:
    change = changed({"thermal-off-centring": {"beta": 1e-4}})
    assert_like(change.twice_different, 1e-4 * temperature_k(change.settings, T_S) * change.made.column("t_xx"))


def test_a_spring_holds_a_moved_mass_and_loses() -> None:
    moved = Injection("mass-1", "x", 9e-6, F_HIGH)
    change = changed({"wire-stiffness": {"kappa[1]": 1e-2, "quality": 50.0}}, moved, hold="mass-2")
    found = line(change.twice_different, F_HIGH)
    # c - i s: the speed is -w times the sine, so its line is + i w.
    assert found == pytest.approx(1e-2 / 0.4 * 9e-6 * (1.0 + 1j / 50.0), rel=0.03)


def test_a_spring_of_the_third_power_makes_a_line_at_three_times() -> None:
    moved = Injection("mass-2", "x", 9e-6, F_HIGH)
    change = changed({"cubic-stiffness": {"kappa3[2]": 1e6}}, moved, hold="mass-1")
    assert line(change.twice_different, 3.0 * F_HIGH) == pytest.approx(-1e6 / 1.36 * (9e-6) ** 3 / 4.0, rel=0.03)


def test_a_charge_drifts_and_steps() -> None:
    drifting = changed({"charge": {"rate[1]": 1e-13}})
    assert_like(drifting.twice_different[100:], 1e-13 * T_S[100:], 0.04)
    stepping = changed({"charge": {"step[2]": 1e-9, "steps_per_orbit": 20.0}})
    steps = np.diff(stepping.twice_different)
    assert 25 < np.sum(np.abs(steps) > 5e-10) < 55
    assert np.sort(np.abs(steps))[-20:] == pytest.approx(1e-9, rel=0.03)


def test_magnetic_forces_have_the_orbit_s_lines() -> None:
    change = changed({"magnetic": {"a1_cos[1]": 1e-12, "a2_sin[2]": 2e-12}})
    assert line(change.twice_different, F_ORB) == pytest.approx(1e-12, rel=0.03)
    assert line(change.twice_different, 2.0 * F_ORB) == pytest.approx(2e-12j, rel=0.03)


def test_glitches_are_pulses_in_both_sensors() -> None:
    change = changed({"glitches": {"amplitude": 1e-8, "per_orbit": 10.0, "phased": 0.5, "ratio": 0.5}})
    x = change.twice_different
    starts = np.flatnonzero((np.abs(x[1:]) > 1e-13) & (np.abs(x[:-1]) <= 1e-13))
    assert 12 <= len(starts) <= 28
    assert 1e-10 < np.abs(x).max() < 5e-9
    # Five an orbit come again an orbit later.
    again = [np.min(np.abs(starts - at - 23_800)) < 2 for at in starts if at < 23_800]
    assert 4 <= sum(again) <= 6
    assert np.abs(change.of("m1_y")).max() > 0.0


def test_aberration_is_a_constant_and_an_orbital_attitude_error() -> None:
    annual = changed({"tracker-aberration": {"annual": 1.0}})
    bias = changed({"tracker-bias": {"y": 29.78e3 / LIGHT_M_S}})
    assert np.array_equal(annual.made.telemetry, bias.made.telemetry)
    orbital = changed({"tracker-aberration": {"orbital": 1.0}})
    at = place(T_S, ORBIT_S, 5e-3, 0.0)
    angle = -7.49e3 / LIGHT_M_S * np.stack([0.0 * T_S, at.cosine, at.sine], axis=1)
    _, dy, dz = orbital.instrument.delta_m
    # It turns at the orbit's frequency: n^2 times the angle is its acceleration.
    inertia = -(N**2) * (angle[::100, 2] * dy - angle[::100, 1] * dz)
    assert_like(orbital.twice_different[::100], of_gradient(turned(angle), orbital.instrument) + inertia, 0.06)


def test_a_tracker_that_is_askew_turns_the_gradient() -> None:
    change = changed({"tracker-bias": {"x": 1e-3, "y": -2e-3, "z": 3e-3}})
    angle = np.tile([-1e-3, 2e-3, -3e-3], (SAMPLES, 1))
    assert_like(change.twice_different[::100], of_gradient(turned(angle), change.instrument), 0.06)


def test_a_wrong_date_is_a_gradient_of_another_time() -> None:
    change = changed({"orbit-dating": {"delay": 20.0}})
    later = np.array(
        [gradient(N * (t + 20.0), 5e-3, N, np.zeros(3)) - gradient(N * t, 5e-3, N, np.zeros(3)) for t in T_S[::100]]
    )
    assert_like(change.twice_different[::100], of_gradient(later, change.instrument), 0.06)
    assert not np.any(change.of("t_xx")[np.abs(change.of("att_y")) == 0.0])


def test_the_perigee_goes_on() -> None:
    change = changed({"orbit-precession": {"rate": 2e-7, "eccentricity_rate": 0.0}})
    # An orbit that has turned is seen as an attitude that has turned back.
    angle = np.stack([0.0 * T_S, 2e-7 * T_S, 0.0 * T_S], axis=1)
    assert_like(change.twice_different[::100], of_gradient(turned(angle), change.instrument), 0.06)
    rounder = changed({"orbit-precession": {"eccentricity_rate": -1e-7}})
    assert np.abs(line(rounder.twice_different[-23_800:], F_ORB)) > 0.0


def test_the_earth_s_flatness_adds_its_gradient() -> None:
    change = changed({"gravity-j2": {"j2": 1.08263e-3, "inclination": 1.7157, "perigee": 0.5}})
    xx, _, _, xy, xz, _ = oblateness(place(T_S, ORBIT_S, 5e-3, 0.0), ORBIT_S, 1.08263e-3, 1.7157, 0.5).T
    dx, dy, dz = change.instrument.delta_m
    assert_like(change.twice_different, xx * dx + xy * dy + xz * dz, 0.05)
    assert np.abs(line(xx, 2.0 * F_ORB)) / 1.6727e-6 == pytest.approx(6e-3, rel=1.0)
    assert not np.any(change.of("t_xx") > 1e-12), "the ground does not believe in it"


def test_sensors_read_one_after_the_other_differ_by_the_rate() -> None:
    wanted = Injection("drag-free", "x", 5e-8, F_LOW)
    change = changed({"sensor-skew": {"delay": 0.01}}, wanted)
    rate = np.gradient(change.without.common("x"), STEP_S)
    assert_like(change.twice_different[1:], 0.01 * rate[:-1], 0.03)


def test_thrusters_that_cannot_do_more_do_not_hold() -> None:
    weak = changed({"thrust-quantisation": {"maximum": 1e-8}})
    assert np.std(weak.made.common("x")) > 1e-9 > 100.0 * np.std(weak.without.common("x"))
    coarse = changed({"thrust-quantisation": {"step": 1e-9, "minimum": 5e-9}})
    assert 1e-11 < np.std(coarse.of("m1_x")) < 1e-8
    assert np.abs(coarse.made.common("x").mean()) < 1e-12


def test_masses_that_drift_together_are_answered_by_thrust() -> None:
    change = changed({"mass-drift": {"rate_x": 1e-6}})
    expected = change.made.column("t_xx") * 1e-6 * T_S
    assert_like(change.of("command_x")[400:], expected[400:], 0.08)


def test_a_cubic_sensor_makes_a_line_at_three_times_the_stimulus() -> None:
    wanted = Injection("drag-free", "x", 5e-8, F_LOW)
    change = changed({"cubic-electrode": {"k3[1]": 4e8}}, wanted)
    assert line(change.twice_different, 3.0 * F_LOW) == pytest.approx(4e8 * (5e-8) ** 3 / 4.0, rel=0.05)


def test_a_cross_quadratic_sensor_takes_y_for_x() -> None:
    wanted = Injection("drag-free", "y", 5e-8, F_LOW)
    change = changed({"cross-quadratic": {"kxy[2]": 1e4}}, wanted)
    along_x = operating_point(change.instrument, change.settings)[1, 0]
    assert line(change.twice_different, F_LOW) == pytest.approx(-1e4 * along_x * 5e-8, rel=0.05)


def test_bias_drifts_with_time_and_its_square() -> None:
    change = changed({"bias-drift": {"rate[1]": 1e-15, "curvature[1]": 1e-18}})
    assert_like(change.twice_different, 1e-15 * T_S + 1e-18 * T_S**2)


def test_noise_gets_louder_and_softer() -> None:
    settings = SatelliteSettings.model_validate(
        {
            "kind": "drag-free-satellite",
            "seed": 1,
            "bounds": dict.fromkeys(("off_centring_m", "scale", "theta_d_rad", "eta_rad", "quadratic_s2_m"), 0.0),
            "effects": {"noise-level": {"change": 0.5, "period": 2.0 * ORBIT_S}},
        }
    )
    y = fly(settings, samples=SAMPLES).different("y")
    quarter = len(y) // 4
    rising, falling = (np.std(np.diff(y[at : at + quarter])) for at in (quarter // 2, 5 * quarter // 2))
    assert rising / falling == pytest.approx(1.45 / 0.55, rel=0.05)


def test_the_satellite_recoils_from_a_moved_mass() -> None:
    moved = Injection("mass-1", "x", 9e-6, F_LOW)
    change = changed({"moved-mass-reaction": {"factor": 1.0}}, moved, hold="mass-2")
    acceleration = -((2.0 * np.pi * F_LOW) ** 2) * 9e-6
    assert line(change.of("command_x"), F_LOW) == pytest.approx(0.4 / 300.0 * acceleration, rel=0.05)


def test_no_effect_does_anything_without_a_size() -> None:
    never = {"quality": 1.0, "period": 1.0}
    change = changed(
        {effect: {name: never.get(name, 0.0) for name in form.parameters} for effect, form in EFFECTS.items()}
    )
    assert np.array_equal(change.made.telemetry, change.without.telemetry)


@pytest.mark.parametrize(
    ("effects", "says"),
    [
        ({"charm": {}}, "unknown effect 'charm'"),
        ({"magnetic": {"b": 1.0}}, "has no parameter 'b'"),
        ({"charge": {"rate[3]": 1.0}}, "is for nothing here; write rate or rate\\[1\\] or rate\\[2\\]"),
        ({"wire-stiffness": {"kappa": 1e-3}}, "needs a quality above zero"),
    ],
)
def test_effects_that_cannot_be_are_refused(effects: dict[str, Any], says: str) -> None:
    with pytest.raises(ValidationError, match=says):
        quiet(effects=effects)
