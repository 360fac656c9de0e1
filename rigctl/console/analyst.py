"""Has things worked out in processes of its own, so that nothing the analysis does keeps the screen waiting."""

from __future__ import annotations

import asyncio
import contextlib
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any


class Analyst:
    """One process for what takes long, one for what is shown live; made when they are first asked.

    `plugins` may grow meanwhile.
    """

    def __init__(self, plugins: Sequence[Path] = ()) -> None:
        self._plugins = plugins
        self._pools: dict[bool, ProcessPoolExecutor] = {}

    async def ask(self, what: str, *arguments: Any, live: bool = False) -> Any:
        """The outcome of a function of `rigctl.console.analysis`; raises what it raises."""
        pool = self._pool(live)
        try:
            return await _outcome(pool.submit(_work_out, what, *arguments, tuple(self._plugins)))
        except BrokenProcessPool:
            # A pool that is broken stays so; the next question makes another, if none has yet.
            if self._pools.get(live) is pool:
                del self._pools[live]
            raise

    def cancel(self) -> None:
        """Give up whatever is asked and not there yet, but not what is shown live."""
        self._end([False])

    def close(self) -> None:
        """End the processes, whatever they are at."""
        self._end([False, True])

    def _end(self, kinds: Sequence[bool]) -> None:
        for pool in [self._pools.pop(kind) for kind in kinds if kind in self._pools]:
            # The pool itself would wait for what they are at, which may take minutes.
            for process in list(pool._processes.values()):
                process.terminate()
            pool.shutdown(wait=False)

    def _pool(self, live: bool) -> ProcessPoolExecutor:
        if live not in self._pools:
            # Not forked from this process, which has threads, whose locks a fork would copy as they are, but from one
            # that has imported the analysis: neither the second process nor one after a cancel imports it again.
            context = multiprocessing.get_context("forkserver")
            context.set_forkserver_preload(["rigctl.console.analysis"])
            with contextlib.redirect_stderr(sys.__stderr__):  # its children need a real one, not the console's
                resource_tracker.ensure_running()
            self._pools[live] = ProcessPoolExecutor(1, mp_context=context, initializer=_begin)
        return self._pools[live]


async def _outcome(asked: Future[Any]) -> Any:
    """Wait for a process; who stops waiting leaves it alone, for a pool stumbles over what is cancelled."""
    done = asyncio.Event()
    loop = asyncio.get_running_loop()

    def wake(_: Future[Any]) -> None:
        with contextlib.suppress(RuntimeError):  # the console has ended meanwhile
            loop.call_soon_threadsafe(done.set)

    asked.add_done_callback(wake)
    await done.wait()
    return asked.result()


def _work_out(what: str, *arguments: Any) -> Any:
    """In that process, which alone imports the analysis."""
    from rigctl.console import analysis

    return getattr(analysis, what)(*arguments)


def _begin() -> None:
    # Ctrl-C at the terminal goes to all its processes; the console ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Without the terminal nobody shows what is worked out.
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    threading.Thread(target=_end_with_console, daemon=True).start()
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):  # the screen is the console's
        os.dup2(nowhere, stream)


def _end_with_console() -> None:
    """Also with one that was killed: nothing else would tell this process, which waits for its next question."""
    if console := multiprocessing.parent_process():
        console.join()
        os._exit(1)
