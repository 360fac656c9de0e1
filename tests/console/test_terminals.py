"""The console on terminals as they are: dumb, without colours or signs, small, dropped, and killed."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from rigctl.campaign.session.requests import is_running
from tests.console.terminal import SLOW_S, Terminal


@pytest.fixture
def terminal(tmp_path: Path) -> Iterator[Callable[..., Terminal]]:
    """Terminals in a directory of their own."""
    opened: list[Terminal] = []

    def open_one(*arguments: object, **options: Any) -> Terminal:
        opened.append(Terminal(tmp_path, *arguments, **options))
        return opened[-1]

    yield open_one
    for each in opened:
        each.close()


@pytest.mark.parametrize(
    "environment",
    [
        {"TERM": "dumb"},
        {"TERM": "vt100", "NO_COLOR": "1", "LANG": "C", "LC_ALL": "C"},
        {"LANG": "C", "LC_ALL": "C", "PYTHONIOENCODING": "ascii"},
        {"LANG": "de_DE.ISO-8859-1", "TERM": "linux"},
    ],
    ids=lambda environment: " ".join(f"{name}={value}" for name, value in environment.items()),
)
def test_it_is_drawn_and_operated_on_any_terminal(
    measured: Path, terminal: Callable[..., Terminal], environment: dict[str, str]
) -> None:
    console = terminal(measured, **environment)
    console.sees("DONE 18/18")
    console.type("3")
    console.sees("Sensing axes")
    console.type("q")
    assert console.ends() == 0
    assert "Traceback" not in console.text


def test_a_terminal_that_is_too_small_says_so_and_goes_on_when_it_is_larger(
    measured: Path, terminal: Callable[..., Terminal]
) -> None:
    console = terminal(measured, columns=60, rows=20)
    console.sees("the console needs 80 x 24")
    console.resize(120, 40)
    os.kill(console.process.pid, signal.SIGWINCH)
    console.sees("DONE 18/18")
    console.type("q")
    assert console.ends() == 0


def test_without_a_terminal_it_is_one_line(measured: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "rigctl", "console", str(measured)],
        cwd=tmp_path,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=SLOW_S,
        env={**os.environ, "XDG_STATE_HOME": str(tmp_path / "state")},
    )
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert "terminal" in done.stderr


def sessions() -> set[int]:
    """Of all processes that live."""
    found = set()
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):  # it has ended meanwhile
            state, _, _, session = stat.read_text().rpartition(")")[2].split()[:4]
            if state != "Z":
                found.add(int(session))
    return found


@pytest.mark.parametrize("how", ["killed", "hung up"])
def test_a_campaign_outlives_its_console_and_another_one_takes_it_over(
    desk: Any, terminal: Callable[..., Terminal], how: str
) -> None:
    store = desk.directory / "campaign.rig.sqlite"
    first = terminal("campaign.toml")
    first.sees("campaign.toml")
    first.type("2s")
    first.sees("Start a campaign")
    first.type("\r")
    first.sees("WAITS FOR YOU")
    if how == "killed":
        first.process.kill()
    else:
        first.hang_up()
    first.ends()
    second = terminal(store)
    # The campaign has a session of its own; what worked things out for the console goes with it.
    second.until(lambda: first.process.pid not in sessions(), "the console's processes end")
    assert is_running(store)
    third = terminal(store)
    second.sees("WAITS FOR YOU")
    third.sees("WAITS FOR YOU")
    third.type("abort\r")
    third.until(lambda: not is_running(store), "the campaign ends")
    # Nor is one asked whether to leave a campaign that has just ended, which is on the screen still.
    third.type("q")
    assert third.ends() == 0
    second.sees("ABORTED")
    second.type("q")
    assert second.ends() == 0


@pytest.mark.parametrize(("told", "status"), [("", 0), ("raise RigError('the rig is not at rest')", 1)])
def test_no_thread_holds_the_console_at_its_end(told: str, status: int) -> None:
    """Nor aborts it: what watches a store may be in compiled code while the interpreter is taken down."""
    code = (
        "import sys, threading\n"
        "import rigctl.console.start as console\n"
        "from rigctl.cli import main\n"
        "from rigctl.core.errors import RigError\n"
        "def start(*_):\n"
        "    console.HAS_RUN.set()\n"
        "    threading.Thread(target=threading.Event().wait).start()\n"
        f"    {told or 'pass'}\n"
        "console.start = start\n"
        "sys.argv = ['rigctl', 'console']\n"
        "main()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == status
    assert ("the rig is not at rest" in done.stderr) == (status != 0)
