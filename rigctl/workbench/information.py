"""What runs, made or imagined, would tell: square roots of information matrices, never their squares.

Rows of whitened derivatives with an effect's columns last: the last block R of their QR factor has R'R = V, the
information on the effect with everything before it fitted too (R is the root of the Schur complement). Absorbed
effects, of which a part in 1e4 and less is left, would drown in the rounding of normal equations.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import solve_triangular

from rigctl.workbench.imagined import Imagined
from rigctl.workbench.questions import Question
from rigctl.workbench.score import ABSORBED
from rigctl.workbench.study import FloatArray, IntArray, Term

_RIDGE = 1e-7
"""Of a column's length: columns that are multiples of others must not leave a direction open by rounding."""


class Triangle:
    """The runs there are as one QR factor, from which every question takes its columns.

    What no further run touches, above all the nuisances of other mountings, is eliminated once. `terms` are what will
    be asked about, `wanted` the fitted parameters that `precision` is to tell of. Only the first `made` rows count as
    there, by default all beliefs and data.
    """

    def __init__(
        self, imagined: Imagined, terms: Sequence[Term] = (), wanted: Sequence[str] = (), made: int | None = None
    ) -> None:
        fitted = imagined.fitted
        touched = np.any(fitted[imagined.made :] != 0.0, axis=0)
        kept = touched | np.isin(imagined.names, list(wanted))
        self._wanted = tuple(wanted)
        self._names = [name for name, keep in zip(imagined.names, kept, strict=True) if keep]
        columns = [fitted[:, kept]]
        self._where: list[tuple[Term, IntArray]] = []
        for term in terms:
            own = imagined.columns(term)
            if own is not None:
                first = sum(each.shape[1] for each in columns)
                self._where.append((term, np.arange(first, first + own.shape[1])))
                columns.append(own)
        there = slice(imagined.made if made is None else made)
        remaining = np.hstack([each[there] for each in columns])
        self._settled, self._made = _eliminated(fitted[there, ~kept], remaining)
        self._ahead = _by_run(np.hstack([each[imagined.made :] for each in columns]), imagined)

    def about(self, question: Question) -> Information | None:
        """What is known of a question; None when no run can be asked."""
        own, rival = self._columns(question.term), self._columns(question.rival)
        if own is None or rival is None or len(own) != len(question.size):
            return None
        beside = np.concatenate([np.arange(len(self._names)), own[question.size == 0.0], rival])
        size = np.zeros(self._made.shape[1])
        size[own] = question.size
        settled, made, ahead = (_asked(rows, beside, size) for rows in (self._settled, self._made, self._ahead))
        return Information(settled, made, ahead, ABSORBED if question.rival is None else 0.0)

    def precision(self) -> Precision:
        """What is known of the wanted parameters, in the order of the model's."""
        own = slice(len(self._names))
        which = np.flatnonzero(np.isin(self._names, list(self._wanted)))
        return Precision(self._settled[:, own], self._made[:, own], self._ahead[..., own], which)

    def _columns(self, term: Term | None) -> IntArray | None:
        if term is None:
            return np.zeros(0, dtype=np.intp)
        return next((where for known, where in self._where if known == term), None)


class Information:
    """What rows tell of an effect with other columns fitted; runs are added one by one.

    All arguments have the columns fitted, then the effect at the size in question: `made` (rows, m + 1) are there,
    `ahead` (runs, rows, m + 1) could be; `settled` went with what was eliminated before. `absorbed` is the share of
    the effect below which it counts as absorbed: less is of second order and promises nothing.
    """

    def __init__(self, settled: FloatArray, made: FloatArray, ahead: FloatArray, absorbed: float = 0.0) -> None:
        self._ahead = ahead
        self._absorbed = absorbed
        self._whole = float(np.sum(settled[:, -1] ** 2) + np.sum(made[:, -1] ** 2))
        ridge = _ridge(settled, made, ahead)
        ridge[:, -1] = 0.0
        self._root = _triangle(np.vstack([ridge, made]))

    @property
    def absorbed(self) -> bool:
        """Whether next to nothing of the effect escapes what is fitted."""
        return bool(self._root[-1, -1] ** 2 <= self._absorbed**2 * self._whole)

    def lambda_now(self) -> float:
        """Noncentrality of the effect, from the runs there are and those added."""
        return float(self._counted(self._root[-1, -1] ** 2, self._whole))

    def lambda_with(self, which: Sequence[int]) -> FloatArray:
        """The same with one run more, for each of these runs."""
        rows = self._ahead[np.asarray(which, dtype=np.intp)]
        beside, asked = rows[..., :-1], rows[..., -1]
        along = _over(self._root[:-1, :-1], beside)
        left = asked - along @ self._root[:-1, -1]
        gain = np.sum(_lessened(along, left[..., None]) ** 2, axis=(1, 2))
        return self._counted(self._root[-1, -1] ** 2 + gain, self._whole + np.sum(asked**2, axis=1))

    def add(self, run: int) -> None:
        """Count a run among those that are there."""
        self._root = _triangle(np.vstack([self._root, self._ahead[run]]))
        self._whole += float(np.sum(self._ahead[run, :, -1] ** 2))

    def _counted(self, free: FloatArray, whole: FloatArray | float) -> FloatArray:
        """What is absorbed counts less, the more it is."""
        if not self._absorbed:
            return np.asarray(free)
        share = free / np.where(whole > 0.0, whole, 1.0) / self._absorbed**2
        return np.asarray(free * np.where(share >= 1.0, 1.0, share**2))


class Precision:
    """Standard uncertainties of some fitted parameters, with all others free; runs are added one by one.

    `settled`, `made` and `ahead` as of `Information`, the parameters as columns; `which` of them are in question.
    """

    def __init__(self, settled: FloatArray, made: FloatArray, ahead: FloatArray, which: IntArray) -> None:
        self._ahead = ahead
        self._which = which
        self._root = _triangle(np.vstack([_ridge(settled, made, ahead), made]))

    def sigma_now(self) -> FloatArray:
        """Of each parameter in question."""
        return np.asarray(np.linalg.norm(self._spread(), axis=1))

    def sigma_with(self, which: Sequence[int]) -> FloatArray:
        """The same with one run more, for each of these runs: shape (runs, parameters)."""
        spread = self._spread()
        along = _over(self._root, self._ahead[np.asarray(which, dtype=np.intp)])
        told = np.sum(_lessened(along, along @ spread.T) ** 2, axis=1)
        return np.asarray(np.sqrt(np.maximum(np.sum(spread**2, axis=1) - told, 0.0)))

    def add(self, run: int) -> None:
        """Count a run among those that are there."""
        self._root = _triangle(np.vstack([self._root, self._ahead[run]]))

    def _spread(self) -> FloatArray:
        """Rows of R^-1: a root of the covariance."""
        return _over(self._root, np.eye(len(self._root))[self._which])


def _eliminated(settled: FloatArray, others: FloatArray) -> tuple[FloatArray, FloatArray]:
    """R of the other columns: the rows that settle what comes first, and those that are left when it is fitted."""
    size = np.linalg.norm(settled, axis=0)
    ridge = np.diag(_RIDGE * np.where(size > 0.0, size, 1.0))
    below = np.zeros((len(ridge), others.shape[1]))
    root = _triangle(np.vstack([np.hstack([ridge, below]), np.hstack([settled, others])]))
    return root[: len(ridge), len(ridge) :], root[len(ridge) :, len(ridge) :]


def _by_run(rows: FloatArray, imagined: Imagined) -> FloatArray:
    """Rows of each proposal, (proposals, rows of the longest, columns), zeros below those of shorter ones."""
    longest = max((len(each) for each in imagined.rows_of), default=0)
    found = np.zeros((len(imagined.rows_of), longest, rows.shape[1]))
    for run, where in enumerate(imagined.rows_of):
        found[run, : len(where)] = rows[where - imagined.made]
    return found


def _asked(rows: FloatArray, beside: IntArray, size: FloatArray) -> FloatArray:
    """The columns beside an effect, and it at its size."""
    return np.concatenate([rows[..., beside], (rows @ size)[..., None]], axis=-1)


def _ridge(settled: FloatArray, made: FloatArray, ahead: FloatArray) -> FloatArray:
    most = np.max(np.sum(ahead**2, axis=1), axis=0, initial=0.0)
    size = np.sqrt(np.sum(settled**2, axis=0) + np.sum(made**2, axis=0) + most)
    return np.diag(_RIDGE * np.where(size > 0.0, size, 1.0))


def _triangle(rows: FloatArray) -> FloatArray:
    """R of (..., rows, columns)."""
    return np.asarray(np.linalg.qr(rows, mode="r"))


def _over(root: FloatArray, rows: FloatArray) -> FloatArray:
    """rows R^-1 for a triangle R and rows (..., columns)."""
    flat = rows.reshape(-1, rows.shape[-1]).T
    return np.asarray(solve_triangular(root, flat, trans="T", check_finite=False).T.reshape(rows.shape))


def _lessened(along: FloatArray, left: FloatArray) -> FloatArray:
    """(1 + B B')^-1/2 of what is left, for B = `along` (runs, rows, m) and `left` (runs, rows, k).

    This is Woodbury's identity by its root: B is large where a run tells what no run before did, and of its square
    the 1 would be rounded away.
    """
    runs, rows, _ = along.shape
    one = np.broadcast_to(np.eye(rows), (runs, rows, rows))
    root = _triangle(np.concatenate([one, along.swapaxes(1, 2)], axis=1))
    return np.asarray(np.linalg.solve(root.swapaxes(1, 2), left))
