"""Which set of effects is missing: the best is added, everything fitted again, what is no longer needed dropped."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import IntArray
from rigctl.core.errors import UNFIT
from rigctl.workbench.study import Line, Study, Term
from rigctl.workbench.verdict.attempt import Attempt, Scored
from rigctl.workbench.verdict.fit import chi2_p_value
from rigctl.workbench.verdict.generic import Best, Generic
from rigctl.workbench.verdict.held_out import HeldOut
from rigctl.workbench.verdict.noise import Noise, orthonormal
from rigctl.workbench.verdict.score import UNDETERMINED, Projector, contained, corrected, p_of

CATALOGUE_SHARE, SHAPES_SHARE, LINES_SHARE = 0.6, 0.3, 0.1
"""How the level over all trials is shared between the catalogue, the shapes without physics and the lines."""

CONFIRM_FROM = 0.05
"""Corrected p-values below are confirmed by bootstrap where noise comes from the scatter."""

MOST_TERMS = 8
MOST_SHAPES = 4
"""Plain shapes beside which an effect must be needed."""

REFITTED = 4
"""So many of the best are fitted in full before one is chosen: T is first order."""

LINEAR = 30.0**2
"""Statistics beyond may mislead about the order of candidates."""

RIVAL_LEVEL = 0.5
"""Share of the level at which a rival is rejected as a substitute: one question, not many."""

_CONTAINED = 0.99

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Move:
    """A step of the search."""

    terms: tuple[Term, ...]
    added: str | None
    dropped: tuple[str, ...]


@dataclass(frozen=True)
class Rival:
    """`term` explains the data as well as the suggested `instead_of`; `wider`: it can do all that does, and more."""

    instead_of: str
    term: Term
    wider: bool


class Search:
    """A search from the given terms, which are never dropped; ends in `terms`."""

    def __init__(self, study: Study, terms: Sequence[Term], alpha: float, seed: int, progress: Progress) -> None:
        self.study = study
        self.alpha = alpha
        self._seed = seed
        self._progress = progress
        self._attempts: dict[str, Attempt] = {}
        self._shapes: dict[int, Generic] = {}
        self._values: dict[str, float] = {}
        self.given = tuple(terms)
        self.terms = self.given
        self.moves = [Move(self.given, None, ())]
        self.unexplained: Best | None = None
        self.lines: list[Line] = []
        self._barred: str | None = None

    def attempt(self, terms: Sequence[Term]) -> Attempt:
        """The model with these terms, fitted and scored once."""
        key = json.dumps(sorted(json.dumps(term.as_json(), sort_keys=True) for term in terms))
        if key not in self._attempts:
            made = Attempt(self.study, terms, self._seed, self._shapes, self._values)
            self._attempts[key] = made
            self._values |= made.values
        return self._attempts[key]

    @property
    def suggested(self) -> tuple[Term, ...]:
        """What was added to the given terms."""
        return tuple(term for term in self.terms if term not in self.given)

    def run(self) -> None:
        """Add and drop until nothing that is left can be explained."""
        self._climb()
        if self.unexplained is not None and (both := self._pair(self.unexplained)):
            self.moves += [
                Move((*self.terms, both[0]), both[0].effect, ()),
                Move((*self.terms, *both), both[1].effect, ()),
            ]
            self.terms, self.unexplained = (*self.terms, *both), None
        final = self.attempt(self.terms)
        if self.unexplained is None and not chi2_p_value(final) < self.alpha:
            return
        for term in self.suggested:
            detour = self._without(term.effect)
            if detour.unexplained is None and detour.price(final.noise) < self.price(final.noise):
                self.terms, self.moves = detour.terms, detour.moves
                self.lines, self.unexplained = detour.lines, None
                return

    def _pair(self, shape: Best) -> tuple[Term, Term] | None:
        """Two effects that together explain what one plain shape does, and all else, where neither does alone.

        A shape with amplitude and phase is as good as two effects that differ in nothing else. It is preferred to
        them only by what it costs: parameters, and how many there were to choose from.
        """
        attempt = self.attempt(self.terms)
        allowed = [e for e in attempt.scored if e.score.dimension and e.candidate.term.effect != self._barred]
        pairs = list(itertools.combinations(allowed, 2))
        per_dimension, choices = 0.5 * float(np.log(len(attempt.result.residuals))), float(np.log(max(len(pairs), 1)))
        wanted = 0.5 * shape.statistic - shape.dimension * per_dimension - float(np.log(shape.n_eff))
        found = []
        for pair in pairs:
            score = attempt.projector.score(np.hstack([attempt.columns(each.candidate) for each in pair]))
            evidence = 0.5 * score.statistic - score.dimension * per_dimension - choices
            if evidence > wanted:
                found.append((evidence, (pair[0].candidate.term, pair[1].candidate.term)))
        for _, both in sorted(found, key=lambda each: -each[0])[:REFITTED]:
            if self._explain(both):
                return both
        return None

    def _explain(self, both: tuple[Term, Term]) -> bool:
        """Whether two further terms are both needed, and nothing beside them is."""
        terms = (*self.terms, *both)
        try:
            level = CATALOGUE_SHARE * self.alpha
            needed = all(self.attempt(terms).corrected(self.p_of_term(terms, each)) < level for each in both)
            return needed and self.adequate(terms)
        except UNFIT:  # these data do not determine both
            return False

    def price(self, noise: Noise) -> float:
        """Chi-square of what was found, with one noise for all that is compared, and what its parameters cost."""
        attempt = self.attempt(self.terms)
        white = noise.whiten(attempt.unexplained())
        pulls = attempt.left[len(white) :]
        added = sum(owner in {term.effect for term in self.suggested} for owner in attempt.model.owners)
        return float(white @ white + pulls @ pulls) + added * float(np.log(len(white)))

    def _climb(self) -> None:
        while len(self.suggested) < MOST_TERMS:
            attempt = self.attempt(self.terms)
            self._progress(f"effects added: {len(self.suggested)}, candidates: {len(attempt.candidates)}")
            chosen = self._choose(attempt)
            if chosen is None:
                break
            terms, dropped = self._floated((*self.terms, chosen))
            if any(move.terms == terms for move in self.moves):
                break
            self.terms = terms
            self.moves.append(Move(terms, chosen.effect, dropped))
        self._add_lines(self.attempt(self.terms))
        self.unexplained = self._unexplained(self.attempt(self.terms))

    def _without(self, effect: str) -> Search:
        """The search with one effect barred: what stands in for two others keeps either of them out."""
        detour = Search(self.study, self.given, self.alpha, self._seed, self._progress)
        detour._attempts, detour._shapes, detour._values = self._attempts, self._shapes, self._values
        detour._barred = effect
        detour._climb()
        return detour

    def _choose(self, attempt: Attempt) -> Term | None:
        """The term to add; None when nothing in the catalogue is significant, or a plain shape explains it better."""
        allowed = [each for each in attempt.scored if each.candidate.term.effect != self._barred]
        significant = [each for each in allowed if self._significant(attempt, each)]
        if not significant:
            return None
        if self._foreign(attempt, max(significant, key=attempt.evidence)):
            beside = self._beside_shape(attempt)
            significant = [each for each in significant if each.candidate.term.effect in beside]
        significant.sort(key=attempt.evidence, reverse=True)
        while significant:
            first = significant[0].score.statistic
            near = first - 30.0 if first < LINEAR else 0.25 * first
            options = [each for each in significant if each.score.statistic >= near][:REFITTED]
            tried = [(self._refitted_cost(attempt, each), each) for each in options]
            for cost, each in sorted(tried, key=lambda pair: pair[0]):
                if np.isfinite(cost) and self._falls(attempt, each) and not self._likeness(attempt, each):
                    return each.candidate.term
            tried_out = {each.candidate.term.effect for each in options}
            significant = [each for each in significant if each.candidate.term.effect not in tried_out]
        return None

    def _significant(self, attempt: Attempt, scored: Scored) -> bool:
        """At the catalogue's share of the level, confirmed where the noise is not known beforehand."""
        level = CATALOGUE_SHARE * self.alpha
        return attempt.corrected(self.p_of_scored(attempt, scored)) < level

    @staticmethod
    def p_of_scored(attempt: Attempt, scored: Scored) -> float:
        """P-value of a candidate, by bootstrap where it matters and its noise comes from the scatter."""
        p_value, score = scored.score.p_value, scored.score
        if attempt.corrected(p_value) >= CONFIRM_FROM or not attempt.to_be_drawn(score.basis):
            return p_value
        law = attempt.bootstrap.law(scored.candidate.term.effect)
        return max(p_value, law.p_value(score.statistic, score.dimension))

    def _refitted_cost(self, attempt: Attempt, scored: Scored) -> float:
        """Chi-square after the full fit, with the price of dimensions and choices; infinite when it is singular."""
        try:
            trial = self.attempt((*attempt.terms, scored.candidate.term))
        except UNFIT:
            return float("inf")
        # One noise for all: the sigma of each trial is its own guess.
        white = attempt.noise.whiten(trial.unexplained())
        pulls = trial.left[len(white) :]
        price = 2.0 * (0.5 * scored.score.statistic - attempt.evidence(scored))
        return float(white @ white + pulls @ pulls) + price

    def _falls(self, attempt: Attempt, scored: Scored) -> bool:
        """Whether held-out data come out better with the candidate in; undecided counts as yes."""
        ratio = self.held_out_ratio(self.attempt((*attempt.terms, scored.candidate.term)), attempt)
        return not ratio >= 1.0

    def held_out_ratio(self, after: Attempt, before: Attempt) -> float:
        """Held-out error after over before, in the series that changed, with one noise for both; NaN if unknown."""
        if len(after.left) < len(after.result.residuals) or len(after.result.residuals) != len(
            before.result.residuals
        ):
            return float("nan")
        touched = self._touched(after, before)
        basis = orthonormal(before.jacobian_with(after.noise), UNDETERMINED)
        left = np.concatenate([after.noise.whiten(before.unexplained()), before.left[len(before.result.residuals) :]])
        earlier = HeldOut(before.model.observations, basis, left - basis @ (basis.T @ left))
        return after.held_out.error(series=touched) / earlier.error(series=touched)

    def _touched(self, after: Attempt, before: Attempt) -> IntArray:
        """Series in which the two models differ at all."""
        change = np.abs(after.noise.whiten(after.unexplained() - before.unexplained()))
        series_of = after.model.observations.series_of
        largest = np.zeros(len(after.model.observations.series))
        np.maximum.at(largest, series_of, change)
        return np.flatnonzero(largest > 1e-3 * largest.max())

    def _foreign(self, attempt: Attempt, best: Scored) -> bool:
        """Does the strongest plain shape make the best effect needless, and not the other way round?"""
        shape = attempt.best_shape
        if shape is None or shape.p_value_corrected >= SHAPES_SHARE * self.alpha:
            return False
        own = attempt.padded(attempt.noise.whiten(shape.columns))
        columns = attempt.columns(best.candidate)
        effect = attempt.corrected(_extended(attempt, own).score(columns).p_value)
        beside = corrected(_extended(attempt, columns).score(own).p_value, shape.n_eff)
        return effect >= CATALOGUE_SHARE * self.alpha and beside < SHAPES_SHARE * self.alpha

    def _beside_shape(self, attempt: Attempt) -> set[str]:
        """Effects that are significant with the strongest plain shape in the model."""
        assert attempt.best_shape is not None
        own = attempt.padded(attempt.noise.whiten(attempt.best_shape.columns))
        projector = _extended(attempt, own)
        level = CATALOGUE_SHARE * self.alpha
        return {
            each.candidate.term.effect
            for each in attempt.scored
            if attempt.corrected(projector.score(attempt.columns(each.candidate)).p_value) < level
        }

    def _likeness(self, attempt: Attempt, scored: Scored) -> bool:
        """Is the candidate needless beside the plain shapes that are left with it in the model?"""
        with_it = self.attempt((*attempt.terms, scored.candidate.term))
        shapes = self._shapes_left(with_it)
        if not shapes:
            return False
        columns = np.hstack([attempt.padded(attempt.noise.whiten(shape.columns)) for shape in shapes])
        beside = _extended(attempt, columns).score(attempt.columns(scored.candidate))
        return attempt.corrected(beside.p_value) >= CATALOGUE_SHARE * self.alpha

    def _shapes_left(self, attempt: Attempt) -> list[Best]:
        """Plain shapes that are significant one after another, the strongest first."""
        found: list[Best] = []
        shape, level = attempt.best_shape, SHAPES_SHARE * self.alpha
        rng = np.random.default_rng([self._seed, 4])
        columns = np.zeros((len(attempt.left), 0))
        while shape is not None and shape.p_value_corrected < level and len(found) < MOST_SHAPES:
            found.append(shape)
            columns = np.hstack([columns, attempt.padded(attempt.noise.whiten(shape.columns))])
            shape = attempt.generic.best(attempt.noise, _extended(attempt, columns), rng)
        return found

    def _floated(self, terms: tuple[Term, ...]) -> tuple[tuple[Term, ...], tuple[str, ...]]:
        """The terms without those that are no longer needed beside the others, and what was dropped."""
        dropped: list[str] = []
        while True:
            added = [term for term in terms if term not in self.given]
            if len(added) < 2:
                return terms, tuple(dropped)
            p_values = {term.effect: self.p_of_term(terms, term) for term in added[:-1]}
            worst = max(p_values, key=lambda effect: p_values[effect])
            if self.attempt(terms).corrected(p_values[worst]) < CATALOGUE_SHARE * self.alpha:
                return terms, tuple(dropped)
            dropped.append(worst)
            terms = tuple(term for term in terms if term.effect != worst or term in self.given)

    def p_of_term(self, terms: Sequence[Term], term: Term) -> float:
        """P-value of one of the terms given the others, from the fits with and without it."""
        with_it = self.attempt(terms)
        try:
            without = self.attempt([each for each in terms if each != term])
        except UNFIT:  # what cannot be fitted without it needs it
            return 0.0
        white = with_it.noise.whiten(without.unexplained())
        pulls = without.left[len(without.result.residuals) :]
        fall = float(white @ white + pulls @ pulls) - with_it.result.chi2
        dimension = sum(owner == term.effect for owner in with_it.model.owners)
        same = [each.score.dof for each in without.scored if each.candidate.term.effect == term.effect]
        return float(p_of(max(fall, 0.0), max(dimension, 1), min(same, default=np.inf)))

    def _add_lines(self, attempt: Attempt) -> None:
        found = [line for line in self.study.lines(attempt.model) if line.p_value < LINES_SHARE * self.alpha]
        self.lines = sorted(found, key=lambda line: line.p_value)
        for line in self.lines:
            if line.term not in self.terms and len(self.suggested) < MOST_TERMS:
                self.terms = (*self.terms, line.term)
                self.moves.append(Move(self.terms, line.term.effect, ()))

    def _unexplained(self, attempt: Attempt) -> Best | None:
        shape = attempt.best_shape
        if shape is None:
            return None
        p_value = shape.p_value_corrected
        if p_value < CONFIRM_FROM and attempt.to_be_drawn(shape.columns):
            law = attempt.bootstrap.shapes
            p_value = max(p_value, corrected(law.p_value(shape.statistic, shape.dimension), shape.n_eff))
        return shape if p_value < SHAPES_SHARE * self.alpha else None

    def adequate(self, terms: Sequence[Term]) -> bool:
        """Nothing in the catalogue or of a plain shape is significant beside these terms."""
        attempt = self.attempt(terms)
        return not any(self._significant(attempt, each) for each in attempt.scored) and (
            self._unexplained(attempt) is None
        )

    def rivals(self, term: Term) -> list[Rival]:
        """Other effects that would do instead of a suggested one: with them in, neither it nor more is needed."""
        others = tuple(each for each in self.terms if each != term)
        without = self.attempt(others)
        own = next((each for each in without.scored if each.candidate.term.effect == term.effect), None)
        if own is None:
            return []
        found = []
        for each in without.scored:
            effect = each.candidate.term.effect
            if effect == term.effect or not each.score.dimension:
                continue
            if each.score.statistic < 0.25 * own.score.statistic:
                continue
            if (instead := self._substituted(others, each, own)) is not None:
                size = sum(owner == term.effect for owner in self.attempt(self.terms).model.owners)
                wider = self._contains(instead, effect, own, max(size, len(own.candidate.names)))
                found.append(Rival(term.effect, each.candidate.term, wider))
        return found

    def _substituted(self, others: tuple[Term, ...], rival: Scored, simpler: Scored) -> Attempt | None:
        term = simpler.candidate.term
        try:
            instead = self.attempt((*others, rival.candidate.term))
            own = next((each for each in instead.scored if each.candidate.term.effect == term.effect), None)
        except UNFIT:
            return None
        if own is not None and own.score.dimension and own.score.p_value < RIVAL_LEVEL * self.alpha:
            return None
        return instead if self.adequate((*others, rival.candidate.term)) else None

    @staticmethod
    def _contains(attempt: Attempt, effect: str, simpler: Scored, parameters: int) -> bool:
        """Whether an effect has more parameters than another's, whose doing it can imitate entirely.

        A candidate's columns are its amplitudes: what is scanned for counts as a parameter once it is in a model.
        """
        own = [i for i, owner in enumerate(attempt.model.owners) if owner == effect]
        if len(own) <= parameters:
            return False
        rest = np.delete(attempt.jacobian, own, axis=1)
        others = Projector(rest, attempt.left, attempt.noise.dof, len(attempt.noise.dof))
        span = orthonormal(others.free(attempt.jacobian[:, own]), 1e-6)
        inner = orthonormal(others.free(attempt.columns(simpler.candidate)), 1e-6)
        return contained(inner, span) > _CONTAINED


def _extended(attempt: Attempt, columns: np.ndarray) -> Projector:
    """The projector with columns among what is fitted."""
    return Projector(
        np.hstack([attempt.jacobian, columns]), attempt.left, attempt.noise.dof, len(attempt.result.residuals)
    )


def corrected_for(attempt: Attempt, p_value: float) -> float:
    """A catalogue p-value at the level over all trials together, shares included."""
    return min(corrected(p_value, attempt.n_eff) / CATALOGUE_SHARE, 1.0)
