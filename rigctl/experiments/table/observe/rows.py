"""Which rows of a table are readings, and in which order they are taken: that of their contents, not of the file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rigctl.core.arrays import FloatArray, IntArray, TextArray
from rigctl.core.readings import pasted_rows


def readings_of(
    samples: Mapping[str, FloatArray],
    texts: Mapping[str, Sequence[str]],
    response: str,
    order: str | None,
    needed: Sequence[str],
    excluded: Sequence[int] = (),
) -> IntArray:
    """Rows that have all that is `needed` and are not `excluded`, pasted ones once, sorted by their contents; indices
    in the file.

    By the column `order` first, then by the others in their order here (`column_order`), words last: blocks that are
    held out and draws of noise thus do not depend on the order of rows.
    """
    rows = np.flatnonzero(np.isfinite([samples[name] for name in needed]).all(axis=0))
    rows = np.setdiff1d(rows, excluded)
    if not rows.size:
        return rows
    columns = [name for name in samples if name not in (response, order)]
    first = [] if order is None else [order]
    # The last key sorts first.
    keys: list[FloatArray | TextArray] = [samples[name][rows] for name in (*first, *columns, response)]
    keys += [np.array(text, dtype=np.str_)[rows] for text in texts.values()]
    sorting = np.lexsort(keys[::-1])
    if not _some_are_equal(keys, sorting):
        return np.asarray(rows[sorting], dtype=np.intp)
    others: list[Sequence[object]] = [values[rows].tolist() for name, values in samples.items() if name != response]
    others += [[text[row] for row in rows.tolist()] for text in texts.values()]
    copies = pasted_rows(samples[response][rows], others)[0]
    return np.asarray(rows[sorting[~np.isin(sorting, copies)]], dtype=np.intp)


def _some_are_equal(keys: Sequence[FloatArray | TextArray], sorting: IntArray) -> bool:
    """Whether two rows are equal in all keys, in whose order they are sorted."""
    equal = np.ones(len(sorting) - 1, dtype=np.bool_)
    for key in keys:
        values = key[sorting]
        same = values[1:] == values[:-1]
        if key.dtype.kind == "f":
            # Two missing numbers are equal here.
            same |= (values[1:] != values[1:]) & (values[:-1] != values[:-1])
        equal &= same
        if not equal.any():
            return False
    return True
