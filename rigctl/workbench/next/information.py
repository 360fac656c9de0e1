"""Information of runs, made or imagined, on terms that a model lacks and on the parameters it has.

The block of a triangle R that belongs to the terms has R'R = V = G' M G, the information on them with everything
fitted too: R is the root of the Schur complement. A run more adds to V by Woodbury's identity, all runs that could be
made in one batch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from rigctl.core.arrays import FloatArray, IntArray
from rigctl.workbench.next.questions import Question
from rigctl.workbench.next.triangle import SECOND_ORDER, Triangle, root_of
from rigctl.workbench.study import Term
from rigctl.workbench.verdict.score import ABSORBED

_TINY = float(np.finfo(np.float64).tiny)


@dataclass(frozen=True)
class Asked:
    """A question in terms of `Information`: the effect's direction `size` (k,), columns that are free `beside` it."""

    size: FloatArray
    beside: IntArray
    absorbed: float


class Information:
    """V = G' M G of a triangle's terms; runs are added one by one."""

    def __init__(self, triangle: Triangle) -> None:
        self._triangle = triangle
        self._free = triangle.free
        self._root = triangle.root
        terms = triangle.settled[:, self._free :]
        self._settled = terms.T @ terms

    def asked(self, question: Question) -> Asked | None:
        """A question as these columns have it; None when no run can be asked."""
        effect, rival = self._place(question.term), self._places(question.terms[1:])
        if effect is None or rival is None or len(effect) != len(question.size):
            return None
        length = self._triangle.length[self._free :]
        size = np.zeros(len(length))
        # The triangle's columns are of unit length; sizes are in units of that.
        size[effect] = question.size * length[effect]
        # Parameters of the effect itself that have no size are as free as the rival's.
        beside = np.concatenate([effect[question.size == 0.0], rival])
        return Asked(size, beside, ABSORBED if question.rival is None else 0.0)

    def noncentralities(self, questions: Sequence[Asked]) -> FloatArray:
        """Noncentrality of each effect, from the runs there are and those added, (questions,)."""
        return np.array([self._counted(_noncentrality(self._information, each), each) for each in questions])

    def noncentralities_with_each(self, questions: Sequence[Asked]) -> FloatArray:
        """The same with one run more, for each that could be made: (questions, runs)."""
        columns = self._triangle.ahead[..., self._free :]
        # The run's rows in V: its columns less what the free parameters imitate, lessened by what it tells of these.
        along = _over(self._root[: self._free, : self._free], self._triangle.ahead[..., : self._free])
        left = columns - along @ self._root[: self._free, self._free :]
        information = self._information + left.swapaxes(1, 2) @ _lessened(along, left)
        return np.array(
            [
                self._counted(_noncentrality(information, each), each, np.sum((columns @ each.size) ** 2, axis=1))
                for each in questions
            ]
        ).reshape(len(questions), len(columns))

    def is_absorbed(self, question: Asked) -> bool:
        """Whether the fitted parameters absorb the effect almost entirely."""
        return bool(_noncentrality(self._information, question) <= question.absorbed**2 * self._whole(question))

    def add(self, run: int) -> None:
        """Count a run among those that are there."""
        self._root = root_of(np.vstack([self._root, self._triangle.ahead[run]]))

    @property
    def _information(self) -> FloatArray:
        """V, (k, k)."""
        block = self._root[self._free :, self._free :]
        return np.asarray(block.T @ block)

    def _whole(self, question: Asked) -> float:
        """Noncentrality of the effect with nothing fitted."""
        there = self._root[:, self._free :] @ question.size
        return float(there @ there + question.size @ self._settled @ question.size)

    def _counted(self, free: FloatArray, question: Asked, more: FloatArray | float = 0.0) -> FloatArray:
        """Noncentrality, reduced where most of the effect is absorbed: what is left is of second order."""
        if not question.absorbed:
            return free
        share = free / np.maximum(self._whole(question) + more, _TINY) / question.absorbed**2
        return np.asarray(free * np.where(share >= 1.0, 1.0, share**2))

    def _places(self, terms: Sequence[Term]) -> IntArray | None:
        places = [self._place(term) for term in terms]
        known = [each for each in places if each is not None]
        return np.concatenate([np.zeros(0, dtype=np.intp), *known]) if len(known) == len(places) else None

    def _place(self, term: Term) -> IntArray | None:
        return next((where for known, where in self._triangle.places if known == term), None)


class Precision:
    """Standard uncertainties of some fitted parameters, all others free; runs are added one by one."""

    def __init__(self, triangle: Triangle, wanted: Sequence[str]) -> None:
        self._ahead = triangle.ahead
        self._root = triangle.root
        which = [triangle.names.index(name) for name in wanted]
        # Back to the parameters' own units.
        self._scaled = np.eye(len(triangle.names))[which] / triangle.length[which, None]

    def sigmas(self) -> FloatArray:
        """Of each parameter that is wanted."""
        return np.asarray(np.linalg.norm(self._spread, axis=1))

    def sigmas_with_each(self) -> FloatArray:
        """The same with one run more, for each that could be made: (parameters, runs)."""
        along = _over(self._root, self._ahead)
        left = along @ self._spread.T
        reduction = np.sum(left * _lessened(along, left), axis=1).T
        return np.asarray(np.sqrt(np.maximum(np.sum(self._spread**2, axis=1)[:, None] - reduction, 0.0)))

    def add(self, run: int) -> None:
        """Count a run among those that are there."""
        self._root = root_of(np.vstack([self._root, self._ahead[run]]))

    @property
    def _spread(self) -> FloatArray:
        """Rows of R^-1: a root of the covariance."""
        return _over(self._root, self._scaled)


def _noncentrality(information: FloatArray, question: Asked) -> FloatArray:
    """Of the information V (..., k, k) in the effect's direction, with the columns `beside` it free."""
    along = information @ question.size
    beside = question.beside
    if not len(beside):
        return np.asarray(along @ question.size)
    # A direction of which next to nothing is left imitates nothing: a fit would hold it at zero.
    free = information[..., beside[:, None], beside] + SECOND_ORDER**2 * np.eye(len(beside))
    imitated = np.linalg.solve(free, along[..., beside, None])[..., 0]
    left = along @ question.size - np.sum(along[..., beside] * imitated, axis=-1)
    return np.asarray(np.maximum(left, 0.0))


def _over(root: FloatArray, rows: FloatArray) -> FloatArray:
    """rows R^-1 for a triangle R and rows (..., columns)."""
    flat = rows.reshape(-1, rows.shape[-1]).T
    return np.asarray(solve_triangular(root, flat, trans="T", check_finite=False).T.reshape(rows.shape))


def _lessened(along: FloatArray, left: FloatArray) -> FloatArray:
    """(1 + B B')^-1 of what is left, for B = `along` (runs, rows, m) and `left` (runs, rows, k): Woodbury's identity.

    B is large where a run tells what no run before did, at most 1 / `triangle.ROUNDING`; of its square the 1 is then
    rounded to a per cent, enough to choose a run. What chosen runs promise comes from the root they are added to.
    """
    return np.asarray(np.linalg.solve(np.eye(along.shape[1]) + along @ along.swapaxes(1, 2), left))
