"""Some of the random tables of metamorphic.py: what is found does not depend on how a table is written."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.foreign.metamorphic import differences, said_of, tried
from tests.foreign.metamorphic_table import drawn


# A curved baseline with a logarithm beside it; words that make a difference; lots; words in parameters of a curved
# baseline; quick ones of those.
@pytest.mark.parametrize("seed", [0, 2, 3, 14])
def test_what_is_found_does_not_depend_on_how_the_table_is_written(seed: int) -> None:
    assert tried(seed)["differed"] == {}


def test_another_table_is_told_from_the_first() -> None:
    """The comparison sees a change of one reading by a tenth of its noise."""
    table = drawn(0)
    response = table.numbers["y"].copy()
    response[3] += 0.01
    said = said_of(table)
    assert differences(said, said) == []
    assert differences(said, said_of(replace(table, numbers={**table.numbers, "y": response})))
