"""A model tried on the data: fitted, its noise estimated, everything that might be added scored."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rigctl.analysis.summed_columns import SummedColumns, SummedScan
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import UNFIT, DataError
from rigctl.workbench.families import families_of
from rigctl.workbench.study import Candidate, HoldsPlaces, NotTestable, ScansBetween, ScansWithin, Study, Term
from rigctl.workbench.verdict.bootstrap import Bootstrap, bootstrap
from rigctl.workbench.verdict.fitted_model import FittedModel, Uncertainty, fit_with_given_noise, stated_noise
from rigctl.workbench.verdict.generic import Best
from rigctl.workbench.verdict.known_noise import KnownNoise
from rigctl.workbench.verdict.noise import Noise
from rigctl.workbench.verdict.noise_alone import ChanceOfNoise
from rigctl.workbench.verdict.noise_estimate import (
    estimator_of,
    with_estimated_noise,
    with_estimated_noise_again,
)
from rigctl.workbench.verdict.noise_pool import WHITE
from rigctl.workbench.verdict.permuted import Permuted, is_heavy_tailed
from rigctl.workbench.verdict.profiled import profiled
from rigctl.workbench.verdict.questions import Questions
from rigctl.workbench.verdict.rotated import FEW, Rotated
from rigctl.workbench.verdict.scan import TOGETHER, OwnNoise, ScanScores
from rigctl.workbench.verdict.score import Projector, Score, contained_at_most, corrected
from rigctl.workbench.verdict.scoring import Scoring
from rigctl.workbench.verdict.shared import Shared
from rigctl.workbench.verdict.sketched import SketchedTrials
from rigctl.workbench.verdict.trials import Family, Trials, trials

REFINED_FROM = 0.05
"""Corrected p-values below are worth a look between the values of a scan."""

# Of a logarithm: the full fit goes on from there.
_SCAN_TOLERANCE = 1e-4
# Of a candidate's square sum: with less of it in data of unsure noise its p-value stays.
_PART = 1e-3
# P-values of the strongest of many choices: those above are far from significant, to whatever digit.
_JUDGED_BELOW = 1e-3
# Degrees of freedom beyond which an estimated scale is as good as known.
_WELL_KNOWN = 500.0
# Of a cosine: six standard deviations of what a sketch of 2048 numbers says where it is 0.99.
_OF_A_SKETCH = 0.003


@dataclass(frozen=True)
class Scored:
    """A candidate and how it does against what is left."""

    candidate: Candidate
    score: Score


@dataclass(frozen=True)
class Ends:
    """Where the fits of an attempt ended, `values` by name, with the stated noise and then with noise told by the one
    before, and what they `held` at zero."""

    values: tuple[Mapping[str, float], ...]
    held: frozenset[str]


class Attempt(FittedModel):
    """One set of terms: see the module's first line. `seed` fixes the draws behind corrected p-values,
    `shared` holds what attempts with this study have in common, `start` where to start from by parameter. With
    `known` noise nothing is estimated: all models of a store's data are judged by one noise. A model that is `fitted`
    in such a noise, or in a smaller model's, is not fitted again; nor is one whose fits have `ended`: they are made
    again from there."""

    def __init__(
        self,
        study: Study,
        terms: Sequence[Term],
        seed: int = 0,
        shared: Shared | None = None,
        start: Mapping[str, float] | None = None,
        known: KnownNoise | None = None,
        held: frozenset[str] = frozenset(),
        fitted: FittedModel | None = None,
        ended: Ends | None = None,
    ) -> None:
        self.study = study
        self.terms = tuple(terms)
        self.seed = seed
        self._known = known
        model = study.model(self.terms) if fitted is None else fitted.model
        given = model.observations
        if not len(given.value):
            raise DataError("no run can be used: import runs that can be reduced, or mark some valid")
        noise = None if known is None else known.noise_of(given)
        if ended is not None:
            fitted = FittedModel.where_it_ended(model, stated_noise(model), ended.held, ended.values[0])
        first = fitted or fit_with_given_noise(model, start or {}, noise, held)
        self._questions = Questions(study, model, first.result.values)
        self.family_of = families_of(study)
        self._shared = shared or Shared()
        self._dofs: dict[str, float] = {}
        self._scored_effects: dict[str, Scored] = {}
        self._asked_alone: set[str] = set()
        self.generic = self._shared.generic(given)
        if known is not None and noise is not None:
            self.estimator, fits = known.estimator, [first]
        else:
            orders = self._shared.orders(given)
            self.estimator = estimator_of(first, lambda: self._questions.groups, self.generic, orders)
            if ended is None:
                fits = with_estimated_noise(first, self.estimator)
            else:
                fits = with_estimated_noise_again(first, self.estimator, ended.values[1:])
            self._questions = self._questions.at(fits[-1].result.values)
        last = self._placed(fits[-1])
        self.ends = Ends(tuple(each.values for each in fits), last.held)
        super().__init__(last.model, last.noise, last.held, last.result)

    def _placed(self, fitted: FittedModel) -> FittedModel:
        """The fit with the places that it holds where they fit best in correlated noise: a study knows of none."""
        if not fitted.noise.factors or not isinstance(self.study, HoldsPlaces):
            return fitted
        model = self.study.placed(fitted.model, self.terms, fitted.noise.whiten)
        if model.terms == fitted.model.terms:
            return FittedModel(model, fitted.noise, fitted.held, fitted.result)
        with suppress(*UNFIT):
            moved = fit_with_given_noise(model, {}, fitted.noise, fitted.held)
            if moved.result.chi2 < fitted.result.chi2:
                self._questions = Questions(self.study, model, moved.result.values)
                return moved
        return fitted

    def judged_by(self, known: KnownNoise | None) -> Attempt:
        """The same attempt where its noise is known from itself: what has been asked of it is not asked again."""
        made = copy(self)
        made._known = known
        # By what noise parameters are uncertain is known too.
        for name in ("noise_beside_fit", "uncertainty"):
            made.__dict__.pop(name, None)
        return made

    def let_go(self) -> None:
        """Keep nothing as long as several columns of the data but what was asked of single effects."""
        super().let_go()
        self._questions.let_go()
        for name in ("weights", "scored", "_scoring", "_scored", "_made", "_sketched"):
            self.__dict__.pop(name, None)
        self._scored_effects = {k: scored for k, scored in self._scored_effects.items() if k in self._asked_alone}

    @property
    def candidates(self) -> list[Candidate]:
        """Every effect that the model lacks, one per choice."""
        return self._questions.candidates

    @property
    def choices(self) -> int:
        """How many candidates there are."""
        return sum(map(len, itertools.chain(*self._questions.groups.values())))

    @property
    def not_testable(self) -> list[NotTestable]:
        """Effects that these data cannot be asked about."""
        return self._questions.not_testable

    def chi2_p_value(self, told: float = 0.0) -> float:
        """Of all that is left; what the saturated design leaves told the noise, and says nothing more."""
        p_value, frame = super().chi2_p_value(told + self.estimator.dof), self.estimator.saturated
        if (chance := self.chance_of_noise) is not None and chance.in_doubt(p_value):
            return max(p_value, chance.of_projected)
        if frame is None or self.permuted is None:
            return p_value
        return max(p_value, self.permuted.p_of_share(frame, self.projector.basis))

    @cached_property
    def uncertainty(self) -> Uncertainty:
        """How well the parameters are known; a place that was scanned for by the data only.

        Noise that may be correlated is that told beside what the account found (decision 078).
        """
        known = profiled(self, self.study) if isinstance(self.study, ScansWithin) else super().uncertainty
        if self.noise_beside_fit is self.noise:
            return known
        more = self.noise_beside_fit.variance_of(self.weights) - self.noise.variance_of(self.weights)
        return replace(known, covariance=known.covariance + more)

    @cached_property
    def noise_beside_fit(self) -> Noise:
        """The noise in which parameters are as uncertain as is said: `noise`, unless that may be correlated."""
        told = None if self._known is None else self._known.beside_fit_of(self.model.observations)
        if told is None:
            return self.noise_beside(np.zeros((len(self.result.residuals), 0)))
        return told

    def noise_beside(self, columns: FloatArray) -> Noise:
        """The same, told beside this fit and further columns (n, k)."""
        jacobian = np.hstack([self.model.jacobian(self.result.values), columns])
        return self.estimator.beside_fit(jacobian, self.unexplained(), self.noise)

    @cached_property
    def weights(self) -> FloatArray:
        """Of the data in each estimate of a parameter, (n, m): to first order estimates are sums of the data.

        None where a parameter is not determined: it stays where it is.
        """
        known = np.nan_to_num(self.result.covariance)
        return self.noise.weights_of(self.jacobian[: len(self.result.residuals)] @ known)

    def columns(self, candidate: Candidate) -> FloatArray:
        """A candidate's whitened derivative with rows for the priors, shape (n + priors, d)."""
        return self.whitened_columns(candidate.derivative)

    @cached_property
    def _scoring(self) -> Scoring:
        # Of the fit alone: a model and its scores that refer to each other would stay until a collector comes by.
        fitted = FittedModel(self.model, self.noise, self.held, self.result)
        return Scoring(fitted, self.projector, self.estimator.saturated)

    @cached_property
    def scored(self) -> list[Scored]:
        """Every candidate with its score, of an effect with several choices the one with the largest statistic only,
        less what its parameters cost where they differ in number.

        What stands out is looked for between the values of the scan too.
        """
        found = [self._scored_effect(effect) for effect in self._questions.groups]
        self._scoring.done()
        return [scored for scored in found if scored is not None]

    def scored_effect(self, effect: str) -> Scored | None:
        """The candidate of one effect, scored when it is asked for; None where it is none."""
        found = self._scored_effect(effect)
        if found is not None:
            self._asked_alone.add(effect)
        return found

    def _scored_effect(self, effect: str) -> Scored | None:
        if effect not in self._scored_effects and self._questions.of(effect):
            self._scored_effects[effect] = self._refined(self._best_choice(effect))
        return self._scored_effects.get(effect)

    def _best_choice(self, effect: str) -> Scored:
        price = float(np.log(len(self.result.residuals)))
        best: Scored | None = None
        for group, scores in zip(self._questions.of(effect), self._scored_groups(effect), strict=True):
            if isinstance(scores, ScanScores):
                chosen, score = group[scores.strongest], scores.score(scores.strongest)
                # Of a long scan the sums find the choice, and the columns themselves judge what may be significant.
                if isinstance(chosen.columns, SummedScan) and score.p_value < _JUDGED_BELOW:
                    score = self._scoring.of(chosen)
                strongest = [(chosen, score)]
            else:
                strongest = list(zip(group, scores, strict=True))
            for candidate, score in strongest:
                more = 0 if best is None else len(candidate.names) - len(best.candidate.names)
                # Twice the log evidence: a further parameter costs ln n (Schwarz).
                if best is None or score.statistic - more * price > best.score.statistic:
                    best = Scored(candidate, score)
        assert best is not None
        return best

    def p_beside_others(self, effect: str) -> float:
        """Of the rise of chi-square, at most, without an effect of the model but with any one that it lacks instead.

        Both to first order: no fit is made.
        """
        shown, rest = self.shown(effect)
        projector = Projector(rest, shown, self.noise.dof, len(self.result.residuals), self.noise.between)
        scoring, there = Scoring(self, projector), {term.effect for term in self.terms}
        others = [groups for each, groups in self._questions.groups.items() if each not in there]
        most = max(map(scoring.most_explained, itertools.chain(*others)), default=0.0)
        return self.p_of_shown(effect, shown, projector, most)

    def dof_of(self, effect: str) -> float:
        """Degrees of freedom of the noise that the test of a candidate meets; infinite for what is none."""
        if effect not in self._dofs:
            self._dofs[effect] = self._best_choice(effect).score.dof if self._questions.of(effect) else np.inf
        return self._dofs[effect]

    @cached_property
    def likeness_bounds(self) -> FloatArray:
        """How far each effect's span lies within each other's at most, as cosines, (effects, effects)."""
        # What is alike to a part in a hundred a sketch tells to a few in ten thousand.
        return contained_at_most(list(map(self._basis, self.scored))) + (
            0.0 if self._sketched is None else _OF_A_SKETCH
        )

    def _basis(self, scored: Scored) -> FloatArray:
        """Of an effect, or its sketch; one column of zeros where all is absorbed."""
        sketched, basis = self._sketched, np.zeros((0, 0))
        if scored.score.dimension:
            basis = (
                scored.score.basis
                if sketched is None
                else sketched.basis(*self._scoring.sketches([scored.candidate]))
            )
        rows = len(self.left) if sketched is None else sketched.rows
        return basis if basis.shape[1] else np.zeros((rows, 1))

    @cached_property
    def trials(self) -> Trials:
        """How many independent trials the catalogue amounts to, family by family."""
        # Rows of priors do not follow the noise.
        if len(self.left) > len(self.result.residuals):
            return self._counted()
        asked = (self.seed, self.held, id(self.model.observations), *(term.key for term in self.terms))
        return self._shared.trials(asked, self.noise, self._counted)

    def _counted(self) -> Trials:
        sketched = self._sketched
        if sketched is None:
            return trials({name: self.family(name) for name in self._families}, len(self.left), self.seed)
        families = {name: self._sketched_family(sketched, effects) for name, effects in self._families.items()}
        return trials(families, sketched.rows, self.seed)

    @cached_property
    def _sketched(self) -> SketchedTrials | None:
        """Of a long table; None of others."""
        groups = itertools.chain(*self._questions.groups.values())
        long = any(isinstance(group[0].columns, SummedScan) for group in groups)
        return SketchedTrials(self.projector) if long else None

    def family(self, name: str) -> Family:
        """What one family of effects tries."""
        if name not in self._made:
            family = self._made[name] = Family()
            for each in itertools.chain(*map(self._scored_groups, self._families[name])):
                if isinstance(each, ScanScores):
                    family.scans.append(each)
                else:
                    family.bases.extend(score.basis for score in each)
        return self._made[name]

    @cached_property
    def _made(self) -> dict[str, Family]:
        return {}

    @cached_property
    def _families(self) -> dict[str, list[str]]:
        """The effects of each family."""
        families: dict[str, list[str]] = {}
        for effect in self._questions.groups:
            families.setdefault(self.family_of(effect), []).append(effect)
        return families

    def _sketched_family(self, sketched: SketchedTrials, effects: Sequence[str]) -> Family:
        family = Family()
        for effect in effects:
            self._scored_groups(effect)  # makes the sketches with the columns: alone they would be made again
        for group in itertools.chain(*map(self._questions.of, effects)):
            scan = group[0].columns
            unit = self._scoring.unit_columns(scan)[0] if isinstance(scan, SummedScan) else None
            if isinstance(unit, SummedColumns) and not self.noise.factors:
                sketched.add_scan(family, unit)
            else:
                family.bases.extend(map(sketched.basis, self._scoring.sketches(group)))
        return family

    @cached_property
    def permuted(self) -> Permuted | None:
        """What is left in other orders, where it is exchangeable and has heavier tails than normal noise."""
        # Readings in an order are exchangeable as well, unless noise that is correlated along it is the likeliest.
        white = all(each.kind == WHITE.kind for each in self.noise.correlations)
        exchangeable = self.estimator.of_one_pool and white and len(self.left) == len(self.result.residuals)
        return Permuted(self.left, self.seed) if exchangeable and is_heavy_tailed(self.left) else None

    @cached_property
    def rotated(self) -> Rotated | None:
        """What is left in other directions, where few degrees of freedom of independent noise tell its size."""
        frame, dof = self.estimator.saturated, self.estimator.dof
        if frame is None or dof > FEW or len(self.left) != len(self.result.residuals):
            return None
        families = {name: self.family(name) for name in self.trials.within}
        return Rotated(self.projector, OwnNoise(frame, dof), families, self.seed)

    def least_p_of(self, effect: str) -> float:
        """The smallest p-value of the choices of an effect that is scored, none looked for between them."""
        return self._best_choice(effect).score.p_value

    @cached_property
    def _scans_between(self) -> ScansBetween | None:
        return self.study if isinstance(self.study, ScansBetween) else None

    def _refined(self, scored: Scored) -> Scored:
        """The choice with the largest statistic between its neighbours in the scan, one name after another."""
        study, term = self._scans_between, scored.candidate.term
        if study is None or self.corrected(scored.score.p_value, term.effect) >= REFINED_FROM:
            return scored
        from scipy import optimize  # here, as in the modules beside: 0.15 s, which most diagnoses do without

        best = scored
        for name, (low, high) in study.neighbours(term).items():

            def with_value(log: float, at: Term = best.candidate.term, name: str = name) -> Scored:
                # Digits beyond the tolerance of the search would stand in documents and mean nothing.
                choice = {**at.choice, name: float(f"{np.exp(log):.6g}")}
                candidate = study.candidate(self.model, self.result.values, Term(at.effect, choice))
                return Scored(candidate, self._scoring.of(candidate))

            minimum = optimize.minimize_scalar(
                lambda log, of=with_value: -of(log).score.statistic,
                bounds=(np.log(low), np.log(high)),
                method="bounded",
                options={"xatol": _SCAN_TOLERANCE},
            )
            best = max(best, with_value(minimum.x), key=lambda each: each.score.statistic)
        return best

    @cached_property
    def chance_of_noise(self) -> ChanceOfNoise | None:
        """What noise alone would show, where it may be correlated along an order that all data have."""
        pool = self.estimator.whole_pool
        if pool is None:
            return None
        return ChanceOfNoise(self, pool, self._questions.groups, self.price_of, self.generic, self.seed)

    @property
    def scores(self) -> list[Score]:
        """Of every candidate, effect by effect."""
        groups = [scored for effect in self._questions.groups for scored in self._scored_groups(effect)]
        return [score for each in groups for score in (each if isinstance(each, list) else each.scores)]

    def _scored_groups(self, effect: str) -> list[ScanScores | list[Score]]:
        """The groups of an effect, scored once; the choices of a long scan together."""
        if effect not in self._scored:
            groups = self._questions.of(effect)
            few = [group for group in groups if len(group) < TOGETHER]
            scores = iter(self._scoring.of_each(list(itertools.chain(*few))))
            self._scored[effect] = [
                self._scoring.of_scan(group) if len(group) >= TOGETHER else list(itertools.islice(scores, len(group)))
                for group in groups
            ]
        return self._scored[effect]

    @cached_property
    def _scored(self) -> dict[str, list[ScanScores | list[Score]]]:
        return {}

    def to_be_drawn(self, columns: FloatArray) -> bool:
        """Whether data whose correlated noise comes from the scatter have a part in these columns."""
        rows = self.estimator.rows
        if not self.estimator.correlated or float(np.min(self.noise.dof[rows])) > _WELL_KNOWN:
            return False
        return bool(np.sum(columns[rows] ** 2) > _PART * np.sum(columns**2))

    @cached_property
    def bootstrap(self) -> Bootstrap:
        """What the smallest p-values would be with nothing hidden, the noise estimated each time."""
        return bootstrap(self, self.candidates, self.scores, self.estimator, self.generic, self.seed)

    @cached_property
    def best_shape(self) -> Best | None:
        """The strongest of them in what is left."""
        return self.generic.best(self.noise, self.projector, (self.seed, 2))

    def corrected(self, p_value: float, effect: str) -> float:
        """A p-value of an effect of the catalogue, for the trials."""
        return corrected(p_value, self.trials_of(effect))

    def trials_of(self, effect: str) -> float:
        """For how many independent trials the p-value of an effect is corrected."""
        return self.trials.of(self.family_of(effect))

    def evidence(self, scored: Scored) -> float:
        """Log evidence: T/2 less the price; ranks candidates of different kinds."""
        return 0.5 * scored.score.statistic - self.price(scored)

    def price(self, scored: Scored) -> float:
        """What the parameters of a candidate and the choices there were cost, in log evidence.

        Schwarz's ln n / 2 for each parameter, one that was scanned for among them: it is fitted on. And ln of the
        choices, for a scan finds more by chance.
        """
        return self.price_of(scored.candidate, scored.score.dimension)

    def price_of(self, candidate: Candidate, dimension: int) -> float:
        """The same of a candidate that adds so many dimensions."""
        grid = sum(map(len, self._questions.of(candidate.term.effect)))
        parameters = dimension + candidate.scanned
        return 0.5 * parameters * float(np.log(len(self.result.residuals))) + float(np.log(grid))
