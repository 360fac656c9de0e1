"""Which runs to make: chosen one after the other, each with the largest gain per second of rig time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import ceil

import numpy as np

from rigctl.core.arrays import FloatArray, IntArray
from rigctl.workbench.next.information import Asked, Information
from rigctl.workbench.next.rig_time import RigTime
from rigctl.workbench.study import Proposal

_WORTH = 0.02
"""Of what is wanted: runs that add less are not worth their time."""

_WAY = 0.1
"""Of the worth of reaching what is wanted: what the way there counts, on a scale of logarithms from `_BEGINS`."""

_BEGINS = 1e-4

COMPANY = 6
"""Least runs of a sitting, as far as runs may be made."""


def greedy(
    gains: Callable[[], FloatArray],
    take: Callable[[int], None],
    worth: Callable[[float, int], bool],
    rig_time: RigTime,
    most: int,
) -> list[int]:
    """Runs in the order chosen, among those of `rig_time`; one may be chosen more than once.

    `gains` tells what each would add, `take` counts one as made, `worth` whether so much is worth a run after so
    many.
    """
    chosen: list[int] = []
    while len(chosen) < most:
        # The information may know further runs, which are not offered (a full scan to compare with).
        gain = gains()[: rig_time.runs]
        best = int(np.argmax(gain / rig_time.of_each(chosen)))
        if not worth(float(gain[best]), len(chosen)):
            break
        chosen.append(best)
        take(best)
    return chosen


class Plan:
    """Runs for several questions at once, of those of `rig_time` (the first of the information's).

    What counts is the sum over questions of min(lambda / wanted, 1): more is no gain. A tenth of it goes by the
    logarithm: what needs three runs to be told (a rival with two parameters) shows next to nothing after the first.
    `course` has the questions' lambdas before and after each run that was chosen.
    """

    def __init__(
        self,
        information: Information,
        questions: Sequence[Asked],
        wanted: Sequence[float],
        rig_time: RigTime,
        most_runs: int,
    ) -> None:
        self._information = information
        self._questions = questions
        self._wanted = np.array(wanted)
        self._most_runs = most_runs
        self.course = [information.noncentralities(questions)]
        self.runs = greedy(self._gains, self._take, self._worth, rig_time, most_runs if questions else 0)
        for sitting in rig_time.sittings(self.runs):
            self._accompany(sitting)

    def promised(self, number: int) -> list[float]:
        """The course of one question."""
        return [float(each[number]) for each in self.course]

    def _accompany(self, sitting: IntArray) -> None:
        """Further runs where a sitting has few: a single run cannot tell an effect from drift and slow noise."""
        chosen = [run for run in self.runs if run in sitting]
        for _ in range(min(COMPANY - len(chosen), self._most_runs - len(self.runs))):
            left = np.setdiff1d(sitting, self.runs)
            if not len(left):
                return
            lambdas = self._information.noncentralities_with_each(self._questions)[:, left]
            # Logarithms: no question is left behind for one that gains much from every run.
            self.runs.append(int(left[np.argmax(np.sum(np.log(lambdas + 1.0), axis=0))]))
            self._take(self.runs[-1])

    def _gains(self) -> FloatArray:
        worth = _worth_of(self._information.noncentralities_with_each(self._questions) / self._wanted[:, None])
        return np.asarray(np.sum(worth - _worth_of(self.course[-1] / self._wanted)[:, None], axis=0))

    def _take(self, run: int) -> None:
        self._information.add(run)
        self.course.append(self._information.noncentralities(self._questions))

    def _worth(self, gain: float, made: int) -> bool:
        """Whether it is much, or what is missing could still be reached with the runs left."""
        missing = float(np.sum(1.0 - _worth_of(self.course[-1] / self._wanted)))
        if not missing:
            return False
        return gain >= _WORTH / (1 + made // 6) or gain * (self._most_runs - made) >= 0.5 * missing


def _worth_of(share: FloatArray | float) -> FloatArray:
    """Of having such a share of what is wanted."""
    capped = np.minimum(share, 1.0)
    return np.asarray((1.0 - _WAY) * capped + _WAY * np.log1p(capped / _BEGINS) / np.log1p(1.0 / _BEGINS))


def runs_needed(course: Sequence[float], wanted: float) -> int | None:
    """Runs until enough is promised; where the list ends before, as many more as its last ones suggest."""
    reached = next((count for count, value in enumerate(course) if value >= wanted), None)
    if reached is not None or len(course) < 2:
        return reached
    # Lambda grows about in proportion to the number of runs.
    rate = (course[-1] - course[0]) / (len(course) - 1)
    return len(course) - 1 + ceil((wanted - course[-1]) / rate) if rate > 1e-3 * wanted else None


def shuffled(runs: Sequence[Proposal], seed: int) -> tuple[Proposal, ...]:
    """In random order, so that no drift passes for what settings do; each room temperature is gone to once, last the
    warmest."""
    mixed = [runs[i] for i in np.random.default_rng([seed, 4]).permutation(len(runs))]
    return tuple(sorted(mixed, key=lambda run: float(run.settings.get("temperature_c", -np.inf))))
