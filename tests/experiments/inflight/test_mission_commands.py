"""A calibration and the test itself, flown and told by the commands."""

import csv
import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from rigctl.cli.application import app
from rigctl.experiments.inflight.model.parameters import NAMES
from rigctl.report.figures.inflight.figures import plates_of

CAMPAIGNS = Path(__file__).parents[3] / "campaigns"
HIDDEN = 1e-13
# Short sessions, a sample a second: frequencies are whole numbers of periods of six orbits.
MISSION = """
experiment = "inflight-calibration"
rig = "rig.toml"

[procedure]
name = "calibration"
sessions = [
    "dx", "dz", "dy", "ac12", "ac13", "ad11", "ad12", "ad13", "k2d", "k2c_1", "k2c_2", "ep_inertial", "ep_spin",
]
orbits = 6.0
orbits_ac12 = 6.0
orbits_ep = 10.0
common_hz = 1.2324929971988796e-3
turn_hz = 1.2324929971988796e-3
displacement_hz = 3.0812324929971988e-3
quadratic_hz = 8.963585434173669e-3
"""


def told(*words):
    found = CliRunner().invoke(app, [*map(str, words)])
    assert found.exit_code == 0, found.output
    return found.stdout


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    place = tmp_path_factory.mktemp("mission")
    world = f"seed = 5\nsample_period_s = 1.0\neotvos = {HIDDEN}"
    (place / "rig.toml").write_text((CAMPAIGNS / "microscope-rig.toml").read_text().replace("seed = 1707", world))
    (place / "mission.toml").write_text(MISSION)
    told("run", place / "mission.toml", "--store", place / "mission.rig.sqlite", "--yes")
    return place / "mission.rig.sqlite"


def test_a_result_has_what_was_hidden_and_what_each_parameter_does(store):
    found = json.loads(told("result", store, "--json"))
    ep = found["ep"]
    sessions = {each["session"]: each for name, each in ep.items() if name != "combined"}
    assert set(sessions) == {"ep_inertial", "ep_spin"}
    for each in [*sessions.values(), ep["combined"]]:
        # Twenty amplitudes and more tell sigma.
        assert abs(each["delta"]["value"] - HIDDEN) < 4.5 * each["delta"]["sigma"]
        assert each["delta"]["sigma"] < 0.05 * HIDDEN
    assert sessions["ep_spin"]["f_ep_hz"] == pytest.approx(18.5 / 5950.0)
    assert all(set(each["rows"]) == set(NAMES) for each in sessions.values())
    assert "Test of the equivalence principle" in told("result", store)


def test_figures_show_the_line_and_delta_before_and_after(store, tmp_path):
    # Not the whole report, which looks for effects besides.
    for plate in plates_of(json.loads(told("result", store, "--json"))):
        plate.write(tmp_path)
    spectra = sorted(tmp_path.glob("equivalence_spectrum_*.csv"))
    assert len(spectra) == 2
    for path in spectra:
        with path.open() as file:
            rows = list(csv.DictReader(file))
        at_line = [row for row in rows if row["is_test"] == "True"]
        assert len(at_line) == 1
        assert float(at_line[0]["after_m_s2"]) == pytest.approx(7.9 * HIDDEN, rel=0.2, abs=0.0)
        # Beside the line is noise, as it is stated.
        others = [float(row["after_m_s2"]) for row in rows if row["is_test"] != "True"]
        assert sum(others) / len(others) == pytest.approx(float(rows[0]["noise_m_s2"]), rel=0.5, abs=0.0)
    with (tmp_path / "equivalence_delta.csv").open() as file:
        assert [row["name"] for row in csv.DictReader(file)][-1] == "all"
