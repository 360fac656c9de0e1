"""One piece of work for many items: in this process, in several of this machine, or by the workers of a dask cluster.

What comes out does not depend on how many there are or where an item is worked on: an item brings all it needs, a
seed of its own where it draws, and linear algebra stays on one thread everywhere. A worker that is lost costs what it
was at, which another does again.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
import traceback
import uuid
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from queue import Empty, SimpleQueue
from typing import Any, Protocol, TypeVar

from rigctl.core.errors import LinkError, ProcedureError, RigError, one_line
from rigctl.core.extra import CLUSTER, needed
from rigctl.core.threads import one_thread

LOOKED_S = 0.2
"""While nothing comes, whoever waits is asked so often whether they still want it."""
LOSSES = 3
"""An item that has taken so many workers with it is not given to another."""
ANSWERS_S = 10.0
"""A scheduler that has not answered by then is not there."""

Item = TypeVar("Item")
Outcome = TypeVar("Outcome")


@dataclass(frozen=True)
class Workers:
    """So many processes of this machine (0: one for each core; 1: this one), or those of a dask `scheduler`."""

    processes: int = 0
    scheduler: str = ""

    def here(self, items: int) -> bool:
        """Whether this process works on so many items itself."""
        return not items or (not self.scheduler and self.beside(items) == 1)

    def beside(self, items: int) -> int:
        """How many processes of this machine work on so many items."""
        return min(self.processes or os.cpu_count() or 1, items)


HERE = Workers(1)
"""This process."""


class _Promise(Protocol):
    """An item that is being worked on."""

    def result(self) -> Any:
        """What came of it, or raised."""
        ...

    def add_done_callback(self, call: Callable[[Any], object], /) -> object:
        """Have it called, on whatever thread, when the item is done."""
        ...


_Submit = Callable[[Any], _Promise]


def _nothing() -> None:
    return


@contextmanager
def outcomes_of(
    work: Callable[[Item], Outcome], items: Sequence[Item], workers: Workers, heed: Callable[[], None] = _nothing
) -> Iterator[Iterator[tuple[int, Outcome]]]:
    """(place among the items, outcome) as they come; leaving it ends whatever is under way.

    `work` and items are pickled unless `workers.here(len(items))`, and `str(item)` names one in errors. `heed` is
    called between items and while nothing comes; what it raises, or a piece of work does, is raised by the iterator.
    `ProcedureError` for an item that loses its workers, `LinkError` without a scheduler, `ConfigError` without dask.
    """
    if workers.here(len(items)):
        yield _done_here(work, items, heed)
        return
    with (
        _cluster(work, workers.scheduler)
        if workers.scheduler
        else _processes(work, workers.beside(len(items))) as submit
    ):
        yield _as_they_come(submit, items, heed)


def in_order(outcomes: Iterable[tuple[int, Outcome]]) -> Iterator[Outcome]:
    """The same in the order of the items; what comes early is held back."""
    early: dict[int, Outcome] = {}
    following = 0
    for place, outcome in outcomes:
        early[place] = outcome
        while following in early:
            yield early.pop(following)
            following += 1


def _done_here(
    work: Callable[[Item], Outcome], items: Sequence[Item], heed: Callable[[], None]
) -> Iterator[tuple[int, Outcome]]:
    for place, item in enumerate(items):
        heed()
        yield place, _worked(work, item)


@one_thread
def _worked(work: Callable[[Item], Outcome], item: Item) -> Outcome:
    # The order of a sum, and so its last digits, goes with the number of threads.
    return work(item)


def _as_they_come(submit: _Submit, items: Sequence[Any], heed: Callable[[], None]) -> Iterator[tuple[int, Any]]:
    came: SimpleQueue[int] = SimpleQueue()

    def put(place: int, _: object) -> None:
        came.put(place)

    # All at once, so that workers are never idle.
    promises = {place: submit(item) for place, item in enumerate(items)}
    for place, promise in promises.items():
        promise.add_done_callback(partial(put, place))
    while promises:
        heed()
        with suppress(Empty):
            place = came.get(timeout=LOOKED_S)
            yield place, promises.pop(place).result()


@contextmanager
def _processes(work: Callable[[Any], Any], count: int) -> Iterator[_Submit]:
    processes = [_Process() for _ in range(count)]
    free: SimpleQueue[_Process] = SimpleQueue()
    for process in processes:
        free.put(process)

    def answered(item: Any) -> Any:
        process = free.get()
        try:
            return process.answer(work, item)
        finally:
            free.put(process)

    # A thread for each, which waits for its answers.
    with ThreadPoolExecutor(count, thread_name_prefix="worker") as pool:
        try:
            yield lambda item: pool.submit(answered, item)
        finally:
            for process in processes:
                process.end()
            pool.shutdown(wait=False, cancel_futures=True)


class _Process:
    """A worker process, started when it is first needed; another takes its place when it is lost."""

    def __init__(self) -> None:
        # Not fork: this process has threads, whose locks a fork would copy as they are.
        self._context = multiprocessing.get_context("spawn")
        self._changing = threading.Lock()
        self._over = False
        self._running: tuple[Any, Connection] | None = None

    def answer(self, work: Callable[[Any], Any], item: Any) -> Any:
        """What the work comes to, or what it raises; `CancelledError` after the end."""
        asked = pickle.dumps((work, item))
        for _ in range(LOSSES):
            ours = self._connection()
            try:
                ours.send_bytes(asked)
                returned, outcome = pickle.loads(ours.recv_bytes())  # noqa: S301 - from a process of ours
            except (EOFError, OSError):
                self._lose()
                continue
            if not returned:
                raise outcome
            return outcome
        raise ProcedureError(_lost(item, LOSSES))

    def end(self) -> None:
        """End it for good, whatever it is at."""
        with self._changing:
            self._over = True
            if self._running is not None:
                # Whoever waits for its answer reads that it has ended, and closes the connection.
                _kill(self._running[0])

    def _connection(self) -> Connection:
        with self._changing:
            if self._over:
                raise CancelledError
            if self._running is None:
                ours, theirs = self._context.Pipe()
                process = self._context.Process(target=_serve, args=(theirs,), daemon=True)
                process.start()
                theirs.close()
                self._running = process, ours
            return self._running[1]

    def _lose(self) -> None:
        with self._changing:
            if self._running is not None:
                process, ours = self._running
                _kill(process)
                ours.close()
                self._running = None


def _kill(process: Any) -> None:
    process.kill()
    process.join()


def _lost(item: object, losses: int) -> str:
    return one_line(
        f"{item}: {losses} workers were lost over it, by a crash or for want of memory; fewer workers leave each more"
    )


def _serve(asked: Connection) -> None:
    """The process: answers until nobody asks any more."""
    # Ctrl-C at the terminal goes to all its processes; the one that asks ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, BrokenPipeError):
        while True:
            asked.send_bytes(_answered(asked.recv_bytes()))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _answered(asked: bytes) -> bytes:
    try:
        work, item = pickle.loads(asked)  # noqa: S301 - from the process that started this one
        return pickle.dumps((True, _worked(work, item)))
    except Exception as error:  # noqa: BLE001 - whoever asked gets it
        return pickle.dumps((False, _travelling(error)))


def _travelling(error: Exception) -> Exception:
    """The error itself, or its words where it cannot be pickled; one that is not for a person says where it was."""
    try:
        pickle.loads(pickle.dumps(error))  # noqa: S301 - of our own
    except Exception:  # noqa: BLE001 - whatever hinders it
        error = ProcedureError(f"{type(error).__name__}: {error}")
    if not isinstance(error, RigError):
        error.add_note(traceback.format_exc())
    return error


@contextmanager
def _cluster(work: Callable[[Any], Any], address: str) -> Iterator[_Submit]:
    distributed = needed("distributed", CLUSTER)
    try:
        client = distributed.Client(address, timeout=ANSWERS_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise LinkError(one_line(f"no scheduler answers at {address} ({error}); start it first")) from None

    def submit(item: Any) -> Any:
        # The scheduler has another worker do what a lost one was at. The key is what its errors name.
        return client.submit(_worked, work, item, key=f"{item}#{uuid.uuid4().hex}")

    with client:
        try:
            yield submit
        except distributed.KilledWorker as lost:
            raise ProcedureError(_lost(str(lost.task).partition("#")[0], lost.allowed_failures + 1)) from None
        except distributed.CancelledError:
            raise LinkError(
                f"the scheduler at {address} was lost; start it again, and go on with what is left"
            ) from None
