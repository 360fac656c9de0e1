"""Whatever ends a command while something moves, its next motion byte is a stop; other cases: `make reliability`."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.reliability.signals import benched, ended_while_moving

XPS, ESP = "isa-rig.toml", "one-axis.rig.toml"


@pytest.mark.parametrize(
    ("rig", "command", "ending", "motions"),
    [
        (XPS, "move-rotation", "SIGTERM", 3),  # its reply comes when the move is over: the stop overtakes it
        (ESP, "home", "SIGHUP", 2),
        (ESP, "run", "SIGINT", 6),  # the stage oscillates
        (XPS, "console-jog", "lost", 1),
        (XPS, "home", "SIGKILL", 3),
    ],
)
def test_a_stop_is_next_on_the_wire(tmp_path: Path, rig: str, command: str, ending: str, motions: int) -> None:
    with benched(tmp_path, rig) as bench:
        told = ended_while_moving(bench, command, ending, motions, following="move-stage")
    assert told["failed"] == ""
    assert told["status"] == (0 if ending == "lost" else 130)
