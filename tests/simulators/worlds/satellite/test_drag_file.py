"""External acceleration from a file: what the sinusoids are where it says the same, refused where it is wrong."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from rigctl.core.arrays import FloatArray
from simulators.worlds.satellite.forcing import Command, forcing
from simulators.worlds.satellite.layout import FORCING
from tests.simulators.worlds.satellite.flights import fly, quiet

ORBIT_S = 5950.0
ACCELERATION = "t_s, accel_x_m_s2, accel_y_m_s2, accel_z_m_s2"
AIR = "t_s,density_kg_m3,wind_x_m_s,wind_y_m_s,wind_z_m_s"


def written(path: Path, names: str, *columns: FloatArray | list[float]) -> Path:
    rows = [",".join(repr(float(value)) for value in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join(["# made by a test", names, *rows]) + "\n", encoding="utf-8")
    return path


def of_default(t_s: FloatArray) -> list[FloatArray]:
    """What the default sinusoids are, written out."""
    mean = 2.0 * math.pi * t_s / ORBIT_S
    return [
        2e-8 + 2e-8 * np.cos(mean) + 5e-9 * np.sin(2.0 * mean),
        -1e-8 + 5e-9 * np.sin(mean) + 2e-9 * np.cos(2.0 * mean),
        3e-8 - 2e-8 * np.sin(mean) + 5e-9 * np.cos(2.0 * mean),
    ]


def test_one_orbit_of_a_file_serves_for_all_and_before_the_session(tmp_path: Path) -> None:
    t_s = np.linspace(0.0, ORBIT_S, 1191)
    settings = quiet(drag={"file": written(tmp_path / "orbit.csv", ACCELERATION, t_s, *of_default(t_s))})
    times_s = np.linspace(-6000.0, 12.5 * ORBIT_S, 7001)
    found, sinusoids = (forcing(each, Command(1), times_s) for each in (settings, quiet()))
    # Straight lines over 5 s: a chord of the double frequency is off by (w h)^2 / 8 of its amplitude.
    assert np.abs(found - sinusoids).max() < 1.1 * (4.0 * math.pi * 5.0 / ORBIT_S) ** 2 / 8.0 * 2.5e-8
    force = slice(FORCING["force"], FORCING["force"] + 3)
    assert np.ptp(found[:, force], axis=0).min() > 1e-8


def test_masses_feel_what_the_file_says(tmp_path: Path) -> None:
    level = written(tmp_path / "level.csv", ACCELERATION, [-6000.0, 9000.0], [4e-8] * 2, [0.0] * 2, [0.0] * 2)
    with_file = fly(quiet(drag={"file": level}, settle_s=0.0), samples=8)
    nothing = {f"force{which}_m_s2": (0.0, 0.0, 0.0) for which in ("", "_1", "_2")}
    without = fly(quiet(drag=nothing, settle_s=0.0), samples=8)
    # In the first sample thrusters have not answered yet; scale factors differ from 1 by up to a hundredth.
    assert with_file.common("x")[0] - without.common("x")[0] == pytest.approx(4e-8, rel=0.03)


def test_air_pushes_along_the_wind_by_half_its_density_times_speed_squared(tmp_path: Path) -> None:
    wind = [[-6000.0, -6000.0], [3000.0, 3000.0], [0.0, 0.0]]
    air = written(tmp_path / "air.csv", AIR, [0.0, 600.0], [1e-14, 3e-14], *wind)
    settings = quiet(drag={"file": air, "area_m2": 3.0, "drag_coefficient": 2.0}, satellite_kg=150.0)
    force = forcing(settings, Command(1), np.array([300.0]))[0, FORCING["force"] : FORCING["force"] + 3]
    speed = math.hypot(6000.0, 3000.0)
    size = 0.5 * 2e-14 * 2.0 * 3.0 * speed**2 / 150.0
    assert force == pytest.approx(size * np.array([-6000.0, 3000.0, 0.0]) / speed, rel=1e-12, abs=1e-24)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("t_s,force_n\n0,1\n1,1\n", "give t_s, accel_x_m_s2"),
        (f"{ACCELERATION}\n0,0,0,0\n", "two rows"),
        (f"{ACCELERATION}\n0,0,0,0\n0,0,0,0\n", "grow from row to row"),
        (f"{ACCELERATION}\n0,0,0,0\n1,0,,0\n", "no table of numbers"),
        (f"{ACCELERATION}\n0,0,0\n1,0,0\n", "no table of numbers"),
        (f"{ACCELERATION}\n0,0,0,0\n1,nan,0,0\n", "missing in row 3"),
        (f"{ACCELERATION}\n0,0,0,0\n1,0.5,0,0\n", "look at the units"),
        (f"{AIR}\n0,1e-14,7e3,0,0\n1,-1e-14,7e3,0,0\n", "negative in row 3"),
        ("", "no table of numbers"),
    ],
)
def test_a_file_that_cannot_be_is_refused_with_the_rig_file(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "wrong.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ValidationError, match=said):
        quiet(drag={"file": path})


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValidationError, match=r"nowhere\.csv cannot be read"):
        quiet(drag={"file": tmp_path / "nowhere.csv"})
