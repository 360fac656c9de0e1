"""A model tried on the data: fitted, its noise estimated, everything that might be added scored."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import optimize

from rigctl.analysis.least_squares import FitResult, Parameter, least_squares
from rigctl.core.arrays import FloatArray, IntArray
from rigctl.core.errors import DataError, ProcedureError
from rigctl.workbench.findings import Estimate
from rigctl.workbench.study import Candidate, Model, NotTestable, ScansBetween, Study, Term
from rigctl.workbench.verdict.bootstrap import Bootstrap, bootstrap
from rigctl.workbench.verdict.generic import Best, Generic
from rigctl.workbench.verdict.held_out import HeldOut
from rigctl.workbench.verdict.noise import Noise, NoiseEstimator, felt, stacked
from rigctl.workbench.verdict.score import ABSORBED, Projector, Score, corrected, p_of, trials

ROUNDS = 2
"""Fit, noise from what is left, fit again with that noise."""

MAX_ITERATIONS = 80
REFINED_FROM = 0.05
"""Corrected p-values below are worth a look between the values of a scan."""

_SCAN_TOLERANCE = 1e-4
_SCANNED = 3
_PART = 1e-3
_WELL_KNOWN = 500.0
_ROUNDING = 1e-14


@dataclass(frozen=True)
class Scored:
    """A candidate and how it does against what is left."""

    candidate: Candidate
    score: Score


class Attempt:
    """One set of terms: see the module's first line. `seed` fixes the draws behind corrected p-values,
    `shapes` holds what attempts at the same observations share, `start` where to start from by parameter."""

    def __init__(
        self,
        study: Study,
        terms: Sequence[Term],
        seed: int = 0,
        shapes: dict[int, Generic] | None = None,
        start: Mapping[str, float] | None = None,
    ) -> None:
        self.study = study
        self.terms = tuple(terms)
        self.model: Model = study.model(self.terms)
        self._seed = seed
        self._shapes = {} if shapes is None else shapes
        # Another choice of the same name is nowhere to start from.
        self._start = {name: value for name, value in (start or {}).items() if name not in self.scanned}
        given = self.model.observations
        if not len(given.value):
            raise DataError("no run can be used: import runs that can be reduced, or mark some valid")
        self.noise = Noise(given.sigma, np.full(len(given.value), np.inf), given.factors, ())
        self.held = self._absorbed()
        self.result = self._fit()
        self.candidates, self.not_testable = self._candidates()
        self.estimator = self._estimator()
        if self.estimator.from_scatter or np.isfinite(self.estimator.estimate(self.unexplained()).dof).any():
            for _ in range(ROUNDS if self.estimator.from_scatter else 1):
                self.noise = self.estimator.estimate(self.unexplained())
                self.result = self._fit()

    @cached_property
    def scanned(self) -> frozenset[str]:
        """Parameters of terms that a scan has found; they have priors."""
        pairs = zip(self.model.parameters, self.model.owners, strict=True)
        return frozenset(each.name for each, owner in pairs if owner and each.prior is not None)

    def unexplained(self) -> FloatArray:
        """Data - model at the fit, in the data's units, shape (n,)."""
        return np.asarray(self.model.observations.value - self.model.predict(self.result.values))

    def whitened(self) -> FloatArray:
        """W (data - model), shape (n,): unit variance where the model is right."""
        return self.result.residuals

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters."""
        return self.result.names

    @cached_property
    def jacobian(self) -> FloatArray:
        """d (whitened model) / d parameters with the priors' rows below the data, shape (n + priors, m)."""
        priors = [
            (column, each.prior.sigma)
            for column, each in enumerate(self.model.parameters)
            if each.prior is not None and not each.fixed
        ]
        below = np.zeros((len(priors), len(self.model.parameters)))
        for row, (column, sigma) in enumerate(priors):
            below[row, column] = 1.0 / sigma
        return np.vstack([-self.result.jacobian, below])

    @cached_property
    def left(self) -> FloatArray:
        """Whitened residuals with the priors' below, shape (n + priors,)."""
        pulls = [
            (each.prior.mean - value) / each.prior.sigma
            for each, value in zip(self.model.parameters, self.result.values, strict=True)
            if each.prior is not None and not each.fixed
        ]
        return np.concatenate([self.result.residuals, np.array(pulls, dtype=np.float64)])

    @cached_property
    def projector(self) -> Projector:
        """What the fitted parameters leave free."""
        return Projector(self.jacobian, self.left, self.noise.dof, len(self.result.residuals))

    def columns(self, candidate: Candidate) -> FloatArray:
        """A candidate's whitened derivative with rows for the priors, shape (n + priors, d)."""
        return self.padded(self.noise.whiten(candidate.derivative))

    def jacobian_with(self, noise: Noise) -> FloatArray:
        """`jacobian` whitened by another noise."""
        return np.vstack(
            [noise.whiten(self.model.jacobian(self.result.values)), self.jacobian[len(self.noise.sigma) :]]
        )

    def padded(self, columns: FloatArray) -> FloatArray:
        """Zero rows for the priors below."""
        return np.vstack([columns, np.zeros((len(self.left) - len(columns), columns.shape[1]))])

    @cached_property
    def scored(self) -> list[Scored]:
        """Every candidate with its score, of a scanned effect the choice with the largest statistic only.

        What stands out is looked for between the values of the scan too.
        """
        best: dict[str, Scored] = {}
        for candidate, score in zip(self.candidates, self.scores, strict=True):
            held = best.get(candidate.term.effect)
            if held is None or score.statistic > held.score.statistic:
                best[candidate.term.effect] = Scored(candidate, score)
        return [self._refined(each) for each in best.values()]

    @cached_property
    def n_eff(self) -> float:
        """How many independent trials the catalogue amounts to."""
        return trials([score.basis for score in self.scores], np.random.default_rng([self._seed, 1]))

    def _refined(self, scored: Scored) -> Scored:
        """The choice with the largest statistic between its neighbours in the scan, one name after another."""
        study, term = self.study, scored.candidate.term
        if not isinstance(study, ScansBetween) or self.corrected(scored.score.p_value) >= REFINED_FROM:
            return scored
        found = scored
        for name, (low, high) in study.neighbours(term).items():

            def with_value(log: float, at: Term = found.candidate.term, name: str = name) -> Scored:
                choice = {**at.choice, name: float(f"{np.exp(log):.6g}")}
                candidate = study.candidate(self.model, self.result.values, Term(at.effect, choice))
                return Scored(candidate, self._score(candidate))

            best = optimize.minimize_scalar(
                lambda log, of=with_value: -of(log).score.statistic,
                bounds=(np.log(low), np.log(high)),
                method="bounded",
                options={"xatol": _SCAN_TOLERANCE},
            )
            found = max(found, with_value(best.x), key=lambda each: each.score.statistic)
        return found

    @cached_property
    def scores(self) -> list[Score]:
        """Of every candidate, in their order."""
        return [self._score(candidate) for candidate in self.candidates]

    def _score(self, candidate: Candidate) -> Score:
        score, frame = self.projector.score(self.columns(candidate)), self.estimator.saturated
        return score if frame is None else self._by_own_noise(score, frame)

    def _by_own_noise(self, score: Score, frame: FloatArray) -> Score:
        """With the scale of the noise as it is once the candidate is in: what it explains inflates it before."""
        data = len(frame)
        outside = score.basis[:data] - frame @ (frame.T @ score.basis[:data])
        explained = float(np.sum((outside.T @ self.left[:data]) ** 2))
        taken = float(np.sum(outside**2))
        dof = float(self.noise.dof[0])
        if dof - taken < 1.0 or not score.dimension:
            return score
        scale = max(dof - explained, 1e-9 * dof) / (dof - taken)
        p_value = p_of(score.statistic / scale, score.dimension, dof - taken)
        return replace(score, dof=dof - taken, p_value=float(p_value))

    def to_be_drawn(self, columns: FloatArray) -> bool:
        """Whether data whose correlated noise comes from the scatter have a part in these columns."""
        rows = self.estimator.rows
        if not self.estimator.correlated or float(np.min(self.noise.dof[rows])) > _WELL_KNOWN:
            return False
        return bool(np.sum(columns[rows] ** 2) > _PART * np.sum(columns**2))

    @cached_property
    def bootstrap(self) -> Bootstrap:
        """What the smallest p-values would be with nothing hidden, the noise estimated each time."""
        return bootstrap(self, self._seed)

    @cached_property
    def generic(self) -> Generic:
        """The shapes without physics; the same for all attempts at the same observations."""
        given = self.model.observations
        if id(given) not in self._shapes:
            self._shapes[id(given)] = Generic(given)
        return self._shapes[id(given)]

    @cached_property
    def best_shape(self) -> Best | None:
        """The strongest of them in what is left."""
        return self.generic.best(self.noise, self.projector, np.random.default_rng([self._seed, 2]))

    def corrected(self, p_value: float) -> float:
        """A p-value of the catalogue, for the trials."""
        return corrected(p_value, self.n_eff)

    def evidence(self, scored: Scored) -> float:
        """Log evidence: T/2 less what dimensions and choices cost; ranks candidates of different kinds."""
        grid = sum(candidate.term.effect == scored.candidate.term.effect for candidate in self.candidates)
        price = 0.5 * scored.score.dimension * float(np.log(len(self.result.residuals)))
        return 0.5 * scored.score.statistic - price - float(np.log(grid))

    @cached_property
    def held_out(self) -> HeldOut:
        """The blocks, each predicted from the others."""
        return HeldOut(self.model.observations, self.projector.basis, self.projector.left)

    def estimates(self) -> dict[str, Estimate]:
        """Parameters by name."""
        sigmas = np.sqrt(np.maximum(np.diag(self.result.covariance), 0.0))
        sigmas[[name in self.held for name in self.names]] = np.nan
        return {
            name: Estimate(float(value), float(sigma), unit)
            for name, value, sigma, unit in zip(self.names, self.result.values, sigmas, self.model.units, strict=True)
        }

    def _absorbed(self) -> frozenset[str]:
        """Parameters of terms that other parameters imitate: held at zero while the rest is fitted.

        What a scan has found has its prior, so that nothing is singular with it: it is neither held nor does it hold.
        """
        model = self.model
        added = [i for i, owner in enumerate(model.owners) if owner and not model.parameters[i].fixed]
        own = [i for i in added if model.parameters[i].name not in self.scanned]
        start = [self._start.get(each.name, each.start) for each in model.parameters]
        slopes = self.noise.whiten(model.jacobian(np.array(start, dtype=np.float64)))
        weights = [0.0 if each.prior is None else 1.0 / each.prior.sigma for each in model.parameters]
        slopes = np.vstack([slopes, np.diag(weights)])
        size = np.linalg.norm(slopes, axis=0)
        size[[each.name in self.scanned for each in model.parameters]] = 0.0
        gram = slopes.T @ slopes / np.outer(*2 * [np.where(size > 0.0, size, 1.0)])
        held: list[int] = []
        while own:
            rest = np.setdiff1d(np.flatnonzero(size > 0.0), held)
            values, vectors = np.linalg.eigh(gram[np.ix_(rest, rest)])
            # The inverse's diagonal: what no other column imitates of each, as a share, is its root's inverse.
            shares = 1.0 / np.sqrt(np.sum(vectors**2 / np.maximum(values, _ROUNDING), axis=1))
            keep = np.zeros(len(size))
            keep[rest] = shares
            least = min(reversed(own), key=lambda i: keep[i])
            if keep[least] >= ABSORBED:
                break
            held.append(least)
            own.remove(least)
        for term in self.terms:
            parts = [i for i, owner in enumerate(model.owners) if owner == term.effect]
            if parts and set(parts) <= set(held):
                raise ProcedureError(
                    f"the fit is singular: these runs cannot tell {term.effect} from the other parameters; "
                    "remove it, or measure at other frequencies or angles"
                )
        return frozenset(model.parameters[i].name for i in held)

    def _fit(self) -> FitResult:
        model, noise, value = self.model, self.noise, self.model.observations.value
        parameters = [
            replace(each, start=0.0, fixed=True)
            if each.name in self.held
            else replace(each, start=self._start.get(each.name, each.start))
            for each in model.parameters
        ]

        def fitted(parameters: Sequence[Parameter]) -> FitResult:
            return least_squares(
                lambda p: noise.whiten(value - model.predict(p)),
                parameters,
                jacobian=lambda p: -noise.whiten(model.jacobian(p)),
                max_iterations=MAX_ITERATIONS,
            )

        if self.scanned:
            # A time or a frequency means something where its amplitude is right: that first.
            amplitudes = fitted([replace(each, fixed=each.fixed or each.name in self.scanned) for each in parameters])
            sizes = np.nan_to_num(amplitudes.values)
            parameters = [replace(each, start=float(x)) for each, x in zip(parameters, sizes, strict=True)]
        result = fitted(parameters)
        if result.verdict == "ill-conditioned":
            raise ProcedureError(f"the fit is singular: {result.reason}")
        if not np.isfinite(result.values).all():
            raise ProcedureError(f"the runs do not determine the model: {result.reason}")
        self._start = dict(zip(result.names, map(float, result.values), strict=True))
        return result

    @property
    def values(self) -> dict[str, float]:
        """Of the parameters by name."""
        return dict(self._start)

    def _candidates(self) -> tuple[list[Candidate], list[NotTestable]]:
        found, refused = self.study.candidates(self.model, self.result.values)
        return found, refused

    def _estimator(self) -> NoiseEstimator:
        """What is hidden may be in the catalogue, or of any plain shape; scans are too many to project out."""
        given = self.model.observations
        required = self.model.jacobian(self.result.values)
        counts: dict[str, int] = {}
        for candidate in self.candidates:
            counts[candidate.term.effect] = counts.get(candidate.term.effect, 0) + 1
        few = stacked([c.derivative for c in self.candidates if counts[c.term.effect] <= _SCANNED], len(given.value))

        def possible(where: IntArray) -> list[FloatArray]:
            return [felt(few, where, given.sigma), self.generic.main_columns(where)]

        return NoiseEstimator(given, required, possible)
