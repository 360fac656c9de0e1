"""What `rigctl report --figures` writes: the result's numbers, drawn and tabled."""

from __future__ import annotations

import csv
import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib as mpl
import matplotlib.figure
import numpy as np
import pytest

from rigctl.core.errors import DataError
from rigctl.experiments.sensing_axis.result.budget import axis_budgets
from rigctl.report.chart.figure import Figure
from rigctl.report.chart.marks import Series
from rigctl.report.figures.data import Plate, write_plates
from rigctl.report.figures.residuals import ResidualRow, draw_residuals
from rigctl.report.figures.sensing_axis.figures import plates_of
from rigctl.report.figures.sensing_axis.null_search import representative, response_plate
from rigctl.report.figures.sensing_axis.plane import plane_plate
from rigctl.report.figures.sensing_axis.result import budget_plate
from rigctl.report.figures.sensing_axis.time_series import time_series_plate

ARCSEC_PER_RAD = 648000.0 / math.pi
ROLL_UM_S2_PER_MM = 9.7e-5 * 9.803 * 1e3
"""rho1 g, the response per millimetre of motion at the null."""


def table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def texts(path: Path) -> str:
    root = ET.parse(path).getroot()
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    return " ".join("".join(each.itertext()) for each in root.iter("{http://www.w3.org/2000/svg}text"))


def column(rows: list[dict[str, str]], name: str) -> list[float]:
    return [float(row[name]) for row in rows]


@pytest.fixture(scope="module")
def written(two_axes, uncertainties, tmp_path_factory) -> Path:
    directory = tmp_path_factory.mktemp("figures") / "made" / "here"
    paths = write_plates(*plates_of(two_axes, axis_budgets(two_axes, uncertainties)), directory)
    assert sorted(paths) == sorted(directory.iterdir())
    return directory


def test_every_figure_comes_as_svg_and_csv(written):
    names = {"fig12", "fig15", "fig17", "nulls", "budget"}
    names |= {f"fig12_{axis}_{configuration}" for axis in "XZ" for configuration in ("pendulum", "flag")}
    expected = {f"{name}.{suffix}" for name in names for suffix in ("svg", "csv")} | {"figures.md"}
    assert {path.name for path in written.iterdir()} == expected


@pytest.mark.parametrize(
    ("figure", "labels"),
    [
        ("fig12", ["in-phase response S/(kA) / (µm s⁻² mm⁻¹)", "stage angle θ / deg", "θ − θ₀ / arcsec", "0.6 Hz"]),
        ("fig15", ["mounting", "angle out of the plane / arcsec", "along y of the cube", "along z of the cube"]),
        ("fig17", ["axis Z: half-cone 2σ = ", "required 100″", "along x of the cube", "pendulum, n = 2", "+2σ"]),
        ("nulls", ["null angle θ₀ / deg", "σ(θ₀) / arcsec", "axis X", "axis Z", "mounting", "pendulum", "flag"]),
        ("budget", ["standard uncertainty / arcsec", "scatter in flag", "combined", "beam tilt of laser_1_mm"]),
    ],
)
def test_axes_say_quantity_and_unit(written, figure, labels):
    shown = texts(written / f"{figure}.svg")
    for label in labels:
        assert label in shown


def test_same_result_same_bytes_whatever_the_user_has_set(two_axes, uncertainties, written, tmp_path):
    axis, settings = two_axes.axes["Z"], two_axes.fit.model.package.axes["Z"]
    runs = [run for run in two_axes.fit.model.runs if run.mounting == 1]
    plates = [
        response_plate("fig12_X_pendulum", two_axes.fit, runs),
        plane_plate("fig17", axis, settings),
        budget_plate(axis_budgets(two_axes, uncertainties)),
    ]
    with mpl.rc_context({"font.size": 20.0, "svg.hashsalt": "other", "axes.facecolor": "red"}):
        before = dict(mpl.rcParams)
        paths = [path for plate in plates for path in plate.write(tmp_path)]
        assert dict(mpl.rcParams) == before
    assert len(paths) == 6
    for path in paths:
        assert path.read_bytes() == (written / path.name).read_bytes(), path.name


class TestResponse:
    def test_points_are_the_runs_amplitudes_per_gain_and_motion(self, two_axes, written):
        rows = [row for row in table(written / "fig12_Z_flag.csv") if row["kind"] == "measured"]
        runs = {run.run_id: run for run in two_axes.fit.model.runs}
        gain = two_axes.fit.result.value("gain[Z,flag]")
        assert len(rows) == 3
        for row in rows:
            run = runs[row["run_id"]]
            assert (run.axis, run.configuration, str(run.mounting)) == ("Z", "flag", row["mounting"])
            um_s2_per_mm = 1e3 / (gain * run.amplitude_m)
            assert float(row["theta_deg"]) == pytest.approx(math.degrees(run.theta_rad), rel=1e-12)
            assert float(row["response_um_s2_per_mm"]) == pytest.approx(
                run.accel_v.value[1].real * um_s2_per_mm, rel=1e-12
            )
            assert float(row["response_sigma_um_s2_per_mm"]) == pytest.approx(
                run.accel_v.sigma[1] * um_s2_per_mm, rel=1e-12
            )

    def test_lines_are_equation_5_and_cross_at_the_null(self, two_axes, written):
        rows = table(written / "fig12_X_pendulum.csv")
        rho1 = two_axes.fit.result.value("rho1")
        lines = [row for row in rows if row["kind"] == "model"]
        assert {round(f, 3) for f in column(lines, "frequency_hz")} == {0.3, 0.6}
        offset = np.array(column(lines, "theta_minus_theta0_arcsec")) / ARCSEC_PER_RAD
        w = 2.0 * math.pi * np.array(column(lines, "frequency_hz"))
        expected = 1e3 * (rho1 * 9.803 * np.cos(offset) + w**2 * np.sin(offset))
        np.testing.assert_allclose(column(lines, "response_um_s2_per_mm"), expected, rtol=1e-6, atol=1e-6)
        (null,) = [row for row in rows if row["kind"] == "null"]
        assert float(null["response_um_s2_per_mm"]) == pytest.approx(1e3 * rho1 * 9.803, rel=1e-6)
        assert float(null["response_um_s2_per_mm"]) == pytest.approx(ROLL_UM_S2_PER_MM, rel=0.2)

    def test_each_frequency_alone_is_off_by_the_roll(self, two_axes, written):
        rho1 = two_axes.fit.result.value("rho1")
        rows = [row for row in table(written / "fig12.csv") if row["kind"] == "apparent null"]
        assert len(rows) == 2
        for row in rows:
            w = 2.0 * math.pi * float(row["frequency_hz"])
            expected = -math.atan(rho1 * 9.803 / w**2) * ARCSEC_PER_RAD
            assert float(row["theta_minus_theta0_arcsec"]) == pytest.approx(expected, rel=1e-4)

    def test_shows_the_mounting_with_most_frequencies_then_runs(self, two_axes):
        runs = [
            replace(run, frequency_hz=0.6) if run.mounting == 1 else run
            for run in two_axes.fit.model.runs
            if (run.mounting, run.run_id) != (3, "7")
        ]
        assert {run.mounting for run in representative(runs)} == {2}
        again = replace(next(run for run in runs if run.mounting == 6), frequency_hz=0.6001)
        assert {run.mounting for run in representative([*runs, again])} == {6}

    def test_null_is_the_fits(self, two_axes, written):
        (row,) = [row for row in table(written / "fig12_X_flag.csv") if row["kind"] == "null"]
        null = two_axes.fit.null("X", "flag", int(row["mounting"]))
        assert float(row["theta_deg"]) == pytest.approx(math.degrees(null.theta0_rad), rel=1e-12)
        assert float(row["theta_sigma_arcsec"]) == pytest.approx(null.theta0_sigma_rad * ARCSEC_PER_RAD, rel=1e-12)
        shown = f"{float(row['theta_deg']):.5f}° ± {float(row['theta_sigma_arcsec']):.2f}″"
        assert shown.replace("-", "−") in texts(written / "fig12_X_flag.svg")


@pytest.mark.parametrize(("figure", "axis"), [("fig15", "X"), ("fig17", "Z")])
class TestPlane:
    def test_out_of_plane_angles_are_the_fits(self, two_axes, written, figure, axis):
        rows = table(written / f"{figure}.csv")
        result = two_axes.axes[axis]
        out = np.array(column(rows, "out_of_plane_arcsec")) / ARCSEC_PER_RAD
        np.testing.assert_allclose(out, result.plane.half_cone_rad, rtol=1e-12)
        sigma = [null.vector_covariance for null in result.nulls]
        expected = [math.sqrt(result.plane.normal @ each @ result.plane.normal) for each in sigma]
        np.testing.assert_allclose(np.array(column(rows, "sigma_fit_arcsec")) / ARCSEC_PER_RAD, expected, rtol=1e-9)
        for sigma_hc in column(rows, "sigma_hc_arcsec"):
            assert 2.0 * sigma_hc == pytest.approx(result.plane.std_hc_2sigma_arcsec, rel=1e-12)
        assert f"{result.plane.std_hc_2sigma_arcsec:.1f}″" in texts(written / f"{figure}.svg")

    def test_in_plane_angles_give_the_vectors_back(self, two_axes, written, figure, axis):
        rows = table(written / f"{figure}.csv")
        plane = two_axes.axes[axis].plane
        start, turn = ("xyz".index(rows[0][name][0]) for name in ("in_plane_from", "in_plane_towards"))
        assert ["XYZ".index(axis), start, turn] in [[0, 1, 2], [2, 0, 1]]
        first = np.eye(3)[start] - plane.normal[start] * plane.normal
        first /= np.linalg.norm(first)
        within, out = np.radians(column(rows, "in_plane_deg")), plane.half_cone_rad
        in_plane = np.outer(np.cos(within), first) + np.outer(np.sin(within), np.cross(plane.normal, first))
        vectors = np.cos(out)[:, None] * in_plane + np.outer(np.sin(out), plane.normal)
        np.testing.assert_allclose(vectors, two_axes.axes[axis].vectors, atol=1e-12)
        by_configuration = {row["configuration"]: float(row["in_plane_deg"]) for row in rows}
        # In pendulum the motion runs along k, in flag along j.
        assert by_configuration == {"pendulum": pytest.approx(90.0, abs=2.0), "flag": pytest.approx(0.0, abs=2.0)}


def test_a_requirement_within_reach_is_drawn(two_axes, written, tmp_path):
    tight = replace(two_axes.axes["X"], requirement_arcsec=15.0)
    plane_plate("fig15", tight, two_axes.fit.model.package.axes["X"]).write(tmp_path)
    assert "requirement ±15″" in texts(tmp_path / "fig15.svg")
    assert "requirement ±" not in texts(written / "fig15.svg")


def test_a_requirement_that_nobody_has_stated_is_not_drawn(two_axes, tmp_path):
    unstated = replace(two_axes.axes["X"], requirement_is_stated=False, requirement_arcsec=15.0)
    plane_plate("fig15", unstated, two_axes.fit.model.package.axes["X"]).write(tmp_path)
    assert "requir" not in texts(tmp_path / "fig15.svg")


def test_nulls_are_the_fits(two_axes, written):
    rows = table(written / "nulls.csv")
    nulls = two_axes.fit.nulls()
    assert [(row["axis"], row["configuration"], int(row["mounting"])) for row in rows] == [
        (null.axis, null.configuration, null.mounting) for null in nulls
    ]
    np.testing.assert_allclose(np.radians(column(rows, "theta0_deg")), [n.theta0_rad for n in nulls], rtol=1e-12)
    sigma = np.array(column(rows, "theta0_sigma_arcsec")) / ARCSEC_PER_RAD
    np.testing.assert_allclose(sigma, [n.theta0_sigma_rad for n in nulls], rtol=1e-12)


def test_bars_are_the_budgets(two_axes, uncertainties, written):
    rows = table(written / "budget.csv")
    for axis, each in axis_budgets(two_axes, uncertainties).items():
        own = {row["contribution"]: row for row in rows if row["axis"] == axis}
        known = each.as_json()
        expected = {row["name"]: row["arcsec"] for row in known["contributions"]}
        expected["combined"] = known["combined_arcsec"]
        assert own.keys() == expected.keys()
        for name, arcsec in expected.items():
            shown = [float(own[name][f"component_{i}_arcsec"]) for i in (1, 2)]
            np.testing.assert_allclose(shown, arcsec, rtol=1e-12)


@pytest.mark.parametrize(
    ("case", "responses"),
    [
        ("one_configuration", {"fig12_X_pendulum"}),
        ("without_lasers", {"fig12_X_pendulum", "fig12_X_flag"}),
    ],
)
def test_what_cannot_be_drawn_is_left_out_and_said(case, responses, request, uncertainties, tmp_path):
    result = request.getfixturevalue(case)
    paths = write_plates(*plates_of(result, axis_budgets(result, uncertainties)), tmp_path)
    expected = responses | {"fig12", "nulls"}
    assert {path.stem for path in paths if path.suffix == ".svg"} == expected
    said = (tmp_path / "figures.md").read_text(encoding="utf-8")
    left_out = [line for line in said.splitlines() if "left out" in line]
    assert [line.split(":")[1].strip(" *") for line in left_out] == ["plane of axis X", "budget"]
    assert result.missing["X"] in left_out[0]


@dataclass(frozen=True)
class Row:
    x: float


def test_a_figure_in_a_page_and_in_a_file_is_drawn_once(tmp_path):
    drawn = []

    def draw(rows):
        drawn.append(rows)
        figure = Figure(1.0)
        figure.subplots()
        return figure

    plate = Plate("figure", "a caption", [Row(1.0)], draw)
    element = plate.svg
    plate.write(tmp_path)
    assert (tmp_path / "figure.svg").read_text(encoding="utf-8").endswith(element)
    assert len(drawn) == 1


def test_an_experiment_from_outside_may_draw_with_matplotlib(tmp_path):
    def draw(rows):
        figure = mpl.figure.Figure(figsize=(2.0, 1.0))
        figure.subplots().plot([row.x for row in rows], [row.x for row in rows])
        return figure

    with mpl.rc_context({"svg.hashsalt": "other", "axes.facecolor": "red"}):
        plates = [Plate("foreign", "a caption", [Row(1.0), Row(2.0)], draw) for _ in range(2)]
        assert plates[0].svg == plates[1].svg
        plates[0].write(tmp_path)
    assert ET.parse(tmp_path / "foreign.svg").getroot().tag == "{http://www.w3.org/2000/svg}svg"
    assert "#ff0000" not in plates[0].svg


def test_a_directory_that_cannot_be_written_is_one_line(one_configuration, tmp_path):
    in_the_way = tmp_path / "file"
    in_the_way.write_text("")
    with pytest.raises(DataError, match="cannot write the figures there") as raised:
        write_plates(*plates_of(one_configuration, {}), in_the_way)
    assert "\n" not in str(raised.value)


def test_the_first_cycles_of_the_run_that_answers_most_stand_beside_their_sine(two_axes):
    runs = two_axes.fit.model.runs
    strongest = max(runs, key=lambda run: abs(run.accel_v.value[1]))
    time_s = 7.0 + 0.01 * np.arange(2000)
    turn = 2.0 * np.pi * strongest.frequency_hz * time_s
    accel_v = 0.3 + 0.2 * np.sin(turn + 0.4)
    accel_v[[3, 50]] = np.nan, 0.9

    class Source:
        def samples(self, run_id):
            assert run_id == strongest.run_id
            return {"t_s": time_s, "stage_x_mm": 5.0 * np.sin(turn), "accel_v": accel_v}

    plate = time_series_plate(Source(), runs)
    shown = [row for row in plate.rows if row.channel == "accel_v"]
    assert shown[-1].time_s - shown[0].time_s == pytest.approx(3.0 / strongest.frequency_hz, abs=0.011)
    # One wild sample of 2000 moves the sine by a thousandth of its size; it is shown as it was read.
    expected = 0.3 + 0.2 * np.sin(
        2.0 * np.pi * strongest.frequency_hz * np.array([row.time_s for row in shown]) + 0.4
    )
    np.testing.assert_allclose([row.fitted for row in shown], expected, atol=2e-3)
    assert (shown[50].value, np.isnan(shown[3].value)) == (0.9, True)
    assert f"run {strongest.run_id}" in plate.caption
    for label in ("stage / mm", "accelerometer / V", "time / s"):
        assert label in plate.svg


def residuals_of(per_series: int) -> list[ResidualRow]:
    """Eight series of two channels."""
    names = [("2 m_dx", f"{k} f cosine") for k in range(6)] + [("own channel", "sine"), ("own channel", "cosine")]
    rows = (
        ResidualRow("start_s", 1.0 * at, "", 1, "", *name, "1", 0.5) for name in names for at in range(per_series)
    )
    return list(rows)


@pytest.mark.parametrize(
    ("per_series", "panels"),
    [(2, ["2 m_dx", "own channel"]), (20, [f"2 m_dx\n{k} f cosine" for k in range(4)])],
)
def test_series_of_few_data_are_drawn_together_by_channel(per_series: int, panels: list[str]) -> None:
    figure = draw_residuals(residuals_of(per_series))
    assert [axes.ylabel for axes in figure.axes] == panels
    points = sum(mark.x.size for axes in figure.axes for mark in axes.marks if isinstance(mark, Series))
    assert points == {2: 16, 20: 80}[per_series]
