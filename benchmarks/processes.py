"""What a program takes as a process of its own."""

from __future__ import annotations

import os
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]


@dataclass(frozen=True)
class Used:
    """What a process took; `peak_mb` of its largest part."""

    wall_s: float
    processor_s: float
    peak_mb: float


def python(*arguments: str | Path, may_miss_targets: bool = False) -> Used:
    """A Python process of one thread; `SystemExit` with its own words when it fails.

    A benchmark that says MISSED has missed a target of its own: no failure where it `may_miss_targets`.
    """
    command = [sys.executable, *map(str, arguments)]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    # As where a program is installed: what is compiled stays compiled.
    environment["PYTHONPYCACHEPREFIX"] = str(Path(tempfile.gettempdir()) / "rigctl-benchmarks")
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    with tempfile.TemporaryFile() as said:
        to_file = [(os.POSIX_SPAWN_DUP2, said.fileno(), number) for number in (1, 2)]
        began_s = time.perf_counter()
        child = os.posix_spawn(sys.executable, command, environment, file_actions=to_file)
        _, status, used = os.wait4(child, 0)
        wall_s = time.perf_counter() - began_s
        ended = os.waitstatus_to_exitcode(status)
        said.seek(0)
        words = said.read()[-1000:].decode(errors="replace")
        if ended and not (ended == 1 and may_miss_targets and "MISSED" in words):
            raise SystemExit(f"{' '.join(command)}: exit status {ended}: {words}")
    return Used(wall_s, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0)


def rigctl(*arguments: str | Path) -> Used:
    """A command, from its start to its end."""
    return python("-m", "rigctl", *arguments)
