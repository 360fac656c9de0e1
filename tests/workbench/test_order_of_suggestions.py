"""What is suggested is in an order in which the error of every version falls."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import pytest

from rigctl.workbench.study import Term
from rigctl.workbench.verdict import diagnose
from rigctl.workbench.verdict.diagnose import _in_order

A, B, C = (Term(name) for name in "abc")


@dataclass(frozen=True)
class Found:
    """A search that has found a, b and c, the most significant first; `errors` of the models with some of them."""

    errors: Mapping[str, float]
    given: tuple[Term, ...] = ()
    lines: tuple[Any, ...] = ()
    suggested: tuple[Term, ...] = (C, B, A)
    terms: tuple[Term, ...] = (A, B, C)

    def p_of_term(self, terms: Sequence[Term], term: Term) -> float:
        return {"a": 1e-9, "b": 1e-6, "c": 1e-4}[term.effect]

    def attempt_if_fit(self, terms: Sequence[Term]) -> Any:
        error = self.errors["".join(sorted(term.effect for term in terms))]
        return SimpleNamespace(error=lambda: error, held_out_error=error, result=SimpleNamespace(chi2=error**2))


def errors(with_a_and_b: float) -> dict[str, float]:
    return {"": 5.0, "a": 2.0, "b": 3.0, "c": 4.0, "ab": with_a_and_b, "ac": 1.5, "abc": 1.0}


@pytest.mark.parametrize(("with_a_and_b", "order"), [(1.8, (A, B, C)), (2.1, (A, C, B))])
def test_significance_gives_way_where_an_error_would_rise(
    with_a_and_b: float, order: tuple[Term, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(diagnose, "rms_by_channel", lambda attempt: {"y": SimpleNamespace(value=attempt.error())})
    assert _in_order(Found(errors(with_a_and_b))) == order  # type: ignore[arg-type]
