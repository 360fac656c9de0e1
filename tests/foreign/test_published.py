"""Published data sets whose missing effect the literature knows: is it named, with its size, and is the account one?

The readings and what is known of them are in data/<name>/recording.toml ([reference]); README.md has the sources.
``make foreign`` also takes those that cost more than a few seconds.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest

from tests.foreign.marks import cases
from tests.foreign.sessions import CHECKS, Session, taken_through

DATA = Path(__file__).parent / "data"

NAMES = sorted(path.name for path in DATA.iterdir())

SLOW = {"beaver", "dnase", "hd-164922", "lynx", "mauna-loa", "mauna-loa-ordered", "sunspots", "treering"}
"""Left to ``make foreign``, until a scan of periods costs what it should."""

STOPS_TODAY: dict[str, str] = {}
"""Data sets that some command does not get through: every check fails."""

WRONG_TODAY = {
    "indometh": {"named": "inverse[time_h], no second exponential", "value": "k of one exponential beside it"},
    "women": {
        "value": "the cube: beside the square it is needed at p = 0.0023 (so it is in R), the square not beside it"
    },
}
"""What the program gets wrong, by data set and check: whoever mends it takes the entry away."""


@cache
def outcome(name: str) -> Session | AssertionError:
    """The session on one data set, taken once for all checks; what stopped it, if something did."""
    try:
        return taken_through(DATA / name)
    except AssertionError as stopped:
        return stopped


@pytest.mark.parametrize(("name", "check"), cases(NAMES, STOPS_TODAY, WRONG_TODAY, SLOW))
def test_published(name: str, check: str) -> None:
    session = outcome(name)
    if isinstance(session, AssertionError):
        raise session
    CHECKS[check](session)
