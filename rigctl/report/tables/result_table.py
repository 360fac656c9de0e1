"""A table of a result, the same on a page and at a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class ResultTable:
    """Rows of text under `columns`, whose names begin with # where numbers stand; `marked` rows need attention.

    `sentence` says what it shows.
    """

    sentence: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    marked: Sequence[bool] = ()
