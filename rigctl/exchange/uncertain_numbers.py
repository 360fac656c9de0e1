"""Measurement results as uncertain numbers of `uncertainties` and of `GTC`; such numbers as constants of a baseline.

Both know an uncertain number by the independent inputs it depends on. A source of uncertainty gives one for each
direction of its covariance over all quantities, so that what quantities share correlates them there too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rigctl.analysis.measurement_result import MeasurementResult, Source
from rigctl.campaign.table_constants import TableConstant
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ConfigError
from rigctl.core.extra import needed

if TYPE_CHECKING:
    from GTC.lib import UncertainReal
    from uncertainties import UFloat

_RANK = 1e-14
"""Share of a source's variance below which a direction is rounding."""


_UNCORRELATED = 1e-12
"""Correlation coefficients below are rounding."""


def as_uncertainties(result: MeasurementResult) -> dict[str, UFloat]:
    """By quantity's name, a `ufloat` whose components are tagged by their source; `ConfigError` without the package.

    `uncertainties` propagates to first order and knows no degrees of freedom. What is certain is a plain float.
    """
    ufloat = needed("uncertainties").ufloat
    made: list[Any] = [each.value for each in result.quantities]
    for source in result.sources:
        for direction in directions(source):
            made = _moved(made, ufloat(0.0, 1.0, tag=source.name), direction)
    return dict(zip(_names(result), made, strict=True))


def as_gtc(result: MeasurementResult) -> dict[str, UncertainReal]:
    """By quantity's name, an uncertain real of `GTC` with the effective degrees of freedom of the result's budget;
    `ConfigError` without the package.

    Directions of a source with finite degrees of freedom are one ensemble: they were estimated together.
    """
    gtc = needed("GTC")
    made = [gtc.constant(each.value) for each in result.quantities]
    for source in result.sources:
        ways = directions(source)
        names = [source.name if len(ways) == 1 else f"{source.name}, {number}" for number in range(1, len(ways) + 1)]
        inputs = (
            [gtc.ureal(0.0, 1.0, source.dof, names[0])]
            if len(ways) == 1
            else gtc.multiple_ureal([0.0] * len(ways), [1.0] * len(ways), source.dof, names)
        )
        for one, direction in zip(inputs, ways, strict=True):
            made = _moved(made, one, direction)
    return {name: gtc.result(number) for name, number in zip(_names(result), made, strict=True)}


def directions(source: Source) -> FloatArray:
    """Independent parts of a source: what each adds to every quantity, (directions, quantities)."""
    covariance = source.covariance
    # Quantities differ by powers of ten: correlations are taken apart.
    size = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    kept = values > _RANK * max(float(values.max(initial=0.0)), 0.0)
    return np.asarray((vectors[:, kept] * np.sqrt(values[kept])).T * scale)


def as_constants(numbers: Mapping[str, UFloat | UncertainReal | float]) -> dict[str, TableConstant]:
    """By name, constants of a table's baseline with what these numbers know of themselves: values, standard
    uncertainties, correlations, and of GTC's the effective degrees of freedom. A plain number is certain.

    `ConfigError` for what is neither, and for numbers of both packages in one call: nobody knows how these correlate.
    """
    uncertain = {name: number for name, number in numbers.items() if not isinstance(number, int | float)}
    kinds = {type(number).__module__.partition(".")[0] for number in uncertain.values()}
    if len(kinds) > 1:
        raise ConfigError(
            f"uncertain numbers of {' and '.join(sorted(kinds))} together; convert them to one of the two"
        )
    readers = {"GTC": _of_gtc, "uncertainties": _of_uncertainties}
    kind = kinds.pop() if kinds else "uncertainties"
    if kind not in readers:
        found = next(iter(uncertain.values()))
        raise ConfigError(
            f"{found!r} is no uncertain number; give a number, one of uncertainties, or a real one of GTC"
        )
    known = readers[kind](uncertain)
    return {name: known.get(name) or TableConstant(float(number)) for name, number in numbers.items()}


def _of_uncertainties(numbers: Mapping[str, Any]) -> dict[str, TableConstant]:
    if not numbers:
        return {}
    matrix = needed("uncertainties").correlation_matrix(list(numbers.values()))
    return {
        name: TableConstant(number.nominal_value, number.std_dev, correlation=correlation)
        for (name, number), correlation in zip(numbers.items(), _above(list(numbers), matrix), strict=True)
    }


def _of_gtc(numbers: Mapping[str, Any]) -> dict[str, TableConstant]:
    gtc = needed("GTC")
    if wrong := [name for name, number in numbers.items() if isinstance(gtc.value(number), complex)]:
        raise ConfigError(f"{wrong[0]} is complex; give its real and imaginary parts as two constants")
    matrix = [[gtc.get_correlation(one, other) for other in numbers.values()] for one in numbers.values()]
    return {
        name: TableConstant(gtc.value(number), gtc.uncertainty(number), gtc.dof(number), correlation)
        for (name, number), correlation in zip(numbers.items(), _above(list(numbers), matrix), strict=True)
    }


def _above(names: Sequence[str], matrix: Any) -> list[dict[str, float]]:
    """Of each name its correlations with those after it, without those that are none."""
    return [
        {
            other: float(matrix[row][column])
            for column, other in enumerate(names)
            if column > row and abs(matrix[row][column]) > _UNCORRELATED
        }
        for row in range(len(names))
    ]


def _moved(numbers: Sequence[Any], by: Any, direction: FloatArray) -> list[Any]:
    # What does not depend on an input is not told of it.
    return [
        number + slope * by if slope else number for number, slope in zip(numbers, direction.tolist(), strict=True)
    ]


def _names(result: MeasurementResult) -> list[str]:
    """Names of the quantities, with their group before them where two have one name."""
    plain = [each.name for each in result.quantities]
    return [
        f"{each.group} {each.name}" if plain.count(each.name) > 1 and each.group else each.name
        for each in result.quantities
    ]
