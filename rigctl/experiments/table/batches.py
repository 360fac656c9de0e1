"""Readings that share an unknown offset: the columns of `batch`, and columns of five words or more."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rigctl.analysis.variance_components import variance_components
from rigctl.core.arrays import FloatArray, IntArray
from rigctl.experiments.table.catalogue import why_not
from rigctl.experiments.table.model.form import Form, TableEffect
from rigctl.experiments.table.model.scanned import Scanned
from rigctl.experiments.table.model.words import Level, Slope
from rigctl.experiments.table.observe.readings import Readings
from rigctl.workbench.study import SharedOffset
from rigctl.workbench.verdict.saturated import Hidden, saturated

# Of fewer levels a variance cannot be estimated (decision 046).
WORDS_OF_A_SCATTER = 5
"""Fewer words are a fixed number each, `level[W]`."""

SIGNIFICANT = 0.05
READINGS_MAX = 2000
"""Beyond, offsets are not looked for: their covariance is a matrix of all readings."""

Ratios = Mapping[str, float]
"""Of columns, the variance of what readings of one value share, to that of a single reading."""


def ratios_of(
    readings: Readings, left: FloatArray, slopes: FloatArray, effects: Mapping[str, TableEffect]
) -> dict[str, float]:
    """Variance components of what the baseline leaves, (n,); those of `batch` always, others where significant.

    What effects of the catalogue do within batches is projected out; between batches only what the baseline does, so
    that effects that vary only there are judged against the batches.
    """
    levels = levels_of(readings)
    if not levels or left.size > READINGS_MAX:
        return {}
    weights = readings.sigma[:, None]
    hidden = _within(readings, effects, levels)
    design = saturated(slopes / weights, [Hidden(hidden.columns / weights, hidden.effect_of)])
    # Without one component the others change: asked again until all that remain are significant.
    asked = dict(levels)
    while True:
        found = variance_components(left / readings.sigma, design, list(asked.values()))
        kept = [
            name
            for name, p_value in zip(asked, found.p_values, strict=True)
            if name in readings.spec.batch or p_value < SIGNIFICANT
        ]
        if len(kept) == len(asked):
            return dict(zip(asked, map(float, found.ratios), strict=True))
        if not kept:
            return {}
        asked = {name: asked[name] for name in kept}


def levels_of(readings: Readings) -> dict[str, IntArray]:
    """Columns whose readings may share offsets, and the place of each reading among their values, (n,)."""
    levels: dict[str, IntArray] = {}
    outer = np.zeros(readings.sigma.size, dtype=np.intp)
    for name in readings.spec.batch:
        inner = np.unique(readings.categories[name].values, return_inverse=True)[1]
        # Nested: bottle 1 of the second day is another than bottle 1 of the first.
        outer = np.unique(np.stack([outer, inner], axis=1), axis=0, return_inverse=True)[1].ravel()
        levels[name] = outer
    for name, category in readings.categories.items():
        if name not in levels and category.names_groups and len(category.levels) >= WORDS_OF_A_SCATTER:
            levels[name] = np.unique(category.values, return_inverse=True)[1]
    return levels


def shared_offsets(readings: Readings, ratios: Ratios) -> tuple[SharedOffset, ...]:
    """As the workbench is told of them."""
    # In units of the variance of a single reading, its own part included.
    levels, total = levels_of(readings), 1.0 + sum(ratios.values())
    return tuple(
        SharedOffset(name, levels[name], float(np.sqrt(ratio / total)))
        for name, ratio in ratios.items()
        if ratio > 0.0
    )


def correlation(offsets: tuple[SharedOffset, ...], count: int) -> tuple[tuple[IntArray, FloatArray], ...]:
    """Of all readings, as `Observations.factors` has it."""
    if not offsets:
        return ()
    # Unit diagonal: the sigmas hold the whole variance.
    matrix = np.eye(count) * (1.0 - sum(each.share**2 for each in offsets))
    for each in offsets:
        matrix += each.share**2 * np.equal.outer(each.level_of, each.level_of)
    return ((np.arange(count), np.asarray(np.linalg.cholesky(matrix))),)


def _within(readings: Readings, effects: Mapping[str, TableEffect], levels: Mapping[str, IntArray]) -> Hidden:
    """What effects of fixed shape do, less its means where all batches are the same."""
    n = readings.sigma.size
    cells = np.unique(np.stack(list(levels.values()), axis=1), axis=0, return_inverse=True)[1].ravel()
    count = np.bincount(cells)
    asked = [
        # A number for each word: which of them the others are counted from has no part in it.
        (effect.basis(effect.choices(lambda _: False)[0]), isinstance(effect, Level | Slope))
        for effect in effects.values()
        if isinstance(effect, Form)
        and not isinstance(effect, Scanned)
        and not (why_not(effect, readings) or effect.unasked())
    ]
    hidden = Hidden.of(asked, n)
    means = [np.bincount(cells, column) / count for column in hidden.columns.T]
    inside = hidden.columns - np.stack(means, axis=1)[cells] if means else hidden.columns
    # What varies between batches only is rounding within them.
    real = np.linalg.norm(inside, axis=0) > 1e-9 * np.linalg.norm(hidden.columns, axis=0)
    return hidden.keep(inside, real)
