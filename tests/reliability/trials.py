"""What a kind of trial is: a promise, and one trial of it that follows from its seed."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol


class Trials(Protocol):
    """A module of this package that tries one promise.

    The constant `DEADLINE_S` (120 when left out) is optional: a trial that takes longer counts as hanging, and its
    process is killed.
    """

    PROMISE: str
    """What is promised, in one sentence, for the table of docs/reliability.md."""

    def trial(self, seed: int, work: Path) -> dict[str, Any]:
        """Try the promise once, in the empty directory `work`, which is kept when the promise was broken.

        Everything drawn follows from `seed`. Returns what can be written as JSON. Three keys mean something to all:
        "failed" (str): "" when the promise held, else one line that says what was broken;
        "tried" (int, 1 when left out): how many of what the promise counts were tried;
        "failures" (int, 1 when left out and "failed" is not ""): how many of them broke it.
        An exception that leaves it is a failure of the trial too.
        """
        ...
