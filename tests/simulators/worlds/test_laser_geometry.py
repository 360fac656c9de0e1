"""What the lasers see, against the contract's r = (d . n) / (c . n), and what can be made of it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

HEADS = ("laser_1_mm", "laser_2_mm", "laser_3_mm")
A = 5e-3
TILT = math.radians(5.0)

# Where the cube axes X, Y, Z of sensor X point in the turntable's frame, column by column.
NOMINAL_X = {
    "pendulum": np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]], dtype=float),
    "flag": np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]], dtype=float),
}
FACES_X = {"pendulum": ((0, 0, 1), (1, 0, 0), (0, 1, 0)), "flag": ((0, 1, 0), (1, 0, 0), (0, 0, -1))}


def beams(tilts: tuple[float, float, float] = (TILT, TILT, TILT)) -> np.ndarray:
    main, side, top = tilts
    return np.array(
        [
            [math.cos(main), 0.0, math.sin(main)],
            [0.0, math.cos(side), math.sin(side)],
            [math.sin(top), 0.0, math.cos(top)],
        ]
    )


def lab_from_cube(theta: float, delta: Any, configuration: str) -> np.ndarray:
    return (
        Rotation.from_euler("z", theta).as_matrix()
        @ Rotation.from_rotvec(delta).as_matrix()
        @ NOMINAL_X[configuration]
    )


def expected(theta: float, delta: Any, configuration: str, tilts: Any = (TILT, TILT, TILT)) -> np.ndarray:
    """Reading per metre of stage motion, head by head."""
    normals = lab_from_cube(theta, delta, configuration) @ np.array(FACES_X[configuration], dtype=float).T
    return normals[0] / np.einsum("hi,ih->h", beams(tilts), normals)


def seen(bench: Any, angle_deg: float, frequency_hz: float = 0.5) -> np.ndarray:
    """Signed amplitude per metre of stage motion, head by head."""
    run = bench.run(angle_deg, frequency_hz)
    fundamentals = np.array([run.harmonics(run.lasers_mm[head]).fundamental for head in HEADS])
    np.testing.assert_allclose(fundamentals.imag, 0.0, atol=1e-9)
    return 1e-3 * fundamentals.real / run.amplitude_m


@pytest.mark.parametrize("configuration", ["pendulum", "flag"])
def test_readings_follow_the_geometry_of_beam_and_face(make_bench: Any, configuration: str) -> None:
    bench = make_bench()
    bench.mount("X", configuration)
    for angle_deg in (-1.5, 0.0, 0.9):
        delta = bench.truth["delta_rad"]
        np.testing.assert_allclose(
            seen(bench, angle_deg), expected(math.radians(angle_deg), delta, configuration), rtol=0, atol=1e-12
        )


@pytest.mark.parametrize("configuration", ["pendulum", "flag"])
def test_the_motion_vector_at_the_null_is_perpendicular_to_the_sensing_axis(
    make_bench: Any, configuration: str
) -> None:
    """Nothing but noiseless readings, angles and the accelerometer's null goes in."""
    bench = make_bench()
    bench.mount("X", configuration, 3)
    angles_deg = np.array([-1.5, -0.5, 0.5, 1.5])
    readings, volts = [], []
    for angle_deg in angles_deg:
        readings.append(seen(bench, angle_deg))
        volts.append(bench.response(angle_deg).fundamental.real)
    angles = np.radians(angles_deg)

    def residuals(delta: np.ndarray) -> np.ndarray:
        return np.concatenate([expected(a, delta, configuration) - r for a, r in zip(angles, readings, strict=True)])

    delta = least_squares(residuals, np.zeros(3), xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    np.testing.assert_allclose(delta, bench.truth["delta_rad"], atol=1e-7)
    sine, cosine = np.linalg.lstsq(np.stack([np.sin(angles), np.cos(angles)], axis=1), np.array(volts), rcond=None)[0]
    theta0 = math.atan2(-cosine, sine)
    assert math.degrees(theta0) == pytest.approx(bench.truth["theta0_deg"], abs=1e-7)
    motion_cube = lab_from_cube(theta0, delta, configuration).T @ [1.0, 0.0, 0.0]
    assert motion_cube @ bench.truth["sensing_axis_coc"] == pytest.approx(0.0, abs=1e-8)


def test_the_main_head_reads_more_as_the_stage_goes_forward(make_bench: Any) -> None:
    bench = make_bench()
    bench.mount()
    main, side, _ = seen(bench, -1.0)
    assert main == pytest.approx(1.0 / math.cos(TILT), rel=1e-3)
    assert side == pytest.approx(math.radians(1.0) / math.cos(TILT), abs=1.2e-2)


def test_turning_moves_the_cube_on_its_lever(make_bench: Any) -> None:
    bench = make_bench(mounting_sigma_rad=0.0, scatter_arcsec=0.0, laser_zero_mm=0.0)
    bench.mount("X", "pendulum", level=False)
    main = bench.bench.displacement_mm("laser_1_mm")
    assert main(np.array([bench.clock.now_s()]))[0] == pytest.approx(0.0, abs=1e-12)
    bench.turn_to(1.0)
    # The face stands 7.5 mm from the cube's centre and leans by the angle; the beam keeps its height y = 72 mm.
    a = math.radians(1.0)
    centre = 72.0 * np.array([-math.sin(a), math.cos(a)])
    normal = np.array([math.cos(a), math.sin(a)])
    along = (7.5 + (centre - [7.5, 72.0]) @ normal) / (math.cos(TILT) * normal[0])
    assert main(np.array([bench.clock.now_s()]))[0] == pytest.approx(along, abs=1e-9)
    assert along == pytest.approx(-1.26, abs=0.01)


@pytest.mark.parametrize("sign", [-1, 1])
def test_spots_leave_the_faces_beyond_two_degrees(make_bench: Any, sign: int) -> None:
    bench = make_bench()
    bench.mount("Z", "flag")
    inside, outside, far = (bench.run(sign * angle_deg) for angle_deg in (1.6, 2.3, 40.0))
    assert all(np.all(np.isfinite(inside.lasers_mm[head])) for head in HEADS)
    lost = np.isnan(outside.lasers_mm["laser_2_mm"])
    assert lost.any()
    assert not lost.all()
    # The cube's centre goes to -x as the table turns on: it is lost at that end of the travel.
    assert np.all(sign * outside.x_m[lost] < 0.0)
    assert np.all(np.isnan(np.stack(list(far.lasers_mm.values()))))


def test_the_beam_of_a_steep_face_is_lost_even_where_the_cube_stays_put(make_bench: Any) -> None:
    bench = make_bench(lever_mm=0.0)
    bench.mount()
    assert np.all(np.isfinite(bench.run(24.0, amplitude_mm=0.5).lasers_mm["laser_1_mm"]))
    assert np.all(np.isnan(bench.run(31.0, amplitude_mm=0.5).lasers_mm["laser_1_mm"]))


def test_a_wrong_tilt_scales_one_laser(make_bench: Any) -> None:
    bench = make_bench({"laser-cosine": {"dt[laser_2_mm]": 4e-3}})
    bench.mount("X", "flag")
    delta = bench.truth["delta_rad"]
    geometry = expected(math.radians(1.0), delta, "flag", (TILT, TILT + 4e-3, TILT))
    np.testing.assert_allclose(seen(bench, 1.0), geometry, rtol=0, atol=1e-12)


def test_a_bent_curve_gives_the_second_harmonic_in_its_own_head(make_bench: Any) -> None:
    bench = make_bench({"laser-nonlinearity": {"q[laser_1_mm]": 0.2}})
    straight = make_bench()
    runs = []
    for b in (bench, straight):
        b.mount()
        runs.append(b.run(1.0))
    main, plain = (r.harmonics(r.lasers_mm["laser_1_mm"]) for r in runs)
    amplitude_m = 1e-3 * plain.fundamental.real
    assert 1e-3 * main.second == pytest.approx(-0.5j * 0.2 * amplitude_m**2, rel=1e-6)
    assert main.fundamental == pytest.approx(plain.fundamental, rel=1e-9)
    np.testing.assert_array_equal(runs[0].lasers_mm["laser_2_mm"], runs[1].lasers_mm["laser_2_mm"])


def test_crosstalk_shows_the_main_motion_to_the_side_head_alone(make_bench: Any) -> None:
    mixed, clean = make_bench({"laser-crosstalk": {"chi": 3e-4}}), make_bench()
    for bench in (mixed, clean):
        bench.mount()
    np.testing.assert_allclose(seen(mixed, 0.7) - seen(clean, 0.7), [0.0, 3e-4, 0.0], atol=1e-12)


def test_yaw_turns_the_cube_too(make_bench: Any) -> None:
    psi1 = 2e-3
    bench = make_bench({"yaw": {"psi1": psi1}})
    bench.mount()
    run = bench.run(0.0)
    second = run.harmonics(run.lasers_mm["laser_2_mm"]).second
    # The side face's normal gets -psi1 x along the motion: r = -psi1 x^2 / cos(tilt), but for delta tan(tilt).
    assert 1e-3 * second == pytest.approx(0.5j * psi1 * A**2 / math.cos(TILT), rel=2e-3)


@pytest.mark.parametrize(
    "effects", [{"roll-gravity": {"rho1": 1e-3}}, {"null-drift": {"rate": 1e-6}}, {"axis-tilt": {"eps_sin": 1e-3}}]
)
def test_what_only_the_sensor_feels_the_lasers_do_not_see(make_bench: Any, effects: Any) -> None:
    moved, still = make_bench(effects), make_bench()
    runs = []
    for bench in (moved, still):
        bench.mount(level=False)
        runs.append(bench.run(1.0))
    for head in HEADS:
        np.testing.assert_array_equal(runs[0].lasers_mm[head], runs[1].lasers_mm[head])


def test_laser_noise_is_white_and_as_large_as_asked(make_bench: Any) -> None:
    noisy, silent = make_bench(quiet=False, angle={"error_steps": 0.0}), make_bench()
    runs = []
    for bench in (noisy, silent):
        bench.mount("X", "flag", level=False)
        runs.append(bench.run(0.5, cycles=20))
    for head in HEADS:
        noise_um = 1e3 * (runs[0].lasers_mm[head] - runs[1].lasers_mm[head])
        n = len(noise_um)
        assert noise_um.std() == pytest.approx(0.05, rel=5.0 / math.sqrt(2 * n))
        assert abs(noise_um[1:] @ noise_um[:-1]) / (n * 0.05**2) < 5.0 / math.sqrt(n)
