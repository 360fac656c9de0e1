"""How much of the catalogue the data exclude, by the yardstick of a full scan; and the runs that exclude more."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigctl.workbench.attempt import Attempt
from rigctl.workbench.information import Imagined, Information
from rigctl.workbench.recommend import Plan, Question, needed
from rigctl.workbench.score import ABSORBED
from rigctl.workbench.search import CATALOGUE_SHARE
from rigctl.workbench.study import FloatArray, Plannable, Proposal, Term
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

    @property
    def reached(self) -> bool:
        """Whether everything a full scan would show is excluded."""
        return all(each.share >= 1.0 for each in self.parameters)


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
    scan = range(len(options), len(options) + len(full_scan))
    level = CATALOGUE_SHARE * alpha / attempt.n_eff
    dof = {each.candidate.term.effect: each.score.dof for each in attempt.scored}
    wanted: list[float] = []
    questions: list[Question] = []
    found: list[tuple[str, str, float, str]] = []
    for candidate in imagined.candidates:
        columns = imagined.columns(candidate.term)
        assert columns is not None
        for number, name in enumerate(candidate.names):
            size = _shown_by(imagined, columns, number, candidate.typical, scan)
            if size is not None:
                questions.append(Question(candidate.term, None, size, "typical"))
                wanted.append(needed(level, dof.get(candidate.term.effect, np.inf)))
                found.append((candidate.term.effect, name, float(size[number]), candidate.units[number]))
    plan = Plan(imagined, questions, batch, wanted, among=range(len(options)), run_price_s=run_price_s)
    shares = [value / enough for value, enough in zip(plan.before, wanted, strict=True)]
    parameters = [Excluded(*each, share=share) for each, share in zip(found, shares, strict=True)]
    chosen = plan.runs() if any(each.share < 1.0 for each in parameters) else []
    return Sensitivity(tuple(parameters), tuple(options[i] for i in chosen))


def _shown_by(
    imagined: Imagined, columns: FloatArray, number: int, typical: FloatArray, scan: range
) -> FloatArray | None:
    """The size of one parameter that a full scan alone shows at 8 sigma; None when it would be absorbed there."""
    size = np.where(np.arange(len(typical)) == number, typical, 0.0)
    beside = np.hstack([imagined.fitted, np.delete(columns, number, axis=1)])
    alone = Information(beside, columns @ size, imagined.priors, imagined.rows_of, ABSORBED)
    for run in scan:
        alone.add(run)
    seen = alone.lambda_now()
    asked = float(np.sum((columns @ size)[np.concatenate([imagined.rows_of[run] for run in scan])] ** 2))
    if not seen > ABSORBED**2 * asked:
        return None
    return np.asarray(size * SIZE_SIGMA / np.sqrt(seen))


def by_effect(parameters: Sequence[Excluded]) -> Mapping[str, float]:
    """The smallest share of each effect's parameters."""
    shares: dict[str, float] = {}
    for each in parameters:
        shares[each.effect] = min(each.share, shares.get(each.effect, np.inf))
    return shares
