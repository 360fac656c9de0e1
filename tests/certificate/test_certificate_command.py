"""`rigctl certificate` and `rigctl verify`: from a store to a page, and back to the store."""

from __future__ import annotations

import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from rigctl.campaign.item import item_of
from rigctl.campaign.store.store import Store
from rigctl.certificate import sealed, sections
from rigctl.files.certificate_file import read_details
from rigctl.report.tables.result_table import ResultTable

ROOT = Path(__file__).parents[2]
PONTIUS = ROOT / "examples" / "pontius"
MARKUP = "<b>Lab</b> & <script>alert(1)</script></body>"


class _Elements(HTMLParser):
    """Every element of a page, and the text beside scripts and styles."""

    def __init__(self) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        if self.elements and self.elements[-1][0] not in ("script", "style"):
            self.text += data


def _page(path: Path) -> _Elements:
    page = _Elements()
    page.feed(path.read_text())
    return page


def _content(path: Path) -> Any:
    found = re.search('id="rigctl-certificate">(.*?)</script>', path.read_text(), re.DOTALL)
    assert found is not None
    return json.loads(found[1])


@pytest.fixture
def table(desk: Any) -> Any:
    """A desk with the table of Pontius, imported."""
    assert desk.rigctl("import", PONTIUS, "--store", desk.store).status == 0
    return desk


def test_a_campaign_is_certified_verified_fitted_further_and_marked(desk: Any) -> None:
    desk.campaign(("mountings = 1", "mountings = 2"), ("[model]", "[item]\nserial = 'FM-1'\n\n[model]"))
    desk.rig(("[certificates.cube]", "[certificates.cube]\nnumber = 'C-7'\nexpires = 2001-02-03"))
    axis = desk.run().json["result"]["axes"]["X"]
    out = desk.directory / "x.html"
    issued = desk.rigctl("certificate", desk.store, "--out", out, "--json").json
    content = _content(out)
    quantities = {each["name"]: each for each in content["quantities"]}
    spread = quantities["half-cone deviation X"]
    assert spread["value"] == pytest.approx(axis["std_hc_2sigma_arcsec"], rel=1e-9)
    assert spread["conformity"]["limits"]["upper"] == axis["requirement_arcsec"]
    assert content["item"]["serial"] == "FM-1"
    listed = desk.rigctl("history", desk.directory, "--json").json["items"]
    assert [(each["serial"], each["simulated"]) for each in listed] == [("FM-1", True)]
    for each in listed[0]["quantities"]:
        assert each["values"][0]["value"] == quantities[each["name"]]["value"]
        assert each["values"][0]["standard_uncertainty"] == pytest.approx(
            quantities[each["name"]]["standard_uncertainty"], rel=1e-12
        )
    length = sum(quantities[f"axis X, {component}"]["value"] ** 2 for component in "xyz")
    assert length == pytest.approx(1.0, rel=1e-12)
    parts = [each["standard_uncertainty"][1] ** 2 for each in content["budget"]]
    assert quantities["axis X, y"]["standard_uncertainty"] == pytest.approx(sum(parts) ** 0.5, rel=1e-9)
    text = _page(out).text
    assert issued["number"] in text
    assert "C-7" in text
    assert "cube: its certificate expired on 2001-02-03" in text

    assert desk.rigctl("model", "add", desk.store, "quadratic").status == 0
    assert "; 1 later version of the model; " in desk.rigctl("verify", out, desk.store).out
    verified = desk.rigctl("verify", out, desk.store, "--json").json
    assert (verified["later"], verified["signature"]) == (1, None)
    assert verified["sha256"] == issued["basis_sha256"]

    run = next(iter(content["basis"]["runs"]))
    assert desk.rigctl("mark", desk.store, run, "knocked", "--invalid").status == 0
    desk.rigctl("verify", out, desk.store).refused(1, f"run {run} was marked invalid since (knocked)")


def test_what_a_recording_does_not_state_is_not_certified(desk: Any) -> None:
    desk.campaign(("mountings = 1", "mountings = 2"))
    stated = desk.run().json["result"]
    assert stated["stated"] == {"requirement": True, "host_frame": True}
    bundle, store, out = (desk.directory / name for name in ("bundle", "imported.rig.sqlite", "i.html"))
    assert desk.rigctl("export", desk.store, bundle).status == 0
    # A bundle has no rig file: neither a requirement nor the rotation into the host's frame.
    assert desk.rigctl("import", bundle, "--store", store).status == 0
    assert desk.rigctl("result", store, "--json").json["stated"] == {"requirement": False, "host_frame": False}
    printed = " ".join(desk.rigctl("result", store).out.split())
    assert "nobody has stated a requirement: no verdict" in printed
    assert "Sensing axes in the host's frame" not in printed
    assert desk.rigctl("certificate", store, "--out", out).status == 0
    content, text = _content(out), _page(out).text
    assert not [each["name"] for each in content["quantities"] if each.get("conformity")]
    assert "No requirement was given; no statement of conformity is made." in text
    assert "Components of axes are in the cube's frame" in text


def test_a_table_is_certified_with_the_numbers_of_its_fit(table: Any) -> None:
    assert table.rigctl("model", "add", table.store, "power2[load_lb]").status == 0
    out = table.directory / "t.html"
    assert table.rigctl("certificate", table.store, "--out", out).status == 0
    found = {each["name"]: each for each in _content(out)["quantities"]}
    (noise,) = table.rigctl("fit", table.store, "--json").json["noise"]
    assert noise["dof"] == 31.0
    # Printed by NIST: Pontius.dat, certified values with their standard deviations, here by the noise of one account.
    ratio = noise["sigma"] / 0.205177424076185e-03
    for name, value, sigma in (
        ("b0", 0.673565789473684e-03, 0.107938612033077e-03),
        ("b1", 0.732059160401003e-06, 0.157817399981659e-09),
        ("power2[load_lb]", -0.316081871345029e-14, 0.486652849992036e-16),
    ):
        assert found[name]["value"] == pytest.approx(value, rel=1e-6)
        assert found[name]["standard_uncertainty"] == pytest.approx(ratio * sigma, rel=1e-5)
        assert found[name]["effective_dof"] == pytest.approx(31.0)
        assert found[name]["expanded_uncertainty"] == pytest.approx(2.04 * ratio * sigma, rel=2.5e-3)


def test_readings_that_are_marked_invalid_are_listed_with_what_they_would_change(desk: Any) -> None:
    marked = desk.directory / "marked"
    shutil.copytree(PONTIUS, marked)
    header, *rows = (marked / "readings.csv").read_text().splitlines()
    marks = [f"{header},valid,reason", f"{rows[0]},0,door", *(f"{row},1," for row in rows[1:])]
    (marked / "readings.csv").write_text("\n".join(marks) + "\n")
    said = desk.rigctl("import", marked, "--store", desk.store).out
    assert said == f"40 rows read into {desk.store}, 1 of them invalid\nrow 1 invalid: door\n"
    for command in ("compare", "fit"):
        assert "1 reading is left out, marked invalid: row 1." in desk.rigctl(command, desk.store).out
    assert "1 reading left out, marked invalid" in desk.rigctl("status", desk.store).out
    out = desk.directory / "x.html"
    assert desk.rigctl("certificate", desk.store, "--out", out, "--json").status == 0
    content = _content(out)
    assert content["excluded"]["runs"] == {"row 1": "door"}
    changes = {each["name"]: each for each in content["excluded"]["changes"]}
    slope = next(each for each in content["quantities"] if each["name"] == "b1")
    assert changes["b1"]["without"] == slope["value"] != changes["b1"]["with_them"]
    assert desk.rigctl("verify", out, desk.store).status == 0


def test_uncertainties_that_few_readings_contradict_stay_and_the_certificate_says_so(desk: Any) -> None:
    bundle = desk.directory / "shrunk"
    bundle.mkdir()
    table = 'response = "ind_c"\nbaseline = "b0 + b1 * ref_c"\nsigma = "u_c"\n'
    (bundle / "recording.toml").write_text(f'format = 1\nexperiment = "table"\n\n[table]\n{table}')
    rows = [(0.01, 0), (10.0, 10), (20.02, 20), (29.99, 30), (40.01, 40), (50.0, 50)]
    lines = ["ind_c,ref_c,u_c", *(f"{reading},{at},0.5" for reading, at in rows)]
    (bundle / "readings.csv").write_text("\n".join(lines) + "\n")
    assert desk.rigctl("import", bundle, "--store", desk.store).status == 0
    out = desk.directory / "x.html"
    assert desk.rigctl("certificate", desk.store, "--out", out).status == 0
    content = _content(out)
    (noise,) = content["budget"]
    assert (noise["type"], noise["dof"], noise["origin"]) == ("B", None, "stated uncertainties")
    # Of a line through six even places, b0 in units of one reading's uncertainty.
    assert noise["standard_uncertainty"][0] == pytest.approx(0.5 * (11.0 / 21.0) ** 0.5)
    (warning,) = content["warnings"]
    assert warning.startswith("Stated uncertainties do not fit the scatter")
    text = _page(out).text
    assert warning in text
    assert "0.5 as stated; below 20 degrees of freedom" in text


def test_a_store_tells_its_certificate_the_item_and_learns_it_from_one(desk: Any) -> None:
    bundle = desk.directory / "bundle"
    shutil.copytree(PONTIUS, bundle)
    header = bundle / "recording.toml"
    header.write_text(header.read_text() + "\n[item]\nserial = 'LC-7'\nname = 'load cell'\n")
    assert desk.rigctl("import", bundle, "--store", "named.rig.sqlite").status == 0
    (desk.directory / "d.toml").write_text("[item]\nname = 'cell of steel'\n")
    assert desk.rigctl("certificate", "named.rig.sqlite", "--details", "d.toml", "--out", "t.html").status == 0
    item = _content(desk.directory / "t.html")["item"]
    assert (item["serial"], item["name"]) == ("LC-7", "cell of steel")
    (desk.directory / "d.toml").write_text("[item]\nserial = 'LC-8'\n")
    other = desk.rigctl("certificate", "named.rig.sqlite", "--details", "d.toml", "--out", "u.html")
    other.refused(2, "d.toml: item.serial is LC-8", "named.rig.sqlite is the calibration of LC-7")

    assert desk.rigctl("import", PONTIUS, "--store", desk.store).status == 0
    with Store.open(desk.store, readonly=True) as store:
        assert item_of(store).serial == ""
    assert desk.rigctl("certificate", desk.store, "--details", "d.toml", "--out", "u.html").status == 0
    with Store.open(desk.store, readonly=True) as store:
        assert item_of(store).serial == "LC-8"
    assert desk.rigctl("verify", "u.html", desk.store).status == 0


def test_an_item_is_not_received_after_its_calibration_began(desk: Any) -> None:
    assert desk.rigctl("import", PONTIUS, "--store", desk.store).status == 0
    details = desk.directory / "d.toml"
    details.write_text("began = 2026-03-02\n[item]\nreceived = 2026-03-03\n")
    refused = desk.rigctl("certificate", desk.store, "--details", "d.toml", "--out", "t.html")
    refused.refused(
        2, "d.toml: item.received is 2026-03-03, and the calibration began on 2026-03-02; correct received"
    )
    details.write_text("began = 2026-03-02\n[item]\nreceived = 2026-03-02\n")
    assert desk.rigctl("certificate", desk.store, "--details", "d.toml", "--out", "t.html").status == 0


@pytest.mark.parametrize(
    ("table", "said"),
    [("serial = 7", "item.serial is 7, not a text"), ("colour = 'red'", "item.colour is unknown"), ("x", "line ")],
)
def test_an_item_that_is_none_is_refused_at_import(desk: Any, table: str, said: str) -> None:
    bundle = desk.directory / "bundle"
    shutil.copytree(PONTIUS, bundle)
    header = bundle / "recording.toml"
    header.write_text(header.read_text() + f"\n[item]\n{table}\n")
    desk.rigctl("import", bundle, "--store", desk.store).refused(2, "recording.toml", said)


def test_names_with_markup_are_text(table: Any) -> None:
    (table.directory / "d.toml").write_text(
        f"number = 'N-1'\n[laboratory]\nname = '{MARKUP}'\n[customer]\nname = '{sealed.place()}'\n"
    )
    out = table.directory / "t.html"
    assert table.rigctl("certificate", table.store, "--details", "d.toml", "--out", out).status == 0
    page = _page(out)
    assert MARKUP in page.text
    assert [attributes for tag, attributes in page.elements if tag == "script"] == [
        {"type": "application/json", "id": "rigctl-certificate"}
    ]
    assert "b" not in [tag for tag, _ in page.elements]
    assert table.rigctl("verify", out, table.store).status == 0


def test_a_changed_certificate_is_refused(table: Any) -> None:
    out = table.directory / "t.html"
    assert table.rigctl("certificate", table.store, "--out", out).status == 0
    text = out.read_text()
    out.write_text(text.replace("UNSIGNED", "SIGNED", 1))
    table.rigctl("verify", out, table.store).refused(1, "changed after it was issued")
    out.write_text("<html></html>")
    table.rigctl("verify", out, table.store).refused(2, "no certificate of this program")


def test_another_form_is_refused_before_any_work(table: Any) -> None:
    out = table.directory / "t.docx"
    table.rigctl("certificate", table.store, "--out", out).refused(2, out.name, ".html, .pdf, .xml only")
    assert not out.exists()


def test_a_directory_that_is_not_there_is_refused_before_any_work(table: Any) -> None:
    ended = table.rigctl("certificate", table.store, "--out", "nowhere/t.html")
    said = "nowhere/t.html: cannot be written: there is no directory nowhere; make it first"
    assert (ended.status, ended.err.splitlines()) == (2, [said])


def test_a_store_without_a_result_gives_one_line(table: Any) -> None:
    assert table.rigctl("mark", table.store, "readings", "wrong cell", "--invalid").status == 0
    out = table.directory / "t.html"
    ended = table.rigctl("certificate", table.store, "--out", out)
    assert (ended.status, ended.out) == (2, "")
    assert ended.err.splitlines()[-1].startswith("the readings are declared invalid (wrong cell)")
    assert "Traceback" not in ended.err
    assert not out.exists()


def test_a_requirement_on_what_is_not_there_names_what_is(table: Any) -> None:
    (table.directory / "d.toml").write_text("[[requirements]]\nquantity = 'b7'\nupper = 1.0\n")
    ended = table.rigctl("certificate", table.store, "--details", "d.toml", "--out", "t.html")
    assert ended.status == 2
    assert ended.err.splitlines()[-1] == "d.toml: there is no quantity 'b7' in this result; one of b0, b1"


def test_two_requirements_on_one_quantity_are_refused(table: Any) -> None:
    """One of them would be dropped without a word."""
    asked = "".join(f"[[requirements]]\nquantity = 'b1'\n{side} = 1.0\n" for side in ("upper", "lower"))
    (table.directory / "d.toml").write_text(asked)
    ended = table.rigctl("certificate", table.store, "--details", "d.toml", "--out", "t.html")
    assert ended.status == 2
    assert "two requirements on 'b1'; write its lower and upper in one" in ended.err.splitlines()[-1]


def test_what_was_asked_for_stands_in_full_and_what_is_accepted_holds_what_passed(table: Any) -> None:
    assert table.rigctl("certificate", table.store, "--out", "a.html").status == 0
    b0, b1 = _content(table.directory / "a.html")["quantities"]
    near = b1["value"] + 1.1 * b1["expanded_uncertainty"]
    narrow = [b0["value"] + half * b0["expanded_uncertainty"] for half in (-0.5, 0.5)]
    (table.directory / "d.toml").write_text(
        f"[[requirements]]\nquantity = 'b1'\nupper = {near:.12g}\n"
        f"[[requirements]]\nquantity = 'b0'\nlower = {narrow[0]:.12g}\nupper = {narrow[1]:.12g}\n"
    )
    assert table.rigctl("certificate", table.store, "--details", "d.toml", "--out", "b.html").status == 0
    content = _content(table.directory / "b.html")
    (said,) = [each.blocks[0] for each in sections.sections(content) if each.title == "Conformity"]
    assert isinstance(said, ResultTable)
    empty, passed = said.rows
    assert empty[2:4] == ["no value: U is too large", "UNDECIDED"]
    assert passed[1].startswith(f"≤ {near:.12g}")
    # Five digits of a number with six would end below the value that passed.
    assert passed[3] == "pass"
    assert float(sections.rounded(b1)[0]) <= float(passed[2].split()[1]) <= near


def test_the_documented_file_of_details_is_taken(tmp_path: Path) -> None:
    section = (ROOT / "docs" / "commands.md").read_text().split("### certificate\n")[1]
    (tmp_path / "d.toml").write_text(section.split("```toml\n")[1].split("```")[0])
    details = read_details(tmp_path / "d.toml")
    assert details.decision.largest_risk == 0.025
    assert details.requirements[0].upper == 60.0
