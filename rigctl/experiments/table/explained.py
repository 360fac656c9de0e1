"""Offsets of batches, or an effect that varies between their values: what tells the one from the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from rigctl.core.arrays import FloatArray
from rigctl.experiments.table.between import INDEPENDENT, Between, Shape

# Prior odds of each parameter of an effect, as -2 log (decision 046).
_ODDS = 5.0
# Offsets that follow one another more smoothly than one in a thousand are no offsets.
_ROUGH = 1e-3
_ROUNDING = 1e-20
_EFFECTS_MAX, _BEAM = 2, 5
# Effects of one column without a scan span little more than a cubic.
_SMOOTH_TRIALS = 3


@dataclass(frozen=True)
class Explained:
    """Coordinates between values (g,) with effects taken out: what is `left`, and a basis (g, k) of the effects.

    `columns` are what they do at the values, (values, d) each; `parameters` counts what was scanned too, `penalty` is
    in units of -2 log likelihood.
    """

    between: Between
    left: FloatArray
    basis: FloatArray
    columns: tuple[FloatArray, ...] = ()
    parameters: int = 0
    penalty: float = 0.0

    @classmethod
    def by_nothing(cls, between: Between) -> Explained:
        """By a constant only."""
        none = cls(between, between.along, np.zeros((len(between.along), 0)))
        constant = np.ones((between.of_values.shape[1], 1, 1))
        added = none.beside(constant)[:, 0]
        return none.with_columns(added[:, np.any(added != 0.0, axis=0)])

    def with_columns(self, added: FloatArray) -> Explained:
        """With orthonormal columns (g, d) beside the basis."""
        left = self.left - added @ (added.T @ self.left)
        return Explained(
            self.between, left, np.hstack([self.basis, added]), self.columns, self.parameters, self.penalty
        )

    def with_best(self, shape: Shape) -> Explained:
        """With the point of a shape that leaves least."""
        grid = shape.grid()
        points = len(grid)
        for _ in range(3):
            at_values = shape.at(grid)
            bases = self.beside(at_values)
            place = int(np.argmax(np.sum(np.einsum("gpd,g->pd", bases, self.left, optimize=True) ** 2, axis=1)))
            grid, best, columns = shape.finer(grid, place), bases[:, place], at_values[:, place]
            if len(grid) == 1:
                break
        added = best[:, np.any(best != 0.0, axis=0)]
        d, values = added.shape[1], len(self.left)
        # Which point of a scan and which of like effects is best was chosen, too.
        chosen = 2.0 * np.log(min(points, values)) * shape.scanned + 2.0 * np.log(shape.rivals)
        more, counted = self.with_columns(added), (d + shape.scanned) * bool(d)
        return Explained(
            self.between,
            more.left,
            more.basis,
            (*self.columns, columns),
            self.parameters + counted,
            self.penalty + float(d * np.log(values) + chosen + _ODDS * counted),
        )

    def beside(self, at_values: FloatArray) -> FloatArray:
        """Columns (values, points, d) made orthonormal beside the basis, (g, points, d); zeros if nothing is left."""
        values, points, d = at_values.shape
        flat = self.between.of_values @ at_values.reshape(values, -1)
        # Between values a column may be next to nothing, and rounding then: its length is that before.
        norms = np.linalg.norm(np.abs(self.between.of_values) @ np.abs(at_values.reshape(values, -1)), axis=0)
        columns = (flat - self.basis @ (self.basis.T @ flat)).reshape(len(flat), points, d)
        for k in range(d):
            for j in range(k):
                columns[:, :, k] -= columns[:, :, j] * np.sum(columns[:, :, j] * columns[:, :, k], axis=0)
            length = np.linalg.norm(columns[:, :, k], axis=0)
            real = length > INDEPENDENT * norms.reshape(points, d)[:, k]
            columns[:, :, k] *= np.where(real, 1.0 / np.where(real, length, 1.0), 0.0)
        return columns

    @property
    def misfit(self) -> float:
        """Square sum of what is left, in units of the variance within values."""
        return float(self.left @ self.left) / self.between.within

    @property
    def degrees(self) -> int:
        """Of freedom of what is left."""
        return int(len(self.left) - self.basis.shape[1])

    def without_offsets(self) -> float:
        """-2 log likelihood and penalty where readings scatter between values as they do within."""
        return self.misfit + self.penalty

    def with_offsets(self) -> float:
        """The same where what is left are offsets, of the size that is likeliest."""
        g = len(self.left)
        ratio = max(self.misfit / g, 1.0)
        return float(g * np.log(ratio)) + self.misfit / ratio + self.penalty + float(np.log(g))

    def is_smooth_along(self, number: FloatArray) -> bool:
        """Whether what is left goes slowly with a number of the values (von Neumann's ratio)."""
        total = self.between.of_values.T @ self.left
        ordered = (total / self.between.counts)[np.argsort(number)]
        k = len(ordered)
        ratio = float(np.sum(np.diff(ordered) ** 2) / np.sum((ordered - ordered.mean()) ** 2))
        return ratio < 2.0 + float(special.ndtri(_ROUGH) * 2.0 * np.sqrt((k - 2.0) / (k**2 - 1.0)))

    def p_value(self) -> float:
        """Of what is left between values, against the scatter within them."""
        if self.degrees < 1:
            return 1.0
        return float(special.fdtrc(self.degrees, self.between.degrees, self.misfit / self.degrees))


def shares_offsets(between: Between, shapes: Sequence[Shape], numbers: Sequence[FloatArray], level: float) -> bool:
    """Whether readings scatter more between values than within, and offsets say why better than effects do.

    A set-point shows effects, which take few parameters; of offsets each is a number of its own. The likelihoods are
    compared, with what is chosen and how many parameters it has as Schwarz counts them.
    """
    found = [Explained.by_nothing(between)]
    # Readings that repeat exactly say nothing of their scatter.
    exact = between.within <= _ROUNDING * float(between.along @ between.along)
    if between.degrees < 1 or exact or found[0].p_value() >= level:
        return False
    beam, most = list(found), min(max(4, len(between.along) // 2), len(between.along) - 1)
    for _ in range(_EFFECTS_MAX):
        more = [each.with_best(shape) for each in beam for shape in shapes]
        beam = sorted((each for each in more if each.parameters <= most), key=Explained.without_offsets)[:_BEAM]
        found += beam
    best = min(found, key=Explained.with_offsets)
    if best.p_value() >= level or best.with_offsets() >= min(each.without_offsets() for each in found):
        return False
    return not any(best.is_smooth_along(number) for number in numbers)


def significant_between(between: Between, shapes: Sequence[Shape], level: float) -> FloatArray | None:
    """The effect that stands out most of the scatter between values, (values, d); None if none does.

    The p-value is corrected for all effects and scans. Its F test has what is left
    between values for its noise, whatever the scatter within.
    """
    none = Explained.by_nothing(between)
    families = {shape.family for shape in shapes}
    least, found = level, None
    for shape in shapes:
        more = none.with_best(shape)
        d = none.degrees - more.degrees
        if not d or more.degrees <= shape.scanned:
            continue
        taken, left = float(none.left @ none.left - more.left @ more.left), float(more.left @ more.left)
        p_value = float(special.fdtrc(d, more.degrees, taken / d / max(left / more.degrees, np.finfo(float).tiny)))
        trials = min(len(shape.grid()), len(between.along)) if shape.scanned else _trials(shape, shapes)
        # Each family has one portion of the level, as in a search.
        corrected = -np.expm1(trials * len(families) * np.log1p(-min(p_value, 1.0 - 1e-16)))
        if corrected < least:
            least, found = float(corrected), more.columns[-1]
    return found


def _trials(shape: Shape, shapes: Sequence[Shape]) -> int:
    alike = sum(each.family == shape.family for each in shapes)
    return min(alike, _SMOOTH_TRIALS) if shape.family.startswith("smooth[") else alike
