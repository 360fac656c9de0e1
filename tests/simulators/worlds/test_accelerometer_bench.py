"""Mounting, levelling, and a nature that is the same however it is asked."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from scipy.signal import welch

AXES = [(axis, configuration) for axis in "XYZ" for configuration in ("pendulum", "flag")]


def test_before_anything_is_mounted_there_is_no_voltage_and_nothing_for_the_lasers(make_bench: Any) -> None:
    bench = make_bench(quiet=False).bench
    times = np.array([1.0, 2.0])
    np.testing.assert_array_equal(bench.accelerometer_v(times), [0.0, 0.0])
    assert np.all(np.isnan(bench.displacement_mm("laser_1_mm")(times)))
    with pytest.raises(ValueError, match="mount the package first"):
        bench.level()


def test_what_is_not_there_is_refused_by_name(make_bench: Any) -> None:
    bench = make_bench().bench
    with pytest.raises(ValueError, match=r"no sensor 'W'.*X, Y, Z"):
        bench.remount("W", "flag", 1)
    with pytest.raises(ValueError, match=r"no configuration 'inverted'.*pendulum, flag"):
        bench.remount("X", "inverted", 1)
    with pytest.raises(ValueError, match=r"no laser head 'laser_9'.*laser_1_mm"):
        bench.displacement_mm("laser_9")


def test_no_times_give_no_values(make_bench: Any) -> None:
    bench = make_bench(quiet=False)
    bench.mount()
    for signal in (bench.bench.accelerometer_v, bench.bench.displacement_mm("laser_1_mm"), bench.bench.temperature_c):
        assert signal(np.empty(0)).shape == (0,)


def test_the_operator_takes_time(make_bench: Any) -> None:
    bench = make_bench(remount_s=600.0, level_s=60.0)
    bench.wait_until(5.0)
    assert bench.bench.remount("X", "flag", 1) == 605.0
    assert bench.bench.level() == 65.0


@pytest.mark.parametrize(("axis", "configuration"), AXES)
def test_levelling_leaves_less_than_a_volt(make_bench: Any, axis: str, configuration: str) -> None:
    bench = make_bench(quiet=False, ideal=False)
    for mounting in (1, 2, 3):
        bench.mount(axis, configuration, mounting)
        assert abs(bench.bench.accelerometer_v(np.array([bench.clock.now_s()]))[0]) < 0.6
        # The axis lies up to 13 mrad from its cube face; the hand adds 2 mrad.
        assert abs(bench.truth["delta_rad"][0]) < 25e-3


def test_levelling_allows_for_bias_and_a_tilted_axis(make_bench: Any) -> None:
    effects = {"axis-tilt": {"eps_cos": 3e-3}, "bias-drift": {"rate": 1e-3}}
    bench = make_bench(effects)
    bench.turn_to(30.0)
    bench.mount("Z", "pendulum")
    assert abs(bench.bench.accelerometer_v(np.array([bench.clock.now_s()]))[0]) < 0.5


def test_unlevelled_the_sensor_of_x_in_flag_saturates(make_bench: Any) -> None:
    bench = make_bench(mounting_sigma_rad=0.0)
    bench.mount("X", "flag", level=False)
    assert bench.bench.accelerometer_v(np.array([bench.clock.now_s()]))[0] == -10.0


def test_levelling_turns_about_x_only(make_bench: Any) -> None:
    bench = make_bench()
    bench.mount("X", "flag", level=False)
    before = np.array(bench.truth["delta_rad"])
    bench.wait_until(bench.bench.level())
    turn = np.array(bench.truth["delta_rad"]) - before
    assert abs(turn[0]) > 5e-3
    # Two small turns compose with half their product.
    np.testing.assert_allclose(turn[1:], 0.5 * turn[0] * np.array([-before[2], before[1]]), atol=1e-6)


def test_mountings_scatter_as_asked(make_bench: Any) -> None:
    bench = make_bench()
    for number in range(400):
        bench.bench.remount("X", "flag", number)
    mountings = bench.bench.truth()["mountings"]
    delta = np.array([m["delta_rad"] for m in mountings])
    assert delta.std(axis=0) == pytest.approx([2e-3] * 3, rel=5.0 / math.sqrt(800))
    axis = np.array(bench.settings.sensors["X"].true_axis)
    off = np.array([m["sensing_axis_coc"] for m in mountings]) - axis
    arcsec = math.radians(1.0 / 3600.0)
    np.testing.assert_allclose(off @ axis, 0.0, atol=1e-7)
    assert off[:, 1:].std(axis=0) / arcsec == pytest.approx([12.5, 12.5], rel=5.0 / math.sqrt(800))
    assert abs(np.corrcoef(off[:, 1:].T)[0, 1]) < 0.25


def test_biases_are_drawn_once_per_axis(make_bench: Any) -> None:
    biases = [make_bench(seed=seed).bench.truth()["bias_v"]["X"] for seed in range(200)]
    assert np.std(biases) == pytest.approx(0.1, rel=0.25)
    assert make_bench(seed=3).bench.truth()["bias_v"]["X"] == biases[3]


def test_the_truth_is_plain_data(make_bench: Any) -> None:
    bench = make_bench(quiet=False)
    bench.mount("X", "flag", 1)
    bench.mount("X", "pendulum", 2)
    truth = bench.bench.truth()
    assert json.loads(json.dumps(truth)) == truth
    assert [m["mounting"] for m in truth["mountings"]] == [1, 2]


def full(make_bench: Any) -> Any:
    effects = {
        "roll-gravity": {"rho1": 9.7e-5},
        "quadratic": {"K2": 1e-2},
        "cable-hysteresis": {"h": 1e-5},
        "yaw": {"psi1": 1e-5},
        "null-drift": {"rate": 1e-10},
        "mains-pickup": {"amplitude": 1e-3, "frequency": 49.7},
    }
    return make_bench(effects, quiet=False, ideal=False)


def samples(bench: Any, edges: np.ndarray) -> np.ndarray:
    return np.stack([bench.bench.accelerometer_v(edges), bench.bench.displacement_mm("laser_2_mm")(edges)])


def test_a_train_asked_for_in_chunks_gives_the_same_bits(make_bench: Any) -> None:
    whole, pieces = full(make_bench), full(make_bench)
    for bench in (whole, pieces):
        bench.mount("Y", "pendulum")
    edges = whole.begin_run(0.4, number=7)
    assert np.array_equal(edges, pieces.begin_run(0.4, number=7))
    chunks = [samples(pieces, part) for part in np.split(edges, [1, 100, 203, 204, 999])]
    np.testing.assert_array_equal(samples(whole, edges), np.concatenate(chunks, axis=1))
    np.testing.assert_array_equal(samples(pieces, edges[50:60]), samples(whole, edges)[:, 50:60])


def test_chunks_taken_as_time_goes_on_are_those_of_the_finished_train(make_bench: Any) -> None:
    late, live = full(make_bench), full(make_bench)
    for bench in (late, live):
        bench.mount("Y", "pendulum")
    edges = late.begin_run(0.4)
    taken: list[np.ndarray] = []

    def look(after_s: float) -> None:
        until_s = live.clock.now_s()
        new = live.trigger.edges(after_s, until_s)
        if len(new):
            taken.append(samples(live, new))
        live.clock.call_at(until_s + 0.777, lambda: look(until_s))

    live.clock.call_at(live.clock.now_s(), lambda: look(live.clock.now_s()))
    live.begin_run(0.4)
    live.clock.sleep_s(1.0)
    assert len(taken) > 20
    np.testing.assert_array_equal(np.concatenate(taken, axis=1), samples(late, edges))


def test_a_resumed_campaign_meets_the_same_nature(make_bench: Any) -> None:
    undisturbed, resumed = (
        make_bench({"roll-gravity": {"rho1": 9.7e-5}}, quiet=False, ideal=False, angle={"error_steps": 0.5})
        for _ in range(2)
    )
    undisturbed.mount("X", "flag", 4)
    for number in (1, 2):
        samples(undisturbed, undisturbed.begin_run(0.1 * number, number=number))
    first = samples(undisturbed, undisturbed.begin_run(0.3, number=3))
    resumed.wait_until(12_345.678)
    resumed.mount("X", "flag", 4)
    second = samples(resumed, resumed.begin_run(0.3, number=3))
    # The clock reads something else, so times of the motion are rounded elsewhere.
    np.testing.assert_allclose(second, first, rtol=0.0, atol=1e-8)


def test_every_run_has_noise_of_its_own(make_bench: Any) -> None:
    bench = make_bench(quiet=False, ideal=False)
    bench.mount()
    one, other, again = (samples(bench, bench.begin_run(0.2, number=n)) for n in (1, 2, 1))
    volts, side_mm = other - one
    assert np.std(volts) > 1e-4
    assert np.std(side_mm) == pytest.approx(0.05e-3 * math.sqrt(2.0), rel=0.2)
    np.testing.assert_allclose(again, one, rtol=0.0, atol=1e-8)


def test_trains_of_one_run_differ(make_bench: Any) -> None:
    bench = make_bench(quiet=False, ideal=False)
    bench.mount()
    bench.bench.announce_run(1)
    records = []
    for _ in range(2):
        bench.trigger.begin(bench.clock.now_s(), 0.01, 500)
        bench.clock.sleep_s(6.0)
        records.append(bench.bench.accelerometer_v(bench.trigger.edges(bench.clock.now_s() - 6.1, math.inf)))
    assert np.std(records[1] - records[0]) > 1e-5


def test_a_remount_does_not_rewrite_the_train_before_it(make_bench: Any) -> None:
    asked, unasked = full(make_bench), full(make_bench)
    for bench in (asked, unasked):
        bench.mount("X", "flag", 1)
    edges = asked.begin_run(0.4)
    expected = samples(asked, edges)
    unasked.begin_run(0.4)
    unasked.bench.remount("X", "flag", 2)
    np.testing.assert_array_equal(samples(unasked, edges), expected)


def test_noise_does_not_repeat_within_a_train_longer_than_planned(make_bench: Any) -> None:
    bench = make_bench(quiet=False, ideal=True, lasers={})
    bench.mount()
    bench.bench.announce_run(1)
    bench.trigger.begin(bench.clock.now_s(), 0.01, 1000)
    bench.trigger.train.count = 3000
    bench.clock.sleep_s(31.0)
    volts = bench.bench.accelerometer_v(bench.trigger.edges(-math.inf, math.inf))
    white = np.diff(volts - volts.mean(), n=2)
    early, late = white[:900], white[1000:1900]
    assert abs(np.corrcoef(early, late)[0, 1]) < 5.0 / math.sqrt(900)
    assert np.max(np.abs(np.diff(volts))) < 6.0 * np.std(np.diff(volts))


@pytest.mark.parametrize("period_s", [0.01, 0.05])
def test_the_noise_of_a_resting_sensor_is_the_grounds_through_its_response(make_bench: Any, period_s: float) -> None:
    bench = make_bench(quiet=False, ideal=False, ground={"bump_asd_m_s2_rthz": 0.0}, lasers={})
    bench.mount("X", "flag")
    bench.bench.announce_run(1)
    count = round(3000.0 / period_s)
    bench.trigger.begin(bench.clock.now_s(), period_s, count)
    bench.clock.sleep_s(3001.0)
    volts = bench.bench.accelerometer_v(bench.trigger.edges(-math.inf, math.inf))
    frequencies, psd = welch(volts, fs=1.0 / period_s, nperseg=round(50.0 / period_s))
    for low, high in ((0.25, 0.8), (1.0, 2.0), (2.5, 3.0), (3.3, 3.7), (5.0, 7.0)):
        band = (frequencies >= low) & (frequencies <= high)
        f = frequencies[band]
        h_squared = 1.0 / ((1.0 - (f / 3.5) ** 2) ** 2 + (f / 35.0) ** 2)
        averages = 3000.0 / 50.0 * band.sum()
        # Ground noise between steps is taken as straight: two per cent are missing at 7 Hz.
        assert np.mean(psd[band] / (1e-4**2 * h_squared)) == pytest.approx(1.0, abs=0.03 + 5.0 / math.sqrt(averages))


def test_single_readings_show_the_level_with_noise_of_their_own(make_bench: Any) -> None:
    noisy, silent = make_bench(quiet=False, ideal=False), make_bench(ideal=False)
    for bench in (noisy, silent):
        bench.mount("X", "pendulum")
    times = noisy.clock.now_s() + np.arange(10.0)
    level = silent.bench.accelerometer_v(times[:1])[0]
    readings = noisy.bench.accelerometer_v(times)
    assert np.std(readings) > 1e-5
    assert np.max(np.abs(readings - level)) < 6e-3
    np.testing.assert_array_equal(noisy.bench.accelerometer_v(times[3:5]), readings[3:5])


def test_times_beside_the_edges_lie_on_the_sensors_smooth_output(make_bench: Any) -> None:
    coarse, fine = make_bench(ideal=False), make_bench(ideal=False)
    for bench in (coarse, fine):
        bench.mount()
    edges = coarse.begin_run(30.0, period_s=0.01)
    fine.begin_run(30.0, period_s=0.0025)
    between = edges[100:200] + 0.0025
    np.testing.assert_allclose(
        coarse.bench.accelerometer_v(between), fine.bench.accelerometer_v(between), rtol=0.0, atol=3e-7
    )


def test_temperature_has_a_mean_a_daily_sine_and_a_drift(make_bench: Any) -> None:
    bench = make_bench(temperature={"mean_c": 20.0, "daily_k": 0.5, "drift_k_per_day": 0.2}).bench
    day = 86400.0
    np.testing.assert_allclose(
        bench.temperature_c(np.array([0.0, day / 4, day / 2, day])), [20.0, 20.55, 20.1, 20.2], atol=1e-12
    )
