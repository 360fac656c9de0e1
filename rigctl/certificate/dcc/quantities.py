"""Quantities of a certificate as D-SI has them: real, complex in polar form, lists, and covariance between them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any
from xml.etree.ElementTree import Element

from rigctl.certificate.content import COVERAGE_PERCENT
from rigctl.certificate.dcc.elements import content, decimal, element, filled
from rigctl.certificate.dcc.units import dsi_unit

Quantity = Mapping[str, Any]

_COVERAGE = decimal(COVERAGE_PERCENT / 100.0)
_NOT_STATED = decimal(float("nan"))
"""The schema asks for the coverage of a joint region; a covariance alone has none."""


def quantity(
    name: str, value: Element, *after: Element | None, about: Sequence[str] = (), **attributes: str
) -> Element:
    """A `dcc:quantity` with its name, paragraphs about it, its value, and what stands behind that."""
    return element(
        "dcc:quantity", content("dcc:name", name), content("dcc:description", *about), value, *after, **attributes
    )


def real(value: float, unit: str, uncertainty: Element | None = None, label: str = "") -> Element:
    """One value with its unit."""
    return element(
        "si:real",
        filled("si:label", label),
        filled("si:value", decimal(value)),
        filled("si:unit", dsi_unit(unit)),
        uncertainty,
    )


def measured(each: Quantity) -> Element:
    """A quantity of a certificate with its expanded uncertainty, or its interval where it has no coverage factor."""
    return real(each["value"], each["unit"], element("si:measurementUncertaintyUnivariate", _coverage(each)))


def _coverage(each: Quantity) -> Element:
    if each["expanded_uncertainty"] is not None:
        return element(
            "si:expandedMU",
            filled("si:valueExpandedMU", decimal(each["expanded_uncertainty"])),
            filled("si:coverageFactor", decimal(each["coverage_factor"])),
            filled("si:coverageProbability", _COVERAGE),
            filled("si:distribution", "normal" if each["effective_dof"] is None else "Student's t"),
        )
    low, high = each["coverage_interval"]
    return element(
        "si:coverageIntervalMU",
        filled("si:valueStandardMU", decimal(each["standard_uncertainty"])),
        filled("si:intervalMin", decimal(low)),
        filled("si:intervalMax", decimal(high)),
        filled("si:coverageProbability", _COVERAGE),
        filled("si:distribution", "chi-square"),
    )


def real_list(labels: Sequence[str], values: Sequence[float], units: Sequence[str], *after: Element) -> Element:
    """Values that belong together; blanks in labels are underscores, for blanks divide a list."""
    return element(
        "si:realListXMLList",
        _listed("si:labelXMLList", (re.sub(r"\s+", "_", label) for label in labels)),
        _listed("si:valueXMLList", map(decimal, values)),
        _listed("si:unitXMLList", map(dsi_unit, units)),
        *after,
    )


def with_covariance(quantities: Sequence[Quantity], covariance: Sequence[Sequence[float]]) -> Element:
    """All quantities with their standard uncertainties and the covariance between them."""
    units = [each["unit"] for each in quantities]
    standard = element(
        "si:standardMUXMLList",
        _listed("si:valueStandardMUXMLList", (decimal(each["standard_uncertainty"]) for each in quantities)),
    )
    region = element("si:ellipsoidalRegionMUXMLList", *_region(units, covariance, "XMLList"))
    return real_list(
        [each["name"] for each in quantities],
        [each["value"] for each in quantities],
        units,
        element("si:measurementUncertaintyUnivariateXMLList", standard),
        element("si:measurementUncertaintyMultivariateXMLList", region),
    )


def polar(magnitude: Quantity, phase: Quantity, covariance: Sequence[Sequence[float]]) -> Element:
    """A complex quantity by its magnitude and its phase, with the covariance (2, 2) of these."""
    units = (magnitude["unit"], phase["unit"])
    return element(
        "si:complex",
        filled("si:label", magnitude["complex"]),
        filled("si:valueMagnitude", decimal(magnitude["value"])),
        filled("si:valuePhase", decimal(phase["value"])),
        filled("si:unit", dsi_unit(magnitude["unit"])),
        filled("si:unitPhase", dsi_unit(phase["unit"])),
        element("si:ellipsoidalRegion", *_region(units, covariance)),
    )


def _region(units: Sequence[str], covariance: Sequence[Sequence[float]], kind: str = "") -> Iterator[Element | None]:
    """A covariance matrix column by column, and no coverage of them together; `kind` ends all names."""
    columns = (
        element(
            f"si:column{kind}",
            *(
                element(
                    f"si:covariance{kind}",
                    filled(f"si:value{kind}", decimal(row[place])),
                    filled(f"si:unit{kind}", dsi_unit(unit, other)),
                )
                for row, unit in zip(covariance, units, strict=True)
            ),
        )
        for place, other in enumerate(units)
    )
    yield element(f"si:covarianceMatrix{kind}", *columns)
    yield filled(f"si:coverageFactor{kind}", _NOT_STATED)
    yield filled(f"si:coverageProbability{kind}", _NOT_STATED)


def _listed(tag: str, said: Any) -> Element | None:
    return filled(tag, " ".join(said))
