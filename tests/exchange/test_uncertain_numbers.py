"""Results as numbers of other packages: the same values, uncertainties, correlations and degrees of freedom."""

from __future__ import annotations

import builtins
from typing import Any

import GTC
import numpy as np
import pytest
import uncertainties
from hypothesis import given
from hypothesis import strategies as st

from rigctl.analysis.measurement_result import MeasurementResult, Quantity, Source
from rigctl.core.errors import ConfigError
from rigctl.exchange.uncertain_numbers import as_gtc, as_uncertainties, directions


def drawn(seed: int, quantities: int, sources: int) -> MeasurementResult:
    """Sources of one direction and of several, with and without degrees of freedom, of very different sizes."""
    rng = np.random.default_rng(seed)
    size = 10.0 ** rng.uniform(-9.0, 3.0, quantities)
    made = []
    for number in range(sources):
        spread = rng.normal(size=(quantities, int(rng.integers(1, quantities + 1)))) * size[:, None]
        dof = float(rng.choice([5.0, 30.0, np.inf]))
        made.append(Source(f"source {number}", "A", spread @ spread.T, dof))
    values = rng.normal(size=quantities) * size * 100.0
    return MeasurementResult(
        tuple(Quantity(f"q{place}", float(value), "V") for place, value in enumerate(values)), tuple(made), "drawn"
    )


RESULTS = st.builds(drawn, st.integers(0, 10_000), st.integers(1, 5), st.integers(1, 4))


@given(result=RESULTS)
def test_uncertainties_has_the_same_covariance(result: MeasurementResult) -> None:
    numbers = list(as_uncertainties(result).values())
    assert [each.nominal_value for each in numbers] == result.values.tolist()
    size = result.standard_uncertainty
    found = np.array(uncertainties.covariance_matrix(numbers)) / np.outer(size, size)
    assert found == pytest.approx(result.covariance / np.outer(size, size), abs=1e-9)


@given(result=RESULTS)
def test_its_components_are_those_of_the_budget(result: MeasurementResult) -> None:
    for place, number in enumerate(as_uncertainties(result).values()):
        by_source: dict[str, float] = {}
        for variable, part in number.error_components().items():
            by_source[variable.tag] = by_source.get(variable.tag, 0.0) + part**2
        for source in result.sources:
            assert by_source[source.name] == pytest.approx(source.covariance[place, place], rel=1e-9)


@given(result=RESULTS)
def test_gtc_has_the_same_uncertainties_correlations_and_degrees_of_freedom(result: MeasurementResult) -> None:
    numbers = list(as_gtc(result).values())
    size = result.standard_uncertainty
    assert [GTC.uncertainty(each) for each in numbers] == pytest.approx(size, rel=1e-9)
    for a in range(len(numbers)):
        for b in range(a):
            known = result.covariance[a, b] / (size[a] * size[b])
            assert GTC.get_correlation(numbers[a], numbers[b]) == pytest.approx(known, abs=1e-9)
    for number, dof in zip(numbers, result.effective_dof, strict=True):
        assert GTC.dof(number) == pytest.approx(dof, rel=1e-6)


def test_a_difference_of_what_shares_its_error_is_better_than_either() -> None:
    """Two readings of one voltmeter whose gain is uncertain: the sum has twice its error, the difference none."""
    gain, noise = np.outer([1e-3, 1e-3], [1e-3, 1e-3]), np.diag([1e-5, 1e-5]) ** 2
    result = MeasurementResult(
        (Quantity("up", 1.0, "V"), Quantity("down", 1.0, "V")),
        (Source("gain", "B", gain), Source("noise", "A", noise, 9.0)),
        "two readings",
    )
    up, down = as_uncertainties(result).values()
    assert (up - down).std_dev == pytest.approx(np.sqrt(2.0) * 1e-5)
    assert (up + down).std_dev == pytest.approx(2e-3, rel=1e-4)


def test_directions_of_nothing_are_none() -> None:
    assert directions(Source("nothing", "B", np.zeros((3, 3)))).shape == (0, 3)


def test_without_the_package_one_line_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def refused(name: str, *rest: Any) -> Any:
        if name == "uncertainties":
            raise ModuleNotFoundError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", refused)
    monkeypatch.setattr("importlib.import_module", lambda name: refused(name))
    with pytest.raises(
        ConfigError, match=r"uncertainties is not installed; pip install 'rigctl\[notebook\]' brings it"
    ):
        as_uncertainties(drawn(1, 2, 1))
