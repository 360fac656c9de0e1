"""Whatever might be left, with no physics assumed: shapes over the conditions, one series at a time.

A shape is a harmonic of the angle, times a power of the frequency, times a covariate. Where no effect of the
catalogue explains what is left, the strongest shape describes it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigctl.workbench.findings import Unexplained
from rigctl.workbench.noise import Noise
from rigctl.workbench.score import ABSORBED, DRAWS, Projector, p_of, smallest_p, trials_of
from rigctl.workbench.study import FloatArray, IntArray, Observations

ANGLE_HARMONICS = 4
POWERS = (-1, 0, 1, 2)
_SIDEWAYS = 1e-3
_MANY = 1 << 22


@dataclass(frozen=True)
class Shape:
    """One generic candidate: `harmonic` of the angle (0: none), `power` of the frequency, `covariate` ("" none)."""

    series: int
    harmonic: int
    power: int
    covariate: str


@dataclass(frozen=True)
class Best:
    """The strongest shape left, with its p-value and that corrected for all shapes; `columns` (n, 1 or 2)."""

    shape: Shape
    statistic: float
    p_value: float
    p_value_corrected: float
    n_eff: float
    dimension: int
    columns: FloatArray


def main_columns(given: Observations) -> FloatArray:
    """The shapes one at a time, products left out, for every series: what saturates a small pool; (n, k)."""
    found = []
    for number in range(len(given.series)):
        rows = np.flatnonzero(given.series_of == number)
        for shape in _shapes(given, number):
            if (shape.harmonic > 0) + (shape.power != 0) + (shape.covariate != "") <= 1:
                columns = np.zeros((len(given.value), 2 if shape.harmonic else 1))
                columns[rows] = _columns(given, rows, shape)
                found.append(columns)
    return np.hstack(found) if found else np.zeros((len(given.value), 0))


class Generic:
    """All shapes of a set of observations."""

    def __init__(self, given: Observations) -> None:
        self._given = given
        self._rows = [np.flatnonzero(given.series_of == number) for number in range(len(given.series))]
        self._parts = [
            self._distinct(rows, _shapes(given, number)) for number, rows in enumerate(self._rows) if len(rows)
        ]

    def _distinct(self, rows: IntArray, shapes: list[Shape]) -> tuple[IntArray, list[Shape], FloatArray, IntArray]:
        """Rows, shapes, their columns (rows, k) at unit length, and how many columns each has."""
        kept, columns, widths = [], [], []
        for shape in shapes:
            made = _orthogonal(_columns(self._given, rows, shape))
            if made.shape[1]:
                kept.append(shape)
                columns.append(made)
                widths.append(made.shape[1])
        stack = np.hstack(columns) if columns else np.zeros((len(rows), 0))
        return rows, kept, stack, np.array(widths, dtype=np.intp)

    def best(self, noise: Noise, projector: Projector, rng: np.random.Generator) -> Best | None:
        """The strongest shape in what is left; None without any that could be seen."""
        parts = [self._scored(part, noise, projector) for part in self._parts]
        scored = [each for each in parts if each is not None]
        if not scored:
            return None
        statistics = np.concatenate([each.statistic for each in scored])
        widths = np.concatenate([each.dimension for each in scored])
        dofs = np.concatenate([each.dof for each in scored])
        p_values = p_of(statistics, widths, dofs)
        n_eff = self._trials(scored, rng, projector)
        order = np.argsort(0.5 * statistics - 0.5 * widths * np.log(projector.data))
        top = int(order[-1]) if p_values.min() < 1e-12 else int(np.argmin(p_values))
        part = 0
        while top >= len(scored[part].shapes):
            top -= len(scored[part].shapes)
            part += 1
        shape = scored[part].shapes[top]
        columns = np.zeros((len(self._given.value), 2 if shape.harmonic else 1))
        columns[self._rows[shape.series]] = _columns(self._given, self._rows[shape.series], shape)
        statistic = float(scored[part].statistic[top])
        p_value = float(p_of(statistic, int(scored[part].dimension[top]), float(scored[part].dof[top])))
        p_corrected = float(-np.expm1(n_eff * np.log1p(-min(p_value, 1.0 - 1e-16))))
        return Best(shape, statistic, p_value, p_corrected, n_eff, int(scored[part].dimension[top]), columns)

    def _scored(
        self, part: tuple[IntArray, list[Shape], FloatArray, IntArray], noise: Noise, projector: Projector
    ) -> _Scored | None:
        rows, shapes, columns, widths = part
        where, white = _whitened(noise, rows, columns)
        size = np.linalg.norm(white, axis=0)
        white = white / np.where(size > 0.0, size, 1.0)
        basis = projector.basis[where]
        # |M g|^2 = |g|^2 - |B' g|^2: the projected columns themselves are never made.
        shadow = basis.T @ white
        along = white.T @ projector.left[where]
        inverse, kept, dimension = [], [], []
        first = 0
        for number, width in enumerate(widths):
            own = slice(first, first + width)
            gram = white[:, own].T @ white[:, own] - shadow[:, own].T @ shadow[:, own]
            values, vectors = np.linalg.eigh(gram)
            seen = values > ABSORBED**2
            if seen.any():
                root = np.zeros((len(size), int(seen.sum())))
                root[own] = vectors[:, seen] / np.sqrt(values[seen])
                inverse.append(root)
                kept.append(shapes[number])
                dimension.append(int(seen.sum()))
            first += width
        if not kept:
            return None
        mixing = np.hstack(inverse)
        dimensions = np.array(dimension, dtype=np.intp)
        squares = (along @ mixing) ** 2
        statistic = np.add.reduceat(squares, np.concatenate([[0], np.cumsum(dimensions)[:-1]]))
        dof = float(np.median(noise.dof[rows])) if np.isfinite(noise.dof[rows]).any() else np.inf
        return _Scored(kept, statistic, dimensions, np.full(len(kept), dof), where, white @ mixing, shadow @ mixing)

    def _trials(self, scored: list[_Scored], rng: np.random.Generator, projector: Projector) -> float:
        rows = len(projector.left)
        draws = min(DRAWS, max(_MANY // rows, 200))
        smallest = np.ones(draws)
        noise = rng.standard_normal((draws, rows))
        fitted = noise @ projector.basis
        for each in scored:
            projected = noise[:, each.where] @ each.columns - fitted @ each.shadow
            smallest = np.minimum(smallest, smallest_p(projected**2, each.dimension))
        return trials_of(smallest)

    def describe(self, best: Best, noise: Noise, projector: Projector) -> Unexplained:
        """In words and numbers."""
        given, shape = self._given, best.shape
        series = given.series[shape.series]
        score = projector.score(_padded(noise.whiten(best.columns), len(projector.left)))
        amplitude = float(np.linalg.norm(score.estimate))
        sigma = float(np.sqrt(np.sum(np.where(np.isfinite(score.sigma), score.sigma, 0.0) ** 2)))
        details: dict[str, object] = {
            "harmonic_of_angle": shape.harmonic,
            "frequency_power": shape.power,
            "covariate": shape.covariate,
            "size": amplitude,
            "sigma": sigma,
            "unit": series.unit,
            "sign": 0 if shape.harmonic else int(np.sign(score.estimate[0])),
        }
        words = [f"{series.name} is off by {amplitude:.3g} +- {sigma:.2g} {series.unit}".replace("  ", " ")]
        if shape.harmonic:
            phase = float(np.degrees(np.arctan2(score.estimate[1], score.estimate[0])))
            details["phase_deg"] = phase
            words.append(f"as cos({_times(shape.harmonic)}{given.angle} - {phase:.0f} deg)")
        else:
            words[0] = words[0].replace("off by ", "off by " + ("" if score.estimate[0] > 0 else "-"), 1)
        if given.frequency is not None:
            words.append(
                {-1: "falling as 1/w", 0: "whatever the frequency", 1: "growing as w", 2: "growing as w^2"}[
                    shape.power
                ]
            )
        if shape.covariate:
            words.append(f"with {_worded(shape.covariate)} (size per standard deviation of it)")
        return Unexplained(series.channel, series.component, ", ".join(words), best.p_value_corrected, details)


@dataclass(frozen=True)
class _Scored:
    """Shapes of one series: Q = columns on the rows `where`, less B shadow."""

    shapes: list[Shape]
    statistic: FloatArray
    dimension: IntArray
    dof: FloatArray
    where: IntArray
    columns: FloatArray
    shadow: FloatArray


def _shapes(given: Observations, series: int) -> list[Shape]:
    harmonics = range(ANGLE_HARMONICS + 1) if given.angle is not None else (0,)
    powers = POWERS if given.frequency is not None else (0,)
    fixed = {given.angle, given.frequency}
    rows = np.unique(given.run_of[given.series_of == series])
    covariates = [""]
    for name, column in given.covariates.items():
        own = column[rows]
        if name in fixed or not np.isfinite(own).all() or np.ptp(own) <= 0.0:
            continue
        covariates.append(name)
        if len(np.unique(own)) > 4:
            covariates.append(f"{name}^2")
    return [Shape(series, h, k, c) for h in harmonics for k in powers for c in covariates]


def _columns(given: Observations, rows: IntArray, shape: Shape) -> FloatArray:
    """Columns of one shape over the rows of its series, shape (rows, 1 or 2)."""
    common = np.ones(len(rows))
    if shape.covariate:
        name, _, squared = shape.covariate.partition("^")
        values = given.of_runs(name)[rows]
        scaled = (values - values.mean()) / values.std()
        common = scaled**2 - np.mean(scaled**2) if squared else scaled
    if shape.power and given.frequency is not None:
        frequency = given.of_runs(given.frequency)[rows]
        common = common * (frequency / frequency.mean()) ** shape.power
    if not shape.harmonic or given.angle is None:
        return np.asarray(common[:, None])
    angle = np.radians(shape.harmonic * given.of_runs(given.angle)[rows])
    return np.stack([common * np.cos(angle), common * np.sin(angle)], axis=1)


def _orthogonal(columns: FloatArray) -> FloatArray:
    """The columns without what is zero or a copy of the first."""
    size = np.linalg.norm(columns, axis=0)
    if not size[0] > 0.0:
        columns, size = columns[:, 1:], size[1:]
    if not len(size) or not size[0] > 0.0:
        return columns[:, :0]
    unit = columns / np.where(size > 0.0, size, 1.0)
    if unit.shape[1] == 2:
        second = unit[:, 1] - unit[:, 0] * (unit[:, 0] @ unit[:, 1])
        length = np.linalg.norm(second)
        return unit[:, :1] if length < _SIDEWAYS else np.stack([unit[:, 0], second / length], axis=1)
    return np.asarray(unit)


def _whitened(noise: Noise, rows: IntArray, columns: FloatArray) -> tuple[IntArray, FloatArray]:
    """Rows and whitened columns: a group whose noise is correlated whitens within its own rows."""
    full = np.zeros((len(noise.sigma), columns.shape[1]))
    full[rows] = columns
    white = noise.whiten(full)
    where = np.flatnonzero(np.any(white != 0.0, axis=1))
    return where, white[where]


def _padded(columns: FloatArray, rows: int) -> FloatArray:
    return np.vstack([columns, np.zeros((rows - len(columns), columns.shape[1]))])


def _times(harmonic: int) -> str:
    return "" if harmonic == 1 else f"{harmonic} "


def _worded(covariate: str) -> str:
    name, _, squared = covariate.partition("^")
    return f"the square of {name}" if squared else name
