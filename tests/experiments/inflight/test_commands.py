"""A bundle of sessions through the commands: imported, reduced once, looked at, a model extended."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from rigctl import Campaign, results
from rigctl.campaign.bundle.bundle import write_bundle
from rigctl.campaign.recording import Header, ImportReport, Recording, RunRecord
from rigctl.campaign.store.store import Store
from rigctl.cli.application import app
from rigctl.composition import opened_workbench
from rigctl.core.errors import DataError
from rigctl.experiments.inflight import study_data
from rigctl.experiments.inflight.model.parameters import NAMES
from rigctl.experiments.inflight.result.monte_carlo import DRAW
from rigctl.experiments.inflight.result.published import published
from rigctl.experiments.inflight.study import InflightStudy
from rigctl.files.certificate_file import CertificateDetails
from tests.certificate import recomputed

STEP_S = 10.0
STATED = {"value", "sigma", "unit", "systematic", "paper", "joint"}


def asked(*words):
    found = CliRunner().invoke(app, [*map(str, words), "--json"])
    assert found.exit_code == 0, found.output
    return json.loads(found.stdout)


@pytest.fixture(scope="module")
def store(flight, tmp_path_factory):
    place = tmp_path_factory.mktemp("flight")
    instrument = flight.drawn(4, eta=0.0)

    def hidden(_, t_s, out):
        made = np.zeros_like(out)
        made[0, 0] = 1e-13 * np.cos(2 * np.pi * t_s / 5950.0)
        return made

    records, samples = [], {}
    for name in flight.SESSIONS:
        sky = flight.Sky(noise=1.2e-12, seed=4, added=hidden)
        samples[name], conditions = flight.recorded(name, instrument, sky, orbits=10, step_s=STEP_S)
        records.append(RunRecord(name, name, "test", conditions))
    header = Header("inflight-calibration", constants={"orbit_period_s": flight.ORBIT_S, "eccentricity": 5e-3})
    write_bundle(Recording(header, records, samples, ImportReport(len(records))), place / "bundle")
    told = asked("import", place / "bundle", "--store", place / "flight.rig.sqlite")
    assert (told["runs"], told["not_reduced"], told["invalid"]) == (11, {}, {})
    return place / "flight.rig.sqlite"


def test_every_command_has_an_answer_and_the_model_grows(store, tmp_path):
    first = asked("result", store)
    assert list(first["parameters"]) == list(NAMES)
    assert all(set(each) == STATED for each in first["parameters"].values())
    assert Campaign.result(store).as_json() == first
    assert asked("diagnose", store)["suggested"] == ["magnetic"]
    assert "2 m_dx" in {channel["channel"] for channel in asked("compare", store)["channels"]}
    asked("model", "add", store, "magnetic")
    ladder = asked("model", "history", store)
    assert ladder[1]["error_fit"] < 0.8 * ladder[0]["error_fit"]
    assert ladder[1]["error_held_out"] < 0.8 * ladder[0]["error_held_out"]
    assert asked("diagnose", store)["verdict"] == "adequate"
    value = asked("fit", store)["parameters"]["once_cos_d"]
    assert value["value"] == pytest.approx(5e-14, abs=4.0 * value["sigma"])
    assert asked("result", store)["parameters"]["ac12_rad"]["value"] != first["parameters"]["ac12_rad"]["value"]
    written = asked("report", store, "--out", tmp_path / "page.html", "--figures", tmp_path / "figures")["written"]
    assert any(path.endswith("estimates.csv") for path in written)
    assert "published" in CliRunner().invoke(app, ["result", str(store)]).stdout


def test_a_campaign_searches_its_samples_once_and_its_result_stands_whatever_they_say(store, tmp_path, monkeypatch):
    copy = Path(shutil.copy(store, tmp_path))
    with Store.open(copy) as opened:
        opened._connection.execute("DELETE FROM reductions WHERE recipe LIKE '%samples%'")

    def no_search(_):
        raise DataError("nothing to be searched")

    with monkeypatch.context() as broken:
        broken.setattr(InflightStudy, "search_samples", no_search)
        told = results.of(copy, keep=True)
    assert results.of(copy, keep=True) == told
    monkeypatch.setattr(study_data, "scan", lambda *_: pytest.fail("searched again"))
    with opened_workbench(copy) as bench:
        assert bench.study.lines(bench.study.model(())) is not None


def test_every_number_of_its_certificate_is_recomputed(store, monkeypatch):
    page, dcc = recomputed.issued(store, CertificateDetails(), monkeypatch)
    with opened_workbench(store, ()) as workbench:
        attempt, runs = workbench.attempt(workbench.current), list(workbench.store.runs())
        account = recomputed.of_calibration(asked("result", store), asked("fit", store), attempt, runs)
        assert recomputed.check(page, dcc, account) > 100


def test_runs_are_reduced_once(store, monkeypatch):
    with Store.open(store) as opened:
        monkeypatch.setattr(Store, "samples", lambda *_: pytest.fail("samples were read again"))
        study = InflightStudy(opened)
        assert len(study.data.reduced.runs) == 11
        assert np.isfinite(study.data.observations.value).all()


def test_a_study_of_draws_has_tables(store, tmp_path):
    rows = published().rows
    with Store.create(tmp_path / "study.rig.sqlite", Header("inflight-calibration")) as opened:
        for number in range(3):
            values = {name: 0.1 * number * rows[name].objective for name in NAMES}
            opened.add_document(
                DRAW,
                {
                    "draw": number,
                    "estimates": {"paper": values, "joint": values},
                    "sigmas": {"paper": values, "joint": values},
                    "truths": {"paper_truth": dict.fromkeys(NAMES, 0.0), "exact_truth": dict.fromkeys(NAMES, 0.0)},
                },
            )
    found = asked("result", tmp_path / "study.rig.sqlite")
    assert (found["draws"], set(found["table2"]), set(found["table3"]["rows"])) == (3, set(NAMES), set(NAMES))
    assert found["table2"]["ad11"]["paper"]["paper_truth"]["worst"] == pytest.approx(0.2 * rows["ad11"].objective)
    written = asked("report", tmp_path / "study.rig.sqlite", "--figures", tmp_path / "figures")["written"]
    assert {path.rpartition("/")[2] for path in written} >= {"table2.csv", "table3.svg"}
    printed = CliRunner().invoke(app, ["result", str(tmp_path / "study.rig.sqlite")], env={"COLUMNS": "200"}).stdout
    assert "Table 3" in printed
    assert printed.count("0 % over") == len(NAMES)
    for figure in ("table2.svg", "table3.svg"):
        drawn = (tmp_path / "figures" / figure).read_text(encoding="utf-8")
        assert "ac11_dx_m" not in drawn
        assert "Δx" in drawn
