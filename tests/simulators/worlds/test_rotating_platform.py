"""The rotating platform's world against what Lenoir et al. 2013 print and against physics done by hand."""

from __future__ import annotations

import itertools
import math
import tracemalloc
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from rigctl.core.arrays import FloatArray
from simulators.clock import VirtualClock
from simulators.motion import MotionAxis
from simulators.wiring import TriggerLine, VoltageLine
from simulators.worlds.platform_settings import PlatformSettings
from simulators.worlds.rotating_platform import RotatingPlatform

G_A, G_B = 846.73, 804.32
SILENT: dict[str, Any] = {
    "chain_noise": {"white_v2_hz": 0.0, "red_v2_hz": 0.0},
    "pendulum_noise": {"asd_m_s2_rthz": 0.0},
    "repeatability_rad": 0.0,
    "adc": {"bits": 32},
    "temperature": {"mean_c": 22.0, "daily_k": 0.0, "drift_k_per_day": 0.0},
}
"""A world without chance, and next to no steps."""
UNCLIPPED = {"bits": 32, "range_v": 1e3}
PATTERNS = {"b": 10.0, "c": 5.0}
"""How long one turn takes."""


def dwells(pattern: str, period_s: float) -> list[tuple[float, float, int]]:
    """Dwells of a period: start, stop, sign."""
    if pattern == "b":
        r = PATTERNS["b"]
        cuts = [0.0, period_s / 4 - r / 2, period_s / 4 + r / 2, 3 * period_s / 4 - r / 2, 3 * period_s / 4 + r / 2]
        return [(cuts[0], cuts[1], 1), (cuts[2], cuts[3], -1), (cuts[4], period_s, 1)]
    r, h = PATTERNS["c"], period_s / 2
    a = (math.sqrt(1.25 * h * h - r * r) - (h / 2 + r)) / 2
    b = a + h / 2
    middle = [(h - b, h - a - r, -1), (h - a, h + a, 1), (h + a + r, h + b, -1)]
    return [(0.0, h - b - r, 1), *middle, (h + b + r, period_s, 1)]


@dataclass
class Run:
    """A run's samples: masked sign, volts by chain."""

    t_s: FloatArray
    sign: FloatArray
    volts: dict[str, FloatArray]

    @property
    def m_z(self) -> FloatArray:
        return self.volts["q_a_v"] / G_A

    @property
    def m_y(self) -> FloatArray:
        return self.volts["q_b_v"] / G_B

    def means(self, m: FloatArray) -> tuple[float, float]:
        """Mean acceleration and bias over the whole run by the projection."""
        n = np.abs(self.sign).sum()
        return float(self.sign @ m / n), float(np.abs(self.sign) @ m / n)

    def by_period(self, m: FloatArray, periods: int) -> FloatArray:
        sign, m = self.sign.reshape(periods, -1), m.reshape(periods, -1)
        return np.asarray((sign * m).sum(axis=1) / np.abs(sign).sum(axis=1))


class Stand:
    """A platform world, its platform, its voltages, and runs on it."""

    def __init__(self, effects: Mapping[str, Mapping[str, float]] | None = None, **settings: Any) -> None:
        self.settings = PlatformSettings.model_validate(
            {"kind": "rotating-platform", "seed": 3, **settings, "effects": effects or {}}
        )
        self.clock, self.axis, self.trigger = VirtualClock(), MotionAxis(history_s=1e6), TriggerLine()
        self.inputs = {"dm1_y_v": VoltageLine(), "dm1_z_v": VoltageLine()}
        self.world = RotatingPlatform(self.settings, self.clock, self.axis, self.trigger, self.inputs)

    def command(self, name: str, volts: float) -> None:
        self.inputs[name].drive(self.clock.now_s(), lambda times_s: np.full_like(times_s, volts))

    def run(
        self,
        pattern: str = "b",
        period_s: float = 60.0,
        periods: int = 1,
        rate_hz: float = 10.0,
        number: int = 1,
        forward: bool = False,
        chunk: int = 1 << 30,
        start_s: float = 0.0,
    ) -> Run:
        """Turn as the pattern says and read both chains at (k + 1/2) / rate."""
        samples, turn_s = round(periods * period_s * rate_hz), PATTERNS[pattern]
        table = dwells(pattern, period_s)
        for begin_s in start_s + period_s * np.arange(periods):
            for (_, stop_s, _), (_, _, following) in itertools.pairwise(table):
                now_deg = self.axis.position(begin_s + stop_s)
                target_deg = now_deg + 180.0 if forward else (0.0 if following > 0 else 180.0)
                self.axis.turn_to(begin_s + stop_s, target_deg, turn_s)
        self.world.announce_run(number)
        self.trigger.begin(start_s + 0.5 / rate_hz, 1.0 / rate_hz, samples)
        t_s = start_s + (np.arange(samples) + 0.5) / rate_hz
        chunks = [t_s[first : first + chunk] for first in range(0, samples, chunk)]
        volts = {
            column: np.concatenate([self.world.chain_v(column)(part) for part in chunks])
            for column in ("q_a_v", "q_b_v")
        }
        place = (t_s - start_s) % period_s
        sign = np.zeros(samples)
        for first_s, stop_s, s in table:
            sign[(place >= first_s) & (place < stop_s)] = s
        return Run(t_s, sign, volts)


def silent(effects: Mapping[str, Mapping[str, float]] | None = None, **settings: Any) -> Stand:
    return Stand(effects, **{**SILENT, **settings})


def added(effects: Mapping[str, Mapping[str, float]], **how: Any) -> tuple[Run, FloatArray, FloatArray]:
    """What effects add to m_z and m_y along a run, and the run."""
    settings = {key: how.pop(key) for key in list(how) if key in PlatformSettings.model_fields}
    run, plain = silent(effects, **settings).run(**how), silent(**settings).run(**how)
    return run, run.m_z - plain.m_z, run.m_y - plain.m_y


# The baseline


def test_a_scan_gives_eq_6_in_its_consistent_reading() -> None:
    stand = silent()
    for number, angle_deg in enumerate(range(0, 360, 15)):
        stand.axis.place(100.0 * number, float(angle_deg))
        stand.axis.turn_to(100.0 * number, angle_deg + 0.0, 1.0)
    times_s = 100.0 * np.arange(24) + 50.0
    theta = np.deg2rad(np.arange(0, 360, 15))
    a_y, a_z = -2.98e-4, 2.8757e-4
    m_z = stand.world.chain_v("q_a_v")(times_s) / G_A
    m_y = stand.world.chain_v("q_b_v")(times_s) / G_B
    assert m_z == pytest.approx(-a_y * np.sin(theta) + a_z * np.cos(theta) + 10.54e-4, abs=5e-8)
    assert m_y == pytest.approx(a_y * np.cos(theta) + a_z * np.sin(theta) - 14.33e-4, abs=6e-7)


def test_the_regression_on_the_command_gives_eq_13() -> None:
    levels_v, found = [0.0, 0.5, 1.0, 1.5], []
    for volts in levels_v:
        stand = silent()
        stand.command("dm1_z_v", volts)
        run = stand.run()
        found.append(run.means(run.m_z)[0])
    slope, intercept = np.polyfit(np.array(levels_v) / 825.0, found, 1)
    assert slope == pytest.approx(0.964, abs=1e-4)
    assert intercept == pytest.approx(2.8757e-4, abs=2e-8)


def test_a_tilt_about_z_is_seen_by_y_at_rest_and_not_by_z() -> None:
    stand = silent()
    stand.command("dm1_y_v", 0.805)
    run, plain = stand.run(), silent().run()
    assert run.means(run.m_y)[0] - plain.means(plain.m_y)[0] == pytest.approx(1e-3, rel=1e-6)
    assert run.means(run.m_z)[0] == pytest.approx(plain.means(plain.m_z)[0], abs=1e-9)


def test_what_is_commanded_is_felt_at_the_instant_of_the_sample() -> None:
    stand = silent()
    stand.inputs["dm1_z_v"].drive(-1.0, lambda times_s: np.sin(2.0 * np.pi * times_s / 45.0))
    run, plain = stand.run(), silent().run()
    wanted = run.sign * 0.964 / 825.0 * np.sin(2.0 * np.pi * run.t_s / 45.0)
    kept = run.sign != 0
    assert (run.m_z - plain.m_z)[kept] == pytest.approx(wanted[kept], abs=2e-9)


def test_the_converter_has_16_bits_and_saturates_at_its_range() -> None:
    stand = Stand({"off-centre": {"r_cos": 0.05}})
    run = stand.run("c")
    step_v = 20.0 / 65536.0
    volts = run.volts["q_a_v"]
    assert volts / step_v == pytest.approx(np.rint(volts / step_v), abs=1e-6)
    assert len(np.unique(volts)) > 100
    assert volts.min() == -10.0
    assert np.all(np.abs(volts[run.sign != 0]) < 2.0)
    wide = Stand({"off-centre": {"r_cos": 0.05}}, adc={"range_v": 100.0, "bits": 16}).run("c").volts["q_a_v"]
    assert wide.min() == pytest.approx(-(0.05 * (2.0 * math.pi / 5.0) ** 2) * G_A, rel=0.03)


# Noise


@pytest.mark.parametrize(("folding", "sigma_1h"), [(1.0, 1.808e-7), (4.0, 2.94e-7)])
def test_the_precision_of_pattern_c_is_what_the_theory_says(folding: float, sigma_1h: float) -> None:
    """1.808e-7 m/s2 in an hour at tau = 1 min: the scatter of 400 periods has a relative sigma of 3.5 %."""
    run = Stand(chain_noise={"folding": folding}).run("c", periods=400, chunk=10_000)
    scatter = np.std(run.by_period(run.m_z, 400), ddof=1) * math.sqrt(60.0 / 3600.0)
    assert scatter == pytest.approx(sigma_1h, rel=0.13)
    y = np.std(run.by_period(run.m_y, 400), ddof=1) * math.sqrt(60.0 / 3600.0)
    assert y == pytest.approx(sigma_1h * G_A / G_B, rel=0.13)


@pytest.mark.parametrize("rate_hz", [10.0, 100.0, 200.0])
def test_the_white_level_is_the_same_at_every_rate(rate_hz: float) -> None:
    run = Stand(pendulum_noise={"asd_m_s2_rthz": 0.0}).run(rate_hz=rate_hz, periods=2)
    kept = run.volts["q_a_v"][run.sign > 0]
    jumps = np.diff(kept)[np.abs(np.diff(kept)) < 1.0]
    assert np.var(jumps) / 2.0 == pytest.approx(3.1925e-5 * rate_hz, rel=0.25)


def test_the_chains_have_noise_of_their_own_and_share_the_pendulums() -> None:
    def read(angle_deg: float) -> dict[str, FloatArray]:
        stand = silent(pendulum_noise={"asd_m_s2_rthz": 3e-5})
        stand.axis.place(-1.0, angle_deg)
        stand.trigger.begin(0.0, 0.1, 500)
        return {column: stand.world.chain_v(column)(0.1 * np.arange(500)) for column in ("q_a_v", "q_b_v")}

    along, across = read(0.0), read(90.0)
    a_y, a_z = along["q_b_v"] / G_B, along["q_a_v"] / G_A
    assert np.std(a_y) > 1e-4
    assert np.std(a_z) > 1e-4
    assert abs(np.corrcoef(a_y, a_z)[0, 1]) < 0.3
    # A quarter turn on, z feels minus what y felt, and y what z felt.
    assert np.diff(across["q_a_v"]) / G_A == pytest.approx(-np.diff(a_y), abs=1e-9)
    assert np.diff(across["q_b_v"]) / G_B == pytest.approx(np.diff(a_z), abs=1e-9)
    alone = Stand(pendulum_noise={"asd_m_s2_rthz": 0.0}).run()
    first = alone.t_s < 10.0
    assert abs(np.corrcoef(np.diff(alone.m_z[first]), np.diff(alone.m_y[first]))[0, 1]) < 0.4


def test_the_bias_wanders_from_where_it_is_and_the_acceleration_does_not() -> None:
    biases, accelerations = [], []
    for number in range(30):
        run = Stand().run("c", period_s=300.0, number=number)
        accel, bias = run.means(run.m_z)
        biases.append(bias)
        accelerations.append(accel)
    assert np.mean(biases) == pytest.approx(10.54e-4, abs=1e-5)
    assert 5.0 * np.std(accelerations) < np.std(biases) < 2e-5
    assert np.std(accelerations) == pytest.approx(3.830e-7 * math.sqrt(12.0), rel=0.5)


# What a run is


def test_nature_depends_on_seed_and_run_and_not_on_how_or_when_it_is_asked() -> None:
    loose: dict[str, Any] = {"repeatability_rad": 1e-2}
    run = Stand(**loose).run(number=5)
    chunked = Stand(**loose).run(number=5, chunk=37)
    stand = Stand(**loose)
    stand.run(number=4)
    later = stand.run(number=5, start_s=120.0)
    other, seed = Stand(**loose).run(number=6), Stand(seed=4, **loose).run(number=5)
    for column in run.volts:
        assert np.array_equal(run.volts[column], chunked.volts[column])
        assert np.array_equal(run.volts[column], later.volts[column])
        for another in (other, seed):
            assert np.mean(run.volts[column] == another.volts[column]) < 0.1


def test_trains_of_one_run_are_one_record_and_the_noise_goes_on_through_the_gap() -> None:
    whole = Stand()
    whole.world.announce_run(1)
    whole.trigger.begin(0.05, 0.1, 2000)
    t_s = 0.05 + 0.1 * np.arange(2000)
    reference = whole.world.chain_v("q_a_v")(t_s)
    parted = Stand()
    parted.world.announce_run(1)
    parted.trigger.begin(0.05, 0.1, 900)
    first = parted.world.chain_v("q_a_v")(t_s[:900])
    parted.trigger.begin(t_s[950], 0.1, 1050)
    second = parted.world.chain_v("q_a_v")(t_s[950:])
    assert np.array_equal(np.concatenate([first, second]), np.delete(reference, np.s_[900:950]))
    parted.trigger.begin(t_s[-1] + 5.0, 0.01, 100)
    assert not np.any(parted.world.chain_v("q_a_v")(t_s[-1] + 5.0 + 0.01 * np.arange(100)) == second[50:150])


def test_a_single_reading_outside_a_train_is_a_reading() -> None:
    stand = Stand()
    once, again = (stand.world.chain_v("q_a_v")(np.array([12.5])) for _ in range(2))
    assert once == again
    assert once == pytest.approx([G_A * (10.54e-4 + 2.8757e-4)], abs=0.4)
    assert stand.world.chain_v("q_a_v")(np.array([12.6])) != once


def test_time_can_only_go_on() -> None:
    stand = Stand()
    stand.trigger.begin(0.0, 0.1, 200_000)
    read = stand.world.chain_v("q_a_v")
    read(np.array([19_000.0]))
    with pytest.raises(ValueError, match="forgotten; ask in order of time"):
        read(np.array([1.0]))


def test_memory_does_not_grow_with_the_record() -> None:
    def peak_bytes(samples: int) -> int:
        stand = Stand()
        stand.trigger.begin(0.05, 0.1, samples)
        read = stand.world.chain_v("q_a_v")
        read(np.array([0.05]))
        tracemalloc.start()
        for first in range(0, samples, 5000):
            read(0.05 + 0.1 * np.arange(first, first + 5000))
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak

    short, long = peak_bytes(50_000), peak_bytes(500_000)
    assert long < 1.2 * short
    assert long < 4e6


def test_a_column_no_chain_gives_is_refused() -> None:
    with pytest.raises(ValueError, match="no chain gives 'accel_v'; there are: q_a_v, q_b_v"):
        Stand().world.chain_v("accel_v")


# The flip


def test_a_flip_shows_scale_factor_and_bias_of_each_chain() -> None:
    for column, scale, gain, bias_v in (("q_a_v", G_A, 1010.9, 0.2221), ("q_b_v", G_B, 990.54, -0.0527)):
        stand = silent()
        volts = {}
        for number, sign in enumerate((1, -1, 0)):
            stand.world.flip(sign)
            volts[sign] = float(stand.world.chain_v(column)(np.array([100.0 * number]))[0])
        assert gain * (volts[1] - volts[-1]) / (2.0 * 9.81) == pytest.approx(scale, rel=1e-8)
        assert gain * (volts[1] + volts[-1]) / 2.0 == pytest.approx(bias_v, abs=1e-4)
        assert abs(volts[1]) < 10.0
        assert abs(volts[0]) < 2.0
    with pytest.raises(ValueError, match="a flip is"):
        silent().world.flip(2)


def test_a_flip_takes_its_time() -> None:
    stand = silent(flip_s=42.0)
    assert stand.world.flip(1) == pytest.approx(stand.clock.now_s() + 42.0)


# The effects


def test_theta_locked_bias_enters_the_mean_acceleration_one_to_one() -> None:
    for pattern in PATTERNS:
        run, z, y = added({"theta-locked-bias": {"e1[z]": 1e-6, "e2[z]": 5e-6}}, pattern=pattern)
        assert run.means(z)[0] == pytest.approx(1e-6, rel=1e-3)
        assert run.means(z)[1] == pytest.approx(0.0, abs=1e-9)
        assert not np.any(y)


def test_pendulum_reaction_is_the_same_times_g() -> None:
    run, z, y = added({"pendulum-reaction": {"d": 1e-8}})
    assert run.means(z)[0] == pytest.approx(9.81e-8, rel=1e-2)
    assert run.means(y)[0] == pytest.approx(9.81e-8, rel=1e-2)


def test_off_centre_forces_act_while_turning_only_and_are_those_of_the_motion() -> None:
    run, z, _ = added({"off-centre": {"r_cos": 0.01, "r_sin": 0.02}}, adc=UNCLIPPED, rate_hz=200.0)
    assert np.abs(z[run.sign != 0]).max() < 1e-9
    turning = (run.t_s > 10.0) & (run.t_s < 20.0)
    u = 0.1 * (run.t_s[turning] - 10.0)
    theta = np.pi * (u - np.sin(2.0 * np.pi * u) / (2.0 * np.pi))
    omega = np.gradient(theta, 0.005)
    wanted = -(0.01 * omega**2 + 0.02 * np.gradient(omega, 0.005))
    assert z[turning][5:-5] == pytest.approx(wanted[5:-5], abs=1e-5)


def test_turning_always_forward_moves_the_euler_leak_from_acceleration_to_bias() -> None:
    """A mask 0.5 s short on both sides of each turn leaks 7.3e-5 m/s2 into mean a; short behind it, half of that."""
    before, behind = ((10.0, 1.0), (40.0, -1.0)), ((19.5, -1.0), (49.5, 1.0))

    def leak(kept: Any, *, forward: bool = False) -> tuple[float, float]:
        run, z, _ = added({"off-centre": {"r_sin": 0.05}}, adc=UNCLIPPED, forward=forward)
        for first_s, sign in kept:
            run.sign[(run.t_s >= first_s) & (run.t_s < first_s + 0.5)] = sign
        return run.means(z)

    assert abs(leak((*before, *behind))[0]) == pytest.approx(7.3e-5, rel=0.01)
    back, on = leak(behind), leak(behind, forward=True)
    assert abs(back[0]) == pytest.approx(3.7e-5, rel=0.02)
    assert abs(back[1]) < 1e-8
    assert abs(on[0]) < 1e-8
    assert abs(on[1]) == pytest.approx(abs(back[0]), rel=1e-6)


@pytest.mark.parametrize(("effect", "where"), [("recovery", 1), ("recovery-signed", 0)])
def test_recoveries_die_away_after_each_turn(effect: str, where: int) -> None:
    run, z, _ = added({effect: {"e": 1e-6, "t_r": 5.0}}, periods=2)
    found = run.means(z)
    # Dwells of 20 s after each turn; the first 10 s of the run follow none.
    one = 5.0 / 20.0 * (1.0 - math.exp(-20.0 / 5.0)) * 1e-6
    half = 5.0 / 10.0 * (1.0 - math.exp(-10.0 / 5.0)) * 1e-6
    wanted = (20.0 * one + 20.0 * one + 20.0 * one + 10.0 * half) / 80.0
    assert abs(found[where]) == pytest.approx(wanted, rel=0.01)
    assert abs(found[1 - where]) < 0.15 * wanted
    turning = run.sign == 0
    assert not np.any(z[turning & (run.t_s < 20.0)])


def test_the_bias_follows_the_temperature_and_only_where_asked() -> None:
    weather = {"mean_c": 22.0, "daily_k": 0.0, "cycle_k": 0.5, "cycle_s": 120.0, "drift_k_per_day": 86.4}
    effects = {"thermal-bias": {"b1[z]": 1e-6, "b2[z]": 2e-7, "b3[z]": 3e-8}}
    run, z, y = added(effects, temperature=weather)
    warmer = 0.5 * np.sin(2.0 * np.pi * run.t_s / 120.0) + 1e-3 * run.t_s
    assert z == pytest.approx(1e-6 * warmer + 2e-7 * warmer**2 + 3e-8 * warmer**3, abs=1e-10)
    assert not np.any(y)


def test_the_scale_factor_drifts_in_what_is_felt() -> None:
    run, z, _ = added({"gain-drift": {"k0": 1e-3, "k1": 1e-4}})
    felt = run.sign * 2.8757e-4 + 9.81 * 8.07e-5
    kept = run.sign != 0
    assert z[kept] == pytest.approx((felt * (1e-3 + 1e-4 * run.t_s))[kept], rel=1e-3, abs=1e-9)


def test_a_line_is_a_line_with_a_phase_of_its_own_in_each_run() -> None:
    phases = []
    for number in (1, 2, 3):
        run, z, _ = added({"line": {"amplitude": 1e-6, "frequency": 0.14}}, number=number, period_s=300.0)
        turn = 2.0 * np.pi * 0.14 * (run.t_s - run.t_s[0])
        (sine, cosine), residue, *_ = np.linalg.lstsq(np.column_stack([np.sin(turn), np.cos(turn)]), z, rcond=None)
        assert math.hypot(sine, cosine) == pytest.approx(1e-6, rel=1e-3)
        assert residue[0] < 1e-6 * len(z) * 1e-12
        phases.append(math.atan2(cosine, sine))
    assert len({round(phase, 2) for phase in phases}) == 3


def test_the_platform_stops_where_it_can() -> None:
    stops: dict[str, Any] = {"repeatability_rad": 0.0}
    run, z, _ = added({"platform-repeatability": {"stop": 1e-3, "backlash": 4e-4}}, **stops)
    # m_z = -a_Y sin + a_Z cos: an angle d away from 0 adds -a_Y d, from pi +a_Y d.
    away, back = run.sign < 0, (run.sign > 0) & (run.t_s > 40.0)
    assert z[away] == pytest.approx(-2.98e-4 * (1e-3 + 2e-4), rel=1e-2)
    assert z[back] == pytest.approx(2.98e-4 * -2e-4, rel=1e-2)
    scattered = silent(repeatability_rad=1e-3).run("b", periods=100)
    dwell = scattered.m_z.reshape(100, -1)[:, 300]
    plain = silent().run("b", periods=1).m_z[300]
    assert np.std(dwell - plain) == pytest.approx(2.98e-4 * 1e-3, rel=0.3)
    assert abs(np.mean(dwell - plain)) < 4.0 * 2.98e-4 * 1e-3 / 10.0


def test_cross_axis_shows_the_other_tilt() -> None:
    run, z, y = added({"cross-axis": {"k[z]": 1e-3}})
    assert run.means(z)[0] == pytest.approx(-2.98e-4 * 1e-3, rel=1e-2)
    assert not np.any(y)


def test_quadratic_and_asymmetry_act_on_all_that_is_read() -> None:
    for effects, wanted in (
        ({"quadratic": {"K2": 30.0}}, lambda m: 30.0 * m**2),
        ({"gain-asymmetry": {"e": 0.1}}, lambda m: 0.1 * np.abs(m)),
    ):
        _, z, y = added(effects)
        plain = silent().run()
        assert z == pytest.approx(wanted(plain.m_z), rel=1e-3)
        assert y == pytest.approx(wanted(plain.m_y), rel=1e-3)


def test_clock_skew_lets_the_turn_reach_into_the_mask() -> None:
    """0.2 s late, r = 5 cm: 6.2e-6 m/s2 (b) and 9.9e-5 (c) at 1 min, worked out separately."""
    for pattern, leak in (("b", 6.2e-6), ("c", 9.9e-5)):
        run, z, _ = added(
            {"clock-skew": {"delay": 0.2, "r_sin": 0.05}},
            pattern=pattern,
            adc=UNCLIPPED,
            periods=2,
        )
        assert abs(run.means(z)[0]) == pytest.approx(leak, rel=0.08)
    run, z, _ = added({"clock-skew": {"drift": 1e-2, "r_sin": 0.05}}, adc=UNCLIPPED)
    late = np.flatnonzero(np.abs(z) > 1e-5)
    assert run.t_s[late[-1]] == pytest.approx(50.0 / 0.99, abs=0.15)


def test_the_filter_rings_after_a_turn_and_only_then() -> None:
    """r = 5 cm, elliptic at 5 Hz: 3.6e-6 m/s2 (b) and 5.8e-5 (c) at 1 min without guard, worked out separately."""
    for pattern, leak in (("b", 3.6e-6), ("c", 5.8e-5)):
        run, z, _ = added(
            {"filter-ringing": {"cutoff": 5.0, "r_sin": 0.05}},
            pattern=pattern,
            adc=UNCLIPPED,
            periods=3,
        )
        assert abs(run.means(z)[0]) == pytest.approx(leak, rel=0.1)
        first = dwells(pattern, 60.0)[0][1]
        assert not np.any(z[run.t_s < first])


def test_the_filter_is_the_filter() -> None:
    """Against scipy's own integration of the whole filter."""
    from scipy.signal import ellip, lsim

    run, z, _ = added(
        {"filter-ringing": {"cutoff": 1.0, "r_cos": 0.01, "r_sin": 0.02}},
        rate_hz=100.0,
        adc=UNCLIPPED,
    )
    zeros, poles, gain = ellip(8, 0.1, 80.0, 2.0 * np.pi, analog=True, output="zpk")
    gain = gain / np.real(gain * np.prod(-zeros) / np.prod(-poles))
    fine_s = np.arange(0.0, 60.0, 0.0005)
    force = np.zeros(fine_s.shape)
    for first_s, way in ((10.0, 1.0), (40.0, -1.0)):
        u = np.clip(0.1 * (fine_s - first_s), 0.0, 1.0)
        speed = way * np.pi / 10.0 * (1.0 - np.cos(2.0 * np.pi * u))
        force -= 0.01 * speed**2 + 0.02 * way * 2.0 * np.pi**2 / 100.0 * np.sin(2.0 * np.pi * u)
    _, filtered, _ = lsim((zeros, poles, gain), force, fine_s)
    assert z == pytest.approx(np.interp(run.t_s, fine_s, filtered), abs=2e-7)
    assert np.abs(z).max() > 2e-3


def test_a_tide_is_acceleration_and_no_bias() -> None:
    run, z, _ = added({"tide": {"amplitude[z]": 1e-6, "period": 43200.0}}, start_s=10_800.0)
    accel, bias = run.means(z)
    assert accel == pytest.approx(1e-6, rel=1e-3)
    assert bias == pytest.approx(0.0, abs=1e-9)


def test_the_room_can_be_brought_to_another_temperature() -> None:
    stand = silent()
    done_s = stand.world.bring_room_to(25.0)
    assert stand.world.temperature_c(np.array([0.0, done_s])) == pytest.approx([22.0, 25.0])


@pytest.mark.parametrize(
    ("effects", "fault"),
    [
        ({"roll-gravity": {"rho1": 1e-4}}, "unknown effect 'roll-gravity'; known: theta-locked-bias, off-centre"),
        ({"line": {"size": 1.0}}, "effect 'line' has no parameter 'size'; it has: amplitude, frequency"),
        ({"line": {"amplitude": 1e-6}}, "effect 'line' needs a frequency above zero"),
        ({"recovery": {"e": 1e-6, "t_r[z]": 5.0}}, "effect 'recovery' needs a t_r above zero"),
        (
            {"tide": {"amplitude[x]": 1e-6, "period": 1.0}},
            r"'amplitude\[x\]' is for nothing here; write amplitude or",
        ),
        ({"platform-repeatability": {"stop[z]": 1e-6}}, r"'stop\[z\]' is for nothing here; write stop"),
        ({"clock-skew": {"delay": -0.1}}, "delay and drift cannot be negative"),
    ],
)
def test_effects_that_make_no_sense_are_refused(effects: Any, fault: str) -> None:
    with pytest.raises(ValidationError, match=fault):
        Stand(effects)
