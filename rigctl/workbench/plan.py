"""Which runs to make: one after the other, each the one that tells most per second of rig time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import ceil

import numpy as np

from rigctl.workbench.information import Information
from rigctl.workbench.study import FloatArray, Proposal

_LOOKED_AT = 160
"""So many of the best are looked at again for the second run and further ones."""

_WORTH = 0.02
"""Of what is wanted: runs that add less are not worth their time."""


def greedy(
    gains: Callable[[Sequence[int]], FloatArray],
    take: Callable[[int], None],
    worth: Callable[[float, int], bool],
    takes_s: FloatArray,
    most: int,
) -> list[int]:
    """Runs in the order chosen, of all whose rig time is in `takes_s`; one may be chosen more than once.

    `gains` tells what each of some runs would add, `take` counts one as made, `worth` whether so much is worth a run
    after so many.
    """
    chosen: list[int] = []
    near: Sequence[int] = range(len(takes_s))
    while len(chosen) < most and len(near):
        gain = gains(near)
        value = gain / takes_s[list(near)]
        best = int(np.argmax(value))
        if not worth(float(gain[best]), len(chosen)):
            break
        chosen.append(near[best])
        take(near[best])
        if len(chosen) == 1:
            near = [near[i] for i in np.argsort(-value)[:_LOOKED_AT]]
    return chosen


def rig_time_s(proposals: Sequence[Proposal]) -> FloatArray:
    """Of each run; where it is not known, one is like another."""
    return np.array([each.takes_s if each.takes_s > 0.0 else 1.0 for each in proposals])


class Plan:
    """Runs for several questions at once: what counts is the sum over questions of min(lambda / wanted, 1).

    More is no gain. `course` has the questions' lambdas before and after each run that was chosen.
    """

    def __init__(
        self, known: Sequence[Information], wanted: Sequence[float], takes_s: FloatArray, most_runs: int
    ) -> None:
        self._known = known
        self._wanted = np.array(wanted)
        self._most_runs = most_runs
        self.course = [self._now()]
        self.runs = greedy(self._gains, self._take, self._worth, takes_s, most_runs if known else 0)

    def promised(self, number: int) -> list[float]:
        """The course of one question."""
        return [float(each[number]) for each in self.course]

    def _now(self) -> FloatArray:
        return np.array([each.lambda_now() for each in self._known])

    def _gains(self, which: Sequence[int]) -> FloatArray:
        gain = np.zeros(len(which))
        for each, wanted, now in zip(self._known, self._wanted, self.course[-1], strict=True):
            if now < wanted:
                gain += np.minimum(each.lambda_with(which) / wanted, 1.0) - now / wanted
        return gain

    def _take(self, run: int) -> None:
        for each in self._known:
            each.add(run)
        self.course.append(self._now())

    def _worth(self, gain: float, made: int) -> bool:
        """Whether it is much, or what is missing could still be reached with the runs left."""
        missing = float(np.sum(np.maximum(1.0 - self.course[-1] / self._wanted, 0.0)))
        if not missing:
            return False
        return gain >= _WORTH / (1 + made // 6) or gain * (self._most_runs - made) >= 0.5 * missing


def runs_needed(course: Sequence[float], wanted: float) -> int | None:
    """Runs until enough is promised; where the list ends before, as many more as its last ones suggest."""
    reached = next((count for count, value in enumerate(course) if value >= wanted), None)
    if reached is not None or len(course) < 2:
        return reached
    rate = (course[-1] - course[0]) / (len(course) - 1)
    return len(course) - 1 + ceil((wanted - course[-1]) / rate) if rate > 1e-3 * wanted else None


def shuffled(runs: Sequence[Proposal], seed: int) -> tuple[Proposal, ...]:
    """In random order, so that no drift passes for what settings do; each room temperature is gone to once."""
    mixed = [runs[i] for i in np.random.default_rng([seed, 4]).permutation(len(runs))]
    rooms = list(dict.fromkeys(str(run.settings.get("temperature_c", "")) for run in mixed))
    rooms.sort(key=lambda room: room != "")
    return tuple(sorted(mixed, key=lambda run: rooms.index(str(run.settings.get("temperature_c", "")))))
