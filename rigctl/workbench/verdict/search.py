"""Which set of effects is missing: the best is added, everything fitted again, what is no longer needed dropped."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from rigctl.core.errors import UNFIT
from rigctl.workbench.findings import MOST_TERMS
from rigctl.workbench.study import Line, Study, Term
from rigctl.workbench.verdict.attempt import Attempt, Scored
from rigctl.workbench.verdict.beside_shapes import (
    needless_beside_shapes,
    replaced_by_shape,
    shapes_left,
    significant_beside_shape,
)
from rigctl.workbench.verdict.choices import joined
from rigctl.workbench.verdict.first_order import FAR_MOST, found_at_most, least_comparable
from rigctl.workbench.verdict.fitted_model import (
    FittedModel,
    fit_that_explains_no_less,
    fit_with_given_noise,
    held_out_ratio,
)
from rigctl.workbench.verdict.generic import Best
from rigctl.workbench.verdict.impossible import impossible_parameters
from rigctl.workbench.verdict.known_noise import KnownNoise
from rigctl.workbench.verdict.noise import Noise
from rigctl.workbench.verdict.rather_than_noise import break_rather_than_noise
from rigctl.workbench.verdict.score import p_of
from rigctl.workbench.verdict.shared import Shared
from rigctl.workbench.verdict.significance import (
    LINES_SHARE,
    corrected_for,
    is_adequate,
    is_significant,
    significant_shape,
)
from rigctl.workbench.verdict.simplest import most_evident_first, simplest
from rigctl.workbench.verdict.unrecorded import imitations

REFITTED = 4
"""So many of the best are fitted in full before one is chosen: T is first order."""

_NO_WORSE = 1.0
"""Of chi-square: so much more a fit may leave than one with fewer terms, whose noise was another."""

_NUMBERS_KEPT, _LEAST_KEPT = 3_000_000, 3
"""Data of models that are kept, and the least number of models."""

_NUMBERS_WHOLE, _LEAST_WHOLE = 200_000, 3
"""The same of models that are kept with their derivatives and all that was scored beside them."""

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Move:
    """A step of the search."""

    terms: tuple[Term, ...]
    added: str | None
    dropped: tuple[str, ...]


class Search:
    """A search from the given terms, which are never dropped; ends in `terms`.

    With `known` noise every model is judged by it; else each by the noise that it leaves. `shared` is what attempts
    have in common, with those made elsewhere too.
    """

    def __init__(
        self,
        study: Study,
        terms: Sequence[Term],
        alpha: float,
        seed: int,
        progress: Progress,
        known: KnownNoise | None = None,
        shared: Shared | None = None,
    ) -> None:
        self.study = study
        self.alpha = alpha
        self.seed = seed
        self._progress = progress
        self._known = known
        self._attempts: dict[tuple[str, ...], Attempt] = {}
        self._shapes_left: WeakKeyDictionary[Attempt, Sequence[Best]] = WeakKeyDictionary()
        self._shared = shared or Shared()
        self._values: dict[str, dict[str, float]] = {}
        self._cheapest: dict[tuple[str, ...], FittedModel] = {}
        self.given = tuple(terms)
        self.terms = self.given
        self.moves = [Move(self.given, None, ())]
        self.unexplained: Best | None = None
        self.lines: list[Line] = []
        self._barred: str | None = None
        self._to_beat: tuple[Noise, float] | None = None

    def attempt(self, terms: Sequence[Term]) -> Attempt:
        """The model with these terms, fitted and scored once."""
        key = _key(terms)
        if key in self._attempts:
            # The last asked for is the last to go.
            self._attempts[key] = self._attempts.pop(key)
            self._forget()
        else:
            start, fitted = self._start(terms), self._cheapest.pop(key, None)
            made = Attempt(self.study, terms, self.seed, self._shared, start, self._known, fitted=fitted)
            self.adopt(self._no_worse(made))
        return self._attempts[key]

    def _no_worse(self, made: Attempt) -> Attempt:
        """The model, fitted anew from where one with a term less explains more than it does.

        Two lines that begin at one place are one line, and a fit finds no way out of there.
        """
        names = {term.key for term in made.terms}
        smaller = [each for each in self._attempts.values() if len({term.key for term in each.terms} ^ names) == 1]
        left = {each: each.chi2_with(made.noise) for each in smaller if len(each.terms) < len(made.terms)}
        best = min(left, key=lambda each: left[each], default=None)
        if best is None or made.chi2_with(made.noise) <= left[best] + _NO_WORSE:
            return made
        start = {
            each.name: best.values.get(each.name, each.start if each.name in made.scanned else 0.0)
            for each in made.model.parameters
        }
        try:
            fitted = fit_that_explains_no_less(made.model, made.noise, best.held, start)
            again = Attempt(self.study, made.terms, self.seed, self._shared, None, self._known, fitted=fitted)
        except UNFIT:
            return made
        return min(made, again, key=lambda each: each.chi2_with(made.noise))

    def adopt(self, attempt: Attempt) -> None:
        """Keep a fitted model, and start others from it."""
        names = {term.effect: term.key for term in attempt.terms}
        self._attempts[_key(attempt.terms)] = attempt
        for owner, (name, value) in zip(attempt.model.owners, attempt.values.items(), strict=True):
            self._values.setdefault(names.get(owner, ""), {})[name] = value
        self._forget()

    def _start(self, terms: Sequence[Term]) -> dict[str, float]:
        """Where to start from: another choice of the same effect is nowhere."""
        owners = ("", *(term.key for term in terms))
        return {name: value for owner in owners for name, value in self._values.get(owner, {}).items()}

    def _forget(self) -> None:
        """Models of long tables that were not asked for lately: a fit is made again in less than a second or two."""
        data = len(next(iter(self._attempts.values())).left)
        kept, whole = max(_NUMBERS_KEPT // data, _LEAST_KEPT), max(_NUMBERS_WHOLE // data, _LEAST_WHOLE)
        while len(self._attempts) > kept:
            del self._attempts[next(iter(self._attempts))]
        for each in list(self._attempts.values())[:-whole]:
            each.let_go()

    def attempt_if_fit(self, terms: Sequence[Term]) -> Attempt | None:
        """The same; None for terms that these data do not determine together, or as nature never has them."""
        try:
            made = self.attempt(terms)
        except UNFIT:
            return None
        added = {term.effect for term in terms} - {term.effect for term in self.given}
        return None if impossible_parameters(made, added, self.alpha) else made

    @property
    def knows_noise(self) -> bool:
        """Whether every model is judged by one noise."""
        return self._known is not None

    @property
    def suggested(self) -> tuple[Term, ...]:
        """What was added to the given terms."""
        return tuple(term for term in self.terms if term not in self.given)

    @property
    def found(self) -> tuple[Term, ...]:
        """The same without lines of the samples: they change none of the data whose scatter tells the noise."""
        lines = {line.term.effect for line in self.lines}
        return tuple(term for term in self.suggested if term.effect not in lines)

    def run_from(self, richest: Attempt) -> None:
        """Add what the `richest` model has besides, drop of it what is not needed, and go on from there."""
        there = {term.effect for term in self.given}
        terms = (*self.given, *(term for term in richest.terms if term.effect not in there))
        self.adopt(richest)
        if self.attempt_if_fit(terms) is None:
            self.run()
            return
        for count in range(len(self.given) + 1, len(terms) + 1):
            self.moves.append(Move(terms[:count], terms[count - 1].effect, ()))
        self.terms, dropped = self._without_needless(terms, len(terms))
        if dropped:
            self.moves.append(Move(self.terms, None, dropped))
        self._climb()

    def run(self) -> None:
        """Add and drop until nothing that is left can be explained."""
        self._climb()
        if self.unexplained is not None and (both := self._pair(self.unexplained)):
            first, (terms, dropped) = (*self.terms, both[0]), self._floated((*self.terms, *both))
            self.moves += [Move(first, both[0].effect, ()), Move(terms, both[1].effect, dropped)]
            self.terms, self.unexplained = terms, None
        self._take_detour()
        self._prefer_simplest()

    def _take_detour(self) -> None:
        """Another end where this one does not fit, or costs more than a search without one of its effects."""
        final = self.attempt(self.terms)
        if self.unexplained is None and not final.chi2_p_value() < self.alpha:
            return
        price = self.price(final.noise)
        for term in self.suggested:
            # A likeness of two effects may have kept both out: without it the search finds them, if they are cheaper.
            detour = self._without(term.effect, final.noise, price)
            if detour.unexplained is None and detour.price(final.noise) < price:
                self.terms, self.moves = detour.terms, detour.moves
                self.lines, self.unexplained = detour.lines, None
                return

    def _prefer_simplest(self) -> None:
        """Of effects that do as well as one that was found the simplest."""
        lines = {line.term.effect for line in self.lines}
        for term in self.suggested:
            if term.effect in lines:
                continue
            simpler = simplest(self.attempt_if_fit, self.terms, term, self.alpha)
            if simpler != term:
                self.terms = tuple(simpler if each == term else each for each in self.terms)
                self.moves.append(Move(self.terms, simpler.effect, (term.effect,)))

    def _pair(self, shape: Best) -> tuple[Term, Term] | None:
        """Two effects that together explain what one plain shape does, and all else, where neither does alone.

        A shape with amplitude and phase is as good as two effects that differ in nothing else. It is preferred to
        them only by what it costs: parameters, and how many there were to choose from.
        """
        attempt = self.attempt(self.terms)
        allowed = [e for e in self._allowed(attempt, self.terms) if e.score.dimension]
        pairs = list(itertools.combinations(allowed, 2))
        per_dimension, choices = 0.5 * float(np.log(len(attempt.result.residuals))), float(np.log(max(len(pairs), 1)))
        wanted = 0.5 * shape.statistic - shape.dimension * per_dimension - float(np.log(shape.n_eff))
        better = []
        for pair in pairs:
            score = attempt.projector.score(np.hstack([attempt.columns(each.candidate) for each in pair]))
            evidence = 0.5 * score.statistic - score.dimension * per_dimension - choices
            if evidence > wanted:
                better.append((evidence, (pair[0].candidate.term, pair[1].candidate.term)))
        for _, both in sorted(better, key=lambda each: -each[0])[:REFITTED]:
            if self._explain(both):
                return both
        return None

    def _explain(self, both: tuple[Term, Term]) -> bool:
        """Whether two further terms are both needed, and nothing beside them is."""
        terms = (*self.terms, *both)
        with_both = self.attempt_if_fit(terms)
        if with_both is None or any(self.corrected_p_of_term(terms, each) >= self.alpha for each in both):
            return False
        return is_adequate(with_both, self.alpha)

    def price(self, noise: Noise) -> float:
        """Chi-square of what was found, with one noise for all that is compared, and what its parameters cost."""
        attempt = self.attempt(self.terms)
        added = sum(owner in {term.effect for term in self.suggested} for owner in attempt.model.owners)
        return attempt.chi2_with(noise) + added * float(np.log(len(attempt.result.residuals)))

    def _climb(self) -> None:
        # What lines do to the data effects would be taken for.
        self._add_lines(self.attempt(self.terms), in_data=True)
        while len(self.suggested) < MOST_TERMS:
            attempt = self.attempt(self.terms)
            if self._is_beaten(attempt):
                return
            self._progress(f"effects added: {len(self.suggested)}, candidates: {attempt.choices}")
            chosen = self._next(attempt)
            if chosen is None:
                break
            terms, dropped = self._floated(joined(self.terms, chosen))
            # A set that was there before: it would go round in circles.
            if any(move.terms == terms for move in self.moves):
                break
            self.terms = terms
            self.moves.append(Move(terms, chosen.effect, dropped))
        # Lines last: they are looked for in what the effects leave of the samples.
        self._add_lines(self.attempt(self.terms))
        self.unexplained = significant_shape(self.attempt(self.terms), self.alpha)
        if self.unexplained and (imitated := imitations(self.attempt(self.given), self.suggested, self.alpha)):
            self.terms = tuple(term for term in self.terms if term not in imitated)
            self.moves.append(Move(self.terms, None, tuple(term.effect for term in imitated)))
            self.unexplained = significant_shape(self.attempt(self.terms), self.alpha) or self.unexplained

    def _is_beaten(self, attempt: Attempt) -> bool:
        """Whether this search cannot end below the price it has to beat, whatever else is added to this model."""
        if self._to_beat is None:
            return False
        columns = [attempt.columns(each.candidate) for each in self._allowed(attempt, self.given)]
        if 2 * sum(each.shape[1] for each in columns) > len(attempt.left):
            return False
        together = attempt.projector.score(np.hstack(columns)).statistic if columns else 0.0
        noise, price = self._to_beat
        share = FAR_MOST * together / float(attempt.left @ attempt.left)
        return (1.0 - share) * attempt.chi2_with(noise) > price

    def _without(self, effect: str, noise: Noise, price: float) -> Search:
        """The search with one effect barred, which may have taken the place of two others, to end below a price."""
        detour = Search(self.study, self.given, self.alpha, self.seed, self._progress, self._known, self._shared)
        # A model means the same in both searches: fits are shared.
        detour._attempts, detour._values, detour._shapes_left = self._attempts, self._values, self._shapes_left
        detour._barred, detour._to_beat = effect, (noise, price)
        detour._climb()
        return detour

    def _next(self, attempt: Attempt) -> Term | None:
        """The term to add; None when nothing helps."""
        if self._known is None:
            # Noise that was estimated without a break of the level may hide it.
            return self._choose(attempt) or (self._break_of_level(attempt) if attempt.noise.slow else None)
        # Noise that was estimated beside a break is less than what the data have without: the break comes first.
        return (self._break_of_level(attempt) if self._known.beside_break else None) or self._choose(attempt)

    def _break_of_level(self, attempt: Attempt) -> Term | None:
        """The break that correlated noise may stand for; None where there is none, or these data do not fit it."""
        found = break_rather_than_noise(attempt)
        if found is None or found.effect == self._barred:
            return None
        return found if self.attempt_if_fit((*attempt.terms, found)) is not None else None

    def _choose(self, attempt: Attempt) -> Term | None:
        """The most significant term; None when nothing in the catalogue is, or a plain shape explains it better."""
        allowed = self._allowed(attempt, self.given)
        significant = [each for each in allowed if is_significant(attempt, each, self.alpha)]
        if not significant:
            return None
        if replaced_by_shape(attempt, max(significant, key=attempt.evidence), self.alpha):
            beside = significant_beside_shape(attempt, self.alpha)
            significant = [each for each in significant if each.candidate.term.effect in beside]
        significant = most_evident_first(attempt, significant)
        while significant:
            near = least_comparable(significant[0].score.statistic)
            options = [each for each in significant if each.score.statistic >= near][:REFITTED]
            tried = self._refitted(attempt, options)
            for cost, each in sorted(tried, key=lambda pair: pair[0]):
                if np.isfinite(cost) and self._is_improvement(attempt, each):
                    return each.candidate.term
            tried_out = {each.candidate.term.effect for _, each in tried}
            significant = [each for each in significant if each.candidate.term.effect not in tried_out]
        return None

    def _allowed(self, attempt: Attempt, kept: Sequence[Term]) -> list[Scored]:
        """Candidates but the barred effect and what makes one of the `kept` terms richer."""
        barred = {term.effect for term in kept} | {self._barred}
        return [each for each in attempt.scored if each.candidate.term.effect not in barred]

    def _refitted(self, attempt: Attempt, options: Sequence[Scored]) -> list[tuple[float, Scored]]:
        """Costs after full fits, but of those options that are dearer than others whatever a fit finds."""
        if len(options) == 1:
            return [(0.0, options[0])]
        before, tried = attempt.chi2_with(attempt.noise), list[tuple[float, Scored]]()
        for each in options:
            least = before - found_at_most(each.score.statistic) + 2.0 * attempt.price(each)
            cheapest = min((cost for cost, _ in tried), default=float("inf"))
            if least < cheapest or not tried:
                tried.append((self._refitted_cost(attempt, each, cheapest), each))
        return tried

    def _refitted_cost(self, attempt: Attempt, scored: Scored, cheapest: float) -> float:
        """Chi-square after the full fit, with the price of dimensions and choices; infinite when it is singular.

        A fit that costs less than the `cheapest` so far is kept for the whole model.
        """
        terms = joined(attempt.terms, scored.candidate.term)
        try:
            # One noise for all: the sigma of each model is its own guess.
            fitted = self._attempts.get(_key(terms)) or fit_with_given_noise(
                self.study.model(terms), self._start(terms), attempt.noise
            )
        except UNFIT:
            return float("inf")
        # The price is in log evidence; twice that is the scale of chi-square.
        cost = fitted.chi2_with(attempt.noise) + 2.0 * attempt.price(scored)
        if cost < cheapest:
            self._cheapest = {_key(terms): fitted}
        return cost

    def _is_improvement(self, attempt: Attempt, scored: Scored) -> bool:
        """Whether held-out data come out better with the candidate in, undecided counting as yes, and plain shapes
        do not make it needless."""
        with_it = self.attempt_if_fit(joined(attempt.terms, scored.candidate.term))
        if with_it is None or held_out_ratio(with_it, attempt) >= 1.0:
            return False
        if with_it not in self._shapes_left:
            self._shapes_left[with_it] = shapes_left(with_it, self.alpha, self.seed)
        return not needless_beside_shapes(attempt, scored, self._shapes_left[with_it], self.alpha)

    def _floated(self, terms: tuple[Term, ...]) -> tuple[tuple[Term, ...], tuple[str, ...]]:
        """The terms without those that are no longer needed beside the last, and what was dropped."""
        return self._without_needless(terms, len(terms) - 1)

    def _without_needless(self, terms: tuple[Term, ...], asked: int) -> tuple[tuple[Term, ...], tuple[str, ...]]:
        """The terms without those of the first `asked` that the others make needless, and what was dropped."""
        last, dropped = terms[asked:], list[str]()
        while True:
            fitted = self.attempt(terms)
            lines = {line.term for line in self.lines}
            added = [term for term in terms if term not in self.given and term not in (*last, *lines)]
            # What stands out far enough is needed beyond doubt.
            doubted = [
                term
                for term in added
                if corrected_for(fitted, fitted.p_without(term.effect), term.effect) >= self.alpha
            ]
            p_values = {term.effect: self.corrected_p_of_term(terms, term) for term in doubted}
            worst = max(p_values, key=lambda effect: p_values[effect], default=None)
            if worst is None or p_values[worst] < self.alpha:
                return terms, tuple(dropped)
            dropped.append(worst)
            terms = tuple(term for term in terms if term.effect != worst or term in self.given)

    def corrected_p_of_term(self, terms: Sequence[Term], term: Term) -> float:
        """The same for the questions that are asked beside the others; compares with the level itself."""
        without = self.attempt_if_fit([each for each in terms if each != term])
        return 0.0 if without is None else corrected_for(without, self.p_of_term(terms, term), term.effect)

    def p_of_term(self, terms: Sequence[Term], term: Term) -> float:
        """P-value of one of the terms given the others, from the fits with and without it."""
        with_it = self.attempt(terms)
        without = self.attempt_if_fit([each for each in terms if each != term])
        if without is None:  # what cannot be fitted without it needs it
            return 0.0
        # Both in the noise of the fuller model, which the term does not inflate.
        fall = without.chi2_with(with_it.noise) - with_it.result.chi2
        dimension = sum(owner == term.effect for owner in with_it.model.owners)
        return float(p_of(max(fall, 0.0), max(dimension, 1), without.dof_of(term.effect)))

    def _add_lines(self, attempt: Attempt, *, in_data: bool = False) -> None:
        """Lines of the samples that are significant, or those of them alone that are `in_data`."""
        asked = [line for line in self.study.lines(attempt.model) if line.in_data or not in_data]
        significant = [line for line in asked if line.p_value < LINES_SHARE * self.alpha]
        found = sorted(significant, key=lambda line: line.p_value)
        self.lines = [*(line for line in self.lines if line.term in self.terms), *found]
        for line in found:
            if line.term not in self.terms and len(self.suggested) < MOST_TERMS:
                self.terms = (*self.terms, line.term)
                self.moves.append(Move(self.terms, line.term.effect, ()))


def _key(terms: Sequence[Term]) -> tuple[str, ...]:
    """The same whatever their order."""
    return tuple(sorted(term.key for term in terms))
