"""Coverage factors, effective degrees of freedom and decisions, against printed numbers."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rigctl.analysis.budget import coverage_factors
from rigctl.analysis.conformity import Knowledge, decide
from rigctl.analysis.measurement_result import (
    Limits,
    MeasurementResult,
    Quantity,
    Source,
    checked,
    spread_interval,
    spread_source,
)
from rigctl.core.errors import ProcedureError


def _result(*sources: Source, values: tuple[float, ...] = (1.0,)) -> MeasurementResult:
    quantities = tuple(Quantity(f"q{number}", value, "1") for number, value in enumerate(values))
    return MeasurementResult(quantities, sources, "made up")


def _source(u: float, dof: float) -> Source:
    return Source(f"{u} with {dof}", "A", np.array([[u * u]]), dof)


def test_coverage_factors_are_those_of_gum_table_g2() -> None:
    dof = np.array([1.0, 2.0, 5.0, 5.99, 10.0, 50.0, math.inf])
    printed = [12.71, 4.30, 2.57, 2.57, 2.23, 2.01, 1.960]
    np.testing.assert_allclose(coverage_factors(dof), printed, atol=0.005)


def test_effective_degrees_of_freedom_are_those_of_gum_g42() -> None:
    # Relative uncertainties 0.25 %, 0.57 % and 0.82 % from 10, 5 and 15 values: u = 1.03 %, 19.0 degrees of freedom.
    result = _result(_source(0.25, 9), _source(0.57, 4), _source(0.82, 14))
    assert result.standard_uncertainty[0] == pytest.approx(1.03, abs=0.005)
    assert result.effective_dof[0] == pytest.approx(19.0, abs=0.05)
    assert result.coverage_factor[0] == pytest.approx(2.10, abs=0.005)  # of 18, as 18.97 is truncated


def test_a_common_source_correlates_and_an_own_one_does_not() -> None:
    common = Source("common", "B", np.outer([3.0, -3.0], [3.0, -3.0]))
    own = Source("own", "A", np.diag([16.0, 16.0]), 7.0)
    result = _result(common, own, values=(1.0, 2.0))
    np.testing.assert_allclose(result.covariance, [[25.0, -9.0], [-9.0, 25.0]])


def test_the_interval_of_a_spread_is_that_of_tables_of_chi_square() -> None:
    # Of a standard deviation from six values: 0.624 to 2.453 times.
    np.testing.assert_allclose(spread_interval(1.0, 5.0), [0.624, 2.453], atol=0.0005)


def test_the_uncertainty_of_a_standard_deviation_is_that_of_gum_table_e1() -> None:
    # GUM E.4.3: for ten values u(s) / s is 24 %, for fifty 10 %.
    for count, percent in ((10, 24), (50, 10)):
        source = spread_source("spread", 0, 1, 1.0, count - 1.0)
        assert 100.0 * source.standard_uncertainty[0] == pytest.approx(percent, abs=0.5)


@pytest.mark.parametrize(
    ("value", "u", "limits", "printed"),
    [
        (-5.47, 0.05, Limits(None, -5.40), 0.92),  # a Zener diode's breakdown voltage: Phi(1.4)
        (507.0, 8.6, Limits(490.0, None), 0.98),  # a container's bursting pressure: Phi(1.98)
    ],
)
def test_probabilities_of_conformance_are_those_of_normal_tables(
    value: float, u: float, limits: Limits, printed: float
) -> None:
    assert Knowledge(value, u, math.inf).inside(limits) == pytest.approx(printed, abs=0.005)


def test_a_guard_band_of_the_expanded_uncertainty_has_a_risk_of_2_3_percent() -> None:
    # JCGM 106, 8.3.2: w = U = 2 u for a normal distribution.
    said = decide(Knowledge(8.0, 1.0, math.inf), Limits(None, 10.0), "guard band", 0.02275013)
    assert said.acceptance.upper == pytest.approx(8.0, abs=1e-6)
    assert decide(Knowledge(7.999, 1.0, math.inf), Limits(None, 10.0), "guard band", 0.02275013).verdict == "pass"


KNOWN = [
    Knowledge(1.0, 0.1, 4.0),
    Knowledge(1.0, 0.1, math.inf),
    Knowledge(1.0, 0.3, 5.0, "spread"),
    Knowledge(1.0, 0.3, 5.0, "spread", 1.1),
]


@pytest.mark.parametrize("known", KNOWN)
@pytest.mark.parametrize("limits", [Limits(None, 3.0), Limits(0.2, None)])
def test_at_the_acceptance_limit_the_risk_is_the_largest_allowed(known: Knowledge, limits: Limits) -> None:
    accepted = decide(known, limits, "guard band", 0.05).acceptance
    (edge,) = [each for each in (accepted.lower, accepted.upper) if each is not None]
    at_edge = replace(known, value=edge)
    assert 1.0 - at_edge.inside(limits) == pytest.approx(0.05, rel=1e-9)


@pytest.mark.parametrize(
    ("value", "verdict"), [(8.0, "pass"), (8.4, "undecided"), (11.6, "undecided"), (11.7, "fail")]
)
def test_a_guard_band_passes_fails_or_leaves_it_open(value: float, verdict: str) -> None:
    said = decide(Knowledge(value, 1.0, math.inf), Limits(None, 10.0), "guard band", 0.05)
    assert said.verdict == verdict
    wrong = {"pass": said.false_accept, "fail": said.false_reject}.get(verdict)
    assert wrong is None if verdict == "undecided" else wrong is not None and wrong < 0.05


def test_simple_acceptance_tells_the_risk_it_takes() -> None:
    said = decide(Knowledge(10.0, 1.0, math.inf), Limits(None, 10.0), "simple acceptance", 0.05)
    assert (said.verdict, said.false_accept) == ("pass", pytest.approx(0.5))


def test_what_is_not_finite_is_not_certified() -> None:
    with pytest.raises(ProcedureError, match="q0 is not determined"):
        checked(_result(_source(math.nan, 3.0)))
    with pytest.raises(ProcedureError, match="no quantity that could be certified"):
        checked(MeasurementResult((), (), "made up"))
