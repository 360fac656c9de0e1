"""Tables of readings as they come: rows that do not count, columns of time stamps, rows that stand in a table again.

Two readings at the same conditions are equal by chance with a probability that follows from the resolution of the
response and the scatter of readings; more equal rows than that allows were pasted.
"""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime

import numpy as np

from rigctl.core.arrays import FloatArray, IntArray

VALID, REASON = "valid", "reason"
"""Columns that say which readings count, as which runs, and why one does not."""

_DATE = re.compile(r"\d{4}-\d\d-\d\d")


def excluded_rows(samples: Mapping[str, FloatArray], texts: Mapping[str, Sequence[str]]) -> dict[int, str]:
    """By index the rows that the column `VALID` takes out of everything (0), and why; one without a mark counts."""
    if VALID not in samples:
        return {}
    reasons = texts.get(REASON)
    return {
        row: (reasons[row] if reasons else "") or "marked invalid in readings.csv"
        for row in np.flatnonzero(samples[VALID] == 0.0).tolist()
    }


def row_label(row: int) -> str:
    """The name of a row by its index: rows are counted from 1, without the header."""
    return f"row {row + 1}"


def seconds_of_stamps(texts: Sequence[str]) -> FloatArray | None:
    """Seconds from the earliest of some time stamps, NaN where a text is empty; None where another is no stamp.

    Stamps without a zone are UTC. A stamp begins with a date in full: "2024-05-01", "2024-05-01T12:00:00+02:00".
    """
    stamps = [_stamp(text.strip()) if text.strip() else None for text in texts]
    known = [stamp for stamp in stamps if stamp is not None]
    if not known or any(stamp is None and text.strip() for stamp, text in zip(stamps, texts, strict=True)):
        return None
    first = min(known)
    return np.array([np.nan if stamp is None else (stamp - first).total_seconds() for stamp in stamps])


def flaw_of_stamps(texts: Sequence[str]) -> tuple[int, str] | None:
    """The first text that is no time stamp in a column where most are, by index, and why; None for other columns."""
    given = [(index, text.strip()) for index, text in enumerate(texts) if text.strip()]
    wrong = [(index, text) for index, text in given if _stamp(text) is None]
    if not wrong or 2 * len(wrong) >= len(given):
        return None
    index, text = wrong[0]
    why = "a day or time that does not exist" if _DATE.match(text) else "no time stamp such as 2024-05-01T12:00:00Z"
    return index, f"{text!r}, {why}"


def _stamp(text: str) -> datetime | None:
    if not _DATE.match(text):
        return None
    try:
        stamp = datetime.fromisoformat(text)
    except ValueError:
        return None
    return stamp if stamp.tzinfo is not None else stamp.replace(tzinfo=UTC)


PASTED_BELOW = 1e-6
BLOCK, BLOCK_BELOW = 3, 1e-3
"""So many rows one after the other that stand elsewhere in the same order need less to be called pasted."""

_SCATTER_UNKNOWN = 0.01
"""Of the response's standard deviation: the scatter taken where no two readings share their conditions."""

_FEW = 3

_DIGITS = 14
"""Of the largest value: beyond, any number is a decimal one but for its rounding in 64 bits."""


def resolution(values: FloatArray) -> float:
    """The largest step of which all values (n,) are multiples; 0 where they have more than 14 digits."""
    largest = float(np.abs(values).max(initial=0.0))
    if largest == 0.0:
        return 0.0
    first = -math.floor(math.log10(largest))
    for decimals in range(first, first + _DIGITS):
        # Powers of ten are exact numbers where they are whole.
        power = 10.0 ** abs(decimals)
        multiples = np.rint(values * power if decimals >= 0 else values / power)
        written = multiples / power if decimals >= 0 else multiples * power
        if np.all(np.abs(written - values) <= 2.0 * np.finfo(float).eps * np.abs(values)):
            step = int(np.gcd.reduce(multiples.astype(np.int64)))
            return step / power if decimals >= 0 else step * power
    return 0.0


def pasted_rows(response: FloatArray, conditions: Sequence[Sequence[object]]) -> tuple[IntArray, IntArray]:
    """Rows that were pasted, and of which row each is a copy; both empty where equal rows may be repeats.

    `response` (n,) without missing values, `conditions` all other columns, each of length n.
    """
    rows = list(zip(*conditions, strict=True)) if conditions else [()] * len(response)
    # NaN is not equal to itself, and two missing values are the same condition here.
    keys = [tuple("" if each != each else each for each in row) for row in rows]
    firsts: dict[object, int] = {}
    copies, originals = [], []
    groups: dict[object, list[int]] = defaultdict(list)
    for number, (key, value) in enumerate(zip(keys, response.tolist(), strict=True)):
        groups[key].append(number)
        first = firsts.setdefault((key, value), number)
        if first != number:
            copies.append(number)
            originals.append(first)
    none = np.zeros(0, dtype=np.intp)
    if not copies:
        return none, none
    p_value = _p_of_equal(response, list(groups.values()), len(copies))
    level = BLOCK_BELOW if _longest_block(copies, originals) >= BLOCK else PASTED_BELOW
    if p_value >= level:
        return none, none
    return np.array(copies, dtype=np.intp), np.array(originals, dtype=np.intp)


def _p_of_equal(response: FloatArray, groups: list[list[int]], equal: int) -> float:
    """Probability of so many equal responses among readings at the same conditions."""
    pairs, square, dof = 0, 0.0, 0
    for group in groups:
        # Of different values only: copies would make the scatter of repeats too small.
        values = np.unique(response[group])
        pairs += len(group) * (len(group) - 1) // 2
        square += float(np.sum((values - values.mean()) ** 2))
        dof += len(values) - 1
    spread = float(response.std())
    scatter = math.sqrt(square / dof) if dof >= _FEW else _SCATTER_UNKNOWN * spread
    # Without a scatter, or with one beyond that of all readings, nothing can be said against chance.
    if not 0.0 < scatter <= spread:
        return 1.0
    # Two normal values lie in one step with probability step / (2 sqrt(pi) sigma).
    by_resolution = resolution(response) / (2.0 * math.sqrt(math.pi) * scatter)
    # At the same conditions values lie closer by spread / scatter, so equal ones are as much more frequent.
    by_frequency = _equal_elsewhere(response, groups) * spread / scatter
    return _binomial_tail(pairs, min(max(by_resolution, by_frequency), 1.0), equal)


def _equal_elsewhere(response: FloatArray, groups: list[list[int]]) -> float:
    """How often responses are equal at different conditions: rounded values, and functions of such, often."""
    n = len(response)
    everywhere = float(np.sum(np.unique(response, return_counts=True)[1] ** 2.0))
    within = sum(float(np.sum(np.unique(response[group], return_counts=True)[1] ** 2.0)) for group in groups)
    pairs = n**2.0 - sum(len(group) ** 2.0 for group in groups)
    # One added to both, by Laplace's rule: never a probability of zero from a finite table.
    return float((everywhere - within + 1.0) / (pairs + 1.0))


def _binomial_tail(trials: int, chance: float, least: int) -> float:
    # Here, since scipy takes its time to import and few tables have equal rows.
    from scipy.special import bdtrc

    return float(bdtrc(least - 1, trials, chance))


def _longest_block(copies: list[int], originals: list[int]) -> int:
    longest = length = 1
    for place in range(1, len(copies)):
        follows = copies[place] == copies[place - 1] + 1 and originals[place] == originals[place - 1] + 1
        length = length + 1 if follows else 1
        longest = max(longest, length)
    return longest
