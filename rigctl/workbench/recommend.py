"""The next measurement: the runs that best separate what is ambiguous, show what is hidden, or tighten the result.

For an effect j and what it must be told from (a rival k, or the fitted parameters alone) the promise of runs x is

    lambda = b' V(data + x) b,    V = G_j' M G_j,    M projecting out everything fitted, k among it,

with b the effect's size: as estimated where it is significant, else the catalogue's typical one, since what is not
significant is estimated too large. lambda is how far chi-square will be from what it would be, on average, with the
wrong one of the two in the model.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any, Literal

import numpy as np
from scipy import optimize, stats

from rigctl.errors import RigError
from rigctl.workbench.attempt import Attempt
from rigctl.workbench.findings import Diagnosis, Rank
from rigctl.workbench.information import Imagined, Information
from rigctl.workbench.score import ABSORBED
from rigctl.workbench.study import FloatArray, Plannable, Proposal, Study, Term
from rigctl.workbench.threads import one_thread

PROMISE = 25.0
"""Lambda that separates: one question at half the default level, any one or two parameters, power 0.95."""

LEVEL = 0.005
POWER = 0.95
MOST_RUNS = 24
_LOOKED_AT = 160
_WORTH = 0.02
"""Of what is wanted: runs that add less are not worth their time."""

_HOPELESS = 0.2 * PROMISE
"""A lambda that nothing can lift past this is no promise."""

_TIGHTER = 0.02

Purpose = Literal["separate", "reveal", "tighten", "none"]
Allowed = Callable[[Proposal], bool]


@dataclass(frozen=True)
class Question:
    """Is it `term`, or `rival`? Or without a rival: is it there at all, so that `instead` does not imitate it?

    `size` (d,) are the parameters' sizes, `basis` where they are from; `beside` is what else is in the model.
    """

    term: Term
    rival: Term | None
    size: FloatArray
    basis: Literal["estimate", "typical"]
    instead: str = ""

    @property
    def other(self) -> str:
        """What it must be told from."""
        return self.rival.effect if self.rival else self.instead


@dataclass(frozen=True)
class Answer:
    """What the runs promise for one question; `runs_needed` None when they do not reach the power."""

    question: Question
    lambda_now: float
    lambda_promised: float
    power: float
    runs_needed: int | None

    def as_json(self) -> dict[str, Any]:
        """Within `next_measurement` in JSON."""
        return {
            "effect": self.question.term.effect,
            "from": self.question.other,
            "size": self.question.basis,
            "lambda_now": self.lambda_now,
            "lambda": self.lambda_promised,
            "power": self.power,
            "runs_needed": self.runs_needed,
        }


@dataclass(frozen=True)
class Tightened:
    """A parameter of the result, its standard uncertainty now and with the runs."""

    name: str
    sigma_now: float
    sigma_promised: float
    unit: str

    def as_json(self) -> dict[str, Any]:
        """Within `next_measurement` in JSON."""
        return {**vars(self)}


@dataclass(frozen=True)
class Recommendation:
    """Runs to make next, in this order, and what they promise; `words` says it in a few sentences."""

    purpose: Purpose
    runs: tuple[Proposal, ...]
    words: str
    answers: tuple[Answer, ...] = ()
    hopeless: tuple[Answer, ...] = ()
    result: tuple[Tightened, ...] = ()
    best: Proposal | None = None

    @property
    def takes_s(self) -> float:
        """Rig time of all runs; NaN where it is not known."""
        return float(sum(run.takes_s for run in self.runs))

    def as_json(self) -> dict[str, Any]:
        """The value of `next_measurement`."""
        return {
            "purpose": self.purpose,
            "description": self.words,
            "runs": [dict(run.settings) for run in self.runs],
            "best_run": None if self.best is None else dict(self.best.settings),
            "takes_s": self.takes_s if self.runs else 0.0,
            "promises": [answer.as_json() for answer in self.answers],
            "cannot_be_separated": [answer.as_json() for answer in self.hopeless],
            "result": [each.as_json() for each in self.result],
        }


@one_thread
def recommend(
    study: Study,
    terms: Sequence[Term],
    diagnosis: Diagnosis,
    *,
    allowed: Allowed | None = None,
    offered: Sequence[Proposal] | None = None,
    seed: int = 0,
    most_runs: int = MOST_RUNS,
) -> Recommendation:
    """What to measure next, given what `diagnosis` found beside `terms`.

    Rivals first; then effects that cannot be told from others or are absorbed; then what is not testable at all; else
    what tightens the result. Runs are chosen among those `offered`, by default all options of the study; `allowed`
    says which of them the bench can do, `seed` fixes their order.
    """
    if not isinstance(study, Plannable):
        return Recommendation("none", (), f"Nothing is known of what a '{study.experiment}' rig could measure next.")
    offered = [each for each in offered or study.options() if allowed is None or allowed(each)]
    if not offered:
        return Recommendation("none", (), "There is no run that the bench can do.")
    final = diagnosis.steps[-1].terms if diagnosis.steps else tuple(terms)
    groups = [_rivals(study, final, diagnosis), _inseparable(study, final, diagnosis)]
    hopeless: list[Answer] = []
    for purpose, (base, questions) in zip(("separate", "reveal"), groups, strict=True):
        if not questions:
            continue
        imagined = Imagined(study, Attempt(study, base), offered)
        plan, chosen = _planned(imagined, questions, most_runs)
        promising = [answer for answer in plan.answers() if answer.lambda_promised >= _HOPELESS]
        hopeless += [answer for answer in plan.answers() if answer.lambda_promised < _HOPELESS]
        reached = [answer for answer in promising if answer.lambda_promised >= PROMISE]
        if reached and len(reached) < len(plan.questions):
            # What cannot be reached anyway would take its share of the runs.
            hopeless += [answer for answer in promising if answer not in reached]
            plan, chosen = _planned(imagined, [answer.question for answer in reached], most_runs)
            promising = list(plan.answers())
        if chosen and promising:
            runs = shuffled([offered[i] for i in chosen], seed)
            return Recommendation(
                purpose,  # type: ignore[arg-type]
                runs,
                _words(promising, hopeless, runs),
                tuple(promising),
                tuple(hopeless),
                best=offered[chosen[0]],
            )
    return _tighten(study, final, offered, hopeless, seed, most_runs)


def _planned(imagined: Imagined, questions: Sequence[Question], most_runs: int) -> tuple[Plan, list[int]]:
    plan = Plan(imagined, questions, most_runs)
    return plan, plan.runs()


class Plan:
    """A greedy choice of runs for several questions: each step the largest gain per second of rig time.

    What counts is the sum over questions of min(lambda / wanted, 1), PROMISE by default: more is no gain. `among`
    are the proposals to choose from, `run_price_s` the rig time that a run is worth where runs are limited too.
    """

    def __init__(
        self,
        imagined: Imagined,
        questions: Sequence[Question],
        most_runs: int,
        wanted: Sequence[float] | None = None,
        among: Sequence[int] | None = None,
        run_price_s: float = 0.0,
    ) -> None:
        self._among = range(len(imagined.proposals)) if among is None else among
        self._most_runs = most_runs
        takes_s = [each.takes_s if each.takes_s > 0.0 else 1.0 for each in imagined.proposals]
        self._takes_s = np.array(takes_s) + run_price_s
        known = [_information(imagined, question) for question in questions]
        asked = [number for number, information in enumerate(known) if information is not None]
        self.questions = [questions[number] for number in asked]
        self._known = [information for information in known if information is not None]
        self._wanted = [PROMISE if wanted is None else wanted[number] for number in asked]
        self.before = [each.lambda_now() for each in self._known]
        self._course: list[list[float]] = [self.before]

    def runs(self) -> list[int]:
        """Which proposals to make, the most telling first; one may be made more than once."""
        chosen: list[int] = []
        near: Sequence[int] = self._among
        while len(chosen) < self._most_runs and self._known:
            value, gain = self._gains(near)
            if not chosen:
                best_first = np.argsort(-value)[:_LOOKED_AT]
                near = [near[i] for i in best_first]
                value, gain = value[best_first], gain[best_first]
            best = int(np.argmax(value))
            if gain[best] < _WORTH / (1 + len(chosen) // 6) and not self._slowly(gain[best], len(chosen)):
                break
            chosen.append(near[best])
            for each in self._known:
                each.add(near[best])
            self._course.append([each.lambda_now() for each in self._known])
            if all(value >= wanted for value, wanted in zip(self._course[-1], self._wanted, strict=True)):
                break
        return chosen

    def answers(self) -> list[Answer]:
        """What the chosen runs promise."""
        return [
            Answer(
                question,
                course[0],
                course[-1],
                power(course[-1], int(np.sum(question.size != 0.0))),
                _needed(course, wanted),
            )
            for question, course, wanted in zip(
                self.questions, zip(*self._course, strict=True), self._wanted, strict=True
            )
        ]

    def _gains(self, which: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """Gain per second and gain of each of these runs."""
        gain = np.zeros(len(which))
        for each, wanted in zip(self._known, self._wanted, strict=True):
            now = each.lambda_now()
            if now < wanted:
                gain += np.minimum(each.lambda_with(which) / wanted, 1.0) - now / wanted
        return gain / self._takes_s[list(which)], gain

    def _slowly(self, gain: float, made: int) -> bool:
        """Whether what is missing could still be reached with the runs left."""
        pairs = zip(self._course[-1], self._wanted, strict=True)
        missing = sum(max(1.0 - now / wanted, 0.0) for now, wanted in pairs)
        return bool(gain * (self._most_runs - made) >= 0.5 * missing)


def _needed(course: Sequence[float], wanted: float) -> int | None:
    """Runs until enough is promised; where the list ends before, as many more as its last ones suggest."""
    reached = next((count for count, value in enumerate(course) if value >= wanted), None)
    if reached is not None or len(course) < 2:
        return reached
    rate = (course[-1] - course[0]) / (len(course) - 1)
    return len(course) - 1 + ceil((wanted - course[-1]) / rate) if rate > 1e-3 * wanted else None


def needed(level: float, dof: float = np.inf) -> float:
    """Lambda of one parameter that is significant at a level with power 0.95, the noise being known with `dof`."""
    if not np.isfinite(dof):
        return float((stats.norm.isf(level / 2.0) + stats.norm.ppf(POWER)) ** 2)
    threshold = stats.f.isf(level, 1, dof)

    def lacking(size: float) -> float:
        return float(stats.ncf.sf(threshold, 1, dof, size)) - POWER

    return float(optimize.brentq(lacking, 1e-3, 20.0 * threshold))


def power(noncentrality: float, dimension: int) -> float:
    """Probability that an effect of this lambda is seen at the level of one question."""
    threshold = stats.chi2.isf(LEVEL, max(dimension, 1))
    return float(stats.ncx2.sf(threshold, max(dimension, 1), max(noncentrality, 1e-12)))


def _information(imagined: Imagined, question: Question) -> Information | None:
    """What is known of a question; None when no run can be asked."""
    own = imagined.columns(question.term)
    if own is None or own.shape[1] != len(question.size):
        return None
    beside = [imagined.fitted, own[:, question.size == 0.0]]
    if question.rival is not None:
        rival = imagined.columns(question.rival)
        if rival is None:
            return None
        beside.append(rival)
    absorbed = ABSORBED if question.rival is None else 0.0
    return Information(np.hstack(beside), own @ question.size, imagined.made, imagined.rows_of, absorbed)


# What there is to ask


def _rivals(study: Study, final: Sequence[Term], diagnosis: Diagnosis) -> tuple[tuple[Term, ...], list[Question]]:
    """Of what was found and has an equal: either against the other, at the size it would have."""
    ranks = {rank.term.effect: rank for rank in diagnosis.ranking}
    contested = [
        rank
        for rank in diagnosis.ranking
        if rank.term in final and rank.term not in diagnosis.terms and _equals(rank, ranks)
    ]
    if not contested:
        return tuple(final), []
    doubted = [rank.term for rank in contested]
    base = tuple(term for term in final if term not in doubted)
    sizes: dict[str, FloatArray] = {}
    questions = []
    for rank in contested:
        others = tuple(each.term for each in contested if each is not rank)
        for alternative in _equals(rank, ranks):
            for one, other in ((rank.term, alternative), (alternative, rank.term)):
                size = sizes.setdefault(one.effect, _estimated(study, (*base, *others), one))
                if len(size):
                    questions.append(Question(one, other, size, "estimate"))
    return base, questions


def _equals(rank: Rank, ranks: dict[str, Rank]) -> list[Term]:
    return [ranks[name].term for name in rank.equivalent_to if name in ranks]


def _estimated(study: Study, beside: Sequence[Term], term: Term) -> FloatArray:
    """Size of a term fitted beside others, (d,); empty when it cannot be."""
    try:
        attempt = Attempt(study, (*[each for each in beside if each != term], term))
    except RigError:
        return np.zeros(0)
    own = [i for i, owner in enumerate(attempt.model.owners) if owner == term.effect]
    return np.asarray(attempt.result.values[own])


def _inseparable(
    study: Study, final: Sequence[Term], diagnosis: Diagnosis
) -> tuple[tuple[Term, ...], list[Question]]:
    """Effects that these data cannot tell from another, or from what is fitted: at their typical sizes."""
    attempt = Attempt(study, final)
    scored = {each.candidate.term.effect: each for each in attempt.scored}
    questions = []
    absorbed: set[str] = set()
    for pair in diagnosis.inseparable:
        if pair.effect not in scored or pair.effect in absorbed:
            continue
        own = scored[pair.effect].candidate
        if pair.other.startswith("baseline:"):
            absorbed.add(pair.effect)
            size = np.where(scored[pair.effect].score.keep < ABSORBED, own.typical, 0.0)
            if size.any():
                questions.append(Question(own.term, None, size, "typical", pair.other))
        elif pair.other in scored:
            questions.append(Question(own.term, scored[pair.other].candidate.term, own.typical, "typical"))
    return tuple(final), questions


# What makes the result better


def _tighten(
    study: Plannable,
    final: Sequence[Term],
    offered: Sequence[Proposal],
    hopeless: Sequence[Answer],
    seed: int,
    most_runs: int,
) -> Recommendation:
    attempt = Attempt(study, final)
    imagined = Imagined(study, attempt, offered)
    result = study.result(attempt.model, attempt.result.values, attempt.result.covariance)
    wanted = [name for name in imagined.names if name in result]
    said = _hopeless_words(hopeless)
    if not wanted:
        return Recommendation(
            "none", (), f"{said}Nothing is ambiguous, and the result has no parameter to tighten.".strip()
        )
    plan = [_precision(imagined, name) for name in wanted]
    before = [each.lambda_now() for each in plan]
    takes_s = np.array([each.takes_s if each.takes_s > 0.0 else 1.0 for each in offered])
    chosen: list[int] = []
    near: Sequence[int] = range(len(offered))
    while len(chosen) < min(most_runs, 6):
        gain = sum((np.log(each.lambda_with(near) / each.lambda_now()) for each in plan), np.zeros(len(near)))
        value = gain / takes_s[list(near)]
        best = int(np.argmax(value))
        if gain[best] < _TIGHTER * len(plan):
            break
        chosen.append(near[best])
        if len(chosen) == 1:
            near = [near[i] for i in np.argsort(-value)[:_LOOKED_AT]]
        for each in plan:
            each.add(chosen[-1])
    tightened = tuple(
        Tightened(name, was**-0.5, each.lambda_now() ** -0.5, result[name]["unit"])
        for name, was, each in zip(wanted, before, plan, strict=True)
    )
    if not chosen:
        return Recommendation(
            "none", (), f"{said}Nothing is ambiguous, and no single run would tighten the result by 1 %.".strip()
        )
    runs = shuffled([offered[i] for i in chosen], seed)
    gains = ", ".join(
        f"{t.name} from {t.sigma_now:.3g} to {t.sigma_promised:.3g} {t.unit}".strip() for t in tightened[:3]
    )
    words = f"{said}{_counted(runs)} would tighten the result: the standard uncertainty of {gains}."
    return Recommendation("tighten", runs, words, (), tuple(hopeless), tightened, offered[chosen[0]])


def _precision(imagined: Imagined, name: str) -> Information:
    """1 / sigma^2 of one fitted parameter."""
    where = imagined.names.index(name)
    others = np.delete(imagined.fitted, where, axis=1)
    own = imagined.fitted[:, where]
    return Information(others, own, imagined.made, imagined.rows_of)


# Words


def shuffled(runs: Sequence[Proposal], seed: int) -> tuple[Proposal, ...]:
    """In random order, so that no drift passes for what settings do; each room temperature is gone to once."""
    mixed = [runs[i] for i in np.random.default_rng([seed, 4]).permutation(len(runs))]
    rooms = list(dict.fromkeys(str(run.settings.get("temperature_c", "")) for run in mixed))
    rooms.sort(key=lambda room: room != "")
    return tuple(sorted(mixed, key=lambda run: rooms.index(str(run.settings.get("temperature_c", "")))))


def _words(answers: Sequence[Answer], hopeless: Sequence[Answer], runs: Sequence[Proposal]) -> str:
    told = []
    for answer in answers:
        size = "as large as estimated" if answer.question.basis == "estimate" else "of its typical size"
        chance = f"lambda {answer.lambda_promised:.3g}, probability {answer.power:.0%}"
        if answer.lambda_promised < PROMISE and answer.runs_needed is not None:
            chance += f"; {answer.runs_needed} runs like these would do"
        told.append(f"{answer.question.term.effect}, {size}, from {_plain(answer.question.other)} ({chance})")
    return f"{_counted(runs)} would tell {'; '.join(told)}. {_hopeless_words(hopeless)}".strip()


def _hopeless_words(hopeless: Sequence[Answer]) -> str:
    if not hopeless:
        return ""
    told = "; ".join(f"{each.question.term.effect} from {_plain(each.question.other)}" for each in hopeless)
    return f"Beyond what runs like these can tell apart: {told}. "


def _plain(other: str) -> str:
    return f"the baseline's {other.removeprefix('baseline:')}" if other.startswith("baseline:") else other


def _counted(runs: Sequence[Proposal]) -> str:
    takes_s = sum(run.takes_s for run in runs)
    known = bool(np.isfinite(takes_s))
    noun = ("run" if known else "reading") + ("" if len(runs) == 1 else "s")
    return f"{len(runs)} {noun}{f' ({takes_s / 60.0:.1f} min of rig time)' if known else ''}"
