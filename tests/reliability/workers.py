"""Trials in processes of their own: one that hangs or dies is a failure of its trial, and of no other."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import threading
import time
import traceback
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from multiprocessing.connection import Connection
from queue import Empty, SimpleQueue
from typing import Any

from tests.reliability.plan import KINDS
from tests.reliability.records import Line, Records

DEADLINE_S = 120.0

Task = tuple[str, int]
"""Kind and seed."""


class Worker:
    """A process that does one trial after the other; a new one takes its place when it had to be killed."""

    def __init__(self, records: Records) -> None:
        self._records = records
        self._over = False
        self._context = multiprocessing.get_context("spawn")
        self._start()

    def trial(self, kind: str, seed: int) -> Line:
        """One trial's line."""
        work = self._records.evidence(kind, seed)
        shutil.rmtree(work, ignore_errors=True)
        work.mkdir(parents=True)
        began_s = time.monotonic()
        found = self._answer(kind, seed, str(work))
        if not found["failed"]:
            shutil.rmtree(work, ignore_errors=True)
        return {**found, "seed": seed, "seconds": round(time.monotonic() - began_s, 3)}

    def end(self) -> None:
        """End the process for good: a trial under way fails, and no other begins."""
        self._over = True
        self._kill()

    def _kill(self) -> None:
        """End the process, and whatever it started."""
        if self._process.pid is not None:
            _kill_session(self._process.pid)
        self._process.kill()
        self._process.join()

    def _answer(self, kind: str, seed: int, work: str) -> dict[str, Any]:
        deadline_s = float(getattr(KINDS[kind].trials, "DEADLINE_S", DEADLINE_S))
        try:
            self._ours.send((kind, seed, work))
            if self._ours.poll(deadline_s):
                answer: dict[str, Any] = self._ours.recv()
                return answer
            failed = f"the trial did not end within {deadline_s:g} s"
        except (EOFError, OSError):
            self._process.join(5.0)
            failed = f"the trial's process died, exit status {self._process.exitcode}"
        self._kill()
        if not self._over:
            self._start()
        return {"failed": failed}

    def _start(self) -> None:
        self._ours, theirs = self._context.Pipe()
        self._process = self._context.Process(target=_serve, args=(theirs,), daemon=False)
        self._process.start()
        theirs.close()


def carry_out(tasks: Iterable[Task], records: Records, workers: int, until_s: float, told: Any) -> None:
    """Do the trials, `workers` at a time, and write a line each; none begins after `until_s` (monotonic).

    Interrupted, it ends the trials under way, of which nothing is written.
    """
    queue: SimpleQueue[Task] = SimpleQueue()
    for task in tasks:
        queue.put(task)
    over = threading.Event()

    def work_off(worker: Worker) -> None:
        try:
            while time.monotonic() < until_s:
                kind, seed = queue.get_nowait()
                line = worker.trial(kind, seed)
                if over.is_set():
                    return
                records.add(kind, line)
                told(kind, line)
        except Empty:
            return

    at_work = [Worker(records) for _ in range(workers)]
    with ThreadPoolExecutor(workers) as pool:
        try:
            for done in [pool.submit(work_off, worker) for worker in at_work]:
                done.result()
        finally:
            over.set()
            for worker in at_work:
                worker.end()


def _serve(tasks: Connection) -> None:
    """The process: a session of its own, so that what its trials start can be ended with it."""
    os.setsid()
    while True:
        try:
            kind, seed, work = tasks.recv()
        except EOFError:
            return
        tasks.send(_tried(kind, seed, work))


def _tried(kind: str, seed: int, work: str) -> dict[str, Any]:
    from pathlib import Path

    try:
        return KINDS[kind].trials.trial(seed, Path(work))
    except Exception as error:  # noqa: BLE001 - whatever it is, it is this trial's failure
        (Path(work) / "traceback.txt").write_text(traceback.format_exc(), encoding="utf-8")
        return {"failed": f"{type(error).__name__}: {error}"}


def _kill_session(leader: int) -> None:
    with suppress(ProcessLookupError):
        os.killpg(leader, signal.SIGKILL)
