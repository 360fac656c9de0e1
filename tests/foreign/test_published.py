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

SLOW = {"air-passengers", "hd-164922", "mauna-loa", "orange", "sunspots"}
"""Left to ``make foreign``, until a scan of periods costs what it should."""

LINALG = "compare ends with a ValueError of matmul: a constant and a column of five words or more"

STOPS_TODAY = {
    "dyestuff": LINALG,
    "hd-164922": "diagnose takes minutes",
    "indometh": "diagnose stops at inverse[time_h] in the set, time_h being zero in one reading",
    "mauna-loa": "diagnose stops: the fit is singular, periodic[year]#2.period",
    "morley": LINALG,
    "orange": "diagnose ends with an error after four effects, 15 s",
    "oxide": LINALG,
    "rail": LINALG,
}
"""Data sets that some command does not get through: every check fails."""

COMPARE_PASSES = "compare passes the baseline in which diagnose finds an effect"

WRONG_TODAY = {
    "attenuation": {
        "named": "step[distance_km] and periodic[magnitude]",
        "value": "the fit is of a step and a period",
        "agree": COMPARE_PASSES,
    },
    "beaver": {"named": "adequate, all taken for correlated noise", "value": "no effect, so one level"},
    "lynx": {"agree": COMPARE_PASSES, "ladder": "error_held_out rises, 0.97 to 1.00"},
    "nile": {"agree": COMPARE_PASSES},
    "nile-ordered": {"named": "adequate, no word of the step", "value": "no step"},
    "nottem": {"agree": COMPARE_PASSES, "ladder": "error_fit rises, 0.989, 1.008, 1.012"},
    "seat-belts": {"named": "adequate, all taken for correlated noise", "value": "no step"},
    "tooth-growth": {"agree": COMPARE_PASSES},
    "trees": {
        "named": "unknown, nothing suggested",
        "value": "nothing suggested",
        "agree": COMPARE_PASSES,
    },
    "women": {"named": "periodic[height_in]", "value": "the fit is of a period"},
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
