"""In which order, and when, to measure again so that what slow noise may hide becomes visible.

Runs are not independent here: the noise of a course is correlated with that of the data there are and from run to
run, by the law that these data tell; every other effect of the catalogue may act too, as far as its typical size.
What is promised is about an effect of the size that these data would have shown if their noise were white.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.workbench.hidden import HiddenInNoise
from rigctl.workbench.next.decide import others_than
from rigctl.workbench.next.imagined import Imagined
from rigctl.workbench.next.information import Information
from rigctl.workbench.next.noncentrality import needed_noncentrality, power
from rigctl.workbench.next.questions import Question
from rigctl.workbench.next.recommendation import Answer, Revealed
from rigctl.workbench.next.rig_time import total_s
from rigctl.workbench.next.triangle import triangle_of
from rigctl.workbench.study import Allowed, Course, Scheduled
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.significance import CATALOGUE_SHARE

ENOUGH = 0.95
"""Of the best course's worth: of those that reach so much, the one that takes least rig time."""

LEAST = 0.2
"""Of what it takes to show one effect: a course that adds less is not worth its time."""


@dataclass(frozen=True)
class Revealing:
    """A course with its promises; `answers` one per effect that it can be asked about."""

    course: Course
    answers: tuple[Answer, ...]
    sizes: tuple[Revealed, ...]


def revealing(
    study: Scheduled, attempt: Attempt, hidden: Sequence[HiddenInNoise], alpha: float, allowed: Allowed | None
) -> Revealing | None:
    """The course that shows what slow noise may hide in the least rig time; None where no course does."""
    asked = [_Asked(attempt, each, alpha) for each in hidden]
    courses = [each for each in study.courses() if allowed is None or all(map(allowed, each.runs))]
    if not courses:
        return None
    now, *promised = [_lambdas(study, attempt, each, asked) for each in (None, *courses)]
    worths = [_worth(each, asked) for each in promised]
    most, there = max(worths, default=0.0), _worth(now, asked)
    if most < there + LEAST:
        return None
    enough = [i for i, worth in enumerate(worths) if worth >= ENOUGH * most]
    best = min(enough, key=lambda i: total_s(courses[i].runs))
    same = {len(c.runs): p for c, p in zip(courses, promised, strict=True) if c.kind == "more of the same"}
    repeated = same.get(len(courses[best].runs), now)
    rows = list(zip(asked, now, promised[best], repeated, strict=True))
    return Revealing(
        courses[best],
        tuple(each.answer(float(before), float(after), len(courses[best].runs)) for each, before, after, _ in rows),
        tuple(each.revealed(float(before), float(after), float(more)) for each, before, after, more in rows),
    )


class _Asked:
    """One effect at the size that would show if the noise were white, and what lambda it takes to show."""

    def __init__(self, attempt: Attempt, hidden: HiddenInNoise, alpha: float) -> None:
        names = list(hidden.units)
        self.hidden = hidden
        size = np.array([hidden.detectable_if_white.get(name, 0.0) for name in names])
        self.question = Question(hidden.term, None, size, "if-white", "slow noise")
        self._level = CATALOGUE_SHARE * alpha / attempt.trials_of(hidden.term.effect)
        self.wanted = needed_noncentrality(self._level)

    def answer(self, now: float, promised: float, runs: int) -> Answer:
        dimension = int(np.sum(self.question.size != 0.0))
        needed = runs if promised >= self.wanted else None
        return Answer(self.question, now, promised, power(promised, dimension, self._level), needed)

    def revealed(self, now: float, promised: float, repeated: float) -> Revealed:
        def shown(noncentrality: float) -> dict[str, float]:
            scale = float(np.sqrt(self.wanted / noncentrality)) if noncentrality > 0.0 else np.inf
            return {name: scale * size for name, size in self.hidden.detectable_if_white.items()}

        return Revealed(
            self.hidden.term.effect, shown(now), shown(promised), shown(repeated), dict(self.hidden.units)
        )


def _worth(lambdas: FloatArray, asked: Sequence[_Asked]) -> float:
    return float(sum(min(value / each.wanted, 1.0) for value, each in zip(lambdas, asked, strict=True)))


def _lambdas(study: Scheduled, attempt: Attempt, course: Course | None, asked: Sequence[_Asked]) -> FloatArray:
    """Noncentrality of each effect with all runs of a course made; None: of the data there are."""
    runs = study.courses()[0].runs if course is None else course.runs
    imagined = Imagined(study, attempt, runs, course=True)
    return np.array([_lambda(imagined, each.question, made=course is not None) for each in asked])


def _lambda(imagined: Imagined, question: Question, *, made: bool) -> float:
    # What drifts goes with a room that warms up: to show an effect is to tell it from the others.
    information = Information(triangle_of(imagined, question.terms, others=others_than([question], imagined)))
    for run in range(len(imagined.proposals)) if made else ():
        information.add(run)
    known = information.asked(question)
    return 0.0 if known is None else float(information.noncentralities([known])[0])
