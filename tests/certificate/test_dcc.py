"""Certificates as DCC: valid by the schemas, their numbers in D-SI, and verified like the page."""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from lxml import etree
from typer.testing import CliRunner

from rigctl.certificate.dcc.document import dcc
from rigctl.certificate.dcc.units import dsi_unit
from rigctl.certificate.verify import NotVerified, verify
from rigctl.cli.application import app
from rigctl.core.errors import ConfigError, DataError
from rigctl.files.certificate_file import read_details

PONTIUS = Path(__file__).parents[2] / "examples" / "pontius"
SCHEMA = Path(__file__).parent / "schemas" / "v3.3.0" / "dcc.xsd"
NAMES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
AWKWARD = "<b>Lab</b> & ]]> --> \\ufffe </dcc:document> ΔΩ"

DETAILS = f"""\
number = " 2026-017 "
place = "{AWKWARD}"
traceability = "Forces by dead weights."
method = "  "
began = 2026-03-01
ended = 2026-03-02
remarks = ["first", "{AWKWARD}"]

[laboratory]
name = "{AWKWARD}"
country = "IT"
city = "Rome"
accreditation = "L-1"

[customer]
name = "Customer"
address = "Street 1"
email = "a@b.it"

[item]
name = "load cell"
manufacturer = "Maker"
model = " two  words "
serial = "{AWKWARD}"
condition = "as received"
received = 2026-02-28

[[persons]]
name = "Name"
role = "head"

[[persons]]
name = "Other"

[conditions]
air = "19.8 to 20.4 degC"

[[requirements]]
quantity = "b1"
upper = 7.3212e-7
source = "data sheet"

[[requirements]]
quantity = "b0"
lower = 0.0
upper = 0.001

[[requirements]]
quantity = "power2[load_lb]"
lower = 0.0
"""


@pytest.fixture(scope="module")
def schema() -> etree.XMLSchema:
    return etree.XMLSchema(etree.parse(SCHEMA))


@dataclass(frozen=True)
class Desk:
    """A directory with the store of Pontius' table, and commands."""

    directory: Path

    @property
    def store(self) -> Path:
        return self.directory / "t.rig.sqlite"

    def rigctl(self, *words: object) -> Any:
        return CliRunner().invoke(app, [str(word) for word in words])

    def issue(self, name: str, details: str = "") -> Path:
        """A certificate as XML."""
        out, given = self.directory / f"{name}.xml", self.directory / f"{name}.toml"
        given.write_text(details)
        ended = self.rigctl("certificate", self.store, "--out", out, "--details", given)
        assert ended.exit_code == 0, ended.output
        return out


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Desk:
    """The table of Pontius, imported and with its square; two certificates of it."""
    desk = Desk(tmp_path_factory.mktemp("dcc"))
    assert desk.rigctl("import", PONTIUS, "--store", desk.store).exit_code == 0
    assert desk.rigctl("model", "add", desk.store, "power2[load_lb]").exit_code == 0
    desk.issue("bare")
    desk.issue("stated", DETAILS)
    return desk


@pytest.fixture
def bare(table: Desk) -> Any:
    """The certificate of which nobody has stated anything."""
    return etree.parse(table.directory / "bare.xml").getroot()


@pytest.fixture
def stated(table: Desk) -> Any:
    """The certificate with all details."""
    return etree.parse(table.directory / "stated.xml").getroot()


@pytest.fixture
def content(bare: Any) -> Any:
    """What the first one carries."""
    return data(bare)


def at(node: Any, path: str) -> list[Any]:
    return list(node.xpath(path, namespaces=NAMES))


def data(root: Any) -> Any:
    """What the certificate carries, read by its own means."""
    (encoded,) = at(root, "dcc:document/dcc:dataBase64/text()")
    return json.loads(base64.b64decode(encoded))


def quantity(root: Any, result: str, name: str) -> Any:
    found = f"//dcc:result[dcc:name/dcc:content='{result}']/dcc:data/dcc:quantity[dcc:name/dcc:content='{name}']"
    (node,) = at(root, found)
    return node


def test_what_nobody_stated_is_said_so_in_a_valid_document(bare: Any, schema: Any) -> None:
    root = bare
    schema.assertValid(root)
    (begun,) = at(root, "//dcc:beginPerformanceDate/text()")
    said = " ".join(at(root, "//dcc:statement//dcc:content/text()"))
    assert begun == "0001-01-01"
    assert "0001-01-01 stands for a day that is not stated" in said
    assert "UNSIGNED" in said
    assert "not fetched from PTB" in said
    assert at(root, "//dcc:nonSIUnit/text()") == ["|not_stated", "|in/lb2"]


def test_everything_that_is_stated_stands_in_a_valid_document(stated: Any, schema: Any) -> None:
    root = stated
    schema.assertValid(root)
    shown = AWKWARD.replace("\\ufffe", "\ufffd")
    for path, value in {
        "//dcc:uniqueIdentifier": "2026-017",
        "//dcc:receiptDate": "2026-02-28",
        "//dcc:beginPerformanceDate": "2026-03-01",
        "//dcc:endPerformanceDate": "2026-03-02",
        "//dcc:calibrationLaboratory/dcc:contact/dcc:name/dcc:content": shown,
        "//dcc:calibrationLaboratory//dcc:countryCode": "IT",
        "//dcc:customer/dcc:location/dcc:further/dcc:content": "Street 1",
        "//dcc:item/dcc:model": "two words",
        "//dcc:item//dcc:identification/dcc:value": shown,
        "//dcc:influenceCondition[dcc:name/dcc:content='air']//dcc:text/dcc:content": "19.8 to 20.4 degC",
    }.items():
        assert at(root, f"{path}/text()") == [value]
    assert at(root, "//dcc:mainSigner/text()") == ["true", "false"]


def test_conformity_is_stated_with_limits_and_probabilities(stated: Any) -> None:
    root = stated
    verdicts = {"b1": "conditionalPass", "b0": "pass", "power2[load_lb]": "fail"}
    for each in data(root)["quantities"]:
        node, decided = quantity(root, "Results", each["name"]), each["conformity"]
        meta = "dcc:measurementMetaData/dcc:metaData"
        assert at(node, f"{meta}/dcc:conformity/text()") == [verdicts[each["name"]]]
        values = {
            kind: float(at(node, f"{meta}/dcc:data/dcc:quantity[@refType='{kind}']/si:real/si:value/text()")[0])
            for kind in at(node, f"{meta}/dcc:data/dcc:quantity/@refType")
            if kind.startswith("basic")
        }
        expected = {
            f"basic_{of}Limit{end.title()}": decided[key][end]
            for of, key in (("tolerance", "limits"), ("acceptance", "acceptance"))
            for end in ("lower", "upper")
            if decided[key][end] is not None
        }
        assert values == expected


def test_results_and_covariance_are_to_the_last_digit_those_of_the_content(bare: Any, content: Any) -> None:
    root = bare
    for each in content["quantities"]:
        real = quantity(root, "Results", each["name"]).find("si:real", NAMES)
        stated = [float(text) for text in at(real, ".//si:value/text() | .//si:expandedMU/*[number(.) = .]/text()")]
        assert stated == [each["value"], each["expanded_uncertainty"], each["coverage_factor"], 0.95]
        assert at(real, "si:unit/text()") == [dsi_unit(each["unit"])]
    together = quantity(root, "Covariance of the results", "all results")
    columns = at(together, ".//si:columnXMLList")
    matrix = [[float(text) for text in at(column, ".//si:valueXMLList/text()")] for column in columns]
    assert matrix == content["covariance"]
    assert at(columns[2], ".//si:unitXMLList/text()")[2] == "|(in/lb2)*(in/lb2)"


def test_a_magnitude_with_its_phase_is_a_complex_quantity(content: Any, schema: Any) -> None:
    magnitude, phase, _ = content["quantities"]
    magnitude |= {"complex": "sensitivity", "unit": "V s2/m"}
    phase |= {"complex": "sensitivity", "unit": "deg"}
    root = etree.fromstring(dcc(content))
    schema.assertValid(root)
    found = quantity(root, "Complex quantities", "sensitivity").find("si:complex", NAMES)
    assert [at(found, f"si:{tag}/text()") for tag in ("valueMagnitude", "valuePhase", "unit", "unitPhase")] == [
        [repr(magnitude["value"])],
        [repr(phase["value"])],
        [r"\volt\second\tothe{2}\metre\tothe{-1}"],
        [r"\degree"],
    ]
    covariances = [float(text) for text in at(found, ".//si:covariance/si:value/text()")]
    assert covariances == [content["covariance"][row][column] for column in (0, 1) for row in (0, 1)]


def test_a_spread_has_an_interval_and_what_is_known_well_is_normal(content: Any, schema: Any) -> None:
    spread, normal, _ = content["quantities"]
    spread |= {"kind": "spread", "coverage_factor": None, "expanded_uncertainty": None}
    normal["effective_dof"] = None
    root = etree.fromstring(dcc(content))
    schema.assertValid(root)
    interval = at(quantity(root, "Results", spread["name"]), ".//si:coverageIntervalMU")[0]
    ends = [float(at(interval, f"si:interval{end}/text()")[0]) for end in ("Min", "Max")]
    assert ends == spread["coverage_interval"]
    assert at(quantity(root, "Results", normal["name"]), ".//si:distribution/text()") == ["normal"]
    degrees = at(root, "//dcc:result//dcc:charsXMLList/text()")[0].split()
    assert (degrees[1], float(degrees[2])) == ("infinite", content["quantities"][2]["effective_dof"])


def test_excluded_runs_and_recorded_conditions_are_quantities(content: Any, schema: Any) -> None:
    change = {"name": "b0", "unit": "", "without": 1.0, "with_them": 1.5, "expanded_uncertainty": 0.2}
    content["excluded"] = {"runs": {"r1": "knocked"}, "changes": [change], "not_worked_out": ""}
    content["conditions"], content["recorded"] = {"temperature_c": "20 to 21"}, {"temperature_c": [20.0, 21.0]}
    content["constants"] = {"g_m_s2": 9.8, "ratio_v_per_v": 2.0}
    root = etree.fromstring(dcc(content))
    schema.assertValid(root)
    assert at(quantity(root, "Results with the excluded runs", "b0"), "si:real/si:value/text()") == ["1.5"]
    condition = at(root, "//dcc:influenceCondition")[0]
    assert at(condition, ".//si:value/text()") == ["20.0", "21.0"]
    assert set(at(condition, ".//si:unit/text()")) == {r"\degreecelsius"}
    # A name that says a unit only by half has none: V/V is no volt.
    assert at(root, "//dcc:usedMethodQuantity//si:unit/text()") == [r"\metre\second\tothe{-2}"]
    assert at(root, "//dcc:usedMethodQuantity/dcc:noQuantity/dcc:content/text()") == ["ratio_v_per_v = 2.0"]


def test_a_document_is_verified_as_a_page_is(table: Desk, bare: Any, tmp_path: Path) -> None:
    text, out = (table.directory / "bare.xml").read_text(), tmp_path / "t.xml"
    out.write_text(text)
    assert verify(out, table.store).number == at(bare, "//dcc:uniqueIdentifier/text()")[0]
    out.write_text(text.replace("UNSIGNED", "SIGNED", 1))
    with pytest.raises(NotVerified, match="changed after it was issued"):
        verify(out, table.store)
    out.write_text(text.replace("dataBase64", "data"))
    with pytest.raises(DataError, match="no certificate of this program"):
        verify(out, table.store)


def test_days_that_go_backwards_are_refused(tmp_path: Path) -> None:
    (tmp_path / "d.toml").write_text("began = 2026-03-02\nended = 2026-03-01\n")
    with pytest.raises(ConfigError, match="ended has to be on the day it began, or later"):
        read_details(tmp_path / "d.toml")


@pytest.mark.parametrize("key", ["number", "remarks", "item.serial", "conditions.air"])
def test_control_characters_are_refused_and_lines_joined(tmp_path: Path, key: str) -> None:
    path, remarks = tmp_path / "d.toml", key == "remarks"
    path.write_text(f'{key} = {"[" * remarks}"RC\\u001b[2J-7"{"]" * remarks}\n')
    with pytest.raises(ConfigError, match=rf"d\.toml: {key}.* has the control character U\+001B; take it out"):
        read_details(path)
    path.write_text('laboratory.address = """\n1 Main Street\n\tFirst floor\n"""\n')
    assert read_details(path).laboratory.address == "1 Main Street First floor"


@pytest.mark.parametrize(
    ("unit", "written"),
    [
        ("m/s2", r"\metre\second\tothe{-2}"),
        ("V/(m/s2)", r"\volt\metre\tothe{-1}\second\tothe{2}"),
        ("arcsec", r"\arcsecond"),
        ("deg", r"\degree"),
        ("1/K", r"\kelvin\tothe{-1}"),
        ("mV", r"\milli\volt"),
        ("m", r"\metre"),
        ("min", r"\minute"),
        ("kg", r"\kilogram"),
        ("degC", r"\degreecelsius"),
        ("%", r"\percent"),
        ("1", r"\one"),
        ("s/s", r"\one"),
        ("", "|not_stated"),
        # Gravity or gram: the text does not say.
        ("V/g", "|V/g"),
        ("ug", "|ug"),
        ("in lb", "|in*lb"),
        ("ein Fuß", "|ein*Fuß"),
    ],
)
def test_units_are_those_of_d_si_or_marked_as_others(unit: str, written: str) -> None:
    assert dsi_unit(unit) == written


def test_the_unit_of_a_covariance_is_a_product() -> None:
    assert dsi_unit("arcsec", "arcsec") == r"\arcsecond\tothe{2}"
    assert dsi_unit("s2/m", "m") == r"\second\tothe{2}"
    assert dsi_unit("1", "V") == r"\volt"
    assert dsi_unit("%", "m") == "|(%)*(m)"
    assert dsi_unit("", "m") == "|not_stated"


def test_the_schema_refuses_what_it_does_not_allow(content: Any, schema: Any) -> None:
    content["laboratory"]["country"] = "Italy"
    assert not schema.validate(etree.fromstring(dcc(content)))
