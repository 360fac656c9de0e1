"""`dcc:measurementResults`: method, equipment, conditions, and results with their budget and their conformity."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any
from xml.etree.ElementTree import Element

from rigctl.certificate.dcc.administration import identification
from rigctl.certificate.dcc.elements import content, element, filled, named, some
from rigctl.certificate.dcc.quantities import measured, polar, quantity, real, real_list, with_covariance
from rigctl.certificate.sections import COVERAGE, Content, Section, decision_rule, sections
from rigctl.core.units import unit_of_column
from rigctl.report.tables.result_table import ResultTable

NO_REGION = (
    "The covariance is stated alone: its joint coverage region is not, so that factor and probability are NaN."
)

_WORDS = ("Model in force", "Excluded runs", "What this certificate rests on")
"""Sections of the page that are mostly words; their numbers stand beside them as quantities."""


def measurement_results(said: Content) -> Element:
    """All results as one `dcc:measurementResult`."""
    method = said["method"]
    return element(
        "dcc:measurementResults",
        named(
            "dcc:measurementResult",
            said["title"],
            element("dcc:usedMethods", named("dcc:usedMethod", method, _constants(said["constants"]))),
            some("dcc:measuringEquipments", map(_instrument, said["instruments"])),
            some("dcc:influenceConditions", _conditions(said)),
            element("dcc:results", *_results(said)),
        ),
    )


def _constants(constants: Mapping[str, Any]) -> Element | None:
    return some(
        "dcc:usedMethodQuantities",
        (_stated("dcc:usedMethodQuantity", name, value) for name, value in constants.items()),
    )


def _stated(tag: str, name: str, value: Any, said: str = "") -> Element:
    """A constant or an uncertainty of a file, with the unit that its name says; as words where that is not sure."""
    unit = unit_of_column(name)
    sure = unit == "V/(m/s2)" or "_per_" not in name
    if unit and sure and isinstance(value, (int, float)):
        return named(tag, said or name, real(float(value), unit))
    return named(tag, said or name, content("dcc:noQuantity", f"{name} = {value}"))


def _instrument(each: Mapping[str, Any]) -> Element:
    numbers = (
        identification("manufacturer", each["serial"], "serial number") if each["serial"] else None,
        identification("other", each["certificate"], "number of its certificate") if each["certificate"] else None,
    )
    certified = {
        "certificate of": each["laboratory"],
        "calibrated": each["calibrated"],
        "expires": each["expires"],
        "serial number in its certificate": each["certified_serial"],
    }
    about = [f"role: {each['role']}"] if each["role"] else []
    about += [f"{name}: {value}" for name, value in certified.items() if value]
    about += ["no certificate in the rig file"] if each["uncertainty"] is None else []
    about += [f"WARNING: {warning}" for warning in each["warnings"]]
    uncertainties = (each["uncertainty"] or {}).items()
    return named(
        "dcc:measuringEquipment",
        each["name"],
        content("dcc:description", *about),
        filled("dcc:model", " ".join(filter(None, [each["model"], each["firmware"]]))),
        some("dcc:identifications", numbers),
        some(
            "dcc:measuringEquipmentQuantities",
            (
                _stated("dcc:measuringEquipmentQuantity", name, value, f"standard uncertainty u({name})")
                for name, value in uncertainties
            ),
        ),
    )


def _conditions(said: Content) -> Iterator[Element]:
    for name, words in said["conditions"].items():
        recorded, unit = said["recorded"].get(name), unit_of_column(name)
        text = content("dcc:text", words)
        if recorded is None or not unit:
            yield named("dcc:influenceCondition", name, element("dcc:data", text))
            continue
        ends = (
            quantity(f"{name}, {which}", real(value, unit))
            for which, value in zip(("smallest", "largest"), recorded, strict=True)
        )
        yield named("dcc:influenceCondition", name, element("dcc:data", *ends))


def _results(said: Content) -> Iterator[Element]:
    quantities = said["quantities"]
    yield _result("Results", (_quantity(place, each) for place, each in enumerate(quantities)), COVERAGE)
    if pairs := _complex_pairs(quantities):
        yield _result("Complex quantities", (_complex(said, place) for place in pairs), NO_REGION)
    together = with_covariance(quantities, said["covariance"])
    yield _result("Covariance of the results", [quantity("all results", together)], NO_REGION)
    yield _result("Effective degrees of freedom", [_degrees_of_freedom(quantities)])
    yield _result("Uncertainty budget", (_source(each, quantities) for each in said["budget"]))
    if changes := said["excluded"]["changes"]:
        yield _result("Results with the excluded runs", map(_change, changes))
    for section in sections(said):
        if section.title in _WORDS:
            yield _result(section.title, [content("dcc:text", *_lines(section))])


def _result(name: str, data: Any, *about: str) -> Element:
    return named("dcc:result", name, content("dcc:description", *about), some("dcc:data", data))


def _quantity(place: int, each: Mapping[str, Any]) -> Element:
    decided = each["conformity"]
    meta = element("dcc:measurementMetaData", _conformity(each)) if decided else None
    return quantity(each["name"], measured(each), meta, id=f"quantity{place + 1}", refType="basic_measuredValue")


CONFORMITY = {
    ("pass", True): "pass",
    ("fail", False): "fail",
    # Simple acceptance decides by the value alone; a guard band may fail what lies within, and pass nothing outside.
    ("fail", True): "fail",
    ("pass", False): "pass",
    ("undecided", True): "conditionalPass",
    ("undecided", False): "conditionalFail",
}
"""What DCC calls a verdict, by whether the measured value is within the requirement (ILAC-G8:09/2019, 4.2.3)."""


def _conformity(each: Mapping[str, Any]) -> Element:
    decided, unit = each["conformity"], each["unit"]
    limits, acceptance = decided["limits"], decided["acceptance"]
    within = (limits["lower"] is None or each["value"] >= limits["lower"]) and (
        limits["upper"] is None or each["value"] <= limits["upper"]
    )
    numbers = [
        ("lower limit of the requirement", limits["lower"], unit, "basic_toleranceLimitLower"),
        ("upper limit of the requirement", limits["upper"], unit, "basic_toleranceLimitUpper"),
        ("lower limit of acceptance", acceptance["lower"], unit, "basic_acceptanceLimitLower"),
        ("upper limit of acceptance", acceptance["upper"], unit, "basic_acceptanceLimitUpper"),
        ("probability of conformance", decided["probability"], "1", "rigctl_probability"),
        ("probability of false acceptance", decided["false_accept"], "1", "rigctl_probability"),
        ("probability of false rejection", decided["false_reject"], "1", "rigctl_probability"),
        ("largest accepted risk", decided["largest_risk"], "1", "rigctl_probability"),
    ]
    stated = (
        quantity(name, real(value, unit), refType=kind) for name, value, unit, kind in numbers if value is not None
    )
    return named(
        "dcc:metaData",
        "statement of conformity",
        filled("dcc:norm", "JCGM 106:2012"),
        filled("dcc:reference", limits["source"]),
        content("dcc:declaration", f"Verdict: {decided['verdict']}.", decision_rule(decided)),
        filled("dcc:conformity", CONFORMITY[decided["verdict"], within]),
        element("dcc:data", *stated),
        refType="basic_conformity",
    )


def _complex_pairs(quantities: Sequence[Mapping[str, Any]]) -> list[int]:
    """Where a magnitude stands that its phase follows."""
    names = [each["complex"] for each in quantities]
    return [place for place, name in enumerate(names[:-1]) if name and name == names[place + 1]]


def _complex(said: Content, place: int) -> Element:
    both = slice(place, place + 2)
    magnitude, phase = said["quantities"][both]
    covariance = [row[both] for row in said["covariance"][both]]
    return quantity(magnitude["complex"], polar(magnitude, phase, covariance))


def _degrees_of_freedom(quantities: Sequence[Mapping[str, Any]]) -> Element:
    said = ("infinite" if each["effective_dof"] is None else repr(each["effective_dof"]) for each in quantities)
    value = filled("dcc:charsXMLList", " ".join(said))
    assert value is not None
    return quantity("degrees of freedom of each result, in their order", value)


def _source(source: Mapping[str, Any], quantities: Sequence[Mapping[str, Any]]) -> Element:
    dof = "infinitely many" if source["dof"] is None else repr(source["dof"])
    about = {
        "type": source["type"],
        "standard uncertainty of the input": source["input"],
        "degrees of freedom": dof,
        "from": source["origin"],
    }
    parts = real_list(
        [each["name"] for each in quantities], source["standard_uncertainty"], [each["unit"] for each in quantities]
    )
    return quantity(source["name"], parts, about=[f"{name}: {value}" for name, value in about.items() if value])


def _change(change: Mapping[str, Any]) -> Element:
    return quantity(change["name"], real(change["with_them"], change["unit"]))


def _lines(section: Section) -> Iterator[str]:
    for block in section.blocks:
        if isinstance(block, ResultTable):
            yield from (": ".join(filter(None, row)) for row in block.rows)
        elif isinstance(block, str):
            yield block
        else:
            yield from block
