"""Whatever ends a command while something moves, a stop is the next thing on the wire; so it is after a kill -9.

Each command that can move anything, with INT, TERM, HUP, KILL, and the console's terminal lost, over
`rigctl simulate` on the wall clock; wires that keep a record tell what was sent when.
"""

from __future__ import annotations

import math
import re
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from tests.reliability.campaigns import SHIPPED
from tests.reliability.commands import STATUSES, Outcome, Process, until
from tests.reliability.served import Served, served
from tests.reliability.stops import Order, at_rest, orders
from tests.reliability.terminal import Terminal

PROMISE = (
    "Whatever ends a command while something moves, the next motion byte on that wire is a stop; "
    "after kill -9 it is the first that any next command sends"
)
DEADLINE_S = 150.0

COMMANDS = ("move-rotation", "move-stage", "home", "run", "resume", "investigate")
CONSOLE = ("console-move", "console-home", "console-jog")
CASES = (
    *product(COMMANDS, ("SIGINT", "SIGTERM", "SIGHUP", "SIGKILL")),
    *product(CONSOLE, ("SIGINT", "SIGTERM", "SIGHUP", "SIGKILL", "lost")),
)
RIGS = ("isa-rig.toml", "one-axis.rig.toml")

IN_FLIGHT_S = 0.01
"""A motion ordered so soon after a signal was sent may have been under way to the wire; a stop has to follow it."""

COMES_S = 5.0
ENDS_S = 20.0
MOVES_S = 30.0

CAMPAIGN = """\
experiment = "sensing-axis"
rig = "rig.toml"
on_terminal_lost = "stop"

[procedure]
name = "scan"
axes = ["{axis}"]
configurations = ["flag"]
angles_deg = [-4.0, -1.6, -0.8, 0.8, 1.6, 4.0]
frequencies_hz = [0.4, 0.6]
approaches = [1, -1]
amplitude_mm = 5.0
dwell_s = 3.0

[model]
effects = ["roll-gravity", "resonance"]
"""

QUICK = {
    "isa-rig.toml": "\n[instruments.rotation.simulator]\ninitialisation_s = 0.3\nhome_search_s = 1.0\n",
    "one-axis.rig.toml": "\n[instruments.rotation.simulator]\nhome_search_s = 1.0\n",
}


MOTIONS = {"move-rotation": 3, "move-stage": 3, "home": 2, "run": 8, "resume": 6, "investigate": 8}
"""How many motions a command orders at least, or so many that it is well under way."""


def quick_rig(name: str) -> str:
    """A shipped rig file whose axes home, and whose operator mounts, in a second."""
    text = (SHIPPED / name).read_text(encoding="utf-8") + QUICK[name]
    return text.replace("[world]\n", "[world]\nremount_s = 1.0\nlevel_s = 1.0\n", 1)


@dataclass
class Bench:
    """A served rig, and what is started on it."""

    work: Path
    rig: Served
    axis: str

    def begin(self, command: str) -> Process | Terminal:
        """Start a command that will move something."""
        match command:
            case "move-rotation":
                return Process(self.work, "move", "rig.toml", "rotation", "60")
            case "move-stage":
                return Process(self.work, "move", "rig.toml", "stage", "20")
            case "home":
                return Process(self.work, "home", "rig.toml")
            case "run":
                return Process(self.work, "run", "campaign.toml", "--store", "x.rig.sqlite", "--yes")
            case "resume":
                return Process(self.work, "resume", "x.rig.sqlite", "--yes")
            case "investigate":
                return Process(self.work, "investigate", "campaign.toml", "--store", "y.rig.sqlite", "--yes")
            case _:
                return self._console(command)

    def orders(self, since: int) -> list[Order]:
        """What was ordered after the first `since` pieces."""
        return orders(self.rig.wires.sent[since:])

    def moved(self, since: int, count: int) -> Callable[[], bool]:
        """Whether `count` motions have been ordered since."""
        return lambda: sum(order.what == "motion" for order in self.orders(since)) >= count

    def _console(self, command: str) -> Terminal:
        since = len(self.rig.wires.sent)
        terminal = Terminal(self.work, "console", "rig.toml")
        self.rig.wires.until(lambda: self._polled(since) > 5, MOVES_S)
        keys = {
            "console-move": [("m", "Move rotation"), ("60\r", "moving")],
            "console-home": [("h", "homing")],
            "console-jog": [("]", "moving")],
        }
        for pressed, shown in keys[command]:
            for _ in range(3):  # a console that is still being drawn does not hear
                terminal.press(pressed)
                if until(lambda shown=shown: terminal.shows(shown), 3.0):  # type: ignore[misc]
                    break
        return terminal

    def _polled(self, since: int) -> int:
        """How often the console has asked where the stage is: it does so once it can be moved."""
        return sum(bool(re.search(rb"PositionCurrentGet|TP\?", piece.data)) for piece in self.rig.wires.sent[since:])


def trial(seed: int, work: Path) -> dict[str, Any]:
    """One command, one way to end it, at a random moment of its motions."""
    random = np.random.default_rng(seed)
    command, ending = CASES[seed % len(CASES)]
    rig = RIGS[int(random.random() < 0.25)]
    motions = int(random.integers(1, MOTIONS.get(command, 2) + 1))
    pause_s = float(random.uniform(0.0, 0.5))
    can_be = ["move-rotation", "move-stage", "home", "console-move", "resume" if command == "run" else "run"]
    following = can_be[int(random.integers(len(can_be)))]
    with benched(work, rig) as bench:
        told = ended_while_moving(bench, command, ending, motions, following, pause_s)
    return {"command": command, "ending": ending, "rig": rig, **told}


@contextmanager
def benched(work: Path, rig: str) -> Iterator[Bench]:
    """A shipped rig served, with a campaign for it; what went over its wires is left in `work`."""
    with served(work, quick_rig(rig)) as reached:
        bench = Bench(work, reached, "X" if rig == "isa-rig.toml" else "Y")
        (work / "campaign.toml").write_text(CAMPAIGN.format(axis=bench.axis), encoding="utf-8")
        try:
            yield bench
        finally:
            _write_down(bench)


def ended_while_moving(
    bench: Bench, command: str, ending: str, motions: int, following: str = "move-stage", pause_s: float = 0.0
) -> dict[str, Any]:
    """End a command `pause_s` after so many motions; what came of it, "failed" unless the promise held.

    After a kill -9 the command `following` is given.
    """
    if command == "resume":
        _interrupted(bench)
    since = len(bench.rig.wires.sent)
    begun = bench.begin(command)
    process = begun.process if isinstance(begun, Terminal) else begun
    wires = bench.rig.wires
    if not wires.until(bench.moved(since, motions), MOVES_S) and not bench.moved(since, 1)():
        return {"failed": f"nothing moved: {process.ended(0.0).message}"}
    wires.until(lambda: False, pause_s)
    moving = {order.instrument for order in bench.orders(since) if order.what == "motion"}
    before = len(wires.sent)
    at_s = begun.lose() if ending == "lost" else process.signal(signal.Signals[ending])  # type: ignore[union-attr]
    try:
        if ending == "SIGKILL":
            process.ended(ENDS_S)
            return _after_a_kill(bench, moving, following)
        return _after_a_signal(bench, moving, before, at_s, process, isinstance(begun, Terminal))
    finally:
        if isinstance(begun, Terminal):
            begun.close()


def _interrupted(bench: Bench) -> None:
    """A campaign that can be resumed."""
    process = bench.begin("run")
    assert isinstance(process, Process)
    bench.rig.wires.until(bench.moved(0, 4), MOVES_S)
    process.signal(signal.SIGTERM)
    process.ended(ENDS_S)


def _after_a_signal(
    bench: Bench, moving: set[str], before: int, at_s: float, process: Process, console: bool
) -> dict[str, Any]:
    def stopped() -> bool:
        return moving <= {order.instrument for order in bench.orders(before) if order.what == "stop"}

    bench.rig.wires.until(stopped, COMES_S)
    first = _first_of_each(bench.orders(before), at_s)
    outcome = process.ended(ENDS_S)
    latency_s = max((first[name].at_s - at_s for name in moving if name in first), default=0.0)
    return {
        "latency_s": round(latency_s, 4),
        "status": outcome.status,
        "message": outcome.message,
        "failed": _not_stopped(first, moving) or _badly_ended(outcome, console) or _still_moves(bench),
    }


def _after_a_kill(bench: Bench, moving: set[str], following: str) -> dict[str, Any]:
    """The next command, whichever it is, stops what may still move before it moves anything."""
    before = len(bench.rig.wires.sent)
    if following == "run":
        (bench.work / "x.rig.sqlite").unlink(missing_ok=True)
    begun = bench.begin(following)
    bench.rig.wires.until(bench.moved(before, 1), MOVES_S)
    sent = bench.orders(before)
    first = _first_of_each(sent)
    process = begun.process if isinstance(begun, Terminal) else begun
    process.signal(signal.SIGTERM)
    outcome = process.ended(ENDS_S)
    if isinstance(begun, Terminal):
        begun.close()
    return {
        "next": following,
        "status": outcome.status,
        "message": outcome.message,
        "failed": _not_first(sent, following) or _not_stopped(first, moving),
    }


def _not_first(sent: list[Order], following: str) -> str:
    if not sent:
        return f"{following} sent neither stop nor motion"
    return (
        "" if sent[0].what == "stop" else f"{following} sent {sent[0].text} to {sent[0].instrument} before any stop"
    )


def _first_of_each(ordered: list[Order], at_s: float = -math.inf) -> dict[str, Order]:
    """Its first order of each instrument, those that were in flight when a signal was sent at `at_s` left out."""
    first: dict[str, Order] = {}
    for order in ordered:
        if order.what == "stop" or order.at_s > at_s + IN_FLIGHT_S:
            first.setdefault(order.instrument, order)
    return first


def _not_stopped(first: dict[str, Order], moving: set[str]) -> str:
    for name in sorted(moving):
        if name not in first:
            return f"{name} moved and was sent no stop within {COMES_S:g} s"
        if first[name].what != "stop":
            return f"{name} was sent {first[name].text} before a stop"
    return ""


def _badly_ended(outcome: Outcome, console: bool) -> str:
    if "NOT known to be at rest" in outcome.err:
        return f"it could not say that all is at rest: {outcome.message}"
    if console:  # what it says is on its screen
        return "" if outcome.status in STATUSES else f"exit status {outcome.status}"
    return outcome.broken()


def _still_moves(bench: Bench) -> str:
    """Ask the controllers themselves."""
    for name, kind, port in bench.rig.motion:
        if not at_rest(kind, port, 3.0):
            return f"{name} still moves after the command has ended"
    return ""


def _write_down(bench: Bench) -> None:
    lines = [f"{piece.at_s:.4f} {piece.instrument} {piece.data!r}" for piece in bench.rig.wires.sent]
    (bench.work / "wire.txt").write_text("\n".join(lines), encoding="utf-8")
