"""What a certificate needs to say that no store knows: laboratory, customer, item, decision rule.

The clauses are those of ISO/IEC 17025:2017. Nothing is made up: what is not stated here is said to be not stated.
"""

from __future__ import annotations

from datetime import date
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from rigctl.core.file_tables import Table
from rigctl.files.item import Item, Line
from rigctl.files.toml_files import checked_file, parsed_file, read_text

Code = Annotated[str, Field(pattern="^[A-Z]{2}$")]


class Party(Table):
    """A laboratory or a customer (7.8.2.1 b, e)."""

    name: Line = ""
    address: Line = ""
    city: Line = ""
    country: Code | None = None
    email: Line = ""
    accreditation: Line = ""


class Person(Table):
    """Who answers for the certificate (7.8.2.1 o)."""

    name: Line
    role: Line = ""


class Decision(Table):
    """How conformity is decided (7.8.6): the rule, and the largest probability of a wrong decision."""

    rule: Literal["guard band", "simple acceptance"] = "guard band"
    largest_risk: Annotated[float, Field(gt=0.0, lt=0.5)] = 0.025


class Requirement(Table):
    """Between which a quantity of the result has to lie, in its unit."""

    quantity: Line
    lower: Annotated[float, Field(allow_inf_nan=False)] | None = None
    upper: Annotated[float, Field(allow_inf_nan=False)] | None = None
    source: Line = ""

    @model_validator(mode="after")
    def _ordered(self) -> Requirement:
        if self.lower is None and self.upper is None:
            raise ValueError("a requirement needs lower, upper or both")
        if self.lower is not None and self.upper is not None and not self.lower < self.upper:
            raise ValueError("lower has to be less than upper")
        return self


class CertificateDetails(Table):
    """A file for `rigctl certificate --details`, checked; `began` and `ended` for stores that do not know."""

    path: Path | None = None
    text: str = ""
    number: Line = ""
    place: Line = ""
    method: Line = ""
    began: date | None = None
    ended: date | None = None
    traceability: Line = ""
    laboratory: Party = Party()
    customer: Party = Party()
    item: Item = Item()
    persons: tuple[Person, ...] = ()
    conditions: dict[str, Line] = {}
    decision: Decision = Decision()
    requirements: tuple[Requirement, ...] = ()
    units: dict[str, Line] = {}
    remarks: tuple[Line, ...] = ()

    @model_validator(mode="after")
    def _forward(self) -> CertificateDetails:
        if self.began is not None and self.ended is not None and self.ended < self.began:
            raise ValueError("ended has to be on the day it began, or later")
        return self

    @model_validator(mode="after")
    def _each_once(self) -> CertificateDetails:
        named = [each.quantity for each in self.requirements]
        if twice := [name for name in dict.fromkeys(named) if named.count(name) > 1]:
            raise ValueError(f"two requirements on {twice[0]!r}; write its lower and upper in one")
        return self


def read_details(path: Path) -> CertificateDetails:
    """Read and check a file of details; `ConfigError`."""
    text = read_text(path)
    return checked_file(CertificateDetails, text, parsed_file(text, path), path)
