"""Which kinds of trial there are, and how many of each make the short form, the full form and the check in CI."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Literal, cast

from tests.reliability.trials import Trials

Form = Literal["ci", "short", "full"]


@dataclass(frozen=True)
class Kind:
    """A kind of trial and its numbers of seeds; `unit` is what the promise counts."""

    name: str
    unit: str
    ci: int
    short: int
    full: int

    @property
    def trials(self) -> Trials:
        """The module that tries it."""
        return cast(Trials, importlib.import_module(f"tests.reliability.{self.name}"))

    def seeds(self, form: Form) -> int:
        """How many seeds this form has; they begin with 1."""
        return {"ci": self.ci, "short": self.short, "full": self.full}[form]


KINDS: dict[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind("faulty_campaigns", "campaigns", ci=12, short=300, full=2000),
        Kind("damaged_stores", "stores", ci=12, short=200, full=1000),
        Kind("fuzzed_files", "files", ci=2, short=10, full=100),
        Kind("killed_campaigns", "campaigns", ci=6, short=150, full=1000),
        Kind("fuzzed_replies", "replies", ci=3, short=60, full=600),
        Kind("simulated_days", "days", ci=0, short=3, full=30),
        Kind("power_cuts", "cuts", ci=2, short=50, full=500),
        Kind("signals", "endings", ci=6, short=200, full=1000),
        Kind("two_programs", "second programs", ci=4, short=36, full=180),
    )
}
