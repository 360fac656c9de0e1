"""Faults that the scripted operator lives through: the screen says what the wire, the disk and the store say."""

from __future__ import annotations

import os
import resource
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

from rigctl.campaign.session.questions import Question, open_question
from rigctl.campaign.session.requests import is_running
from rigctl.campaign.store.store import Store
from rigctl.console.campaigns import last_line
from rigctl.console.log_lines import lines_of
from tests.console.at_the_keys import STARTED_BY_KEYS, Operator, Wrong, process_of, status_in
from tests.reliability.campaigns import SMALL_CAMPAIGNS
from tests.reliability.faulty_campaigns import heard
from tests.reliability.random_faults import as_toml
from tests.reliability.single_faults import IN_A_RUN_S, OUTAGE, Single
from tests.reliability.truth import wrong_number

ENDS_S = 600.0
ENDED = {"done", "aborted", "interrupted"}
WIDE = (200, 60)
"""So that what is said of a fault stands on few lines."""

ON_THE_WIRE = {
    "doubled reply": Single("duplicated", "accelerometer", {"at_s": IN_A_RUN_S}),
    "lost reply": Single("silent", "accelerometer", {"at_s": IN_A_RUN_S}),
    "late reply": Single("late", "accelerometer", {"at_s": IN_A_RUN_S, "delay_s": 5.0}),
    "instrument hangs": Single("silent", "accelerometer", {"between_s": [IN_A_RUN_S, 1e6]}),
    "instrument power-cycled": Single("power_cycle", "stage", {"at_s": IN_A_RUN_S, **OUTAGE}),
}


LOOKED_FOR = 60
"""Letters of an alarm that are typed."""


def on_the_wire(single: Single, directory: Path) -> str:
    """A campaign that meets one fault: every alarm of its store is on the screen, and how it ended."""
    small = SMALL_CAMPAIGNS[single.campaign]
    small.write(directory, heard(small) + as_toml({single.instrument: single.plan}))
    store = directory / "campaign.rig.sqlite"
    operator = Operator(directory, "campaign.toml", size=WIDE)
    try:
        operator.until(lambda: "campaign.toml" in operator.text, "the campaign file")
        operator.type(*STARTED_BY_KEYS)
        operator.until(lambda: status_in(store).get("state") in ENDED, "the end", ENDS_S)
        status = status_in(store)
        ended = str(status["state"]).upper(), int(status["runs_done"]), int(status["runs_planned"])
        operator.until(lambda: operator.count() == ended, f"{ended}", 20.0)
        with Store.open(store, readonly=True) as recorded:
            alarms = [line.text for line in lines_of(recorded.events()) if line.alarm]
        if ended[0] != "DONE":
            alarms.append(last_line(store))  # of the campaign's process
        if not alarms:
            raise Wrong("nobody was told of the fault")
        operator.type("5", "w")
        for alarm in dict.fromkeys(alarms):
            # A log may be longer than the screen: what is not in sight is looked for by its last words.
            # Looked at once: the screen may still be on its way to what was searched for before.
            if not _is_said(operator, alarm):
                operator.type("/", *alarm[-LOOKED_FOR:], "\r")
                _says(operator, alarm)
        operator.leaves()
    finally:
        operator.close()
    if wrong := wrong_number(store, directory / "measured.jsonl"):
        raise Wrong(wrong)
    return f"{ended[0]}, {len(alarms)} alarms, each on the screen: {alarms[0][:60]}"


def disk_takes_no_more(directory: Path) -> str:
    """The campaign cannot write: it ends, the screen says why, and it is resumed once there is room."""
    operator, store, question = _asked(directory)
    try:
        # For the campaign's process alone: files do not grow any more, as on a disk that is full.
        resource.prlimit(process_of(store), resource.RLIMIT_FSIZE, (store.stat().st_size // 2,) * 2)
        operator.type(*question.choices[0], "\r")
        operator.until(lambda: not is_running(store), "the end", 60.0)
        _says(operator, "the disk", within_s=20.0)
        operator.until(lambda: (operator.count() or ("",))[0] in {"INTERRUPTED", "ABORTED"}, "its end", 20.0)
        operator.type("2", "r")
        operator.until(lambda: is_running(store), "resumed", 60.0)
        # At once: it may not have begun.
        _stopped(operator, store)
    finally:
        operator.close()
    return "ended, told, resumed, stopped"


def store_is_locked(directory: Path) -> str:
    """Another program writes: what the operator answers is not taken, the screen says so, and then it is."""
    operator, store, question = _asked(directory)
    try:
        other = sqlite3.connect(store, isolation_level=None)
        other.execute("BEGIN IMMEDIATE")
        operator.type(*question.choices[0], "\r")
        _says(operator, "another program has been writing", within_s=60.0)
        other.rollback()
        other.close()
        if not is_running(store):
            raise Wrong(f"the campaign has ended\n{operator.text}")
        _stopped(operator, store)
    finally:
        operator.close()
    return "told; stopped when it was free"


def terminal_is_lost(directory: Path) -> str:
    """The connection drops: the campaign goes on, and the next console says so and asks the same."""
    operator, store, _ = _asked(directory)
    try:
        operator.hangs_up()
    finally:
        operator.close()
    if not is_running(store):
        raise Wrong("the campaign has ended with the terminal")
    operator = Operator(directory, size=WIDE)
    try:
        _says(operator, "WAITS FOR YOU", within_s=60.0)
        operator.type("\x1b", "5")
        _says(operator, "The terminal was lost", "the campaign went on", within_s=20.0)
        _stopped(operator, store)
    finally:
        operator.close()
    return "the campaign went on; the next console told it, asked, and stopped it"


def stop_without_an_instrument(directory: Path) -> str:
    """A rig whose instruments are gone: LOST, and a STOP is not confirmed, on the screen and by the exit status."""
    small = SMALL_CAMPAIGNS["angle-scan"]
    small.write(directory)
    command = [sys.executable, "-m", "rigctl", "simulate", "rig.toml", "--write-rig", "live.toml"]
    served = subprocess.Popen(command, cwd=directory, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    operator: Operator | None = None
    try:
        while not (directory / "live.toml").exists():
            if served.poll() is not None:
                raise Wrong("the rig is not served")
        operator = Operator(directory, "live.toml", size=WIDE)
        _says(operator, "● ready", within_s=60.0)
        os.kill(served.pid, signal.SIGKILL)
        served.wait()
        _says(operator, "✗ lost", within_s=30.0)
        operator.type("\x18")
        _says(operator, "NOT CONFIRMED at rest", within_s=30.0)
        operator.type("q")
        operator.ends_with(1)
    finally:
        served.kill()
        if operator is not None:
            operator.close()
    return "lost, not confirmed, exit status 1"


STEPS: dict[str, Callable[[Path], str]] = {
    **{label: partial(on_the_wire, single) for label, single in ON_THE_WIRE.items()},
    "disk takes no more": disk_takes_no_more,
    "store is locked": store_is_locked,
    "terminal is lost": terminal_is_lost,
    "STOP without an instrument": stop_without_an_instrument,
}


def _asked(directory: Path) -> tuple[Operator, Path, Question]:
    """A campaign that waits for its operator, and what it asks; the dialog is open."""
    SMALL_CAMPAIGNS["angle-scan"].write(directory)
    operator, store = Operator(directory, "campaign.toml", size=WIDE), directory / "campaign.rig.sqlite"
    operator.until(lambda: "campaign.toml" in operator.text, "the campaign file")
    operator.type("2", "s", "\r")
    operator.sees("WAITS FOR YOU")
    with Store.open(store, readonly=True) as recorded:
        question = open_question(recorded)
    assert question is not None
    return operator, store, question


def _stopped(operator: Operator, store: Path) -> None:
    operator.type("\x18")
    operator.until(lambda: not is_running(store), "stopped", 30.0)
    # One that is stopped before it has begun has written nothing: it stands as it was left.
    state = str(status_in(store)["state"])
    if state not in {"aborted", "interrupted"}:
        raise Wrong(f"the campaign is {state}\n{operator.text}")
    operator.until(lambda: (operator.count() or ("",))[0] == state.upper(), state, 20.0)
    operator.leaves()


def _says(operator: Operator, *said: str, within_s: float = 20.0) -> None:
    """Wait until all of it is on the screen, wherever its lines are broken."""
    for words in said:
        operator.until(lambda words=words: _is_said(operator, words), words, within_s)  # type: ignore[misc]


def _is_said(operator: Operator, words: str) -> bool:
    return "".join(words.split()) in "".join(operator.text.split())
