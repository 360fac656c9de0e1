"""How much of the catalogue the data exclude, by the yardstick of a full scan; and the runs that exclude more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigctl.workbench.attempt import Attempt
from rigctl.workbench.imagined import Imagined
from rigctl.workbench.information import Information, Triangle
from rigctl.workbench.plan import Plan, rig_time_s
from rigctl.workbench.promise import needed
from rigctl.workbench.questions import Question
from rigctl.workbench.search import CATALOGUE_SHARE
from rigctl.workbench.study import Candidate, FloatArray, Plannable, Proposal, Term
from rigctl.workbench.threads import one_thread

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
    asked = [candidate.term for candidate in imagined.candidates]
    scanned, there = Triangle(imagined, asked, made=imagined.beliefs), Triangle(imagined, asked)
    scan = range(len(options), len(options) + len(full_scan))
    level = CATALOGUE_SHARE * alpha / attempt.n_eff
    dof = {each.candidate.term.effect: each.score.dof for each in attempt.scored}
    wanted: list[float] = []
    known: list[Information] = []
    found: list[tuple[str, str, float, str]] = []
    for candidate in imagined.candidates:
        for number, name in enumerate(candidate.names):
            size = _shown_by(scanned, candidate, number, scan)
            information = None if size is None else there.about(Question(candidate.term, None, size, "typical"))
            if size is None or information is None:
                continue
            known.append(information)
            wanted.append(needed(level, dof.get(candidate.term.effect, np.inf)))
            found.append((candidate.term.effect, name, float(size[number]), candidate.units[number]))
    plan = Plan(known, wanted, rig_time_s(options) + run_price_s, batch)
    shares = [value / enough for value, enough in zip(plan.course[0], wanted, strict=True)]
    parameters = [Excluded(*each, share=float(share)) for each, share in zip(found, shares, strict=True)]
    return Sensitivity(tuple(parameters), tuple(options[i] for i in plan.runs))


def _shown_by(scanned: Triangle, candidate: Candidate, number: int, scan: range) -> FloatArray | None:
    """The size of one parameter that a full scan alone shows at 8 sigma; None when it would be absorbed there."""
    size = np.where(np.arange(len(candidate.typical)) == number, candidate.typical, 0.0)
    alone = scanned.about(Question(candidate.term, None, size, "typical"))
    if alone is None:
        return None
    for run in scan:
        alone.add(run)
    return None if alone.absorbed else np.asarray(size * SIZE_SIGMA / np.sqrt(alone.lambda_now()))
