"""Which effects the data exclude, at the size that a full scan would show; and the runs that exclude more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.threads import one_thread
from rigctl.workbench.next.imagined import Imagined
from rigctl.workbench.next.information import Asked, Information
from rigctl.workbench.next.noncentrality import needed_noncentrality
from rigctl.workbench.next.plan import Plan
from rigctl.workbench.next.questions import Question
from rigctl.workbench.next.rig_time import RigTime
from rigctl.workbench.next.triangle import triangle_of
from rigctl.workbench.study import Candidate, Plannable, Proposal, Term
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.significance import CATALOGUE_SHARE

SIZE_SIGMA = 8.0
"""Effects that a full scan would show so clearly are looked for."""


@dataclass(frozen=True)
class Excluded:
    """One parameter of an effect that is not in the model: `size` [unit] is what a full scan shows at 8 sigma.

    `share` is the lambda of that size in these data over what power 0.95 takes: excluded from 1 on.
    """

    effect: str
    parameter: str
    size: float
    unit: str
    share: float

    def as_json(self) -> dict[str, Any]:
        """Within `rigctl investigate --json`."""
        return {**vars(self), "excluded": self.share >= 1.0}


@dataclass(frozen=True)
class Sensitivity:
    """What is excluded, and the runs (proposals' indices) that would best exclude the rest."""

    parameters: tuple[Excluded, ...]
    batch: tuple[Proposal, ...]


@one_thread
def sensitivity(
    study: Plannable,
    terms: Sequence[Term],
    full_scan: Sequence[Proposal],
    options: Sequence[Proposal],
    alpha: float,
    batch: int,
    run_price_s: float = 0.0,
) -> Sensitivity:
    """What the runs of `study` exclude beside `terms`, and a `batch` of `options` to go on with; see `Plan`."""
    attempt = Attempt(study, terms)
    imagined = Imagined(study, attempt, [*options, *full_scan])
    candidate_terms = [candidate.term for candidate in imagined.candidates]
    information = Information(triangle_of(imagined, candidate_terms))
    # Without the data there are: the size that a full scan would show by itself.
    scanned = Information(triangle_of(imagined, candidate_terms, made=imagined.beliefs))
    for run in range(len(options), len(imagined.proposals)):
        scanned.add(run)
    dof = {each.candidate.term.effect: each.score.dof for each in attempt.scored}
    wanted: list[float] = []
    questions: list[Asked] = []
    asked: list[tuple[str, str, float, str]] = []
    for candidate in imagined.candidates:
        for number, name in enumerate(candidate.names):
            size = _shown_by(scanned, candidate, number)
            if size is None:
                continue
            questions.append(_parameter(information, candidate, size))
            # Of one trial among all of the catalogue (Bonferroni).
            level = CATALOGUE_SHARE * alpha / attempt.trials_of(candidate.term.effect)
            wanted.append(needed_noncentrality(level, dof.get(candidate.term.effect, np.inf)))
            asked.append((candidate.term.effect, name, float(size[number]), candidate.units[number]))
    plan = Plan(information, questions, wanted, RigTime(options, run_price_s), batch)
    # The course begins with the runs there are: what they exclude already.
    shares = [value / enough for value, enough in zip(plan.course[0], wanted, strict=True)]
    parameters = [Excluded(*each, share=float(share)) for each, share in zip(asked, shares, strict=True)]
    return Sensitivity(tuple(parameters), tuple(options[i] for i in plan.runs))


def _shown_by(scanned: Information, candidate: Candidate, number: int) -> FloatArray | None:
    """The size of one parameter that a full scan alone shows at 8 sigma; None when it would be absorbed there."""
    size = np.where(np.arange(len(candidate.typical)) == number, candidate.typical, 0.0)
    asked = _parameter(scanned, candidate, size)
    if scanned.is_absorbed(asked):
        return None
    return np.asarray(size * SIZE_SIGMA / np.sqrt(scanned.noncentralities([asked])[0]))


def _parameter(information: Information, candidate: Candidate, size: FloatArray) -> Asked:
    asked = information.asked(Question(candidate.term, None, size, "typical"))
    assert asked is not None  # a candidate has columns
    return asked
