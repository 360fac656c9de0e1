"""In which order the columns of a table are taken: that of their contents, not of the file."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from rigctl.core.arrays import FloatArray, TextArray

# Of numbers between -1 and 1: what a change of units leaves the same.
_DECIMALS = 6


def in_order(
    samples: Mapping[str, FloatArray],
    texts: Mapping[str, Sequence[str]],
    response: str,
    first: Collection[str],
    excluded: Sequence[int] = (),
) -> tuple[dict[str, FloatArray], dict[str, Sequence[str]]]:
    """Columns of numbers and of words by what they contain, those named `first` before the others.

    Columns are told apart by how their values are spread and go with the response in rows that are not `excluded`,
    which neither their names, units and zeros nor the order of rows change; by name where that is the same.
    """
    known = np.isfinite(samples[response])
    known[list(excluded)] = False
    if not known.any():
        return dict(samples), dict(texts)
    level = _standard(samples[response][known])

    def of_numbers(name: str) -> tuple[bool, tuple[float, ...], str]:
        return name not in first, _spread(samples[name][known], level), name

    def of_words(name: str) -> tuple[tuple[float, ...], str]:
        return _groups(np.array(texts[name], dtype=np.str_)[known], level), name

    return {name: samples[name] for name in sorted(samples, key=of_numbers)}, {
        name: texts[name] for name in sorted(texts, key=of_words)
    }


def _spread(values: FloatArray, level: FloatArray) -> tuple[float, ...]:
    """How many values are missing, skewness, and correlations of the values and their squares with the response."""
    there = np.isfinite(values)
    standard, level = _standard(values[there]), level[there]
    moments = (np.mean(standard**3), np.mean(standard * level), np.mean(standard**2 * level)) if there.any() else ()
    return (float(np.sum(~there)), *(round(float(each), _DECIMALS) for each in moments))


def _groups(words: TextArray, level: FloatArray) -> tuple[float, ...]:
    """How many words there are, how even they are, and how far they tell the response."""
    group, count = np.unique(words, return_inverse=True, return_counts=True)[1:]
    sums = np.bincount(group.ravel(), level)
    told = (np.sum(count.astype(np.float64) ** 2) / len(words) ** 2, np.sum(sums**2 / count) / len(words))
    return (float(len(count)), *(round(float(each), _DECIMALS) for each in told))


def _standard(values: FloatArray) -> FloatArray:
    """Values less their mean in units of their standard deviation; zeros of a column that is constant."""
    if not values.size or np.ptp(values) == 0.0:
        return np.zeros(values.size)
    # Squares of large values would overflow.
    away = (values - values.mean()) / np.ptp(values)
    return np.asarray(away / away.std())
