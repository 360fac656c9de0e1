"""An operator at a terminal, by keys alone, typed ahead at fifty a second: `make console-operator`.

Every shipped campaign is started, watched and looked at, then the loops of the workbench are gone through, and one is
stalled, killed, stopped and answered. In every step the screen is held to what the store says: how many runs there
are, what the model is, what is asked, what went wrong. Prints a line for each; exit status 1 when the screen said
otherwise.

    python -m tests.console.operator [CAMPAIGN ...]
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rigctl.campaign.session.requests import is_running
from tests.console import operator_faults
from tests.console.at_the_keys import STARTED_BY_KEYS, Operator, Wrong, process_of, status_in

CAMPAIGNS_AT = Path(__file__).parents[2] / "campaigns"
SHIPPED = (
    "quick-check",
    "one-axis",
    "angle-scan",
    "hidden-effect",
    "frequency-response",
    "bias-rejection",
    "microscope-table2",
    "microscope",
    "isa-flight-model",
)
SIZES = ((80, 24), (120, 40), (200, 60))
LATE_S = 4.0
"""The screen may be so much behind the store: it looks four times a second, and computers are busy."""

LONG_S = 900.0


def watched(operator: Operator, store: Path) -> None:
    """The runs on the screen are those of the store, no more than a few seconds ago, until all is done."""
    history: list[tuple[float, int]] = []
    deadline = time.monotonic() + LONG_S
    while True:
        status = status_in(store)
        now_s, done = time.monotonic(), int(status.get("runs_done", 0))
        history.append((now_s, done))
        shown = operator.count()
        latest = int(status_in(store).get("runs_done", 0))
        before = [count for at_s, count in history if at_s < now_s - LATE_S]
        if shown is not None and before and not before[-1] <= shown[1] <= latest:
            raise Wrong(f"{shown} on the screen, {before[-1]} to {latest} in the store\n{operator.text}")
        if status.get("state") == "done":
            break
        if status.get("state") in {"aborted", "interrupted"} or now_s > deadline:
            raise Wrong(f"the campaign is {status.get('state')}\n{operator.text}")
        time.sleep(0.2)
    operator.until(lambda: operator.count() == ("DONE", latest, int(status["runs_planned"])), "DONE", LATE_S + 10.0)


def campaign_by_keys(directory: Path, name: str, size: tuple[int, int]) -> str:
    """Start, watch, results, fit, log, quit."""
    operator = Operator(directory, CAMPAIGNS_AT / f"{name}.toml", size=size)
    store = directory / f"{name}.rig.sqlite"
    try:
        operator.sees("1 Rig")
        operator.until(lambda: f"{name}.toml" in operator.text, "the campaign file")
        operator.type(*STARTED_BY_KEYS)
        operator.until(store.exists, "the store that was to be made")
        watched(operator, store)
        operator.type("3", "f")
        operator.until(lambda: "No result yet" not in operator.text and "result of" not in operator.text, "a result")
        sentence = _compared(directory, store)
        operator.type("4", "f")
        if sentence:
            # Lines are broken where the screen ends.
            wanted = " ".join(sentence.split())[:50]
            operator.until(lambda: wanted in " ".join(operator.text.split()), wanted, LONG_S)
        operator.type("5")
        operator.sees("[5 Log]")
        if "internal error" in operator.text or "Traceback" in operator.text:
            raise Wrong(operator.text)
        operator.leaves()
    finally:
        operator.close()
    return f"{status_in(store)['runs_done']} runs; {sentence or 'nothing to compare'}"


def loop_of_the_workbench(directory: Path, name: str) -> str:
    """Diagnose, add what is suggested, look at the ladder, take it back, write what to measure next."""
    store = directory / f"{name}.rig.sqlite"
    operator = Operator(directory, store, size=(120, 40))
    try:
        operator.sees("DONE")
        before = _effects(directory, store)
        operator.type("4", "g")
        operator.until(lambda: "g diagnoses" not in operator.text, "a verdict", LONG_S)
        suggested = _json(directory, "diagnose", store)["suggested"]
        if not suggested:
            raise Wrong(f"nothing is suggested in {name}\n{operator.text}")
        operator.sees(f"a adds {', '.join(suggested)}")
        operator.type("a", "\r")
        operator.until(
            lambda: _effects(directory, store) == [*before, *suggested], "the effects in the model", LONG_S
        )
        operator.sees(*suggested, within_s=LONG_S)
        operator.type(".")
        operator.sees("[Ladder]", "error / noise")
        operator.type("u")
        operator.until(lambda: _effects(directory, store) == before, "the effects taken back", LONG_S)
        operator.leaves()
    finally:
        operator.close()
    return f"{', '.join(suggested)} added and taken back"


def faults(directory: Path) -> str:
    """A question, a stalled campaign, a killed one, one that is resumed and stopped."""
    operator = Operator(directory, CAMPAIGNS_AT / "one-axis.toml", size=(80, 24))
    store = directory / "one-axis.rig.sqlite"
    try:
        operator.until(lambda: "one-axis.toml" in operator.text, "the campaign file")
        operator.type("2", "s", "\r")
        operator.sees("WAITS FOR YOU", "Mount the package")
        operator.type("\x1b")
        operator.sees("OPERATOR: Mount the package")
        process = process_of(store)
        os.kill(process, signal.SIGSTOP)
        operator.sees("STALLED: no sign of life", within_s=20.0)
        os.kill(process, signal.SIGCONT)
        operator.until(lambda: "STALLED" not in operator.text, "no longer stalled", 20.0)
        os.kill(process, signal.SIGKILL)
        operator.until(lambda: (operator.count() or ("",))[0] == "INTERRUPTED", "interrupted", 20.0)
        operator.type("r")
        operator.sees("WAITS FOR YOU")
        if not is_running(store):
            raise Wrong("it asks, and nothing runs")
        operator.type("\x18")  # Ctrl+X: STOP, as F8
        operator.until(lambda: not is_running(store), "stopped", 20.0)
        operator.until(lambda: (operator.count() or ("",))[0] == "ABORTED", "aborted", 20.0)
        operator.leaves()
    finally:
        operator.close()
    return "asked, stalled, killed, resumed, stopped: each on the screen"


def _json(directory: Path, *arguments: object) -> Any:
    command = [sys.executable, "-m", "rigctl", *map(str, arguments), "--json"]
    done = subprocess.run(command, cwd=directory, capture_output=True, text=True, check=False)
    return json.loads(done.stdout) if done.returncode in {0, 3} and done.stdout else None


def _compared(directory: Path, store: Path) -> str:
    """What `rigctl compare` says of the model; "" where it has nothing to compare."""
    command = [sys.executable, "-m", "rigctl", "compare", str(store)]
    done = subprocess.run(command, cwd=directory, capture_output=True, text=True, check=False)
    lines = [line for line in done.stdout.splitlines() if line.startswith("The model ")]
    return lines[0] if lines else ""


def _effects(directory: Path, store: Path) -> list[str]:
    shown = _json(directory, "model", "show", store)
    return list(shown["effects"]) if shown else []


def main(names: Sequence[str]) -> int:
    """All of it, or these campaigns alone."""
    wrong = 0
    with tempfile.TemporaryDirectory() as scratch:
        at_once: list[tuple[str, Callable[[], str]]] = []
        for place, name in enumerate(names or SHIPPED):
            size = SIZES[place % len(SIZES)]
            label = f"{name}, {size[0]}x{size[1]}"
            at_once.append((label, lambda name=name, size=size: campaign_by_keys(Path(scratch), name, size)))  # type: ignore[misc]
        if not names:
            at_once.append(
                ("workbench of hidden-effect", lambda: loop_of_the_workbench(Path(scratch), "hidden-effect"))
            )
            at_once.append(("faults", lambda: faults(_fresh(Path(scratch)))))
            for label, step in operator_faults.STEPS.items():
                at_once.append((label, lambda step=step: step(_fresh(Path(scratch)))))  # type: ignore[misc]
        for label, step in at_once:
            began_s = time.monotonic()
            try:
                told = step()
            except Wrong as error:
                told, wrong = f"WRONG: {error}", wrong + 1
            print(  # noqa: T201 - what it is for
                f"{label:32} {time.monotonic() - began_s:6.0f} s  {told}",
                flush=True,
            )
    return int(wrong > 0)


def _fresh(scratch: Path) -> Path:
    directory = scratch / "faults"
    shutil.rmtree(directory, ignore_errors=True)
    directory.mkdir()
    return directory


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
