"""The figures of the rotating platform: the result's numbers, beside what the paper prints."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmarks.platform_sampler import SampledRun, record
from rigctl.cli.application import app
from rigctl.core.errors import DataError
from rigctl.effects.catalogue import catalogue
from rigctl.report.figures.rotating_platform.signature import signature_plate
from simulators.worlds.platform_settings import PlatformSettings

RUNS = [
    SampledRun("c", 60.0, 24, v_z_v=0.0),
    SampledRun("c", 60.0, 24, v_z_v=1.0),
    SampledRun("a", 300.0, 12, v_z_v=1.0, external="sine", external_period_s=3600.0),
    SampledRun("c", 60.0, 60, v_z_v=1.0, external="triangle", external_period_s=3600.0),
    SampledRun(angles_deg=(0.0, 60.0, 120.0, 180.0, 240.0, 300.0), dwell_s=60.0),
    SampledRun(angles_deg=(0.0, 60.0, 120.0, 180.0, 240.0, 300.0), dwell_s=60.0, v_z_v=-0.5),
]


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def figures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("platform")
    record(PlatformSettings(kind="rotating-platform", seed=41), RUNS, place / "bundle")
    runner = CliRunner()
    for line in (["import", "bundle", "--store", "s.rig.sqlite"], ["report", "s.rig.sqlite", "--figures", "figures"]):
        done = runner.invoke(app, [str(place / w) if w in {"bundle", "s.rig.sqlite", "figures"} else w for w in line])
        assert done.exit_code == 0, done.output
    return place / "figures"


def test_every_figure_is_drawn_and_tabled(figures: Path) -> None:
    for name in ("fig5", "fig7", "fig8", "fig9", "table4", "residuals_since_turn_s", "residuals_stop"):
        assert (figures / f"{name}.svg").read_text(encoding="utf-8").startswith("<?xml")
        assert rows(figures / f"{name}.csv")
    assert "*left out:* noise: no noise record" in (figures / "figures.md").read_text(encoding="utf-8")


def test_the_sine_is_shown_with_what_the_pattern_makes_of_it(figures: Path) -> None:
    found = rows(figures / "fig8.csv")
    assert {row["pattern"] for row in found} == {"a"}
    expected = [float(row["expected_bias_m_s2"]) for row in found]
    assert max(expected) - min(expected) == pytest.approx(3.04e-4, rel=0.05)
    assert float(found[3]["bias_m_s2"]) == pytest.approx(expected[3], abs=6e-5)
    assert "0.000306 measured" in (figures / "figures.md").read_text(encoding="utf-8")


def test_precision_stands_beside_theory_and_table_4(figures: Path) -> None:
    found = rows(figures / "table4.csv")
    printed = {float(r["sample_rate_hz"]): float(r["sigma_m_s2"]) for r in found if r["kind"] == "printed"}
    assert printed == {10.0: 1.6631e-7, 100.0: 1.5718e-7, 200.0: 1.2524e-7}
    theory = [float(r["sigma_m_s2"]) for r in found if (r["kind"], r["channel"]) == ("theory", "z")]
    assert theory == pytest.approx([1.80834e-7] * 3, abs=2e-10)
    measured = [r for r in found if r["kind"] == "measured"]
    assert all(float(r["low_m_s2"]) < float(r["sigma_m_s2"]) < float(r["high_m_s2"]) for r in measured)
    curve = [r for r in rows(figures / "fig9.csv") if (r["kind"], r["pattern"]) == ("theory", "c")]
    assert float(curve[-1]["sigma_m_s2"]) == pytest.approx(2.64535e-6, rel=1e-4)


def test_scan_and_tilts_are_shown_together(figures: Path) -> None:
    found = rows(figures / "fig5.csv")
    scans = [row for row in found if row["kind"] == "scan"]
    assert len(scans) == 24
    # Equation 6 has numbers for the paper's tilt only.
    assert {float(row["commanded_m_s2"]) for row in scans if row["printed_m_s2"]} == {-0.5 / 825.0}
    at_zero = {row["channel"]: row for row in scans if row["printed_m_s2"] and row["theta_deg"] == "0.0"}
    assert {name: float(row["printed_m_s2"]) for name, row in at_zero.items()} == pytest.approx(
        {"y": -14.33e-4 - 2.94e-4, "z": 10.54e-4 - 3.34e-4}
    )
    # Four sigma of the chain's noise above the frequency of a scan.
    assert float(at_zero["y"]["value_m_s2"]) == pytest.approx(-14.33e-4 - 2.98e-4, abs=2e-5)
    assert "0.9297" in (figures / "figures.md").read_text(encoding="utf-8")
    assert "-2.49 deg" in (figures / "figures.md").read_text(encoding="utf-8")
    tilts = [row for row in found if row["kind"] == "tilt"]
    assert [float(row["commanded_m_s2"]) for row in tilts] == pytest.approx([0.0, 1.0 / 825.0])
    for row in tilts:
        assert float(row["value_m_s2"]) == pytest.approx(float(row["printed_m_s2"]), abs=2e-6)


def test_another_sensor_has_no_printed_numbers_and_units_of_its_own(tmp_path: Path) -> None:
    """What the paper prints is of its two Q-Flex: chains a thousand times as sensitive stand for themselves."""
    record(PlatformSettings(kind="rotating-platform", seed=41), [*RUNS[:3], RUNS[5]], tmp_path / "bundle")
    header = tmp_path / "bundle" / "recording.toml"
    text = header.read_text(encoding="utf-8")
    for name, value in (("gain_q_a", 846.73), ("gain_q_b", 804.32), ("gain_dm1_y", 805.0), ("gain_dm1_z", 825.0)):
        text, count = re.subn(rf"({name}_v_per_m_s2.*= )[0-9.]+", rf"\g<1>{1e3 * value}", text)
        assert count == 1
    header.write_text(text, encoding="utf-8")
    runner, store = CliRunner(), str(tmp_path / "s.rig.sqlite")
    for line in (["import", str(tmp_path / "bundle")], ["report", "--figures", str(tmp_path / "figures")]):
        done = runner.invoke(app, [*line, *(["--store"] if line[0] == "import" else []), store])
        assert done.exit_code == 0, done.output
    for name in ("fig5", "fig8", "fig9", "table4"):
        found = rows(tmp_path / "figures" / f"{name}.csv")
        assert not any(row.get("printed_m_s2") or row.get("kind", "").startswith("printed") for row in found)
    assert "Measurement 46" not in (tmp_path / "figures" / "figures.md").read_text(encoding="utf-8")
    told = runner.invoke(app, ["result", store]).output
    assert "Means of the runs / 1e-9 m/s2" in told
    assert "Precision in an hour / 1e-10 m/s2" in told


@pytest.mark.parametrize(
    ("effect", "output", "size"),
    [
        ("recovery", "bias mean", 1.0),
        ("recovery-signed", "accel mean", 1.0),
        ("theta-locked-bias", "accel mean", 0.0),
    ],
)
def test_a_signature_falls_with_the_period_where_the_effect_does(effect: str, output: str, size: float) -> None:
    plate = signature_plate(catalogue("rotating-platform")[effect])
    short, long = (
        next(r.added_m_s2 for r in plate.rows if (r.output, r.pattern, r.period_s) == (output, "b", period_s))
        for period_s in (60.0, 1200.0)
    )
    assert abs(short) > 1e-7
    # Of a recovery what leaks goes as one over the period; the joint fit sees a theta-locked bias whole.
    assert (abs(long) < 0.12 * abs(short)) == bool(size)
    if not size:
        assert long == pytest.approx(short, rel=1e-9)


def test_a_line_has_no_signature() -> None:
    with pytest.raises(DataError, match="looked for in the samples"):
        signature_plate(catalogue("rotating-platform")["line"])
