"""Commands in this process or in another one, and whether they ended as a command has to."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

STATUSES = {0, 1, 2, 130}
LONGEST_MESSAGE = 2000
UNTYPED = re.compile(r"Traceback|internal error|Error\(|Exception ignored|Warning:|Segmentation|Aborted!|\bassert\b")


@dataclass(frozen=True)
class Outcome:
    """How a command ended."""

    status: int
    out: str
    err: str

    @property
    def message(self) -> str:
        """What it said last."""
        lines = self.err.strip().splitlines()
        return lines[-1] if lines else ""

    def broken(self) -> str:
        """What no command may do; "" when it ended as it has to."""
        if self.status not in STATUSES:
            return f"exit status {self.status}; {self.message}"
        if untyped := UNTYPED.search(self.err + self.out):
            return f"an untyped message, {untyped.group()!r}: {self.message}"
        if self.status and not self.message:
            return f"exit status {self.status} without a word"
        if len(self.message) > LONGEST_MESSAGE:
            return f"a message of {len(self.message)} characters"
        return ""


def here(work: Path, *arguments: object) -> Outcome:
    """`rigctl` with these arguments in this process, in the directory `work`."""
    from rigctl import cli

    out, err = work / "stdout.txt", work / "stderr.txt"
    before = sys.argv, Path.cwd()
    sys.argv = ["rigctl", *map(str, arguments)]
    os.chdir(work)
    try:
        with _written_to(1, out), _written_to(2, err):
            status = _status(cli.main)
    finally:
        sys.argv = before[0]
        os.chdir(before[1])
    return Outcome(status, out.read_text(errors="replace"), err.read_text(errors="replace"))


def _status(main: object) -> int:
    try:
        main()  # type: ignore[operator]
    except SystemExit as ended:
        return ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    return 0


def process(work: Path, *arguments: object, **options: object) -> subprocess.Popen[str]:
    """`rigctl` with these arguments in another process."""
    root = Path(__file__).parents[2]
    return subprocess.Popen(
        [sys.executable, "-m", "rigctl.cli", *map(str, arguments)],
        cwd=work,
        text=True,
        env={**os.environ, "PYTHONPATH": str(root)},
        **{"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options},  # type: ignore[call-overload]
    )


def ended(running: subprocess.Popen[str], timeout_s: float) -> Outcome:
    """How it ended; killed, with status -9, when it did not within `timeout_s`."""
    try:
        out, err = running.communicate(timeout=timeout_s)
    except subprocess.TimeoutExpired:
        running.kill()
        out, err = running.communicate()
        return Outcome(-9, out, f"{err}\ndid not end within {timeout_s:g} s")
    return Outcome(running.returncode, out, err)


@contextmanager
def _written_to(descriptor: int, path: Path) -> Iterator[None]:
    """A standard stream goes to a file: the descriptor too, so that nothing escapes."""
    stream = sys.stdout if descriptor == 1 else sys.stderr
    stream.flush()
    kept = os.dup(descriptor)
    with path.open("w") as file:
        os.dup2(file.fileno(), descriptor)
        try:
            yield
        finally:
            stream.flush()
            os.dup2(kept, descriptor)
            os.close(kept)
