"""The compiled loop: the same as written plainly, and the closed loop's numbers."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.inflight_plain import PlainSatellite, State
from simulators.worlds.satellite.forcing import Command, Injection
from simulators.worlds.satellite.instrument import drawn
from simulators.worlds.satellite.layout import COLUMNS
from simulators.worlds.satellite.settings import SatelliteSettings
from simulators.worlds.satellite.simulation import Simulation
from tests.simulators.worlds.satellite.flights import F_CAL, F_ORB, STEP_S, Flown, fly, line, quiet

TURNED = Injection("attitude", "z", 1e-2, F_CAL)
COMMON = Injection("drag-free", "x", 5e-8, F_CAL)
INJECTIONS = [
    (Injection(), "both"),
    (COMMON, "both"),
    (TURNED, "both"),
    (Injection("masses", "y", 9e-6, 3.0756e-3, 0.4), "both"),
    (Injection("mass-1", "x", 9e-6, 8.9916e-3), "mass-2"),
]
PLAIN = ("m1_x", "m1_y", "m1_z", "m2_x", "m2_y", "m2_z")
OTHERS = ("dw_x", "dw_y", "dw_z", "att_x", "att_y", "att_z", "command_x", "command_y", "command_z")


@pytest.fixture(scope="module")
def turned() -> Flown:
    return fly(quiet(), TURNED)


@pytest.mark.parametrize(("injection", "hold"), INJECTIONS, ids=[one.target for one, _ in INJECTIONS])
def test_the_loop_does_what_it_does_when_written_plainly(injection: Injection, hold: str) -> None:
    settings = quiet(settle_s=0.0, bounds={"tracker_bias_rad": 1e-4})
    samples = 400
    flown = fly(settings, injection, hold=hold, samples=samples, draws=(5,))
    plain = PlainSatellite(settings, drawn(settings, 5), Command(samples, injection, hold))
    state, nothing = State(), np.zeros(18)
    rows = np.array([plain.step(state, STEP_S * k, nothing) for k in range(samples)])
    for place, name in enumerate((*PLAIN, *OTHERS)):
        scale = np.abs(rows[:, place]).max() + 1e-20
        assert np.abs(flown.column(name) - rows[:, place]).max() < 1e-10 * scale, name


def test_what_is_left_of_the_drag_at_the_orbit_s_frequency(at_rest: Flown) -> None:
    """The means of draws, beside one satellite that was measured: 1.14e-12, 2.6e-13 and 1.13e-12 m/s2."""
    x, y, z = (np.mean([abs(line(at_rest.common(axis, draw), F_ORB)) for draw in range(16)]) for axis in "xyz")
    assert (x, z) == pytest.approx((1.14e-12, 1.13e-12), rel=0.02)
    # Of the little on Y the thrusters' matrix decides: up to 2 % of the other axes' thrust is in it.
    assert y == pytest.approx(2.6e-13, abs=0.02 * (x + z))


def test_the_mean_common_output_is_held_at_zero(at_rest: Flown) -> None:
    assert all(abs(at_rest.common(axis, draw).mean()) < 1e-20 for axis in "xyz" for draw in range(16))


def test_with_noise_the_mean_is_held_nearly_at_zero() -> None:
    noisy = fly(SatelliteSettings(kind="drag-free-satellite", seed=17), draws=tuple(range(16)))
    means = np.array([[noisy.common(axis, draw).mean() for axis in "xyz"] for draw in range(16)])
    assert np.sqrt(np.mean(means**2)) < 1e-13


def test_an_injected_line_comes_out_as_wanted() -> None:
    found = line(fly(quiet(), COMMON).common("x"), F_CAL)
    assert abs(found) == pytest.approx(5.015e-8, rel=2e-4)
    assert found.real == pytest.approx(5.015e-8, rel=2e-4)


def test_an_attitude_line_comes_out_a_little_larger(turned: Flown) -> None:
    assert abs(line(turned.column("att_z"), F_CAL)) == pytest.approx(1.0157e-2, rel=2e-4)


def test_a_star_tracker_that_is_off_turns_the_satellite_the_other_way_and_nobody_knows(
    at_rest: Flown,
) -> None:
    settings = quiet(bounds={"tracker_bias_rad": 1e-4})
    instrument = drawn(settings, 2)
    off = fly(settings, draws=(2,))
    for axis in "xyz":
        believed = (off.column(f"att_{axis}") - at_rest.column(f"att_{axis}", 2)).mean()
        assert abs(believed) < 1e-3 * np.abs(instrument.tracker_bias_rad).max()
    # The lines of Dx and Dz at twice the orbit's frequency go into each other, and Dy comes in.
    twice = 2.0 * F_ORB
    change = line(off.different("x"), twice) - line(at_rest.different("x", 2), twice)
    dx, dy, dz = instrument.delta_m
    x, y, z = -instrument.tracker_bias_rad
    expected = 0.5 * 1.6727e-6 * (2.0 * y * (1j * dx + dz) - (z + 1j * x) * dy)
    assert abs(change - expected) < 0.02 * abs(expected)


def test_every_sample_comes_down_once_in_order_whatever_is_asked_for_at_a_time() -> None:
    settings = SatelliteSettings(kind="drag-free-satellite", seed=3, settle_s=100.0)
    whole = fly(settings, COMMON, samples=3000).telemetry
    simulation = Simulation(settings, (0,), 1, Command(3000, COMMON))
    parts = [simulation.take(count) for count in (1, 0, 7, 1000, 1991, 1, 50)]
    assert [len(part) for part in parts] == [1, 0, 7, 1000, 1991, 1, 0]
    assert np.array_equal(np.concatenate(parts), whole)


def test_a_draw_does_not_depend_on_the_others_that_fly_with_it() -> None:
    settings = SatelliteSettings(kind="drag-free-satellite", seed=3, settle_s=100.0)
    alone = fly(settings, draws=(7,), samples=500)
    among = fly(settings, draws=(1, 9, 7, 4), samples=500)
    assert np.array_equal(alone.telemetry[:, :, 0], among.telemetry[:, :, 2])
    another_run = fly(settings, draws=(7,), samples=500, run=2)
    assert not np.array_equal(alone.column("m1_x"), another_run.column("m1_x"))


def test_more_draws_than_lanes_are_refused() -> None:
    with pytest.raises(ValueError, match="17 draws in lock step; there are 1 to 16 lanes"):
        fly(quiet(), draws=tuple(range(17)), samples=1)


def test_the_gradient_in_telemetry_follows_from_orbit_and_attitude(at_rest: Flown, turned: Flown) -> None:
    assert set(COLUMNS) >= {"t_xx", "t_yy", "t_zz"}
    trace = sum(at_rest.column(name) for name in ("t_xx", "t_yy", "t_zz"))
    assert np.abs(trace).max() < 1e-20
    angle = turned.column("att_z")
    expected = angle * (at_rest.column("t_yy") - at_rest.column("t_xx"))
    assert np.abs(turned.column("t_xy") - expected).max() < 2e-2 * np.abs(expected).max()
