"""A fitted model on its data and on runs that could be made: what their derivatives are, in units of the noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import pairwise

import numpy as np

from rigctl.core.arrays import FloatArray, IntArray
from rigctl.core.errors import UNFIT
from rigctl.workbench.study import Candidate, Model, Observations, Plannable, Proposal, Study, Term
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.noise import Noise


class Imagined:
    """Whitened derivatives row by row: beliefs (priors) first, then runs that were made, then the proposals.

    `noise` and `values` (by parameter) come from `attempt`. Noise of imagined runs is independent, as large as that
    of existing data of its pool; of proposals that are a `course`, all made at their times, it is correlated with
    that of the data there are, and from run to run, by the law of these data.
    """

    def __init__(
        self, study: Plannable, attempt: Attempt, proposals: Sequence[Proposal], *, course: bool = False
    ) -> None:
        self.proposals = tuple(proposals)
        self._attempt = attempt
        self._recorded = study
        self._study: Study = study.extended(proposals)
        self._model: Model = self._study.model(attempt.terms)
        self._values = _values(self._model, attempt.values)
        self._given = self._model.observations
        self._made = len(attempt.model.observations.value)
        made = attempt.model.observations
        self._joint = joint_noise(attempt.noise, made, self._given) if course else None
        self._sigma = _imagined_sigma(attempt.noise.total_sigma(), made, self._given)
        self._beliefs = _beliefs(self._model, attempt.model)

    def only(self, which: Sequence[int]) -> Imagined:
        """The same of these proposals alone."""
        return Imagined(self._recorded, self._attempt, [self.proposals[run] for run in which])

    @property
    def beliefs(self) -> int:
        """How many rows are beliefs."""
        return len(self._beliefs)

    @property
    def made(self) -> int:
        """Rows of beliefs and of data there are."""
        return self.beliefs + self._made

    @cached_property
    def rows_of(self) -> list[IntArray]:
        """Rows of each proposal's data."""
        first = len(self._attempt.model.observations.run_ids)
        bounds = np.searchsorted(self._given.run_of, np.arange(first, first + len(self.proposals) + 1))
        return [self.beliefs + np.arange(start, end) for start, end in pairwise(bounds)]

    @cached_property
    def names(self) -> list[str]:
        """Of the free parameters."""
        return [self._model.parameters[column].name for column in self._free]

    @property
    def units(self) -> dict[str, str]:
        """Of every parameter, by name."""
        return {each.name: unit for each, unit in zip(self._model.parameters, self._model.units, strict=True)}

    @property
    def of_effects(self) -> list[bool]:
        """Which free parameters belong to an effect; the others are the baseline's."""
        return [bool(self._model.owners[column]) for column in self._free]

    @cached_property
    def fitted(self) -> FloatArray:
        """By the model's free parameters, shape (n, m)."""
        slopes = self._model.jacobian(self._values)[:, self._free]
        return np.vstack([self._beliefs[:, self._free], self._whitened(slopes)])

    @property
    def _free(self) -> list[int]:
        return [column for column, each in enumerate(self._model.parameters) if not each.fixed]

    def columns(self, term: Term) -> FloatArray | None:
        """By a term that is not in the model, (n, d); None when no run can be asked about it."""
        for candidate in self.candidates:
            if candidate.term == term:
                return self._padded(candidate.derivative)
        try:
            # A choice between the values of a scan is among no candidates: a model that has it is made.
            model = self._study.model((*self._attempt.terms, term))
        except UNFIT:
            return None
        values = _values(model, {**self._attempt.values, **_zeros(model, term)})
        # A parameter whose value the term's choice fixes has the choice's name behind the effect's.
        fitted = [each.name.rpartition(".")[2] not in term.choice for each in model.parameters]
        columns = [column for column, owner in enumerate(model.owners) if owner == term.effect and fitted[column]]
        slopes = model.jacobian(values)[:, columns]
        return self._padded(slopes[:, np.any(slopes != 0.0, axis=0)])

    @cached_property
    def candidates(self) -> list[Candidate]:
        """Candidates of the model, with their derivatives on all data."""
        return self._study.candidates(self._model, self._values)[0]

    def _padded(self, columns: FloatArray) -> FloatArray:
        return np.vstack([np.zeros((self.beliefs, columns.shape[1])), self._whitened(columns)])

    def _whitened(self, columns: FloatArray) -> FloatArray:
        if self._joint is not None:
            return self._joint.whiten(columns)
        made = self._attempt.noise.whiten(columns[: self._made])
        return np.vstack([made, columns[self._made :] / self._sigma[:, None]])


def _beliefs(model: Model, made: Model) -> FloatArray:
    """A row for each prior, as if it were a datum; imagined runs remove none of them."""
    priors = {each.name: each.prior for each in (*model.parameters, *made.parameters)}
    known = [(i, prior) for i, p in enumerate(model.parameters) if (prior := priors[p.name]) and not p.fixed]
    rows = np.zeros((len(known), len(model.parameters)))
    for row, (column, prior) in enumerate(known):
        rows[row, column] = 1.0 / prior.sigma
    return rows


def _values(model: Model, known: Mapping[str, float]) -> FloatArray:
    return np.array([known.get(each.name, each.start) for each in model.parameters])


def _zeros(model: Model, term: Term) -> dict[str, float]:
    """A term's amplitudes at zero, and its scanned parameters at their values."""
    parameters = [each for each, owner in zip(model.parameters, model.owners, strict=True) if owner == term.effect]
    return {each.name: each.start if each.name.rpartition(".")[2] in term.choice else 0.0 for each in parameters}


def joint_noise(noise: Noise, made: Observations, whole: Observations) -> Noise:
    """The noise of data that were `made` and of those imagined after them in `whole`, by the laws of the former."""
    sigma = np.concatenate([noise.sigma, _imagined_sigma(noise.sigma, made, whole)])
    factors = list(noise.factors[: len(made.factors)])
    for slow in noise.slow:
        names = {made.pools[number].name for number in np.unique(made.pool_of[slow.where])}
        alike = np.array([pool.name in names for pool in whole.pools])[whole.pool_of]
        at = whole.of_runs(slow.order)
        for group in np.unique(whole.group_of[alike]):
            members = np.flatnonzero(alike & (whole.group_of == group))
            # Data there are come first: what they are whitened to does not depend on what is imagined.
            factors.append((members, slow.factor(at[members])))
    return Noise(sigma, np.full(len(sigma), np.inf), tuple(factors), noise.correlations, slow=noise.slow)


def _imagined_sigma(sigma: FloatArray, made: Observations, whole: Observations) -> FloatArray:
    """Standard deviations of imagined data: given weights times what the existing data of the pool came out at."""
    count = len(made.value)
    # What estimation made of the given weights.
    ratio = sigma / made.sigma
    names = [pool.name for pool in made.pools]
    by_pool = {
        name: float(np.median(ratio[made.pool_of == number]))
        for number, name in enumerate(names)
        if np.any(made.pool_of == number)
    }
    typical = float(np.median(ratio)) if count else 1.0
    scale = np.array([by_pool.get(pool.name, typical) for pool in whole.pools])
    return np.asarray(whole.sigma[count:] * scale[whole.pool_of[count:]])
