"""The columns of shapes without physics: harmonics of the angle, powers of the frequency, functions of covariates."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.analysis.lengths import lengths
from rigctl.core.arrays import FloatArray, IntArray
from rigctl.workbench.study import Observations

ANGLE_HARMONICS = 4
POLYNOMIAL = 6
"""Highest power of a covariate where neither angle nor frequency gives other shapes."""

POWERS = (-1, 0, 1, 2)
# What makes a sine a column of its own beside the cosine; the correlation of columns that say the same.
_SIDEWAYS, _COPY = 1e-3, 0.999


@dataclass(frozen=True)
class Shape:
    """One generic candidate: `harmonic` of the angle (0: none), `power` of the frequency, `covariate` ("" none)."""

    series: int
    harmonic: int
    power: int
    covariate: str


Factor = tuple[int, str]
"""A power of the frequency, and a covariate or ""."""

Part = tuple[IntArray, list[Shape], FloatArray, IntArray]
"""Rows of a series, its shapes, their columns at unit length, and where the second column of each is, or -1."""


def distinct(given: Observations, number: int, rows: IntArray, factors: Sequence[Factor]) -> Part:
    """The shapes of a series over its rows, made of some factors and of the angle."""
    shapes, columns, seconds = [], [], []
    common = np.stack(list(_columns_of(given, rows, factors)), axis=1)
    if given.angle is None:
        shapes = [Shape(number, 0, power, covariate) for power, covariate in factors]
        return rows, shapes, normalised(common), np.full(len(shapes), -1, dtype=np.intp)
    for harmonic in range(ANGLE_HARMONICS + 1):
        first, second = common, np.zeros_like(common)
        if harmonic:
            angle = np.radians(harmonic * given.of_runs(given.angle)[rows])[:, None]
            first, second = common * np.cos(angle), common * np.sin(angle)
        columns.append(first)
        seconds.append(second)
        shapes += [Shape(number, harmonic, power, covariate) for power, covariate in factors]
    one, other = normalised(np.hstack(columns)), normalised(np.hstack(seconds))
    # With two angles only, cosine and sine are multiples of each other: one column then stands for both.
    other = other - one * np.einsum("nk,nk->k", one, other)
    length = lengths(other)
    paired = length > _SIDEWAYS
    seen = np.any(one != 0.0, axis=0) | paired
    # Where the cosine is nil at every set-point the sine takes its place.
    one = np.where(np.any(one != 0.0, axis=0), one, other / np.where(paired, length, 1.0))
    paired &= np.any(np.hstack(columns) != 0.0, axis=0)
    where = np.full(len(shapes), -1, dtype=np.intp)
    where[np.flatnonzero(paired & seen)] = int(seen.sum()) + np.arange(int((paired & seen).sum()))
    stack = np.hstack([one[:, seen], (other / np.where(paired, length, 1.0))[:, paired & seen]])
    return rows, [shape for shape, used in zip(shapes, seen, strict=True) if used], stack, where[seen]


def factors_of(given: Observations, number: int, rows: IntArray) -> list[Factor]:
    """Powers of the frequency times covariates of a series, neither of them first."""
    covariates = [name for name in covariates_of(given, rows) if (number, name) not in given.templates]
    powers = POWERS if given.frequency is not None else (0,)
    return [(power, covariate) for power in powers for covariate in covariates]


def covariates_of(given: Observations, rows: IntArray) -> list[str]:
    """Those that vary and are not collinear with others, with their powers; "" for none."""
    names = [""]
    used_up = given.angle is not None or given.frequency is not None
    used = [_centred(given.of_runs(name)[rows]) for name in (given.angle, given.frequency) if name is not None]
    for name in (*given.covariates, *given.indicators):
        values = given.of_runs(name)[rows]
        if (
            # Words are numbered in no order: they have no slope.
            name in (given.angle, given.frequency, *given.levels)
            or not np.isfinite(values).all()
            or np.ptp(values) <= 0.0
        ):
            continue
        centred = _centred(values)
        if any(abs(centred @ each) > _COPY for each in used):
            continue
        used.append(centred)
        names.append(name)
        # No more than half as many powers as values: else they would go through every point.
        degrees = min(POLYNOMIAL if not used_up else 2, (len(np.unique(values)) - 1) // 2)
        names += [f"{name}^{degree}" for degree in range(2, degrees + 1)]
    return names


def _centred(values: FloatArray) -> FloatArray:
    """Less their mean and at unit length, so that products are correlations; zeros of what does not vary."""
    centred = values - values.mean()
    length = np.linalg.norm(centred)
    return np.asarray(centred / length if np.ptp(values) > 0.0 else np.zeros_like(values))


def plain(given: Observations, rows: IntArray, shape: Shape) -> FloatArray:
    """Columns of one shape over the rows of its series, shape (rows, 1 or 2)."""
    common = next(_columns_of(given, rows, [(shape.power, shape.covariate)]))
    if not shape.harmonic or given.angle is None:
        return np.asarray(common[:, None])
    angle = np.radians(shape.harmonic * given.of_runs(given.angle)[rows])
    return np.stack([common * np.cos(angle), common * np.sin(angle)], axis=1)


def _columns_of(given: Observations, rows: IntArray, factors: Sequence[Factor]) -> Iterator[FloatArray]:
    """The column (rows,) of each factor; the powers of one covariate together, as each needs those below it."""
    powers: dict[str, _Powers] = {}
    for power, covariate in factors:
        column = np.ones(len(rows))
        if covariate:
            name, _, degree = covariate.partition("^")
            if name not in powers:
                powers[name] = _Powers(given.of_runs(name)[rows])
            column = powers[name].of(int(degree or 1))
        if power and given.frequency is not None:
            frequency = given.of_runs(given.frequency)[rows]
            column = column * (frequency / frequency.mean()) ** power
        yield column


class _Powers:
    """Powers of a covariate, each orthogonal to those below it and of unit rms."""

    def __init__(self, values: FloatArray) -> None:
        # Centred and of unit size: powers of years since 0 would be alike to the last digit.
        self._scaled = (values - values.mean()) / values.std()
        self._made: list[FloatArray] = [np.ones(len(values)), self._scaled]
        self._size = 1.0

    def of(self, degree: int) -> FloatArray:
        """One of them, (rows,)."""
        while len(self._made) <= degree:
            before, power = self._made[-2:]
            # Three terms suffice (Stieltjes): what remains of lower powers is rounding.
            following = (self._scaled - np.mean(self._scaled * power**2)) * power - self._size * before
            self._size = float(np.sqrt(np.mean(following**2)))
            self._made.append(following / self._size)
        return self._made[degree]


def normalised(columns: FloatArray) -> FloatArray:
    """Columns brought to unit length."""
    size = lengths(columns)
    return np.asarray(columns / np.where(size > 0.0, size, 1.0))
