"""A recommendation as data and in words: which runs, and what they promise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from rigctl.workbench.next.noncentrality import SEPARATING_LAMBDA
from rigctl.workbench.next.questions import Question
from rigctl.workbench.next.rig_time import total_s
from rigctl.workbench.study import CourseKind, Proposal

Purpose = Literal["separate", "reveal", "tighten", "none"]


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
class Revealed:
    """What a course does for one effect: the smallest size that shows, by parameter, as it is, after it, and after as
    many runs of the same kind as there are."""

    effect: str
    now: dict[str, float]
    promised: dict[str, float]
    if_repeated: dict[str, float]
    units: dict[str, str]

    def as_json(self) -> dict[str, Any]:
        """Within `smallest_detectable` of `rigctl next --json`."""
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
    course: CourseKind | None = None
    sizes: tuple[Revealed, ...] = ()

    @property
    def takes_s(self) -> float:
        """Rig time of all runs; NaN where it is not known."""
        return total_s(self.runs)

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
            "course": self.course,
            "smallest_detectable": [each.as_json() for each in self.sizes],
        }


def telling_words(answers: Sequence[Answer], hopeless: Sequence[Answer], runs: Sequence[Proposal]) -> str:
    """Of runs that answer questions."""
    answered = []
    for answer in answers:
        size = "as large as estimated" if answer.question.basis == "estimate" else "of its typical size"
        chance = f"lambda {answer.lambda_promised:.3g}, probability {answer.power:.0%}"
        if answer.lambda_promised < SEPARATING_LAMBDA and answer.runs_needed is not None:
            chance += f"; {answer.runs_needed} runs like these would do"
        answered.append(f"{answer.question.term.effect}, {size}, from {_plain(answer.question.other)} ({chance})")
    return f"{_counted(runs)} would tell {'; '.join(answered)}. {hopeless_words(hopeless)}".strip()


def course_words(
    kind: CourseKind, answers: Sequence[Answer], sizes: Sequence[Revealed], runs: Sequence[Proposal]
) -> str:
    """Of runs in an order, and at times, that make what is slow visible."""
    shown = []
    for answer, size in zip(answers, sizes, strict=True):
        least = [
            f"{name} from {size.promised[name]:.3g} {unit} on, now from {size.now[name]:.3g}, with as many more "
            f"runs of the scan from {size.if_repeated[name]:.3g}"
            for name, unit in size.units.items()
            if name in size.promised
        ]
        promise = f"lambda {answer.lambda_promised:.3g}, now {answer.lambda_now:.3g}"
        shown.append(f"{size.effect} ({promise}, if as large as white noise would have shown): {'; '.join(least)}")
    said = f"{_counted(runs)} as {kind}, in this order, would show what slow noise may hide"
    told = f"{said}, and tell it from what else may act: {'. '.join(shown)}."
    # Runs at other times tell more of the noise too, and a diagnosis counts how little is known of it.
    return f"{told} That is if the noise goes on by the law that these data tell."


def tightening_words(result: Sequence[Tightened], runs: Sequence[Proposal]) -> str:
    """Of runs that make the result better."""
    gains = [f"{t.name} from {t.sigma_now:.3g} to {t.sigma_promised:.3g} {t.unit}".strip() for t in result[:3]]
    return f"{_counted(runs)} would tighten the result: the standard uncertainty of {', '.join(gains)}."


def hopeless_words(hopeless: Sequence[Answer]) -> str:
    """Of questions that no runs answer; "" for none."""
    if not hopeless:
        return ""
    pairs = "; ".join(f"{each.question.term.effect} from {_plain(each.question.other)}" for each in hopeless)
    return f"Beyond what runs like these can tell apart: {pairs}. "


def _plain(other: str) -> str:
    return f"the baseline's {other.removeprefix('baseline:')}" if other.startswith("baseline:") else other


def _counted(runs: Sequence[Proposal]) -> str:
    takes_s = total_s(runs)
    # A table's readings have no rig time that anybody knows.
    known = bool(np.isfinite(takes_s))
    noun = ("run" if known else "reading") + ("" if len(runs) == 1 else "s")
    return f"{len(runs)} {noun}{f' ({takes_s / 60.0:.1f} min of rig time)' if known else ''}"
