"""What runs, made or imagined, would tell: square roots of information matrices, never their squares.

Rows of whitened derivatives with an effect's columns last: the last block R of their QR factor has R'R = V, the
information on the effect with everything before it fitted too. Absorbed effects, of which a part in 1e4 and less is
left, would drown in the rounding of normal equations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import pairwise

import numpy as np

from rigctl.errors import RigError
from rigctl.workbench.attempt import Attempt
from rigctl.workbench.noise import Noise
from rigctl.workbench.study import (
    Candidate,
    FloatArray,
    IntArray,
    Model,
    Observations,
    Plannable,
    Proposal,
    Study,
    Term,
)

_RIDGE = 1e-7
"""Of a column's length: columns that are multiples of others must not leave a direction open by rounding."""


class Imagined:
    """A fitted model on its data and on runs that could be made: derivatives row by row, by run.

    `noise` and `values` (by parameter) come from `attempt`. Noise of imagined runs is independent, as large as that
    of existing data of its pool.
    """

    def __init__(self, study: Plannable, attempt: Attempt, proposals: Sequence[Proposal]) -> None:
        self.proposals = tuple(proposals)
        self._attempt = attempt
        self._study: Study = study.extended(proposals)
        self._model: Model = self._study.model(attempt.terms)
        self._values = _values(self._model, attempt.values)
        self._given = self._model.observations
        self._made = len(attempt.model.observations.value)
        self._sigma = _imagined_sigma(attempt.noise, attempt.model.observations, self._given)

    @cached_property
    def rows_of(self) -> list[IntArray]:
        """Rows of each proposal's data, beliefs above all."""
        first = len(self._attempt.model.observations.run_ids)
        run_of = self._given.run_of
        bounds = np.searchsorted(run_of, np.arange(first, first + len(self.proposals) + 1))
        return [self.priors + np.arange(start, end) for start, end in pairwise(bounds)]

    @cached_property
    def fitted(self) -> FloatArray:
        """Whitened derivatives of all data by the model's free parameters, priors' rows first; shape (n, m)."""
        free = [column for column, each in enumerate(self._model.parameters) if not each.fixed]
        return np.vstack([self._priors()[:, free], self._whitened(self._model.jacobian(self._values))[:, free]])

    @property
    def priors(self) -> int:
        """How many rows are beliefs, above all data."""
        return len(self._priors())

    @property
    def made(self) -> int:
        """Rows of beliefs and of data there are."""
        return self.priors + self._made

    @cached_property
    def names(self) -> list[str]:
        """Of the free parameters."""
        return [each.name for each in self._model.parameters if not each.fixed]

    def columns(self, term: Term) -> FloatArray | None:
        """Whitened derivatives by a term that is not in the model, (n, d); None when no run can be asked about it."""
        for candidate in self.candidates:
            if candidate.term == term:
                return self._padded(candidate.derivative)
        try:
            model = self._study.model((*self._attempt.terms, term))
        except RigError:
            return None
        values = _values(model, {**self._attempt.values, **_zeros(model, term)})
        own = [column for column, owner in enumerate(model.owners) if owner == term.effect]
        slopes = model.jacobian(values)[:, own]
        return self._padded(slopes[:, np.any(slopes != 0.0, axis=0)])

    @cached_property
    def candidates(self) -> list[Candidate]:
        """Everything the model lacks, on all data."""
        return self._study.candidates(self._model, self._values)[0]

    def _padded(self, columns: FloatArray) -> FloatArray:
        return np.vstack([np.zeros((self.priors, columns.shape[1])), self._whitened(columns)])

    def _whitened(self, columns: FloatArray) -> FloatArray:
        made = self._attempt.noise.whiten(columns[: self._made])
        return np.vstack([made, columns[self._made :] / self._sigma[:, None]])

    def _priors(self) -> FloatArray:
        known = [(i, p.prior.sigma) for i, p in enumerate(self._model.parameters) if p.prior and not p.fixed]
        rows = np.zeros((len(known), len(self._model.parameters)))
        for row, (column, sigma) in enumerate(known):
            rows[row, column] = 1.0 / sigma
        return rows


class Information:
    """What rows tell of an effect with other columns fitted; runs are added one by one.

    `beside` (n, m) are the columns fitted, `asked` (n,) is the effect at the size in question; the first `made` rows
    are there already. `absorbed` is the share of the effect below which it counts as absorbed: less is of second
    order and promises nothing.
    """

    def __init__(
        self, beside: FloatArray, asked: FloatArray, made: int, rows_of: Sequence[IntArray], absorbed: float = 0.0
    ) -> None:
        scale = np.linalg.norm(beside, axis=0)
        width = beside.shape[1]
        whole = np.hstack([beside / np.where(scale > 0.0, scale, 1.0), asked[:, None]])
        # Columns that no further run touches go first: their part of R never changes and is left behind.
        touched = np.append(np.any(whole[made:, :-1] != 0.0, axis=0), True)
        whole = np.hstack([whole[:, ~touched], whole[:, touched]])
        ridge = np.hstack([_RIDGE * np.eye(width), np.zeros((width, 1))])
        root = _triangle(np.vstack([ridge, whole[:made]]))
        settled = int(np.sum(~touched))
        self._whole = whole[:, settled:]
        self._root = root[settled:, settled:]
        self._elsewhere = float(np.sum(root[:settled, -1] ** 2))
        self._rows_of = rows_of
        self._absorbed = absorbed

    def lambda_now(self) -> float:
        """Noncentrality of the effect, from the runs there are and those added."""
        return float(self._of(self._root))

    def lambda_with(self, which: Sequence[int]) -> FloatArray:
        """The same with one run more, for each of these runs."""
        found = np.empty(len(which))
        by_length: dict[int, list[int]] = {}
        for place, run in enumerate(which):
            by_length.setdefault(len(self._rows_of[run]), []).append(place)
        for places in by_length.values():
            rows = np.stack([self._rows(which[place]) for place in places])
            roots = np.broadcast_to(self._root, (len(places), *self._root.shape))
            found[places] = self._of(_triangle(np.concatenate([roots, rows], axis=1)))
        return found

    def add(self, run: int) -> None:
        """Count a run among those that are there."""
        self._root = _triangle(np.vstack([self._root, self._rows(run)]))

    def _rows(self, run: int) -> FloatArray:
        return np.asarray(self._whole[self._rows_of[run]])

    def _of(self, root: FloatArray) -> FloatArray:
        """Of QR factors (..., m + 1, m + 1); what is absorbed counts less, the more it is."""
        free, whole = root[..., -1, -1] ** 2, self._elsewhere + np.sum(root[..., :, -1] ** 2, axis=-1)
        if not self._absorbed:
            return np.asarray(free)
        share = free / np.where(whole > 0.0, whole, 1.0) / self._absorbed**2
        return np.asarray(free * np.where(share >= 1.0, 1.0, share**2))


def _triangle(rows: FloatArray) -> FloatArray:
    """R of (..., rows, columns)."""
    return np.asarray(np.linalg.qr(rows, mode="r"))


def _values(model: Model, known: Mapping[str, float]) -> FloatArray:
    return np.array([known.get(each.name, each.start) for each in model.parameters])


def _zeros(model: Model, term: Term) -> dict[str, float]:
    """A term's parameters at none of it; what was scanned for stays where it is."""
    own = [each for each, owner in zip(model.parameters, model.owners, strict=True) if owner == term.effect]
    return {each.name: each.start if each.name.rpartition(".")[2] in term.choice else 0.0 for each in own}


def _imagined_sigma(noise: Noise, made: Observations, whole: Observations) -> FloatArray:
    """Standard deviations of imagined data: given weights times what the existing data of the pool came out at."""
    count = len(made.value)
    ratio = noise.plain() / made.sigma
    names = [pool.name for pool in made.pools]
    by_pool = {
        name: float(np.median(ratio[made.pool_of == number]))
        for number, name in enumerate(names)
        if np.any(made.pool_of == number)
    }
    typical = float(np.median(ratio)) if count else 1.0
    scale = np.array([by_pool.get(pool.name, typical) for pool in whole.pools])
    return np.asarray(whole.sigma[count:] * scale[whole.pool_of[count:]])
