"""The second world of the satellite, and what the commands say of recordings made in it."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.foreign.satellite_bundle import Habits, lost_samples, write
from tests.foreign.satellite_loop import drag_free_sensitivity
from tests.foreign.satellite_orbit import Orbit, oblate_gradient, sphere_gradient
from tests.foreign.satellite_score import SATELLITE
from tests.foreign.satellite_size import Session, Sight, difference
from tests.foreign.satellite_trial import Trial, drawn_noise, drawn_runs, drawn_satellite, without_thermometers
from tests.foreign.satellite_world import Floats, Mass, Run, Satellite, flown, temperatures_k
from tests.foreign.sessions import command, run
from tests.foreign.trials import summary, tried

ORBIT = Orbit(5950.0, 5e-3, 1.72, 0.3)
ZERO = np.zeros(3)
SENSOR = Mass(ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO)
AIR = np.array([[2e-8, 2e-8, 0.0, 0.0, 5e-9], [-1e-8, 0.0, 5e-9, 2e-9, 0.0], [3e-8, 0.0, -2e-8, 5e-9, 0.0]])
HABITS = Habits(thermometers=2, thermometer_k=1e-5, lost=0.0)
BASELINE_P = 1e-3

slow = pytest.mark.skipif("RIGCTL_FOREIGN" not in os.environ, reason="slow: make foreign")


def ideal(first: Mass = SENSOR, second: Mass = SENSOR, air: Floats = 0.0 * AIR, **effects: float) -> Satellite:
    none = np.zeros((3, 5))
    warm = np.array([[0.0, 1e-3, 0.0, 0.0, 0.0], [0.0, 1e-3, 0.0, 0.0, 0.0]])
    return Satellite(ORBIT, (first, second), np.eye(3), ZERO, ZERO, air, none, warm, effects)


def session(name: str, cycles: int, amplitude: float) -> Run:
    return Run(name, 4, 2.5, cycles / (4 * ORBIT.period_s), amplitude, 0.0, 0.0, (0.0, 0.0))


def amplitude(made: Run, samples: Floats, f_hz: float) -> complex:
    """c - i s of the line, in a session of whole cycles."""
    time_s = np.arange(made.samples(ORBIT)) * made.step_s
    return complex(2.0 * np.mean(samples * np.exp(-2j * np.pi * f_hz * time_s)))


def apart(**offset: float) -> tuple[Mass, Mass]:
    """Both masses with p_2 - p_1 as given."""
    delta = np.array([offset.get(axis, 0.0) for axis in "xyz"])
    return replace(SENSOR, place_m=-delta / 2.0), replace(SENSOR, place_m=delta / 2.0)


@pytest.mark.parametrize(
    ("row", "column", "harmonic", "expected"),
    [
        (0, 0, 1, 4.182e-9), (0, 0, 2, 1.6727e-6), (0, 0, 3, 2.93e-8), (2, 2, 1, 1.2545e-8), (2, 2, 2, -1.6725e-6),
        (0, 2, 1, 4.182e-9j), (0, 2, 2, -1.6726e-6j), (1, 1, 1, -1.673e-8), (1, 1, 2, -1.3e-10),
    ],
)  # fmt: skip
def test_the_gradient_has_the_amplitudes_of_the_page(row: int, column: int, harmonic: int, expected: complex) -> None:
    made = session("dx+dz", 0, 0.0)
    tensor = sphere_gradient(*ORBIT.place(np.arange(made.samples(ORBIT)) * made.step_s))
    found = amplitude(made, tensor[:, row, column], harmonic / ORBIT.period_s)
    assert found == pytest.approx(expected, rel=4e-2 if abs(expected) < 1e-9 else 1.5e-3, abs=0.0)


def test_an_oblate_field_obeys_laplace_and_is_as_large_as_the_page_says() -> None:
    direction, distance = ORBIT.place(np.linspace(0.0, ORBIT.period_s, 50))
    added = oblate_gradient(direction, distance, ORBIT.pole)
    whole = sphere_gradient(direction, distance)
    assert np.trace(added, axis1=1, axis2=2) == pytest.approx(0.0, abs=1e-12 * np.abs(whole).max())
    assert 2e-3 < np.linalg.norm(added, axis=(1, 2)).max() / np.linalg.norm(whole, axis=(1, 2)).max() < 1e-2


def test_the_loop_leaves_what_the_page_measured() -> None:
    """1.14e-12, 2.6e-13 and 1.13e-12 of the drag at f_orb; the injected line 1.003 times C; no mean."""
    made = session("ad11", 29, 5e-8)
    common = flown(made, ideal(air=AIR)).measured.mean(axis=0)
    for axis, expected in enumerate((1.14e-12, 2.6e-13, 1.13e-12)):
        assert abs(amplitude(made, common[axis], ORBIT.frequency_hz)) == pytest.approx(expected, rel=0.1, abs=0.0)
    assert abs(amplitude(made, common[0], made.frequency_hz)) == pytest.approx(5.015e-8, rel=2e-3, abs=0.0)
    assert np.abs(common.mean(axis=1)).max() < 1e-20
    assert drag_free_sensitivity(np.array([ORBIT.frequency_hz]))[0] == pytest.approx(5.7e-5, rel=0.02, abs=0.0)


def test_an_off_centring_is_seen_through_the_gradient() -> None:
    made = session("dx+dz", 0, 0.0)
    seen = difference(flown(made, ideal(*apart(x=2e-5, z=-1e-5))))
    found = amplitude(made, seen, 2.0 * ORBIT.frequency_hz)
    assert found == pytest.approx(2e-5 * 1.6727e-6 + 1e-5 * 1.6726e-6j, rel=1e-3, abs=0.0)


def test_a_turn_about_z_shows_the_off_centring_along_y() -> None:
    """-(1.5 n^2 + w^2) times the angle."""
    made = session("dy", 29, 1e-2)
    told = flown(made, ideal(*apart(y=2e-5)))
    w = 2.0 * np.pi * made.frequency_hz
    angle = -amplitude(made, told.turning[2], made.frequency_hz) / w**2
    expected = -(1.5 * ORBIT.rate_rad_s**2 + w**2) * angle * 2e-5
    assert amplitude(made, difference(told), made.frequency_hz) == pytest.approx(expected, rel=5e-3, abs=0.0)


@pytest.mark.parametrize(("name", "turn"), [("ac12", (0.0, 0.0, 2e-3)), ("ac13", (0.0, 2e-3, 0.0))])
def test_moved_masses_show_the_turn_of_their_axes(name: str, turn: tuple[float, float, float]) -> None:
    """E7 and E8: sidebands -theta_z Txx and theta_y Txx - theta_y Tzz + Txz, half each, of 9 um."""
    made = session(name, 73, 9e-6)
    mass = replace(SENSOR, rotation_rad=np.array(turn))
    sideband = made.frequency_hz + 2.0 * ORBIT.frequency_hz
    found = amplitude(made, difference(flown(made, ideal(mass, mass))), sideband)
    own = -2e-3 * 1.6727e-6 if name == "ac12" else 2e-3 * (1.6727e-6 + 1.6725e-6) - 1.6726e-6j
    assert found == pytest.approx(0.5 * 9e-6 * own, rel=5e-3, abs=0.0)


def test_the_sensors_curves_show_at_their_harmonics() -> None:
    moved = session("k2c_1", 214, 9e-6)
    a = 9e-6 * (2.0 * np.pi * moved.frequency_hz) ** 2
    curved = flown(moved, ideal(replace(SENSOR, quadratic=np.array([1e4, 0.0, 0.0])))).measured[0, 0]
    assert amplitude(moved, curved, 2.0 * moved.frequency_hz) == pytest.approx(1e4 * a**2 / 2.0, rel=1e-2, abs=0.0)
    driven = session("ad11", 29, 5e-8)
    cubic = difference(flown(driven, ideal(**{"K3[1]": 4e8})))
    assert amplitude(driven, cubic, 3.0 * driven.frequency_hz) == pytest.approx(
        4e8 * 5.015e-8**3 / 4.0, rel=2e-2, abs=0.0
    )


def test_effects_act_as_the_page_writes_them() -> None:
    """Of the difference: lambda dT at f_orb, tau m_c' in quadrature, kappa3 x^3 at three times the motion."""
    still, driven, moved = session("dx+dz", 0, 0.0), session("ad11", 29, 5e-8), session("k2c_1", 214, 9e-6)
    warm = difference(flown(still, ideal(**{"lambda[1]": 4e-9})))
    assert amplitude(still, warm, ORBIT.frequency_hz) == pytest.approx(4e-12, rel=1e-3, abs=0.0)
    late = amplitude(driven, difference(flown(driven, ideal(skew_s=1e-2))), driven.frequency_hz)
    assert abs(late) == pytest.approx(1e-2 * 2.0 * np.pi * driven.frequency_hz * 5.015e-8, rel=1e-2, abs=0.0)
    stiff = difference(flown(moved, ideal(**{"cubic[1]": 1e3})))
    assert amplitude(moved, stiff, 3.0 * moved.frequency_hz) == pytest.approx(1e3 * 9e-6**3 / 4.0, rel=2e-2, abs=0.0)
    spring = flown(moved, ideal(**{"loss[1]": 1e-5})).measured[0, 0] - flown(moved, ideal()).measured[0, 0]
    assert amplitude(moved, spring, moved.frequency_hz) == pytest.approx(1e-5j * 9e-6, rel=1e-2, abs=0.0)


def test_apsides_that_turn_mix_the_off_centrings() -> None:
    """cos 2 (n t + psi): 2 psi Dx comes up against the sine of 2 f_orb; psi grows from zero to twice its mean."""
    made = replace(session("dx+dz", 0, 0.0), start_s=1e5)
    turned = difference(flown(made, ideal(*apart(x=2e-5), precession=1e-6)))
    psi = 1e-6 * 2.0 * ORBIT.period_s
    found = amplitude(made, turned, 2.0 * ORBIT.frequency_hz)
    assert found.imag == pytest.approx(2.0 * psi * 2e-5 * 1.6727e-6, rel=2e-2, abs=0.0)


def test_a_gain_and_a_place_follow_the_temperature_of_the_mission_not_of_the_session() -> None:
    warmer = replace(session("ad11", 29, 5e-8), offset_k=(0.5, 0.5))
    gained = difference(flown(warmer, ideal(**{"kappa[1]": 1e-4})))
    expected = 1e-4 * 0.5 * 5.015e-8
    assert abs(amplitude(warmer, gained, warmer.frequency_hz)) == pytest.approx(expected, rel=1e-2, abs=0.0)
    still = replace(warmer, session="dx+dz", frequency_hz=0.0, amplitude=0.0)
    shifted = difference(flown(still, ideal(**{"beta[x]": 1e-7})))
    assert amplitude(still, shifted, 2.0 * ORBIT.frequency_hz).real == pytest.approx(
        5e-8 * 1.6727e-6, rel=5e-3, abs=0.0
    )
    assert temperatures_k(still, ideal(), np.zeros(1))[0, 0] == pytest.approx(0.501)


SMALL = Orbit(6000.0, 4e-3, 1.72, 0.3)
SMALL_ORBITS = 6


def small(seed: int, effects: dict[str, float], name: str = "", step_s: float = 8.0) -> Trial:
    """A satellite seen in the shortest sessions that can be told apart, at a slow rate."""
    random = np.random.default_rng(seed)
    length_s = SMALL_ORBITS * SMALL.period_s
    runs = []
    for each in drawn_runs(random, SMALL, alike=False):
        cycles = round(each.frequency_hz * length_s)
        whole = cycles + (cycles % SMALL_ORBITS == 0)
        frequency_hz = whole / length_s if cycles else 0.0
        runs.append(replace(each, orbits=SMALL_ORBITS, step_s=step_s, frequency_hz=frequency_hz))
    satellite, noise = drawn_satellite(random, SMALL), drawn_noise(random)
    return Trial(runs, satellite.with_effects(effects), noise, HABITS, {name: 15.0} if name else {})


def test_the_noise_is_that_from_which_sizes_are_computed() -> None:
    trial, random = small(5, {}), np.random.default_rng(6)
    seen = []
    for made in trial.runs[:8]:
        watched = Session(made, trial.satellite, trial.noise)
        noises = trial.noise.drawn(random, made, trial.satellite)
        seen.append(watched.observed(flown(made, trial.satellite, noises)))
    white = np.concatenate(seen)
    assert (white**2).mean() == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / white.size))


def test_sizes_are_linear() -> None:
    trial = small(3, {})
    sight = Sight(trial.runs[:4], trial.satellite, trial.noise)
    size = sight.size({"rate[1]": 1e-17})
    assert size > 0.0
    assert sight.size({"rate[1]": 2e-17}) == pytest.approx(2.0 * size, rel=1e-3, abs=0.0)


def test_lost_samples_are_bursts_of_the_part_asked_for() -> None:
    lost = lost_samples(np.random.default_rng(1), 20_000, 2.5, 0.01)
    assert 0.01 <= lost.mean() < 0.013
    assert np.diff(np.flatnonzero(np.diff(np.concatenate([[0], lost, [0]]))))[::2].max() > 10


def test_both_worlds_have_the_same_conventions(tmp_path: Path) -> None:
    """Without effects the baseline describes this world within its noise."""
    trial = small(1, {})
    write(trial.runs, trial.satellite, trial.noise, trial.habits, 1, tmp_path / "clean")
    store = str(tmp_path / "clean.rig.sqlite")
    run("import", str(tmp_path / "clean"), "--store", store)
    compared = command("compare", store)
    assert compared["p_value"] > BASELINE_P, compared["channels"]


def sized(seed: int, name: str, direction: dict[str, float], sigma: float = 15.0) -> Trial:
    """An effect of so many sigma in that direction."""
    trial = small(seed, {})
    scale = sigma / Sight(trial.runs, trial.satellite, trial.noise).size(direction)
    return small(seed, {key: value * scale for key, value in direction.items()}, name)


def diagnosed(trial: Trial, directory: Path) -> dict[str, Any]:
    """What diagnose says of the recording."""
    write(trial.runs, trial.satellite, trial.noise, trial.habits, 1, directory / "elsewhere")
    store = str(directory / "elsewhere.rig.sqlite")
    run("import", str(directory / "elsewhere"), "--store", store)
    return dict(command("diagnose", store, "--alpha", "0.01"))


def test_a_third_power_of_the_electrodes_is_named(tmp_path: Path) -> None:
    said = diagnosed(sized(3, "cubic-electrode", {"K3[1]": 4e8}), tmp_path)
    assert (said["verdict"], said["suggested"]) == ("effect", ["cubic-electrode"])


@slow
def test_one_thermometer_names_a_bias_and_without_it_nothing_is_suggested(tmp_path: Path) -> None:
    trial = sized(6, "thermal-bias", {"lambda[1]": 1e-10})
    (tmp_path / "one").mkdir()
    one = replace(trial, habits=replace(HABITS, thermometers=1))
    said = diagnosed(one, tmp_path / "one")
    # A gain whose levels go with the temperature contains a bias that does.
    assert said["verdict"] in ("effect", "ambiguous")
    assert said["suggested"] == ["thermal-bias"]
    (tmp_path / "none").mkdir()
    said = diagnosed(without_thermometers(trial), tmp_path / "none")
    assert (said["verdict"], said["suggested"]) == ("unknown", [])
    assert "or one temperature_c" in said["not_testable"]["thermal-bias"]


@slow
def test_glitches_are_named_and_the_next_run_is_proposed(tmp_path: Path) -> None:
    """Masked, they leave runs without those samples, and imagined ones beside them."""
    events = {"glitch": 2e-9, "glitch_seed": 5.0, "glitch_ratio": 0.08, "glitch_per_orbit": 3.0}
    trial = small(7, events, "glitches", step_s=2.5)
    said = diagnosed(replace(trial, runs=trial.runs[:5]), tmp_path)
    assert (said["verdict"], said["suggested"]) == ("effect", ["glitches"])


@slow
def test_a_spring_that_stiffens_is_named_at_a_slow_rate(tmp_path: Path) -> None:
    said = diagnosed(sized(8, "cubic-stiffness", {"cubic[1]": 1e3}, 16.7), tmp_path)
    assert (said["verdict"], said["suggested"]) == ("effect", ["cubic-stiffness"])


@slow
def test_a_trial_scores_what_was_said() -> None:
    """A whole session; many of them are `python -m tests.foreign.trials --kind satellite`."""
    score = tried(replace(SATELLITE, drawn=lambda seed: sized(seed, "cubic-electrode", {"K3[1]": 4e8})), 3)
    assert score["all_named"], score
    assert score["invented"] == []
    assert "one effect named      1 of 1" in summary([json.loads(json.dumps(score))])


@slow
def test_a_gain_that_follows_the_battery_is_unknown() -> None:
    score = tried(replace(SATELLITE, drawn=lambda seed: sized(seed, "eclipse-gain", {"per_v[1]": 1e-6})), 4)
    assert score["unknown_said"], score
