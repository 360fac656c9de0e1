"""All runs there are, as one triangle: everything a question needs of them.

Whitened derivatives become R of a QR factorisation, square roots of information matrices and never their squares:
absorbed effects, of which a part in 1e4 and less is left, would drown in the rounding of normal equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import FloatArray, IntArray
from rigctl.workbench.next.imagined import Imagined
from rigctl.workbench.study import Candidate, Term

ROUNDING = 1e-7
"""Of a column's length: columns that are multiples of others must not leave a direction open by rounding."""

SECOND_ORDER = 1e-4
"""Of an effect's: a fit holds what others imitate at zero, so the little that is left of it imitates nothing."""


@dataclass(frozen=True)
class Triangle:
    """The runs there are as `root` (c, c), those that could be made as rows `ahead` (runs, rows, c).

    Columns, all divided by their `length` (c,): `free` of them are parameters that are free, first those of `names`;
    then come those of terms (`places` says which). What no further run touches, above all the nuisances of other
    mountings, has been eliminated: `settled` (rows, c) is what of the columns went with it.
    """

    root: FloatArray
    ahead: FloatArray
    length: FloatArray
    settled: FloatArray
    free: int
    names: tuple[str, ...]
    places: tuple[tuple[Term, IntArray], ...]


def triangle_of(
    imagined: Imagined,
    terms: Sequence[Term] = (),
    *,
    others: Sequence[Candidate] = (),
    wanted: Sequence[str] = (),
    made: int | None = None,
) -> Triangle:
    """Of everything fitted and of `terms`, as far as runs can be asked about them.

    `others` may act too, as far as their typical sizes. Fitted parameters that are `wanted` stay even if no further
    run touches them. Only the first `made` rows count as there, by default all beliefs and data.
    """
    there, ahead = slice(imagined.made if made is None else made), slice(imagined.made, None)
    kept = np.any(imagined.fitted[ahead] != 0.0, axis=0) | np.isin(imagined.names, list(wanted))
    # A prior as weak as possible: what is left of an absorbed effect must not pass for information.
    firmness = np.where(imagined.of_effects, SECOND_ORDER, ROUNDING)
    places, asked = _columns_of(terms, imagined)
    possible, sizes = _possible(others, imagined)
    columns = np.hstack([imagined.fitted[:, kept], possible, asked])
    settled, left = _eliminated(imagined.fitted[there, ~kept], firmness[~kept], columns[there])
    runs = _by_run(columns[ahead], imagined)
    length = _length(settled, left, runs)
    # Free are the fitted parameters that stay and the effects that may act too; what is asked comes last.
    count = int(np.sum(kept))
    free = count + len(sizes)
    # Priors as rows: almost none on what is fitted, typical sizes for what may act too, none on what is asked.
    belief = np.concatenate([firmness[kept], 1.0 / (sizes * length[count:free]), np.zeros(asked.shape[1])])
    return Triangle(
        root=root_of(np.vstack([np.diag(belief), left / length])),
        ahead=runs / length,
        length=length,
        settled=settled / length,
        free=free,
        names=tuple(name for name, keep in zip(imagined.names, kept, strict=True) if keep),
        places=places,
    )


def root_of(rows: FloatArray) -> FloatArray:
    """R of a QR factorisation of rows (n, c): square even where there are fewer rows than columns."""
    root = np.linalg.qr(rows, mode="r")
    return np.vstack([root, np.zeros((rows.shape[1] - len(root), rows.shape[1]))])


def _columns_of(terms: Sequence[Term], imagined: Imagined) -> tuple[tuple[tuple[Term, IntArray], ...], FloatArray]:
    """Derivatives by terms side by side, and where each has its own."""
    places: list[tuple[Term, IntArray]] = []
    columns = [np.zeros((len(imagined.fitted), 0))]
    for term in terms:
        derivatives = imagined.columns(term)
        if derivatives is not None:
            first = sum(each.shape[1] for each in columns)
            places.append((term, np.arange(first, first + derivatives.shape[1])))
            columns.append(derivatives)
    return tuple(places), np.hstack(columns)


def _possible(others: Sequence[Candidate], imagined: Imagined) -> tuple[FloatArray, FloatArray]:
    """Derivatives by effects side by side, as far as runs can be asked about them, and their typical sizes."""
    known, columns = _columns_of([each.term for each in others], imagined)
    terms = [term for term, _ in known]
    return columns, np.concatenate([np.zeros(0), *(each.typical for each in others if each.term in terms)])


def _eliminated(settled: FloatArray, firmness: FloatArray, others: FloatArray) -> tuple[FloatArray, FloatArray]:
    """R of the other columns: the rows that settle what comes first, and those that are left when it is fitted."""
    length = np.linalg.norm(settled, axis=0)
    belief = np.diag(firmness * np.where(length > 0.0, length, 1.0))
    none = np.zeros((len(belief), others.shape[1]))
    # One factorisation eliminates: below the rows of what is settled stands the triangle of the rest.
    root = root_of(np.vstack([np.hstack([belief, none]), np.hstack([settled, others])]))
    return root[: len(belief), len(belief) :], root[len(belief) :, len(belief) :]


def _by_run(rows: FloatArray, imagined: Imagined) -> FloatArray:
    """Rows of each proposal, (proposals, rows of the longest, columns), zeros below those of shorter ones."""
    longest = max((len(each) for each in imagined.rows_of), default=0)
    padded = np.zeros((len(imagined.rows_of), longest, rows.shape[1]))
    for run, where in enumerate(imagined.rows_of):
        padded[run, : len(where)] = rows[where - imagined.made]
    return padded


def _length(settled: FloatArray, left: FloatArray, ahead: FloatArray) -> FloatArray:
    """Of each column, with the run ahead that tells most of it."""
    most = np.max(np.sum(ahead**2, axis=1), axis=0, initial=0.0)
    length = np.sqrt(np.sum(settled**2, axis=0) + np.sum(left**2, axis=0) + most)
    return np.where(length > 0.0, length, 1.0)
