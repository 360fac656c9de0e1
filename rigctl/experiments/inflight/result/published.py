"""The paper's printed numbers, and what an error of each parameter does to the test of the equivalence principle."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

from rigctl.experiments.inflight.model.parameters import NAMES


@dataclass(frozen=True)
class Row:
    """One parameter: `objective`, and `worst`, `mean`, `std` of |estimate - true| over 100 draws, as printed.

    `per_unit_m_s2` turns an error into an acceleration at the test's frequency (table 1); `before_m_s2` is its
    contribution uncorrected, at its `bound`; `row_worst_m_s2`, `row_mean_m_s2` are printed in table 3.
    """

    term: str
    bound: float
    before_m_s2: float
    objective: float
    worst: float
    mean: float
    std: float
    row_worst_m_s2: float
    row_mean_m_s2: float
    per_unit_m_s2: float


@dataclass(frozen=True)
class Published:
    """All rows by parameter, in the order of `parameters.NAMES`, and the totals as printed."""

    rows: dict[str, Row]
    total_worst_m_s2: float
    total_mean_m_s2: float
    before_m_s2: float
    limit_m_s2: float


@cache
def published() -> Published:
    """Hardy et al., arXiv 1707.07630, tables 1 to 3."""
    text = files("rigctl.experiments.inflight").joinpath("published.toml").read_text(encoding="utf-8")
    data = tomllib.loads(text)
    rows = {}
    for name in NAMES:
        row = dict(data["parameters"][name])
        scale = row.pop("driver") * row.pop("factor", 1.0) * row.pop("off_centring_m", 1.0)
        rows[name] = Row(**row, per_unit_m_s2=scale)
    totals = data["totals"]
    return Published(rows, totals["worst_m_s2"], totals["mean_m_s2"], totals["before_m_s2"], data["limit_m_s2"])
