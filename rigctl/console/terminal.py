"""The terminal the console is on, which can be lost: who writes to it neither fails nor waits."""

from __future__ import annotations

import io
import os
import select
import signal
import threading
from typing import TYPE_CHECKING, Any, TextIO

from textual.drivers import linux_driver

from rigctl.console.escape import EscapeFirst

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

LEAVE_S = 8.0
"""A console that has lost its terminal has stopped everything, and is gone, after so long."""


class TerminalDriver(linux_driver.LinuxDriver):
    """Textual's own, with keys read by `EscapeFirst`, on a terminal that can be lost while it is drawn on."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        # It makes its parser by this name and takes none.
        setattr(linux_driver, "XTermParser", EscapeFirst)  # noqa: B010 - the module does not declare it as its own
        if self._file is not None:
            # Its thread that writes would end with the terminal, and the screen wait for that thread for ever.
            self._file = outliving(self._file)


def outliving(terminal: TextIO) -> io.TextIOWrapper:
    """The same terminal, which stays open; what it no longer takes is gone."""
    raw = _Outlived(terminal.fileno(), "w", closefd=False)
    return io.TextIOWrapper(io.BufferedWriter(raw), terminal.encoding, terminal.errors)


class _Outlived(io.FileIO):
    def write(self, data: ReadableBuffer, /) -> int:
        try:
            return super().write(data)
        except OSError:  # the terminal hung up; the signal that tells it may come later
            return memoryview(data).nbytes


def watch_terminal(terminal: int = 0) -> None:
    """Be sent HUP when a terminal hangs up.

    The system sends it to who leads the terminal's session: not to a console that a script or a notebook started.
    """

    def watch() -> None:
        hung_up = select.poll()
        # No events but the hang-up, which poll always tells; reading would take away keys.
        hung_up.register(terminal, 0)
        if any(event & select.POLLHUP for _, event in hung_up.poll()):
            os.kill(os.getpid(), signal.SIGHUP)

    if os.isatty(terminal):
        threading.Thread(target=watch, name="terminal", daemon=True).start()


def leave_terminal() -> None:
    """Nothing more is written to a terminal that is gone: the screen would wait for it for ever.

    It may wait already: then this process ends nevertheless. What it holds has been stopped by then.
    """
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in range(3):
        os.dup2(nowhere, descriptor)
    # The main thread may hang in a write that never returns.
    last_resort = threading.Timer(LEAVE_S, os._exit, (1,))
    last_resort.daemon = True
    last_resort.start()
