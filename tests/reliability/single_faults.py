"""What the operator is told of each kind of fault: a small campaign for each, in which nothing else goes wrong."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rigctl.campaign.store.store import Store
from simulators.faults import FaultPlan
from tests.reliability.campaigns import SMALL_CAMPAIGNS
from tests.reliability.commands import here
from tests.reliability.faulty_campaigns import heard, told
from tests.reliability.random_faults import as_toml
from tests.reliability.truth import wrong_number

SEED = 1
IN_A_RUN_S, AFTER_IT_S, TURNING_S = 29.0, 32.9, 38.0
"""Rig times in the first run of a scan of angles, when its records are fetched, and on the way to the second."""
QUOTED = 2
"""Messages of one campaign: what happened first, and what it waited for."""


@dataclass(frozen=True)
class Single:
    """A fault, the instrument that has it, and the campaign; `silence` says why nobody is told, if nobody is."""

    fault: str
    instrument: str
    table: dict[str, Any]
    campaign: str = "angle-scan"
    silence: str = ""

    @property
    def plan(self) -> FaultPlan:
        """Just this fault."""
        return FaultPlan.model_validate({"seed": SEED, self.fault: self.table})


def _meter(fault: str, **table: Any) -> Single:
    return Single(fault, "accelerometer", {"at_s": IN_A_RUN_S, **table})


def _stage(fault: str, **table: Any) -> Single:
    return Single(fault, "stage", {"at_s": IN_A_RUN_S, **table})


SPELL = {"lasting_s": 2.0}
OUTAGE = {"lasting_s": 20.0}

SINGLE_FAULTS = (
    # the wire
    _meter("late", delay_s=5.0),
    _meter("truncated"),
    _meter("silent"),
    _meter("duplicated"),
    _meter("previous"),
    _meter("garbage"),
    _meter("non_ascii"),
    _meter("echo"),
    _meter("wrong_terminator"),
    _meter("disconnect", before=True),
    Single(
        "disconnect",
        "accelerometer",
        {"at_s": IN_A_RUN_S},
        silence="after its reply, between two questions: the connection is made anew before the next",
    ),
    Single("bits", "lasers_b", {"at_s": AFTER_IT_S}),
    # the count of its storage, and the home search
    Single("command_bits", "lasers_b", {"nth": [134]}),
    Single("command_lost", "rotation", {"nth": [34]}, "six-mountings"),
    Single("refused", "rotation", {"between_s": [0.0, 5.0]}),
    Single("wrong_identity", "accelerometer", {"text": "34465A", "instead": "34401A"}),
    # stages
    _stage("power_cycle", **OUTAGE),
    Single("following_error", "rotation", {"at_s": TURNING_S}),
    _stage("following_error"),
    _stage("limit_hit"),
    _stage("emergency_stop", **OUTAGE),
    _stage("air_lost", **OUTAGE),
    _stage("wrong_unit", **OUTAGE),
    # sensors and recorders
    Single("target_lost", "lasers_a", {"at_s": IN_A_RUN_S, **SPELL}),
    _meter("saturation", **SPELL),
    Single("saturation", "q_b", {"at_s": 200.0, **SPELL}, "bias-rejection"),
    _meter("stuck", **SPELL),
    Single(
        "stuck",
        "q_b",
        {"at_s": 200.0, **SPELL},
        "bias-rejection",
        silence="its numbers are what the instrument measured, and near enough to those before and after",
    ),
    Single("missing_edges", "stage", {"at_s": IN_A_RUN_S, **SPELL}),
    _meter("memory_overflow"),
    _meter("clock_jump", jump_s=2.0),
    Single("clock_drift", "accelerometer", {"ppm": 1e5}),
    Single("clock_drift", "accelerometer", {"ppm": 50.0}, silence="a run of seconds is not long enough to show it"),
    Single(
        "wrong_unit",
        "thermometer",
        {"at_s": IN_A_RUN_S, **OUTAGE},
        silence="the unit is set with every reading",
    ),
)


def said_of(single: Single, work: Path) -> list[str]:
    """What a campaign with this one fault tells its operator; `AssertionError` when it breaks a promise."""
    small = SMALL_CAMPAIGNS[single.campaign]
    small.write(work, heard(small) + as_toml({single.instrument: single.plan}))
    store = work / "x.rig.sqlite"
    outcome = here(work, "run", "campaign.toml", "--store", store, "--yes", "--seed", SEED)
    assert not outcome.broken(), outcome.broken()
    assert not (wrong := wrong_number(store, work / "measured.jsonl")), wrong
    message = outcome.message if outcome.status else ""
    said = list(dict.fromkeys(each for each in (*told(store), *_reasons(store), message) if " " in each))
    return [each for each in said if not any(other != each and other.startswith(each) for other in said)]


def rows() -> list[str]:
    """The table of docs/reliability.md: what is said of each kind of fault."""
    rows = ["| fault | of | what the operator is told |", "|---|---|---|"]
    for single in SINGLE_FAULTS:
        with tempfile.TemporaryDirectory() as work:
            said = said_of(single, Path(work))
        assert said or single.silence, f"{single.fault} of {single.instrument} has not struck: is its time right?"
        words = "; then: ".join(said[:QUOTED]).replace("|", r"\|") or f"*nothing: {single.silence}*"
        rows.append(f"| `{single.fault}` | {single.instrument} | {words} |")
    return rows


def _reasons(path: Path) -> list[str]:
    """Why runs are not to be used, or what is remarked about them."""
    if not path.exists():
        return []
    with Store.open(path, readonly=True) as store:
        return [run.reason for run in store.runs() if run.reason]
