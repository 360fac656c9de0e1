"""What is said of the time that a campaign still takes: nothing that nobody knows."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

from rigctl.campaign.session.heartbeat import STALLED_S
from rigctl.report.progress_bar import ProgressBar
from rigctl.report.status_lines import status_lines
from rigctl.report.time_left import time_left

NOW = datetime.now(UTC)


def status(state: str, ago_s: float = 0.0, **other: Any) -> dict[str, Any]:
    updated = (NOW - timedelta(seconds=ago_s)).isoformat()
    counted = {"runs_done": 2, "runs_planned": 9, "runs_invalid": 0}
    return {"state": state, "eta_s": 60.0, "updated": updated, "step": "x", **counted, **other}


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (status("running", 20.0), "40 s left"),
        (status("running", 90.0), "30 s later than expected"),
        (status("running", 20.0, heartbeat_age_s=STALLED_S + 1.0), "time left unknown"),
        (status("running", eta_s=None), "time left unknown"),
        (status("paused", 20.0), "60 s of work left"),
        (status("interrupted", 1e5), "60 s of work left"),
        (status("aborted", 1e5), "60 s of work left"),
        (status("done"), ""),
    ],
)
def test_time_left(given: dict[str, Any], said: str) -> None:
    assert time_left(given, NOW) == said


def test_a_stalled_campaign_is_told_no_time() -> None:
    lines = status_lines(status("running", 600.0, heartbeat_age_s=STALLED_S + 600.0))
    assert lines[0] == "running: 2 of 9 runs (0 invalid), time left unknown"
    assert "STALLED" in lines[1]


def test_a_question_is_told_with_how_to_answer_it_from_here() -> None:
    asked = {"number": 1, "text": "Level the package. Type 'done', or 'abort': ", "choices": ["done", "abort"]}
    lines = status_lines(status("running", question=asked))
    said = "WAITS FOR YOU: Level the package. Answer at its terminal, or with `rigctl answer STORE done|abort`"
    assert lines[:2] == ["running: 2 of 9 runs (0 invalid)", said]


def test_what_is_done_has_no_time_left() -> None:
    assert status_lines(status("done"))[0] == "done: 2 of 9 runs (0 invalid)"


def test_a_log_has_a_line_for_each_step_and_says_what_is_waited_for(capsys: pytest.CaptureFixture[str]) -> None:
    lost = "scan Y / waiting for an instrument: stage: no connection; the campaign goes on by itself once it answers."
    with ProgressBar() as bar:
        for state, step in [
            ("running", "scan Y"),
            ("running", "scan Y / run 3"),
            ("running", lost),
            ("paused", lost),
            ("paused", "scan Y"),
            ("running", "scan Y / run 3"),
        ]:
            bar.show(status(state, step=step))
    assert capsys.readouterr().err.splitlines() == [
        "running: scan Y, 2 of 9 runs, 60 s left",
        f"paused: 2 of 9 runs; {lost}",
        "running: scan Y, 2 of 9 runs, 60 s left",
    ]
