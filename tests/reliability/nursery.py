"""Starts commands as processes of their own without importing everything anew each time: seconds become milliseconds.

`python -m tests.reliability.nursery` reads one JSON object per line from stdin and answers each with one:
{"start": [arguments of rigctl], "directory", "stdin", "stdout", "stderr", "terminal": false,
 "environment": {}} -> {"process": number}
{"ended": number} -> {"status": exit status, negative for a signal, or null while it runs}
Each process is forked from this one, leads a session of its own, and runs the command line as a shell would: signals
are as a fresh interpreter has them. When stdin ends, what still runs is killed.
"""

from __future__ import annotations

import contextlib
import fcntl
import importlib
import json
import os
import signal
import sys
import termios
from typing import Any

NEEDED = (
    "rigctl.cli",
    "rigctl.runner",
    "rigctl.serving",
    "rigctl.results",
    "rigctl.investigate",
    "rigctl.console.app",
    "procedures.sensing_axis.campaign",
    "rigctl.report.experiments.sensing_axis",
    "procedures.rotating_platform.campaign",
    "rigctl.report.experiments.rotating_platform",
    "procedures.inflight.campaign",
    "rigctl.report.experiments.inflight",
    "drivers.newport_xps",
    "drivers.newport_esp301",
    "drivers.aerotech_ensemble",
    "drivers.keyence_lkg",
    "drivers.keysight_34465a",
    "drivers.keysight_33500b",
    "simulators.serve",
    "serial",
    "pyvisa_py",
)


def main() -> None:
    """Serve until stdin ends."""
    for name in NEEDED:
        importlib.import_module(name)
    running: set[int] = set()
    for line in sys.stdin:
        asked = json.loads(line)
        if "start" in asked:
            process = os.fork()
            if not process:
                _become(asked)
                return
            running.add(process)
            answer: dict[str, Any] = {"process": process}
        else:
            answer = {"status": _status(asked["ended"], running)}
        print(json.dumps(answer), flush=True)
    for process in running:
        with contextlib.suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)


def _become(asked: dict[str, Any]) -> None:
    """Run the command in this process, which is new; ends as an interpreter ends."""
    from rigctl import cli

    os.setsid()
    for descriptor, name, flags in ((0, "stdin", os.O_RDWR), (1, "stdout", os.O_RDWR), (2, "stderr", os.O_RDWR)):
        opened = os.open(asked[name], flags | os.O_CREAT, 0o644)
        os.dup2(opened, descriptor)
        os.close(opened)
    if asked["terminal"]:
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)
    os.chdir(asked["directory"])
    os.environ |= {"XDG_STATE_HOME": asked["directory"], "TERM": "xterm-256color", **asked["environment"]}
    sys.argv = ["rigctl", *asked["start"]]
    sys.stdin = os.fdopen(0, closefd=False)
    cli.main()


def _status(process: int, running: set[int]) -> int | None:
    if process not in running:
        return None
    ended, how = os.waitpid(process, os.WNOHANG)
    if not ended:
        return None
    running.remove(process)
    return os.waitstatus_to_exitcode(how)


if __name__ == "__main__":
    main()
