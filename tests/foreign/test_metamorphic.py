"""Some of the random tables of metamorphic.py: what is found does not depend on how a table is written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from rigctl.campaign.bundle.bundle import read_bundle
from rigctl.campaign.recording import READINGS, ImportReport, Recording
from rigctl.experiments.table.study import TableStudy
from rigctl.workbench.verdict.account import account_of
from rigctl.workbench.verdict.compare import compared
from tests.foreign.metamorphic import differences, said_of, tried
from tests.foreign.metamorphic_table import drawn

DATA = Path(__file__).parent / "data"


def test_what_is_found_in_stack_loss_does_not_depend_on_the_order_of_its_columns() -> None:
    """Of Brownlee's 21 days, whose columns go together."""
    recording = read_bundle(DATA / "stackloss")
    header, run = recording.header, recording.runs()[0]
    samples = recording.samples(READINGS)
    said = []
    for names in (list(samples), list(samples)[::-1], [*list(samples)[1:], next(iter(samples))]):
        columns = {name: samples[name] for name in names}
        study = TableStudy(Recording(header, (run,), {READINGS: columns}, ImportReport(1)))
        account = account_of(study, [()])
        attempt = account.attempt(study, ())
        said.append((compared(attempt, account, 1).p_value, attempt.held_out.error()))
    assert said[1:] == [pytest.approx(said[0], rel=1e-6)] * 2


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
