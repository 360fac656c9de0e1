"""The command line: thin, every command calls what Python users call.

Exit status: 0 done; 1 the work failed; 2 wrong usage or bad input; 130 aborted by the operator.
"""

from __future__ import annotations

import gc
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

from rigctl.core.errors import Aborted, RigError, refuses_input
from rigctl.core.whole_file import mend_of
from rigctl.report.plain_signs import on_standard_streams

# The matrices here are small: a second thread only waits, and the other core belongs to the console.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Plain help: panels and colours take longer to import than all that a page of help needs. Typer asks while it is
# imported, by whatever comes first.
os.environ.setdefault("TYPER_USE_RICH", "0")

TRACEBACK = "RIGCTL_TRACEBACK"
"""Environment variable for whoever hunts a bug of ours: show it in full."""


def main() -> None:
    """Run a command; errors become one line on stderr and an exit status."""
    on_standard_streams()
    try:
        _main()
    except SystemExit as leaving:
        _leave_console(leaving.code)
        raise
    _leave_console(0)


def _leave_console(status: object) -> None:
    """Leave at once where a console has run, whatever its threads are at.

    The interpreter's end would abort one that is in compiled code.
    """
    module = sys.modules.get("rigctl.console.start")
    if module is None or not module.HAS_RUN.is_set():
        return
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # the terminal may be gone
            stream.flush()
    os._exit(status if isinstance(status, int) else int(status is not None))


def _main() -> None:
    try:
        _run(sys.argv[1:])
    except RigError as error:
        message = f"aborted: {error}" if isinstance(error, Aborted) else str(error)
        _fail("; ".join([message, *getattr(error, "__notes__", [])]), _status(error))
    except KeyboardInterrupt:
        _fail("aborted: interrupted", 130)
    except BrokenPipeError:
        # Whoever read has gone; closed, the interpreter cannot complain of it a second time at its end.
        sys.stderr.close()
    except OSError as error:
        mend = mend_of(error, "check the path and its permissions")
        _fail(f"{error.filename or 'rigctl'}: {error.strerror or error}; {mend}", 1)
    # The last resort: no traceback reaches a user.
    except Exception as error:
        if TRACEBACK in os.environ:
            raise
        text = f"{type(error).__name__}: {error}"
        _fail(f"internal error: {text}; please report it with what {TRACEBACK}=1 shows", 1)


def _run(arguments: list[str]) -> None:
    match arguments:
        # The operator waits for the frame with STOP: what reads command lines takes half as long to import as that.
        case ["console", *place] if len(place) <= 1 and not "".join(place).startswith("-"):
            # Nothing that is made until all screens are there is garbage: the console collects from then on.
            gc.disable()
            from rigctl.console.start import start

            start(Path(place[0]) if place else None, ())
        case _:
            # Nor is what a command imports: it collects from then on, and leaves that alone.
            gc.disable()
            try:
                _command(arguments or ["--help"])
            finally:
                gc.enable()


def _command(arguments: list[str]) -> None:
    from typer.exceptions import TyperException

    from rigctl.cli.application import app

    try:
        status = app(arguments, standalone_mode=False)
    except TyperException as wrong:
        context = getattr(wrong, "ctx", None)
        command = "rigctl" if context is None else context.command_path
        said = wrong.format_message().removesuffix(".")
        _fail(f"{command}: {said}{'' if said.endswith('?') else ';'} `{command} --help` tells more", wrong.exit_code)
    sys.exit(status if isinstance(status, int) else 0)


def _status(error: RigError) -> int:
    if isinstance(error, Aborted):
        return 130
    return 2 if refuses_input(error) else 1


def _fail(message: str, status: int) -> NoReturn:
    # One line, whatever the message holds.
    print(" ".join(message.split()), file=sys.stderr)  # noqa: T201
    sys.exit(status)
