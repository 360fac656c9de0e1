"""A file of effects is tried in a process of its own first: it may hang, end the program or change it there.

The file is run as it would be here, and each effect called on made-up runs. What an exception says is left to the
program itself; what no exception tells (no return, an exit, a fork, changed signals, text on stdout) is found here.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO

from rigctl.core.bounds import MIB
from rigctl.core.errors import ConfigError, PluginError
from rigctl.effects.plugin_code import effects_of, executed
from rigctl.effects.trial import flaw_of_function

PATIENCE_S = 30.0
"""A file of effects takes a quarter of a second, one that compiles its functions ten."""

_PROGRAM = (
    "import json, sys; path, name, result = json.loads(sys.argv[1]); sys.path[:] = path;"
    " from rigctl.effects.rehearsal import perform; perform(name, result)"
)
# A file that prints without end then fails by itself instead of filling the disk.
_WRITES_BYTES = 64 * MIB
_MEND = "mend the file, or leave it out of --plugin"


@lru_cache(maxsize=64)
def rehearse(path: Path, source: bytes) -> None:
    """Try a file of effects out in another process; `PluginError` for what must not happen in this one.

    Takes about a quarter of a second, once for each text in a program.
    """
    with tempfile.TemporaryFile() as text, tempfile.TemporaryFile() as result, tempfile.TemporaryFile() as printed:
        text.write(source)
        text.seek(0)
        status = _performed(path, text, result, printed)
        result.seek(0)
        reports = [json.loads(line) for line in result.read().splitlines()]
    where = next((each["at"] for each in reversed(reports) if "at" in each), "")
    flaw = next((each["flaw"] for each in reports if "flaw" in each), None)
    if flaw is None and {"done": True} not in reports:
        flaw = f"ends the program ({_ended(status)})" if status is not None else f"takes over {PATIENCE_S:g} s"
    if flaw is not None:
        raise PluginError(f"{path}: {where}{flaw}; {_MEND}")


def _performed(path: Path, text: BinaryIO, result: BinaryIO, printed: BinaryIO) -> int | None:
    """The exit status of the other process; None when it was ended because it took too long."""
    task = json.dumps([sys.path, str(path), result.fileno()])
    child = subprocess.Popen(  # noqa: S603 - this interpreter, on a file that the user named
        [sys.executable, "-c", _PROGRAM, task],
        stdin=text,
        stdout=printed,
        stderr=subprocess.DEVNULL,
        pass_fds=[result.fileno()],
        # A group of its own: ending it ends what the file started as well.
        start_new_session=True,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )
    try:
        return child.wait(PATIENCE_S)
    except subprocess.TimeoutExpired:
        return None
    finally:
        with suppress(ProcessLookupError):
            os.killpg(child.pid, signal.SIGKILL)
        child.wait()


def _ended(status: int) -> str:
    return f"status {status}" if status >= 0 else f"signal {signal.Signals(-status).name}"


def perform(name: str, result: int) -> None:
    """The other process: run the file, call its effects, tell by the descriptor `result`, and end."""
    source = sys.stdin.buffer.read()
    main = os.getpid()
    # Inherited by whatever the file starts, however it writes.
    resource.setrlimit(resource.RLIMIT_FSIZE, (_WRITES_BYTES, _WRITES_BYTES))

    def tell(**what: object) -> None:
        # A process forked by other means than `os.fork` must not report for this one.
        if os.getpid() == main:
            os.write(result, json.dumps(what).encode() + b"\n")

    def heard(event: str, _: tuple[Any, ...]) -> None:
        if event in {"os.fork", "os.forkpty"}:
            tell(flaw="starts a process of its own, an effect only computes")
            os._exit(1)

    sys.addaudithook(heard)
    before = _handlers()
    try:
        _go_through(Path(name), source, tell)
    except Exception:  # noqa: BLE001 - what an exception says, this process's parent finds by itself
        tell(at="")
    except BaseException as error:  # noqa: BLE001 - sys.exit and whatever else a user's file may raise
        tell(flaw=f"raises {type(error).__name__}, which would end the program")
    # What waits in the buffer is text on stdout as well.
    sys.stdout.flush()
    if os.fstat(1).st_size:
        tell(flaw="prints to stdout, where a command's result goes; print to stderr")
    if _handlers() != before:
        tell(flaw="changes how signals are handled")
    tell(done=True)
    # At once: nothing that the file registered for the end of a program runs.
    os._exit(0)


def _go_through(path: Path, source: bytes, tell: Callable[..., None]) -> None:
    for each in effects_of(executed(path, source)):
        tell(at=f"effect '{each.id}': ")
        with suppress(ConfigError):
            flaw_of_function(each)
    tell(at="")


def _handlers() -> dict[int, object]:
    return {number: signal.getsignal(number) for number in signal.valid_signals()}
