"""Readings that share an unknown offset: the columns of `batch`, words of five or more, numbers that name batches."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy import sparse

from rigctl.analysis.correlated_groups import CorrelatedGroups, Factor
from rigctl.analysis.variance_components import variance_components
from rigctl.core.arrays import FloatArray, IntArray
from rigctl.core.errors import DataError
from rigctl.experiments.table.between import Between, shapes_between
from rigctl.experiments.table.catalogue import why_not
from rigctl.experiments.table.explained import shares_offsets, significant_between
from rigctl.experiments.table.model.form import Form, TableEffect
from rigctl.experiments.table.model.forms import Offset
from rigctl.experiments.table.model.scanned import Scanned
from rigctl.experiments.table.model.words import Level, Slope
from rigctl.experiments.table.observe.readings import Column, Readings
from rigctl.workbench.study import SharedOffset
from rigctl.workbench.verdict.saturated import Hidden, saturated

# Of fewer levels a variance cannot be estimated (decision 046).
WORDS_OF_A_SCATTER = 5
"""Fewer words are a fixed number each, `level[W]`; fewer numbers are set-points."""

READINGS_OF_A_NUMBER = 2
"""So many readings has a number that names batches, in the mean."""

DISPERSION = 0.5
"""Variance over mean of how often a value is read: lots are of a size (0), what is rounded repeats by chance (1)."""

SIGNIFICANT = 0.05
SIGNIFICANT_NUMBER = 0.01
"""Of all numbers that repeat together: most are set-points."""

SIGNIFICANT_CHANCE, VALUES_BY_CHANCE = 1e-6, 50
"""The same of numbers that repeat as if by chance, and how many values they need."""

SIGNIFICANT_EFFECT = 0.01
_EFFECTS_MAX = 5
_SHARE_BETWEEN = 1.0 / 3.0
_KNOWN_WITHIN = 1.0 / 3.0
"""Of the variance of a number: with so much of it within batches the size of its effects is known from there."""
NEVER_TOO_MANY, READINGS_MAX, TOGETHER_MAX, NUMBERS_MAX = 2_000, 10_000, 2_000, 4_000_000
"""Up to so many readings offsets are always looked for; of more, where there are no more readings, none that hang
together and no more readings times values than this: what takes a minute and 3 GB."""

FEW_READINGS = 500
"""One matrix of so many is faster than one for each batch."""

Ratios = Mapping[str, float]
"""Of columns, the variance of what readings of one value share, to that of a single reading."""

Levels = dict[str, IntArray]


def ratios_of(
    readings: Readings, left: FloatArray, slopes: FloatArray, effects: Mapping[str, TableEffect]
) -> dict[str, float]:
    """Variance components of what the baseline leaves, (n,); those of `batch` always, others where significant.

    What effects of the catalogue do within batches is projected out; between batches what the baseline does, and the
    effects that stand out of the batches' scatter: other effects that vary only there are judged against it.
    """
    scatter = Scatter(readings, effects, left, slopes)
    levels = levels_of(readings)
    if are_too_many(list(levels.values())):
        levels = {name: level for name, level in levels.items() if name in readings.spec.batch}
        if are_too_many(list(levels.values())):
            raise DataError(
                f"recording.toml: [table] batch: offsets of {left.size} readings with "
                f"{' and '.join(f'{level.max() + 1} values of {name}' for name, level in levels.items())} "
                "are too many to be told from noise; give a part of the readings, or the mean of each batch"
            )
    found = scatter.ratios(levels) if levels else {}
    for name in scatter.numbers(found):
        more = scatter.ratios({each: level_of(readings, each) for each in (*found, name)})
        found = more if name in more else found
    return found


@dataclass(frozen=True)
class Scatter:
    """What the baseline leaves of the readings, `left` (n,), where its derivatives are `slopes` (n, m)."""

    readings: Readings
    effects: Mapping[str, TableEffect]
    left: FloatArray
    slopes: FloatArray

    def ratios(self, asked: Levels) -> dict[str, float]:
        """Of these columns, without those that are not needed; effects between batches are taken out one by one."""
        beside, found = self, self._components(asked)
        for _ in range(_EFFECTS_MAX):
            columns = beside._effect_between(found, {name: asked[name] for name in found})
            if columns is None:
                break
            beside = replace(beside, slopes=np.hstack([beside.slopes, columns]))
            found = beside._components(asked)
        return found

    def numbers(self, known: Collection[str]) -> Iterator[str]:
        """Columns of numbers whose values name batches; of those that sort the readings alike one."""
        taken = {_partition(level_of(self.readings, name)) for name in known}
        alike: dict[bytes, list[Column]] = {}
        for column in self.readings.columns.values():
            if _may_name_batches(column, self.readings):
                alike.setdefault(_partition(level_of(self.readings, column.name)), []).append(column)
        others = [level_of(self.readings, name) for name in known]
        asked = [
            columns
            for partition, columns in alike.items()
            if partition not in taken and not are_too_many([*others, level_of(self.readings, columns[0].name)])
        ]
        for columns in asked:
            # Lots are numbered one by one, what else differs between them is not.
            name = min(columns, key=lambda column: not _is_even(column)).name
            # Set-points of one quantity leave the others as they are: what they share besides is of a batch.
            level = SIGNIFICANT_NUMBER if _is_read_evenly(columns[0]) else SIGNIFICANT_CHANCE
            if self._share_conditions(level_of(self.readings, name)) or self._shares_offsets(
                name, columns, level / len(asked)
            ):
                yield name

    def _share_conditions(self, level: IntArray) -> bool:
        """Whether two numbers or more that are no functions of each other are the same in all readings of a value."""
        rows, inverse = np.unique(level, return_index=True, return_inverse=True)[1:]
        values = [
            column.values[rows]
            for column in self.readings.columns.values()
            if column.distinct.size >= WORDS_OF_A_SCATTER
            and np.array_equal(column.values, column.values[rows][inverse])
        ]
        return any(not _go_together(one, other) for one, other in combinations(values, 2))

    def _shares_offsets(self, name: str, alike: Sequence[Column], level: float) -> bool:
        level_of_each = level_of(self.readings, name)
        design = self._design({name: level_of_each}, self._weighed)
        between = Between.of(self._weighed(self.left), design, self._weighed(_indicators(level_of_each)))
        rows = np.unique(level_of_each, return_index=True)[1]
        numbers = [column.values[rows] for column in alike]
        return shares_offsets(between, shapes_between(self.readings, self.effects, level_of_each), numbers, level)

    def _components(self, asked: Levels) -> dict[str, float]:
        design = self._design(asked, self._weighed)
        # Without one component the others change: asked again until all that remain are significant.
        while asked:
            found = variance_components(self._weighed(self.left), design, list(asked.values()))
            p_values = {
                name: float(p_value)
                for name, p_value in zip(asked, found.p_values, strict=True)
                if name not in self.readings.spec.batch
            }
            # Of columns that sort the readings alike each seems useless beside the others: one at a time.
            worst = max(reversed(p_values), key=lambda name: p_values[name], default=None)
            if worst is None or p_values[worst] < SIGNIFICANT:
                return dict(zip(asked, map(float, found.ratios), strict=True))
            asked = {name: level for name, level in asked.items() if name != worst}
        return {}

    def _effect_between(self, ratios: Ratios, levels: Levels) -> FloatArray | None:
        """What an effect that stands out of the scatter between batches does, (n, d)."""
        offsets = tuple(SharedOffset(name, levels[name], share) for name, share in _shares(ratios).items())
        if not offsets:
            return None
        groups = CorrelatedGroups(correlation(offsets, self.left.size), self.left.size)

        def white(columns: FloatArray) -> FloatArray:
            return groups.solve(self._weighed(columns))

        design = self._design(levels, white)
        for level in levels.values():
            shapes = shapes_between(self.readings, self.effects, level)
            between = Between.of(white(self.left), design, white(_indicators(level)))
            found = significant_between(between, shapes, SIGNIFICANT_EFFECT)
            if found is not None:
                return found[level]
        return None

    def _weighed(self, columns: FloatArray) -> FloatArray:
        sigma = self.readings.sigma
        return np.asarray(columns / (sigma if columns.ndim == 1 else sigma[:, None]))

    def _design(self, levels: Levels, weigh: Callable[[FloatArray], FloatArray]) -> FloatArray:
        hidden = _within(self.readings, self.effects, levels)
        return saturated(weigh(self.slopes), [Hidden(weigh(hidden.columns), hidden.effect_of)])


def levels_of(readings: Readings) -> Levels:
    """Columns of words whose readings may share offsets, and the place of each reading among their values, (n,)."""
    names = [
        name
        for name, category in readings.categories.items()
        if name in readings.spec.batch or (category.names_groups and len(category.levels) >= WORDS_OF_A_SCATTER)
    ]
    first = [name for name in readings.spec.batch if name in names]
    return {name: level_of(readings, name) for name in (*first, *(each for each in names if each not in first))}


def level_of(readings: Readings, name: str) -> IntArray:
    """The place of each reading among the values of a column, (n,); those of `batch` are nested."""
    if name not in readings.spec.batch:
        return np.asarray(np.unique(readings.given[name], return_inverse=True)[1], dtype=np.intp)
    outer = np.zeros(readings.sigma.size, dtype=np.intp)
    for each in readings.spec.batch[: readings.spec.batch.index(name) + 1]:
        inner = np.unique(readings.categories[each].values, return_inverse=True)[1]
        # Nested: bottle 1 of the second day is another than bottle 1 of the first.
        outer = np.unique(np.stack([outer, inner], axis=1), axis=0, return_inverse=True)[1].ravel()
    return outer


def shared_offsets(readings: Readings, ratios: Ratios) -> tuple[SharedOffset, ...]:
    """As the workbench is told of them."""
    return tuple(SharedOffset(name, level_of(readings, name), share) for name, share in _shares(ratios).items())


def _shares(ratios: Ratios) -> dict[str, float]:
    # In units of the variance of a single reading, its own part included.
    total = 1.0 + sum(ratios.values())
    return {name: float(np.sqrt(ratio / total)) for name, ratio in ratios.items() if ratio > 0.0}


def correlation(offsets: tuple[SharedOffset, ...], count: int) -> tuple[Factor, ...]:
    """Of so many readings, as `Observations.factors` has it: those that share nothing are groups of their own."""
    if not offsets:
        return ()
    factors = []
    for members in readings_together([each.level_of for each in offsets], count):
        # Unit diagonal: the sigmas hold the whole variance.
        matrix = np.eye(len(members)) * (1.0 - sum(each.share**2 for each in offsets))
        for each in offsets:
            level = each.level_of[members]
            matrix += each.share**2 * np.equal.outer(level, level)
        factors.append((members, np.asarray(np.linalg.cholesky(matrix))))
    return tuple(factors)


def are_too_many(levels: Sequence[IntArray]) -> bool:
    """Whether offsets of these values, (n,) each, would take too long to be told."""
    count = len(levels[0]) if levels else 0
    if count <= NEVER_TOO_MANY:
        return False
    values = sum(int(level.max()) + 1 for level in levels)
    if count > READINGS_MAX or count * values > NUMBERS_MAX:
        return True
    return max(map(len, readings_together(levels, count))) > TOGETHER_MAX


def readings_together(levels: Sequence[IntArray], count: int) -> list[IntArray]:
    """Readings that hang together by values they share, each set in the order of the readings; of few all."""
    if count <= FEW_READINGS:
        return [np.arange(count)]
    # Each value is a node that its readings are tied to.
    begins = count + np.cumsum([0, *(int(level.max()) + 1 for level in levels)])
    ties = np.tile(np.arange(count), len(levels)), np.concatenate(list(map(np.add, levels, begins)))
    graph = sparse.coo_matrix((np.ones(len(ties[0])), ties), (begins[-1], begins[-1]))
    together = sparse.csgraph.connected_components(graph, directed=False)[1][:count]
    ends = np.cumsum(np.unique(together, return_counts=True)[1])[:-1]
    return np.split(np.argsort(together, kind="stable"), ends)


def _may_name_batches(column: Column, readings: Readings) -> bool:
    """Whether readings repeat its values, and neither the baseline nor the order is about them."""
    if column.name in (*readings.expression.columns, readings.spec.order) or not np.isfinite(column.values).all():
        return False
    if not WORDS_OF_A_SCATTER <= column.distinct.size <= column.values.size // READINGS_OF_A_NUMBER:
        return False
    return _is_read_evenly(column) or column.distinct.size >= VALUES_BY_CHANCE


def _is_read_evenly(column: Column) -> bool:
    count = np.unique(column.values, return_counts=True)[1]
    return bool(count.var(ddof=1) <= DISPERSION * count.mean())


def _go_together(one: FloatArray, other: FloatArray) -> bool:
    """Whether one of two numbers rises or falls with the other throughout, as in another unit it does."""
    steps = np.diff(one[np.lexsort((one, other))])
    return bool(np.all(steps >= 0.0) or np.all(steps <= 0.0))


def _is_even(column: Column) -> bool:
    steps = np.diff(column.distinct)
    return bool(np.ptp(steps) <= 1e-9 * steps.max())


def _partition(level: IntArray) -> bytes:
    """The same for all columns that sort the readings alike."""
    first, inverse = np.unique(level, return_index=True, return_inverse=True)[1:]
    return first[inverse].tobytes()


def _indicators(level: IntArray) -> FloatArray:
    return np.equal.outer(level, np.arange(level.max() + 1)).astype(np.float64)


def _within(readings: Readings, effects: Mapping[str, TableEffect], levels: Mapping[str, IntArray]) -> Hidden:
    """What effects of fixed shape do; of those that are nearly the same within batches the part within only.

    With the part between, an effect that is known by what it does within says what it does between: half of a square
    of x, at two readings per batch, would else count as the batches' scatter.
    """
    n = readings.sigma.size
    cells = np.unique(np.stack(list(levels.values()), axis=1), axis=0, return_inverse=True)[1].ravel()
    count = np.bincount(cells)
    forms = [
        effect
        for effect in effects.values()
        if isinstance(effect, Form)
        and not isinstance(effect, Scanned)
        and not (why_not(effect, readings) or effect.unasked())
    ]
    # A number for each word: which of them the others are counted from has no part in it.
    asked = [(form.basis(form.choices(lambda _: False)[0]), isinstance(form, Level | Slope)) for form in forms]
    widths = [basis.shape[1] for basis, _ in asked]
    whole = np.repeat([_is_known_within(form, cells) for form in forms], widths).astype(bool)
    # Of few batches they would leave next to nothing to tell offsets by.
    whole &= whole.sum() <= _SHARE_BETWEEN * len(count)
    hidden = Hidden.of(asked, n)
    means = [np.bincount(cells, column) / count for column in hidden.columns.T]
    inside = hidden.columns - np.stack(means, axis=1)[cells] if means else hidden.columns
    # What varies between batches only is rounding within them.
    real = whole | (np.linalg.norm(inside, axis=0) > 1e-9 * np.linalg.norm(hidden.columns, axis=0))
    return hidden.keep(np.where(whole, hidden.columns, inside), real)


def _is_known_within(form: Form, cells: IntArray) -> bool:
    """Whether its size is known from within batches, by its numbers' variance; slopes by lot span what lots share."""
    # That of all readings is what batches scatter about.
    if isinstance(form, Offset):
        return True
    # Of a product one number is enough: with the other's zero moved it is that number's line besides.
    return not isinstance(form, Level | Slope) and any(
        np.var(column.values - (np.bincount(cells, column.values) / np.bincount(cells))[cells])
        > _KNOWN_WITHIN * np.var(column.values)
        for column in form.columns
    )
