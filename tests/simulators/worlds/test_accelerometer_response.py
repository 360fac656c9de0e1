"""What the accelerometer gives against eq. 5 of Lucente et al. 2022 and the signature of each effect.

The formulas are first order in the small angles; tolerances are what the next order leaves.
"""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np
import pytest

from simulators.worlds.bench_settings import isa_twin

G = 9.803
A = 5e-3
GAIN = {"pendulum": 59.7, "flag": 100.0}
NO_ANGLES = {"mounting_sigma_rad": 0.0, "scatter_arcsec": 0.0}


class Bench(Protocol):
    truth: dict[str, Any]
    bench: Any

    def mount(self, axis: str = ..., configuration: str = ..., mounting: int = ..., level: bool = ...) -> None: ...
    def run(self, angle_deg: float, frequency_hz: float = ..., **how: Any) -> Any: ...
    def response(self, angle_deg: float, frequency_hz: float = ..., **how: Any) -> Any: ...


class MakeBench(Protocol):
    def __call__(self, effects: Any = ..., *, quiet: bool = ..., ideal: bool = ..., **changes: Any) -> Bench: ...


def omega(frequency_hz: float) -> float:
    return 2.0 * math.pi * frequency_hz


def from_null(bench: Bench, angle_deg: float) -> float:
    """theta - theta0 [rad]."""
    return math.radians(angle_deg - bench.truth["theta0_deg"])


def change(make_bench: MakeBench, effects: dict[str, Any], angle_deg: float, frequency_hz: float = 0.5) -> Any:
    """Harmonics with the effects minus without them, and the angle from the null; X in flag, first mounting."""
    with_them, without = make_bench(effects), make_bench()
    with_them.mount()
    without.mount()
    more, less = (b.response(angle_deg, frequency_hz) for b in (with_them, without))
    off = from_null(without, angle_deg)
    return more.dc - less.dc, more.fundamental - less.fundamental, more.second - less.second, off


@pytest.mark.parametrize("axis", ["X", "Y", "Z"])
@pytest.mark.parametrize("configuration", ["pendulum", "flag"])
@pytest.mark.parametrize("angle_deg", [-1.2, 0.3, 35.0])
def test_inertia_and_roll_give_eq_5(make_bench: MakeBench, axis: str, configuration: str, angle_deg: float) -> None:
    rho1 = 9.7e-5
    bench = make_bench({"roll-gravity": {"rho1": rho1}})
    bench.mount(axis, configuration)
    for frequency_hz in (0.3, 0.6):
        w, off = omega(frequency_hz), from_null(bench, angle_deg)
        eq_5 = GAIN[configuration] * (rho1 * A * G * math.cos(off) + A * w**2 * math.sin(off))
        measured = bench.response(angle_deg, frequency_hz).fundamental
        # The elevation of the levelled axis is below a milliradian: cos b is 1 to 5e-7.
        assert measured.real == pytest.approx(eq_5, rel=1e-6, abs=1e-9)
        assert measured.imag == pytest.approx(0.0, abs=1e-9)


def test_the_response_grows_with_the_angle(make_bench: MakeBench) -> None:
    bench = make_bench()
    bench.mount("Y", "pendulum")
    null_deg = bench.truth["theta0_deg"]
    assert bench.response(null_deg + 1.0).fundamental.real > 0.0
    assert bench.response(null_deg).fundamental == pytest.approx(0.0, abs=1e-9)
    assert bench.response(null_deg - 1.0).fundamental.real < 0.0


def test_curves_of_three_frequencies_cross_at_the_null_and_not_where_they_vanish(make_bench: MakeBench) -> None:
    bench = make_bench({"roll-gravity": {"rho1": 9.7e-5}})
    bench.mount()
    null_deg = bench.truth["theta0_deg"]
    at_null = [bench.response(null_deg, nu).fundamental.real for nu in (0.3, 0.5, 0.6)]
    assert at_null == pytest.approx([100.0 * 9.7e-5 * A * G] * 3, rel=1e-6)
    naive_deg = null_deg - math.degrees(9.7e-5 * G / omega(0.3) ** 2)
    assert abs(bench.response(naive_deg, 0.3).fundamental.real) < 1e-6 * at_null[0]
    assert abs(bench.response(naive_deg, 0.6).fundamental.real) > 0.5 * at_null[0]


def test_the_null_is_where_the_sensing_axis_is_perpendicular_to_the_motion(make_bench: MakeBench) -> None:
    # Perfectly mounted in flag, cube axes Y and Z of sensor X lie along x_T and -z_T.
    bench = make_bench(**NO_ANGLES)
    bench.mount("X", "flag", level=False)
    x, y, _ = 0.99992, 1.4503e-3, 1.2822e-2
    assert bench.truth["theta0_deg"] == pytest.approx(math.degrees(math.atan(y / x)), abs=1e-9)
    pendulum = make_bench(**NO_ANGLES)
    pendulum.mount("X", "pendulum", level=False)
    assert pendulum.truth["theta0_deg"] == pytest.approx(math.degrees(math.atan(1.2822e-2 / 0.99992)), abs=1e-9)


def test_static_gravity_is_what_the_elevation_gives(make_bench: MakeBench) -> None:
    bench = make_bench(**NO_ANGLES, sensors=sensors_with(bias_v=0.02))
    bench.mount("Y", "flag", level=False)
    # In flag the third axis, X for sensor Y, points down.
    length = math.hypot(-6.7925e-3, 0.99997, -1.9907e-3)
    expected = 100.0 * G * 6.7925e-3 / length + 0.02
    assert bench.response(0.5).dc == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("configuration", ["pendulum", "flag"])
@pytest.mark.parametrize("frequency_hz", [0.3, 0.6, 1.0])
def test_the_sensor_multiplies_by_its_transfer_function(
    make_bench: MakeBench, configuration: str, frequency_hz: float
) -> None:
    effects = {"roll-gravity": {"rho1": 9.7e-5}}
    real, ideal = make_bench(effects, ideal=False), make_bench(effects)
    real.mount("X", configuration)
    ideal.mount("X", configuration)
    w, w0 = omega(frequency_hz), omega({"pendulum": 4.53, "flag": 3.5}[configuration])
    h = w0**2 / (w0**2 - w**2 + 1j * w * w0 / 10.0)
    ratio = real.response(-0.8, frequency_hz).fundamental / ideal.response(-0.8, frequency_hz).fundamental
    assert ratio == pytest.approx(h, rel=1e-7)
    assert h.imag < 0.0


def test_a_resonance_given_as_an_effect_is_the_one_felt(make_bench: MakeBench) -> None:
    effects = {"resonance": {"inv_w0_squared[X,flag]": 1e-3, "damping[X,flag]": 2e-3}}
    real, ideal = make_bench(effects), make_bench()
    real.mount()
    ideal.mount()
    w = omega(0.5)
    ratio = real.response(0.7).fundamental / ideal.response(0.7).fundamental
    assert ratio == pytest.approx(1.0 / (1.0 - w**2 * 1e-3 + 1j * w * 2e-3), rel=1e-7)


def test_pitch_weighs_with_the_angle(make_bench: MakeBench) -> None:
    for nu in (0.3, 0.6):
        _, s, _, off = change(make_bench, {"pitch-gravity": {"pi1": 3e-4}}, 20.0, nu)
        assert s == pytest.approx(100.0 * G * 3e-4 * A * math.sin(off), rel=1e-3)


def test_bench_recoil_rolls_with_the_acceleration(make_bench: MakeBench) -> None:
    for nu in (0.3, 0.6):
        _, s, _, off = change(make_bench, {"bench-recoil": {"c": 2e-5}}, 20.0, nu)
        assert s == pytest.approx(100.0 * G * 2e-5 * A * omega(nu) ** 2 * math.cos(off), rel=1e-6)


def test_the_quadratic_term_gives_dc_and_the_second_harmonic(make_bench: MakeBench) -> None:
    k2 = 0.05
    dc, s, second, off = change(make_bench, {"quadratic": {"K2[X]": k2}}, 30.0)
    force = A * omega(0.5) ** 2 * math.sin(off)
    assert dc == pytest.approx(100.0 * 0.5 * k2 * force**2, rel=1e-6)
    assert s == pytest.approx(0.0, abs=1e-9)
    # sin^2 = (1 - cos 2) / 2, and a cosine is j in amplitudes of the sine.
    assert second == pytest.approx(-0.5j * 100.0 * k2 * force**2, rel=1e-6)


def test_the_quadratic_term_of_one_axis_is_not_felt_by_another(make_bench: MakeBench) -> None:
    dc, s, second, _ = change(make_bench, {"quadratic": {"K2[Y]": 1.0}}, 30.0)
    assert (dc, s, second) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("ideal", [True, False])
def test_time_skew_delays_the_accelerometer_and_not_the_lasers(make_bench: MakeBench, ideal: bool) -> None:
    tau = 1.7e-3
    late, sharp = make_bench({"time-skew": {"tau": tau}}, ideal=ideal), make_bench(ideal=ideal)
    late.mount()
    sharp.mount()
    for nu in (0.3, 0.6):
        late_run, sharp_run = (b.run(1.0, nu) for b in (late, sharp))
        ratio = late_run.harmonics(late_run.accel_v).fundamental / sharp_run.harmonics(sharp_run.accel_v).fundamental
        assert ratio == pytest.approx(np.exp(-1j * omega(nu) * tau), rel=1e-7)
        np.testing.assert_array_equal(late_run.lasers_mm["laser_1_mm"], sharp_run.lasers_mm["laser_1_mm"])


def test_yaw_turns_the_sensor_as_it_moves(make_bench: MakeBench) -> None:
    psi1 = 4e-4
    dc, s, second, off = change(make_bench, {"yaw": {"psi1": psi1}}, 20.0)
    size = 0.5 * 100.0 * psi1 * A**2 * omega(0.5) ** 2 * math.cos(off)
    assert dc == pytest.approx(size, rel=1e-3)
    assert second == pytest.approx(-1j * size, rel=1e-3)
    # Third order: what remains at nu is the square of the yaw.
    assert abs(s) < 100.0 * A * omega(0.5) ** 2 * (psi1 * A) ** 2


@pytest.mark.parametrize("angle_deg", [0.0, 60.0, -90.0])
def test_yaw_lever_acts_along_a_fixed_direction(make_bench: MakeBench, angle_deg: float) -> None:
    effects = {"yaw-lever": {"lever_cos": 1e-4, "lever_sin": -3e-4}}
    _, s, _, off = change(make_bench, effects, angle_deg)
    expected = 100.0 * A * omega(0.5) ** 2 * (1e-4 * math.cos(off) - 3e-4 * math.sin(off))
    assert s == pytest.approx(expected, rel=1e-6)


def test_axis_tilt_adds_gravity_that_goes_round(make_bench: MakeBench) -> None:
    effects = {"axis-tilt": {"eps_cos": 2e-4, "eps_sin": 5e-4}}
    tilted, upright = make_bench(effects), make_bench()
    for bench in (tilted, upright):
        bench.mount("X", "flag", level=False)
    tilted.bench.level()
    upright.bench.level()
    at = {}
    for angle_deg in (0.0, 40.0, 90.0, 170.0):
        off = from_null(upright, angle_deg)
        dc = tilted.response(angle_deg).dc - upright.response(angle_deg).dc
        at[angle_deg] = dc - 100.0 * G * (2e-4 * math.cos(off) + 5e-4 * math.sin(off))
    # Levelled at zero, where both stand at the same level: what differs from the formula is one constant.
    assert list(at.values()) == pytest.approx([at[0.0]] * 4, abs=2e-6)
    assert tilted.response(0.0).dc == pytest.approx(upright.response(0.0).dc, abs=1e-9)


def test_eccentricity_is_felt_as_an_angle(make_bench: MakeBench) -> None:
    e1, e2 = 3e-4, 2e-4
    bench = make_bench({"encoder-eccentricity": {"e1": e1, "e2": e2}})
    bench.mount()
    for angle_deg in (1.0, 50.0, -120.0):
        theta = math.radians(angle_deg)
        true = theta + e1 * math.cos(theta) + e2 * math.sin(theta)
        expected = 100.0 * A * omega(0.5) ** 2 * math.sin(true - math.radians(bench.truth["theta0_deg"]))
        assert bench.response(angle_deg).fundamental.real == pytest.approx(expected, rel=1e-6)


def test_hysteresis_shifts_the_null_against_the_approach(make_bench: MakeBench) -> None:
    h = 5e-5
    bench = make_bench({"cable-hysteresis": {"h": h}})
    bench.mount()
    scale = 100.0 * A * omega(0.5) ** 2
    from_below = bench.response(1.0).fundamental.real
    bench.run(2.0)
    from_above = bench.response(1.0).fundamental.real
    off = from_null(bench, 1.0)
    assert from_below == pytest.approx(scale * math.sin(off + h), rel=1e-6)
    assert from_above == pytest.approx(scale * math.sin(off - h), rel=1e-6)


WARM = {"temperature": {"mean_c": 21.0, "daily_k": 0.0, "drift_k_per_day": 400.0}}


def test_bias_follows_the_temperature(make_bench: MakeBench) -> None:
    warm, steady = make_bench({"thermal-bias": {"bT[X]": 0.03}}, **WARM), make_bench(**WARM)
    for bench in (warm, steady):
        bench.mount(level=False)
        bench.bench.level()
    drifts = []
    for bench in (warm, steady):
        early, late = bench.run(1.0), bench.run(1.0)
        warming = np.mean(bench.bench.temperature_c(late.times_s)) - np.mean(bench.bench.temperature_c(early.times_s))
        drifts.append(np.mean(late.accel_v) - np.mean(early.accel_v))
    assert warming > 0.1
    assert drifts[0] - drifts[1] == pytest.approx(0.03 * warming, rel=1e-6)


def test_gain_follows_the_temperature_for_motion_gravity_and_bias_alike(make_bench: MakeBench) -> None:
    k_t, bias_v = 2e-3, -0.5
    given = {"sensors": sensors_with(bias_v=bias_v), **WARM}
    warm, steady = make_bench({"thermal-gain": {"kT": k_t}}, **given), make_bench(**given)
    for bench in (warm, steady):
        bench.mount("Y", "flag", level=False)
    warm_run, steady_run = warm.run(-30.0), steady.run(-30.0)
    factor = 1.0 + k_t * (np.mean(warm.bench.temperature_c(warm_run.times_s)) - 21.0)
    assert factor > 1.005
    warm_seen, steady_seen = (r.harmonics(r.accel_v) for r in (warm_run, steady_run))
    assert warm_seen.dc / steady_seen.dc == pytest.approx(factor, abs=1e-5)
    # The level's drift within the record leaks 6e-5 V into a line of 2.5 V.
    assert abs(warm_seen.fundamental / steady_seen.fundamental) == pytest.approx(factor, abs=5e-5)


def drifted(make_bench: MakeBench, effects: dict[str, Any]) -> tuple[Any, Any, float, Any]:
    bench = make_bench(effects)
    bench.mount()
    early = bench.run(1.0)
    bench.wait_until(early.times_s[0] + 3600.0)
    late = bench.run(1.0)
    hours_s = late.times_s.mean() - early.times_s.mean()
    return early.harmonics(early.accel_v), late.harmonics(late.accel_v), hours_s, bench


def test_bias_drifts_with_time(make_bench: MakeBench) -> None:
    early, late, passed_s, _ = drifted(make_bench, {"bias-drift": {"rate": 1e-5}})
    assert late.dc - early.dc == pytest.approx(1e-5 * passed_s, rel=1e-6)
    assert late.fundamental == pytest.approx(early.fundamental, rel=1e-9)


def test_gain_drifts_with_time(make_bench: MakeBench) -> None:
    early, late, passed_s, bench = drifted(make_bench, {"gain-drift": {"rate": 1e-6}})
    started_s = late.fundamental.real / early.fundamental.real - 1.0
    origin = 1e-6 * passed_s / started_s
    # Referred to the gain at the early run: 1 + rate t there.
    assert started_s > 0.0
    assert origin == pytest.approx(1.0 + 1e-6 * (bench.clock.now_s() - passed_s), rel=1e-3)


def test_the_null_drifts_with_time(make_bench: MakeBench) -> None:
    rate = 1e-8
    early, late, passed_s, bench = drifted(make_bench, {"null-drift": {"rate[X]": rate}})
    scale = 100.0 * A * omega(0.5) ** 2
    off = from_null(bench, 1.0)
    shift = (late.fundamental.real - early.fundamental.real) / (scale * math.cos(off))
    assert shift == pytest.approx(-rate * passed_s, rel=1e-3)


def test_a_line_has_its_amplitude_and_frequency_and_a_phase_of_its_own_in_every_run(make_bench: MakeBench) -> None:
    humming, silent = make_bench({"mains-pickup": {"amplitude": 2e-3, "frequency": 7.3}}), make_bench()
    humming.mount()
    silent.mount()
    phases = []
    for number in (1, 2):
        runs = [b.run(1.0, number=number) for b in (humming, silent)]
        line = runs[0].accel_v - runs[1].accel_v
        t = runs[0].times_s - runs[0].times_s[0]
        columns = np.stack([np.sin(2 * np.pi * 7.3 * t), np.cos(2 * np.pi * 7.3 * t)], axis=1)
        (sine, cosine), left, *_ = np.linalg.lstsq(columns, line, rcond=None)
        assert math.hypot(sine, cosine) == pytest.approx(2e-3, rel=1e-9)
        assert left[0] < 1e-20
        phases.append(math.atan2(cosine, sine))
    assert phases[0] != pytest.approx(phases[1], abs=1e-3)


def test_effects_together_multiply_in_the_order_of_the_chain(make_bench: MakeBench) -> None:
    # Roll and quadratic before H, gain and skew after it.
    effects = {
        "roll-gravity": {"rho1": 2e-3},
        "quadratic": {"K2": 0.05},
        "time-skew": {"tau": 2e-3},
        "gain-drift": {"rate": 1e-6},
    }
    bench = make_bench(effects, ideal=False)
    bench.mount()
    run = bench.run(30.0)
    measured = run.harmonics(run.accel_v)
    w, w0, off = omega(0.5), omega(3.5), from_null(bench, 30.0)
    force = 2e-3 * A * G * math.cos(off) + A * w**2 * math.sin(off)
    gain = 100.0 * (1.0 + 1e-6 * (run.times_s.mean() - 2e-3))

    def chain(order: int) -> complex:
        v = order * w
        return gain * w0**2 / (w0**2 - v**2 + 1j * v * w0 / 10.0) * np.exp(-1j * v * 2e-3)

    assert measured.fundamental == pytest.approx(chain(1) * force, rel=2e-5)
    assert measured.second == pytest.approx(chain(2) * -0.5j * 0.05 * force**2, rel=2e-3)


def sensors_with(**change: Any) -> dict[str, Any]:
    sensors = isa_twin().model_dump()["sensors"]
    for sensor in sensors.values():
        sensor |= change
        sensor["pendulum"]["ideal"] = sensor["flag"]["ideal"] = True
    return sensors
