"""What statistics of first order say about fits that need not be made."""

from __future__ import annotations

LINEAR = 30.0**2
"""Statistics beyond may mislead: second order may reverse what is distant."""

FAR_MOST = 2.0
"""Of a statistic of any size, what fits explain at most of all that is left."""

_LEAST, _MOST = 0.6, 1.25
"""Of a statistic up to there, what a fit finds at least and at most: in published tables 0.63 of what amplitudes say
(in one case 0.50), and 1.16 of what a candidate promises."""

_NEAR, _OF_THE_FIRST = 30.0, 0.25


def found_at_least(statistic: float, alone: float) -> float:
    """The part of a statistic that a fit finds too; `alone` is what it would be if nothing else imitated it."""
    imitated = statistic < _OF_THE_FIRST * alone
    return 0.0 if statistic >= LINEAR and imitated else _LEAST * statistic


def found_at_most(statistic: float) -> float:
    """What a fit may find where first order promises so much."""
    return _MOST * statistic if statistic < LINEAR else float("inf")


def least_comparable(first: float) -> float:
    """The least statistic that may be the largest after a fit, where the largest of all is `first`."""
    return first - _NEAR if first < LINEAR else _OF_THE_FIRST * first
