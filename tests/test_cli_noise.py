"""`rigctl noise`: from a store and from CSV files, right and wrong ones."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from rigctl.campaign.recording import OWN_CLOCK, ChannelInfo, Header
from rigctl.campaign.store.store import Store
from rigctl.cli.application import app
from rigctl.core.errors import RigError


def noise(*arguments: object) -> dict[str, Any]:
    found = CliRunner().invoke(app, ["noise", *map(str, arguments), "--json"])
    assert found.exit_code == 0, (found.output, found.exception)
    return dict(json.loads(found.stdout))


def refused(*arguments: object) -> str:
    """The one line of an error a person is meant to read."""
    found = CliRunner().invoke(app, ["noise", *map(str, arguments)])
    assert isinstance(found.exception, RigError), (found.output, found.exception)
    assert "\n" not in str(found.exception)
    return str(found.exception)


def written(path: Path, **columns: np.ndarray) -> Path:
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    path.write_text("\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows)]) + "\n")
    return path


@pytest.fixture
def white(tmp_path: Path) -> Path:
    """2000 samples of 1 um/s2 at 20 Hz, with a flag that never changes."""
    samples = 1e-6 * np.random.default_rng(5).normal(size=2000)
    return written(tmp_path / "white.csv", t_s=np.arange(2000) / 20.0, accel_m_s2=samples, flag=np.ones(2000))


def test_white_noise_is_told_by_the_names_of_the_field(white: Path) -> None:
    (found,) = noise(white)["series"]
    assert (found["channel"], found["unit"], found["samples"]) == ("accel_m_s2", "m/s2", 2000)
    assert found["rate_hz"] == pytest.approx(20.0)
    walk = found["coefficients"][0]
    assert (walk["symbol"], walk["name"], walk["unit"]) == ("N", "velocity random walk", "m/s2/sqrt(Hz)")
    # White noise of standard deviation s at rate r has N = s / sqrt(r).
    assert abs(walk["value"] - 1e-6 / 20.0**0.5) < 4.0 * walk["sigma"] < 0.2e-6 / 20.0**0.5
    assert not any(each["resolved"] for each in found["coefficients"][1:])
    first = found["allan"][0]
    assert first["low"] < 1e-6 < first["high"] or abs(first["value"] - 1e-6) < 4e-8
    assert {each["noise"] for each in found["allan"][:4]} == {"white"}


def test_the_rate_of_a_file_without_times_is_given(white: Path, tmp_path: Path) -> None:
    samples = np.loadtxt(white, delimiter=",", skiprows=1)[:, 1]
    bare = written(tmp_path / "bare.csv", accel_m_s2=samples)
    assert "--rate" in refused(bare)
    (found,), (expected,) = noise(bare, "--rate", 20)["series"], noise(white)["series"]
    for kind in ("allan", "modified", "time", "hadamard"):
        values = [[each[key] for each in of[kind]] for of in (found, expected) for key in ("tau_s", "value")]
        assert values[0] == pytest.approx(values[2])
        assert values[1] == pytest.approx(values[3])


def test_a_stretch_without_gaps_is_taken_and_told(tmp_path: Path) -> None:
    samples = np.random.default_rng(1).normal(size=1000)
    time = np.arange(1000) / 10.0
    holes = samples.copy()
    holes[300] = np.nan
    time[900:] += 5.0
    (found,) = noise(written(tmp_path / "gaps.csv", t_s=time, x_v=holes))["series"]
    assert found["samples"] == 599
    assert "599 of 1000 samples, from sample 302" in found["remarks"][0]
    whole = noise(written(tmp_path / "part.csv", t_s=time[301:900], x_v=samples[301:900]))["series"][0]
    assert [each["value"] for each in found["allan"]] == [each["value"] for each in whole["allan"]]


def test_a_line_is_found_and_taken_out(tmp_path: Path) -> None:
    n, rate = 20000, 50.0
    time = np.arange(n) / rate
    samples = np.random.default_rng(2).normal(size=n) + 3.0 * np.sin(2 * np.pi * 7.123 * time)
    path = written(tmp_path / "line.csv", x_v=samples)
    (found,) = noise(path, "--rate", rate)["series"]
    (line,) = found["density"]["lines"]
    assert line["frequency_hz"] == pytest.approx(7.123, abs=1e-4)
    assert abs(line["amplitude"] - 3.0) < 4.0 * line["sigma"]
    assert line["sigma"] == pytest.approx((1.5 * 2.0 / n) ** 0.5, rel=0.2)
    assert "--without-lines" in found["remarks"][0]
    assert found["allan"][0]["value"] > 1.5
    (without,) = noise(path, "--rate", rate, "--without-lines")["series"]
    # A chi-squared of 1.3e4 degrees of freedom.
    assert without["allan"][0]["value"] == pytest.approx(1.0, abs=0.03)


def test_the_density_is_fitted_in_a_band(tmp_path: Path) -> None:
    """White noise of 1 V with a hump of slow noise below 0.2 Hz."""
    n, rate, rng = 20000, 50.0, np.random.default_rng(6)
    slow = np.convolve(rng.normal(size=n + 400), np.hanning(401), "valid") / 5.0
    path = written(tmp_path / "band.csv", x_v=slow + rng.normal(size=n))
    (whole,), (part,) = (noise(path, "--rate", rate, *more)["series"] for more in ([], ["--above", 2]))
    assert whole["density"]["p_value"] < 1e-3 < part["density"]["p_value"]
    assert part["density"]["band_hz"] == [2.0, 25.0]
    walk = part["coefficients"][0]
    assert abs(walk["value"] - 1.0 / rate**0.5) < 4.0 * walk["sigma"]
    assert "fit a wider band" in refused(path, "--rate", rate, "--above", 30)
    assert "fit a wider band" in refused(path, "--rate", rate, "--above", 9, "--below", 8)


def test_figures_are_drawn_with_their_numbers(white: Path, tmp_path: Path) -> None:
    told = noise(white, "--figures", tmp_path / "figures")["written"]
    names = [f"{figure}_accel_m_s2.{suffix}" for figure in ("allan", "density") for suffix in ("svg", "csv")]
    assert [Path(each).name for each in told] == [*names, "figures.md"]
    assert all(Path(each).stat().st_size > 200 for each in told)


def test_the_table_fits_a_terminal(white: Path) -> None:
    found = CliRunner().invoke(app, ["noise", str(white)], env={"COLUMNS": "80"})
    assert found.exit_code == 0
    assert "velocity random walk" in found.stdout
    assert "random walk" in found.stdout
    rows = [line for line in found.stdout.splitlines() if line.startswith("│")]
    assert len(rows) == 9 + 3  # one line each: 9 averaging times, 3 coefficients


@pytest.fixture
def store(tmp_path: Path) -> Path:
    """Two runs of white noise, the second longer and with a laser on a clock of its own; a third was cut off."""
    path, rng = tmp_path / "runs.rig.sqlite", np.random.default_rng(8)
    laser = ChannelInfo("mm", "displacement", clock=OWN_CLOCK)
    channels = {"accel_v": ChannelInfo("V", "accelerometer"), "laser_1_mm": laser}
    with Store.create(path, Header("sensing-axis", channels=channels)) as made:
        for run_id, n in (("1", 500), ("2", 800), ("3", 900)):
            with made.begin_run(run_id, "scan", {}, run_id) as run:
                run.append(
                    {"t_s": np.arange(n) / 100.0, "accel_v": rng.normal(size=n), "theta_deg": np.arange(n) / n}
                )
                run.append({"laser_1_mm.t_s": np.arange(400) / 50.0, "laser_1_mm": rng.normal(size=400)})
                if run_id == "3":
                    run.append({"accel_v": np.ones(9)})
                else:
                    run.finish()
    return path


def test_a_store_gives_the_channels_of_its_longest_run_each_on_its_own_clock(store: Path) -> None:
    found = noise(store)["series"]
    assert [(each["run"], each["channel"], each["samples"], each["unit"]) for each in found] == [
        ("2", "accel_v", 800, "V"),
        ("2", "laser_1_mm", 400, "mm"),
    ]
    assert [each["rate_hz"] for each in found] == [pytest.approx(100.0), pytest.approx(50.0)]
    assert [each["coefficients"][0]["name"] for each in found] == ["velocity random walk", "white noise"]


def test_runs_and_channels_of_a_store_are_chosen(store: Path) -> None:
    found = noise(store, *("--run", 1), *("--run", 2), *("--run", 3), *("--channel", "accel_v"))["series"]
    # Of a run that was cut off, what has a time.
    assert [(each["run"], each["samples"]) for each in found] == [("1", 500), ("2", 800), ("3", 900)]
    assert "no channel accel_x; there are accel_v, theta_deg" in refused(store, "--channel", "accel_x")
    assert "no run 9" in refused(store, "--run", 9)
    assert "for CSV files" in refused(store, "--rate", 5)


def test_a_store_without_runs_has_no_noise(tmp_path: Path) -> None:
    path = tmp_path / "empty.rig.sqlite"
    with Store.create(path, Header("sensing-axis")):
        pass
    assert "no valid runs" in refused(path)


@pytest.mark.parametrize(
    ("content", "options", "said"),
    [
        ("", [], "empty"),
        ("1.0\n2.0\n", ["--rate", "1"], "write the column names"),
        ("x_v\n1.0\nabc\n", ["--rate", "1"], "'abc', not a number"),
        ("x_v\n1.0\n2.0\n", ["--rate", "1"], "too few"),
        ("x_v\n" + "1.0\n" * 99, ["--rate", "1"], "no column in it varies"),
        ("x_v\n" + "nan\n" * 99, ["--rate", "1"], "no column in it varies"),
        ("x_v\n" + "nan\n" * 99, ["--rate", "1", "--channel", "x_v"], "no two samples in a row"),
        ("x_v\n1.0\n", ["--rate", "1", "--channel", "y_v"], "no column y_v; there are x_v"),
        ("x_v\n1.0\n", ["--rate", "0"], "--rate"),
        ("x_v\n1.0\n", ["--rate", "1", "--taus", "all"], "octave or decade"),
        ("x_v\n1.0\n", ["--rate", "1", "--confidence", "95"], "between 0 and 1"),
        ("x_v\n1.0\n", ["--rate", "1", "--run", "1"], "--run is for stores"),
        ("x_v\n1.0\n", ["--time", "when"], "no column when"),
        ("t_s,x_v\n1.0,2\n1.0,3\n2.0,4\n", [], "time does not go on"),
        ("t_s,x_v\n1.0,2\n,3\n2.0,4\n", [], "has no time"),
        ("t_s,x_v\n0,1\n1,2\n2.4,3\n3,4\n4,5\n", [], "not evenly spaced"),
    ],
)
def test_wrong_files_and_options_are_told_in_a_line(
    content: str, options: list[str], said: str, tmp_path: Path
) -> None:
    path = tmp_path / "wrong.csv"
    path.write_text(content)
    assert said in refused(path, *options)


def test_a_file_without_an_end_is_not_read(tmp_path: Path) -> None:
    pipe = tmp_path / "endless.csv"
    os.mkfifo(pipe)
    assert "a device or a pipe" in refused(pipe, "--rate", 1)
    assert "a device or a pipe" in refused("/dev/zero", "--rate", 1)
