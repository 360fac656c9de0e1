"""A certificate as sections of text and tables: the same on a page of HTML and on paper.

Everything is made from the certificate's JSON: what stands on a page can be made again from what it carries.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal
from typing import Any

from rigctl.report.quantities import counted, number, probability, share, with_unit
from rigctl.report.tables.result_table import ResultTable

Content = Mapping[str, Any]
NOT_STATED = "not stated"
UNSIGNED = (
    "UNSIGNED, and not valid, unless a signature file FILE.sig accompanies this FILE (`rigctl verify` checks it) or "
    "it is signed by hand."
)
COVERAGE = (
    "U is the expanded uncertainty for a coverage probability of about 95 %: the standard uncertainty times the "
    "coverage factor k of the t distribution with the effective degrees of freedom (JCGM 100, G.4). An interval "
    "in brackets is probabilistically symmetric for 95 %."
)
RELATES = (
    "The results relate to the calibrated item alone, in the state and under the conditions stated. This "
    "certificate may be reproduced in full only, unless the laboratory agrees in writing."
)
ACROSS = 4
"""Columns of numbers that a page of paper has room for beside the names."""

DIGITS = 2
"""Significant digits of an uncertainty (GUM, 7.2.6)."""

_ROUNDING = 1e-12
"""Parts of a combined uncertainty that are what rounding leaves of none."""

_INFINITE = 1e6
"""Degrees of freedom that make no difference to infinitely many."""


@dataclass(frozen=True)
class Section:
    """A heading with what stands below it: paragraphs as text, tables, and lists of texts."""

    title: str
    blocks: Sequence[str | ResultTable | Sequence[str]]


def sections(content: Content) -> list[Section]:
    """All of a certificate but its title and its warnings."""
    found = [
        Section("Identification", [_identification(content)]),
        Section("Results", list(_results(content))),
        Section("Conformity", list(_conformity(content))),
        Section("Uncertainty budget", list(_budget(content))),
        Section("Conditions and equipment", list(_equipment(content))),
        Section("Model in force", list(_model(content))),
        Section("Excluded runs", list(_excluded(content))),
        Section("Traceability and remarks", list(_remarks(content))),
        Section("What this certificate rests on", list(_basis(content))),
    ]
    return [each for each in found if any(each.blocks)]


def heading(content: Content) -> str:
    """What stands above everything."""
    return f"Calibration certificate {content['number']}"


def signature_lines(content: Content) -> list[str]:
    """Who may sign it, a line each; one line where nobody is named."""
    persons = [", ".join(filter(None, [each["name"], each["role"]])) for each in content["persons"]]
    return [f"{person}: place, date, signature" for person in persons or ["Authorised by"]]


def _identification(content: Content) -> ResultTable:
    item, dates = content["item"], content["dates"]
    made_by = " ".join(filter(None, [item["manufacturer"], item["model"]]))
    rows = {
        "issued": content["issued"],
        "laboratory": _party(content["laboratory"]),
        "customer": _party(content["customer"]),
        "calibration": content["title"],
        "item": ", ".join(filter(None, [item["name"], made_by])) or NOT_STATED,
        "serial number": item["serial"] or NOT_STATED,
        "condition of the item": item["condition"],
        "received": dates["received"] or "",
        "calibrated": _days(dates),
        "place": content["place"] or NOT_STATED,
        "method": content["method"],
    }
    return ResultTable("", ["", "value"], [[name, said] for name, said in rows.items() if said])


def _party(party: Mapping[str, Any]) -> str:
    keys = ("name", "address", "city", "country", "email", "accreditation")
    return ", ".join(str(party[key]) for key in keys if party.get(key)) or NOT_STATED


def _days(dates: Mapping[str, Any]) -> str:
    began, ended = dates["began"], dates["ended"]
    if not began:
        return "the recording does not say when"
    return began if began == ended else f"{began} to {ended}"


def _results(content: Content) -> Iterator[str | ResultTable]:
    rows = [
        [
            each["name"],
            *rounded(each),
            _factor(each["coverage_factor"]),
            _dof(each["effective_dof"]),
            _unit(each["unit"]),
        ]
        for each in content["quantities"]
    ]
    columns = ["quantity", "#value", "#U or interval", "#k", "#degrees of freedom", "unit"]
    yield ResultTable("Results", columns, rows)
    yield COVERAGE


def rounded(quantity: Mapping[str, Any]) -> tuple[str, str]:
    """Value and expanded uncertainty, or interval, to two digits of the uncertainty, without the unit."""
    value, half = quantity["value"], _half_width(quantity)
    if not half:
        return number(value, 9), "0"
    places = _places(half)
    if quantity["expanded_uncertainty"] is None:
        low, high = quantity["coverage_interval"]
        return fixed(value, places), f"[{fixed(low, places)}, {fixed(high, places)}]"
    return fixed(value, places), fixed(half, places)


def _half_width(quantity: Content) -> float:
    """Expanded uncertainty, of a spread half its interval."""
    low, high = quantity["coverage_interval"]
    expanded = quantity["expanded_uncertainty"]
    return float(0.5 * (high - low) if expanded is None else expanded)


def _places(uncertainty: float) -> int:
    """Decimal places that show two digits of an uncertainty; negative before the decimal point."""
    return DIGITS - 1 - math.floor(math.log10(uncertainty))


def fixed(value: float, places: int) -> str:
    """A number rounded to decimal places, as a power of ten where it would be longer."""
    if places <= 9 and abs(value) < 1e7:
        return f"{round(value, places):.{max(places, 0)}f}"
    exponent = math.floor(math.log10(abs(value))) if value else -places
    digits = max(exponent + places, 0)
    return f"{value:.{digits}e}"


def _conformity(content: Content) -> Iterator[str | ResultTable]:
    decided = [each for each in content["quantities"] if each["conformity"]]
    if not decided:
        yield "No requirement was given; no statement of conformity is made."
        return
    rows = []
    for each in decided:
        said = each["conformity"]
        risk = said["false_accept"] if said["verdict"] == "pass" else said["false_reject"]
        rows.append(
            [
                each["name"],
                with_unit(_between(said["limits"], _in_full), each["unit"]),
                _accepted(each),
                said["verdict"].upper() if said["verdict"] != "pass" else "pass",
                number(said["probability"], 4),
                probability(risk) if risk is not None else "-",
            ]
        )
    columns = ["quantity", "#requirement", "#accepted", "verdict", "#P(conforms)", "#P(wrong)"]
    yield ResultTable("Conformity", columns, rows, [each["conformity"]["verdict"] != "pass" for each in decided])
    yield from decision_rules(content)
    sources = dict.fromkeys(filter(None, (each["conformity"]["limits"]["source"] for each in decided)))
    if sources:
        yield f"Requirements: {'; '.join(sources)}."


def decision_rules(content: Content) -> list[str]:
    """The rules by which it was decided, in words; one rule in all certificates of this program."""
    decided = (each["conformity"] for each in content["quantities"] if each["conformity"])
    return list(dict.fromkeys(map(decision_rule, decided)))


def decision_rule(decided: Mapping[str, Any]) -> str:
    """The rule of one decision in words."""
    if decided["rule"] == "guard band":
        return (
            f"Decision rule (JCGM 106): guard band. It passes where it fails to conform with a probability of "
            f"{share(decided['largest_risk'])} at most, fails where it conforms with no more than that, and is "
            "undecided between. Probabilities are those of the quantity's state of knowledge: t with the effective "
            "degrees of freedom, chi-square for a spread. P(wrong) is the probability of false acceptance of what "
            "passed, or of false rejection of what failed."
        )
    return (
        "Decision rule (JCGM 106, 8.2): simple acceptance, the measured value within the requirement, "
        "whatever its uncertainty. P(wrong) is the probability of false acceptance, or of false rejection."
    )


def _between(limits: Mapping[str, Any], shown: Callable[[float, str], str]) -> str:
    low, high = limits["lower"], limits["upper"]
    if low is None:
        return f"≤ {shown(high, ROUND_FLOOR)}"
    if high is None:
        return f"≥ {shown(low, ROUND_CEILING)}"
    return f"{shown(low, ROUND_CEILING)} to {shown(high, ROUND_FLOOR)}"


def _in_full(limit: float, _: str) -> str:
    """What was asked for, to its last digit."""
    return f"{limit:.15g}"


def _accepted(quantity: Content) -> str:
    """Between which values it passes, to one digit more than the value, rounded into that interval."""
    decided, half = quantity["conformity"], _half_width(quantity)
    accepted = decided["acceptance"]
    if accepted == decided["limits"] or not half:
        return with_unit(_between(accepted, _in_full), quantity["unit"])
    if None not in (accepted["lower"], accepted["upper"]) and accepted["lower"] > accepted["upper"]:
        return "no value: U is too large"
    places = _places(half) + 1

    def inwards(limit: float, rounding: str) -> str:
        return fixed(float(Decimal(limit).quantize(Decimal(1).scaleb(-places), rounding)), places)

    return with_unit(_between(accepted, inwards), quantity["unit"])


def _budget(content: Content) -> Iterator[str | ResultTable]:
    quantities, sources = content["quantities"], content["budget"]
    places = range(len(quantities))
    groups = itertools.groupby(places, key=lambda place: (quantities[place]["group"], quantities[place]["kind"]))
    for _, members in groups:
        for some in _batched(members, ACROSS):
            yield _budget_table(quantities, sources, some)
    yield "Standard uncertainties in the unit of the quantity; type A from statistics, B from what is stated."


def _batched(members: Iterator[int], count: int) -> Iterator[tuple[int, ...]]:
    while some := tuple(itertools.islice(members, count)):
        yield some


def _budget_table(quantities: Sequence[Content], sources: Sequence[Content], places: Sequence[int]) -> ResultTable:
    rows = []
    combined = [quantities[place]["standard_uncertainty"] for place in places]
    for source in sources:
        parts = [source["standard_uncertainty"][place] for place in places]
        shown = [_part(part, whole) for part, whole in zip(parts, combined, strict=True)]
        if any(part != "0" for part in shown):
            rows.append(
                [
                    source["name"],
                    source["type"],
                    source["input"],
                    _dof(source["dof"]),
                    source["origin"],
                    *shown,
                ]
            )
    rows.append(["combined", "", "", "", "", *(_part(whole, whole) for whole in combined)])
    heads = [f"#{quantities[place]['name']} / {_unit(quantities[place]['unit'])}" for place in places]
    marked = [False] * (len(rows) - 1) + [True]
    columns = ["source", "type", "input u", "#dof", "from", *heads]
    return ResultTable("", columns, rows, marked)


def _part(value: float, combined: float) -> str:
    return f"{value:.2g}" if value > _ROUNDING * combined else "0"


def _equipment(content: Content) -> Iterator[str | ResultTable]:
    if content["conditions"]:
        rows = [[name, said] for name, said in content["conditions"].items()]
        yield ResultTable("Conditions", ["condition", "value"], rows)
    if content["constants"]:
        rows = [
            [name, f"{value:g}" if isinstance(value, float) else str(value)]
            for name, value in content["constants"].items()
        ]
        yield ResultTable("Constants", ["constant", "#value"], rows)
    rows = [
        [
            each["name"],
            " ".join(filter(None, [each["model"], each["firmware"]])),
            each["serial"],
            _own_certificate(each),
            ", ".join(f"u({name}) = {value:g}" for name, value in (each["uncertainty"] or {}).items()),
            "; ".join(each["warnings"]),
        ]
        for each in content["instruments"]
    ]
    if rows:
        columns = ["instrument", "model, firmware", "serial", "its certificate", "standard uncertainties", "warning"]
        yield ResultTable("Equipment", columns, rows, [bool(row[-1]) for row in rows])


def _own_certificate(each: Content) -> str:
    if each["uncertainty"] is None:
        return "none in the rig file"
    said = [each["certificate"], each["laboratory"]]
    said += [f"serial {each['certified_serial']}" if each["certified_serial"] else ""]
    said += [f"of {each['calibrated']}" if each["calibrated"] else ""]
    said += [f"until {each['expires']}" if each["expires"] else ""]
    return ", ".join(filter(None, said)) or "number and dates not stated"


def _model(content: Content) -> Iterator[str | ResultTable | Sequence[str]]:
    model = content["model"]
    yield f"Version {model['version']}: {model['name']}."
    if model["plugins"]:
        yield [
            f"{effect} comes from a plug-in, SHA-256 {each['sha256']}" for effect, each in model["plugins"].items()
        ]
    yield from filter(None, [model["adequacy"], model["noise"], model["verdict"]])
    if model["warnings"]:
        yield list(model["warnings"])
    if model["inseparable"]:
        yield "These data could not tell apart:"
        yield list(model["inseparable"])


def _excluded(content: Content) -> Iterator[str | ResultTable]:
    excluded = content["excluded"]
    if not excluded["runs"]:
        yield "No run was excluded."
        return
    yield ResultTable("", ["run", "reason"], [[name, reason] for name, reason in excluded["runs"].items()])
    if excluded["not_worked_out"]:
        yield f"With these runs there is no result: {excluded['not_worked_out']}"
        return
    rows = []
    for each in excluded["changes"]:
        expanded = each["expanded_uncertainty"]
        places = _places(expanded) if expanded else 6
        shift = each["with_them"] - each["without"]
        numbers = [fixed(each[key], places) for key in ("without", "with_them")]
        over = f"{shift / expanded:+.2f}" if expanded else "-"
        rows.append([each["name"], *numbers, over, _unit(each["unit"])])
    columns = ["quantity", "#without (certified)", "#with them", "#change / U", "unit"]
    yield ResultTable("With and without them", columns, rows)


def _remarks(content: Content) -> Iterator[str | Sequence[str]]:
    traceability, remarks, rest = remarks_of(content)
    yield from traceability
    if remarks:
        yield remarks
    yield from rest


def remarks_of(content: Content) -> tuple[list[str], list[str], list[str]]:
    """Traceability, the remarks, and what closes them: what is not stated, and what the results relate to."""
    not_stated = f"Asked for by ISO/IEC 17025:2017 and not stated: {', '.join(content['not_stated'])}."
    traceability = list(filter(None, [content["traceability"]]))
    return traceability, list(content["remarks"]), [not_stated, RELATES] if content["not_stated"] else [RELATES]


def _basis(content: Content) -> Iterator[str | ResultTable]:
    basis = content["basis"]
    runs = basis["runs"]
    valid = sum(each["valid"] for each in runs.values())
    rows = [[name, digest] for name, digest in (*basis["files"].items(), *basis["records"].items())]
    yield f"SHA-256 over all of it: {content['basis_sha256']}"
    yield ResultTable("", ["file or record", "SHA-256"], rows)
    yield (
        f"{counted(len(runs), 'run')}, {valid} of them valid, in {basis['store']}; the hash of every run's samples "
        "and conditions is in the data this certificate carries. `rigctl verify` compares them with a store."
    )
    software = content["software"]
    yield f"Made by {software['name']} {software['version']}."


def _factor(k: float | None) -> str:
    return "-" if k is None else f"{k:.2f}"


def _dof(dof: float | None) -> str:
    return "∞" if dof is None or dof > _INFINITE else f"{dof:.0f}" if dof >= 100 else f"{dof:.3g}"


def _unit(unit: str) -> str:
    return unit or "unit not stated"
