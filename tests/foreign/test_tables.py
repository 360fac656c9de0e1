"""Tables made from a description (tables.py): is what is hidden in them said, and nothing else?"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from tests.foreign import tables
from tests.foreign.marks import cases
from tests.foreign.sessions import CHECKS, Session, taken_through

MADE = {
    "batches-1": (tables.common_offsets, 1),
    "batches-2": (tables.common_offsets, 2),
    "batches-3": (tables.common_offsets, 3),
    "gravimeter": (tables.gravimeter, 1),
    "pasted-1": (tables.pasted_rows, 1),
    "pasted-2": (tables.pasted_rows, 2),
    "pasted-3": (tables.pasted_rows, 3),
    "pasted-4": (tables.pasted_rows, 4),
    "pasted-5": (tables.pasted_rows, 5),
    "triad": (tables.triad, 1),
    "turning-point": (tables.turning_point, 1),
}

WRONG_TODAY: dict[str, dict[str, str]] = {}
"""What the program gets wrong, by table and check: whoever mends it takes the entry away."""


@cache
def outcome(name: str) -> Session | AssertionError:
    """The session on one made table, taken once for all checks; what stopped it, if something did."""
    make, seed = MADE[name]
    with TemporaryDirectory() as directory:
        bundle = Path(directory) / "table"
        hidden = make(bundle, seed)
        try:
            return taken_through(bundle, hidden.as_reference())
        except AssertionError as stopped:
            return stopped


@pytest.mark.parametrize(("name", "check"), cases(MADE, {}, WRONG_TODAY))
def test_made_table(name: str, check: str) -> None:
    session = outcome(name)
    if isinstance(session, AssertionError):
        raise session
    CHECKS[check](session)
