"""What we do beside what it is measured against, taken in turn on the same disk."""

from __future__ import annotations

import random
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

PAUSE_S = 4e-3
"""Up to this long is spun before each turn: a wait for the disk often ends on a scheduler tick (4 ms at 250 Hz), and
whatever starts on one as well would seem to take whole ticks."""


@dataclass(frozen=True)
class Pairs:
    """Durations [s], turn by turn."""

    floor_s: list[float]
    ours_s: list[float]

    @property
    def ratio(self) -> float:
        """Ours over the floor, of the medians."""
        return statistics.median(self.ours_s) / statistics.median(self.floor_s)

    def line(self, name: str, target: float | None) -> str:
        """The medians, their ratio with the quartiles of the pairs' own, the ratio of the means, and the verdict."""
        low, _, high = statistics.quantiles([a / b for a, b in zip(self.ours_s, self.floor_s, strict=True)], n=4)
        means = statistics.mean(self.ours_s) / statistics.mean(self.floor_s)
        verdict = "" if target is None else f"  <= {target:g}" + ("" if self.ratio <= target else "  MISSED")
        floor_ms, ours_ms = 1e3 * statistics.median(self.floor_s), 1e3 * statistics.median(self.ours_s)
        return (
            f"  {name:<44} {floor_ms:7.2f} ms {ours_ms:7.2f} ms"
            f"  {self.ratio:6.2f}  ({low:.2f} .. {high:.2f}; of the means {means:.2f}){verdict}"
        )


def pairs(floor: Callable[[], object], ours: Callable[[int], object], turns: int) -> Pairs:
    """`turns` of each, after one that does not count; `ours` is told its number."""
    found = Pairs([], [])
    dice = random.Random(1)
    for number in range(turns + 1):
        floor_s = timed_s(floor, dice)
        ours_s = timed_s(lambda: ours(number), dice)  # noqa: B023 - called at once
        if number:
            found.floor_s.append(floor_s)
            found.ours_s.append(ours_s)
    return found


def timed_s(action: Callable[[], object], dice: random.Random) -> float:
    """How long `action` takes, begun at no particular phase of the scheduler's tick."""
    until = time.perf_counter() + dice.uniform(0.0, PAUSE_S)
    while time.perf_counter() < until:
        pass
    start = time.perf_counter()
    action()
    return time.perf_counter() - start
