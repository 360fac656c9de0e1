"""Every number of certificates, page and DCC, recomputed from the store."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.platform_sampler import SampledRun, record
from rigctl.campaign.recording import Header
from rigctl.campaign.store.store import Store
from rigctl.cli.application import app
from rigctl.experiments.inflight.model.parameters import NAMES
from rigctl.experiments.inflight.result.monte_carlo import DRAW
from rigctl.files.certificate_file import CertificateDetails, Requirement
from simulators.worlds.platform_settings import PlatformSettings
from tests.certificate import recomputed

PONTIUS = Path(__file__).parents[2] / "examples" / "pontius"
SIDES = {0: (0.0, None), 1: (7.30e-7, 7.3212e-7), 2: (0.0, None)}
"""Requirements on Pontius' coefficients: one that is met, one that is undecided, one that is not met."""


def rigctl(*words: object) -> Any:
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout) if "--json" in words else None


@pytest.fixture(scope="module")
def pontius(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, bytes, recomputed.Account]:
    """Page and DCC of the load cell with requirements, and what they have to say."""
    store = tmp_path_factory.mktemp("pontius") / "t.rig.sqlite"
    rigctl("import", PONTIUS, "--store", store)
    rigctl("model", "add", store, "power2[load_lb]")
    names = ("b0", "b1", "power2[load_lb]")
    wanted = [Requirement(quantity=names[at], lower=low, upper=high) for at, (low, high) in SIDES.items()]
    with pytest.MonkeyPatch.context() as patch:
        page, dcc = recomputed.issued(store, CertificateDetails(requirements=tuple(wanted)), patch)
    readings = np.genfromtxt(PONTIUS / "readings.csv", delimiter=",", names=True)
    columns = {name: readings[name] for name in readings.dtype.names or ()}
    (noise,) = rigctl("fit", store, "--json")["noise"]
    return page, dcc, recomputed.of_line(columns, noise, SIDES)


def test_of_a_table_with_requirements(pontius: tuple[str, bytes, recomputed.Account]) -> None:
    page, dcc, account = pontius
    assert recomputed.check(page, dcc, account) == 32
    assert re.findall(r"<td>(pass|UNDECIDED|FAIL)</td>", page) == ["pass", "UNDECIDED", "FAIL"]


@pytest.mark.parametrize("number", range(30))
def test_a_changed_number_of_a_page_is_seen(pontius: tuple[str, bytes, recomputed.Account], number: int) -> None:
    page, dcc, account = pontius
    # The first digit that is not zero, of a number and not of a unit.
    cells = list(re.finditer(r'<td class="n">[^<\w]*[0.]*([1-9])', page))
    assert len(cells) > 20
    cell = cells[number % len(cells)]
    changed = page[: cell.start(1)] + str(int(cell[1]) % 9 + 1) + page[cell.end(1) :]
    with pytest.raises(AssertionError):
        recomputed.check(changed, dcc, account)


def test_a_changed_or_an_added_number_of_a_dcc_is_seen(pontius: tuple[str, bytes, recomputed.Account]) -> None:
    page, dcc, account = pontius
    text = dcc.decode()
    numbers = list(re.finditer(r"<si:[^>]*>[^<]*?([1-9])[^<]*</si:", text[: text.index("Model in force")]))
    assert len(numbers) > 40
    for each in numbers[:: len(numbers) // 20]:
        if "unit" in each[0] or "label" in each[0]:
            continue
        changed = text[: each.start(1)] + str(int(each[1]) % 9 + 1) + text[each.end(1) :]
        with pytest.raises(AssertionError):
            recomputed.check(page, changed.encode(), account)
    added = text.replace("<si:coverageFactor>", "<si:value>1.0</si:value><si:coverageFactor>", 1)
    with pytest.raises(AssertionError):
        recomputed.check(page, added.encode(), account)


def test_of_a_study_of_draws(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(7)
    with Store.create(tmp_path / "s.rig.sqlite", Header("inflight-calibration", started="2026-01-01")) as store:
        for number in range(5):
            truth = dict(zip(NAMES, rng.normal(size=len(NAMES)), strict=True))
            found = {name: value + 1e-3 * rng.normal() for name, value in truth.items()}
            told = {"paper_truth": truth, "exact_truth": truth}
            estimates = {"paper": found, "joint": found}
            store.add_document(DRAW, {"draw": number, "estimates": estimates, "sigmas": estimates, "truths": told})
    with Store.open(tmp_path / "s.rig.sqlite", readonly=True) as store:
        draws = [each.data for each in store.documents(DRAW)]
    page, dcc = recomputed.issued(tmp_path / "s.rig.sqlite", CertificateDetails(), monkeypatch)
    assert recomputed.check(page, dcc, recomputed.of_draws(draws)) == 63


def test_of_the_platform(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    nature = PlatformSettings.model_validate({"kind": "rotating-platform", "seed": 6, "effects": {}})
    runs = [SampledRun("c", 60.0, 12, v_z_v=0.0), SampledRun("b", 60.0, 12, v_z_v=1.0)]
    record(nature, runs, tmp_path / "bundle")
    rigctl("import", tmp_path / "bundle", "--store", tmp_path / "s.rig.sqlite")
    page, dcc = recomputed.issued(tmp_path / "s.rig.sqlite", CertificateDetails(), monkeypatch)
    told = rigctl("result", tmp_path / "s.rig.sqlite", "--json")
    assert recomputed.check(page, dcc, recomputed.of_platform(told)) > 30


def test_of_sensing_axes(desk: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    desk.campaign(("mountings = 1", "mountings = 2"))
    told = desk.run().json["result"]
    page, dcc = recomputed.issued(desk.store, CertificateDetails(), monkeypatch)
    assert recomputed.check(page, dcc, recomputed.of_axes(told)) > 60
