"""`dcc:administrativeData`: who calibrated what for whom, when, and what is stated of the certificate as a whole."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from typing import Any
from xml.etree.ElementTree import Element

from rigctl.certificate.dcc.elements import LANGUAGE, content, element, filled, named, some
from rigctl.certificate.dcc.units import dsi_unit, in_dsi
from rigctl.certificate.sections import NOT_STATED, UNSIGNED, Content, decision_rules, remarks_of

SCHEMA_VERSION, DSI_VERSION = "3.3.0", "2.2.1"

NO_COUNTRY = "ZZ"
"""The schema asks for a country; this is one that ISO 3166 leaves to users, for none."""

NO_DATE = "0001-01-01"
"""The schema asks for the days of calibration; a recording from elsewhere may say none."""

STRUCTURE = (
    f"Structure: PTB's DCC {SCHEMA_VERSION} with D-SI {DSI_VERSION}. Certificates like this one are validated in the "
    "program's tests against copies of these schemas that were passed on by another project, not fetched from PTB; "
    "this file was not validated when it was written, and neither PTB's schematron rules nor its good-practice "
    "catalogue of refTypes were applied."
)


def administrative_data(said: Content) -> Element:
    """All of it."""
    software, laboratory = said["software"], said["laboratory"]
    release = element(
        "dcc:software",
        content("dcc:name", software["name"]),
        filled("dcc:release", software["version"]),
        filled("dcc:type", "application"),
    )
    return element(
        "dcc:administrativeData",
        element("dcc:dccSoftware", release),
        _core_data(said),
        element("dcc:items", _item(said["item"])),
        element(
            "dcc:calibrationLaboratory",
            filled("dcc:calibrationLaboratoryCode", laboratory["accreditation"]),
            _party("dcc:contact", laboratory),
        ),
        element("dcc:respPersons", *_persons(said)),
        _party("dcc:customer", said["customer"]),
        element("dcc:statements", *_statements(said)),
    )


def _core_data(said: Content) -> Element:
    dates = said["dates"]
    return element(
        "dcc:coreData",
        filled("dcc:countryCodeISO3166_1", said["laboratory"]["country"] or NO_COUNTRY),
        filled("dcc:usedLangCodeISO639_1", LANGUAGE),
        filled("dcc:mandatoryLangCodeISO639_1", LANGUAGE),
        filled("dcc:uniqueIdentifier", said["number"]),
        filled("dcc:receiptDate", dates["received"] or ""),
        filled("dcc:beginPerformanceDate", dates["began"] or NO_DATE),
        filled("dcc:endPerformanceDate", dates["ended"] or dates["began"] or NO_DATE),
        filled("dcc:performanceLocation", "other"),
        filled("dcc:issueDate", said["issued"][:10]),
    )


def _item(item: Mapping[str, Any]) -> Element:
    return named(
        "dcc:item",
        item["name"] or NOT_STATED,
        content("dcc:description", item["condition"]),
        named("dcc:manufacturer", item["manufacturer"]) if item["manufacturer"] else None,
        filled("dcc:model", item["model"]),
        element("dcc:identifications", identification("manufacturer", item["serial"] or NOT_STATED, "serial number")),
    )


def identification(issuer: str, value: str, name: str) -> Element:
    """A number of something, and whose number that is."""
    return element(
        "dcc:identification", filled("dcc:issuer", issuer), filled("dcc:value", value), content("dcc:name", name)
    )


def _party(tag: str, party: Mapping[str, Any]) -> Element:
    location = some(
        "dcc:location",
        [
            filled("dcc:city", party["city"]),
            filled("dcc:countryCode", party["country"] or ""),
            content("dcc:further", party["address"]),
        ],
    )
    nowhere = element("dcc:location", content("dcc:further", NOT_STATED))
    # An element without children is false.
    place = nowhere if location is None else location
    return named(tag, party["name"] or NOT_STATED, filled("dcc:eMail", party["email"]), place)


def _persons(said: Content) -> Iterator[Element]:
    for number, each in enumerate(said["persons"] or [{"name": NOT_STATED, "role": ""}]):
        yield element(
            "dcc:respPerson",
            named("dcc:person", each["name"]),
            filled("dcc:role", each["role"]),
            filled("dcc:mainSigner", "false" if number else "true"),
        )


def _statements(said: Content) -> Iterator[Element]:
    yield _statement("signature", UNSIGNED)
    for warning in said["warnings"]:
        yield _statement("warning", warning)
    yield _statement("place of the calibration", said["place"] or NOT_STATED)
    if not said["dates"]["began"]:
        yield _statement("dates", f"The recording does not say when; {NO_DATE} stands for a day that is not stated.")
    if not said["laboratory"]["country"]:
        yield _statement("country", f"{NO_COUNTRY} stands for a country that is not stated.")
    for rule in decision_rules(said):
        yield _statement("decision rule", rule, norm="JCGM 106:2012")
    for paragraph in itertools.chain.from_iterable(remarks_of(said)):
        yield _statement("remark", paragraph)
    units = {each["unit"]: dsi_unit(each["unit"]) for each in said["quantities"]}
    for unit, written in units.items():
        if not in_dsi(written):
            yield _other_unit(unit, written)
    yield _statement("structure", STRUCTURE)


def _statement(name: str, declaration: str, norm: str = "") -> Element:
    return named("dcc:statement", name, filled("dcc:norm", norm), content("dcc:declaration", declaration))


def _other_unit(unit: str, written: str) -> Element:
    definition = f"as the laboratory writes it: {unit}" if unit else "no unit was stated"
    return named(
        "dcc:statement",
        "unit without a form in D-SI",
        filled("dcc:nonSIDefinition", definition),
        filled("dcc:nonSIUnit", written),
    )
