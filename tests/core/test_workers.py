"""Work for many items: the same outcomes wherever it is done, whatever befalls the workers; none is left behind."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from distributed import LocalCluster

from rigctl.core.errors import Aborted, ConfigError, DataError, LinkError, ProcedureError
from rigctl.core.workers import Workers, in_order, outcomes_of
from tests.core import work

ASLEEP = """\
import signal
import sys
from pathlib import Path
from rigctl.core.workers import Workers, outcomes_of
from tests.core import work
if __name__ == "__main__":
    # Ignored from the start where whoever runs the tests has put them in the background.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with outcomes_of(work.asleep, [Path(sys.argv[1])] * 2, Workers(2)) as outcomes:
        list(outcomes)
"""


def found_by(piece: Callable[[Any], Any], items: Any, workers: Workers) -> list[Any]:
    with outcomes_of(piece, items, workers) as outcomes:
        return list(in_order(outcomes))


def until(what: Callable[[], bool]) -> None:
    ends_s = time.monotonic() + 60.0
    while not what():
        assert time.monotonic() < ends_s
        time.sleep(0.02)


def test_as_many_processes_as_asked_for_find_what_this_one_finds() -> None:
    alone = found_by(work.drawn, range(12), Workers(1))
    for count in (2, 3):
        found = found_by(work.drawn, range(12), Workers(count))
        assert [number for number, _ in found] == [number for number, _ in alone]
        assert os.getpid() not in {process for _, process in found}
        assert len({process for _, process in found}) <= count
    assert {process for _, process in alone} == {os.getpid()}


def test_what_comes_early_waits_for_its_turn() -> None:
    assert list(in_order(iter([(2, "c"), (0, "a"), (1, "b"), (3, "d")]))) == ["a", "b", "c", "d"]


def test_what_a_killed_worker_was_at_is_done_again(tmp_path: Path) -> None:
    found = found_by(work.killed_once, [(number, tmp_path) for number in range(10)], Workers(2))
    assert (tmp_path / "killed").exists()
    assert found == [number * number for number in range(10)]


def test_an_item_that_kills_its_workers_is_named_in_one_line() -> None:
    with pytest.raises(ProcedureError, match=r"^2: 3 workers were lost over it, by a crash or for want of memory"):
        found_by(work.deadly, range(4), Workers(2))
    assert not multiprocessing.active_children()


def test_errors_come_back_as_they_were_or_in_words() -> None:
    with pytest.raises(DataError, match=r"^table.csv: line 3: no number$"):
        found_by(work.refused, range(4), Workers(2))
    with pytest.raises(ProcedureError, match=r"^Awkward: of [01]$"):
        found_by(work.awkward, range(2), Workers(2))
    with pytest.raises(ZeroDivisionError) as ours:
        found_by(work.divided, range(2), Workers(2))
    assert "in divided" in ours.value.__notes__[0]


def test_who_does_not_want_it_any_more_ends_what_is_under_way(tmp_path: Path) -> None:
    def heed() -> None:
        if len(list(tmp_path.glob("*.pid"))) == 2:
            raise Aborted("enough")

    with pytest.raises(Aborted), outcomes_of(work.asleep, [tmp_path] * 5, Workers(2), heed) as outcomes:
        list(outcomes)
    assert not multiprocessing.active_children()


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGKILL])
def test_no_worker_outlives_who_started_it(tmp_path: Path, end: signal.Signals) -> None:
    script = tmp_path / "asleep.py"
    script.write_text(ASLEEP)
    command = [sys.executable, str(script), str(tmp_path)]
    quiet = subprocess.DEVNULL
    with subprocess.Popen(command, env={**os.environ, "PYTHONPATH": str(Path.cwd())}, stderr=quiet) as started:
        until(lambda: len(list(tmp_path.glob("*.pid"))) == 2)
        started.send_signal(end)
    assert started.returncode == -end
    workers = [int(path.stem) for path in tmp_path.glob("*.pid")]
    until(lambda: not any(Path(f"/proc/{worker}").exists() for worker in workers))


def test_a_dask_cluster_finds_the_same_until_its_scheduler_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    alone = found_by(work.squared, range(12), Workers(1))
    with LocalCluster(n_workers=1, threads_per_worker=2, processes=False, dashboard_address=":0") as cluster:
        there = Workers(scheduler=cluster.scheduler_address)
        assert found_by(work.squared, range(12), there) == alone
        with pytest.raises(DataError, match=r"^table.csv: line 3: no number$"):
            found_by(work.refused, range(4), there)
        # A scheduler that ends meanwhile is said in one line.
        monkeypatch.setattr("rigctl.core.workers.ANSWERS_S", 0.5)
        try:
            lost = rf"^the scheduler at {there.scheduler} was lost; start it again, and go on with what is left$"
            with (
                pytest.raises(LinkError, match=lost),
                outcomes_of(work.held, range(2), there, cluster.close) as outcomes,
            ):
                list(outcomes)
        finally:
            work.RELEASED.set()


def test_without_dask_it_is_said_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(
        ConfigError, match=r"^distributed is not installed; pip install 'rigctl\[cluster\]' brings it$"
    ):
        found_by(work.squared, range(2), Workers(scheduler="tcp://127.0.0.1:9"))


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nonsense://here", "tcp://127.0.0.1:not-a-port"])
def test_a_scheduler_that_does_not_answer_is_said_in_one_line(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rigctl.core.workers.ANSWERS_S", 0.5)
    with pytest.raises(LinkError) as refused:
        found_by(work.squared, range(2), Workers(scheduler=address))
    assert str(refused.value).startswith(f"no scheduler answers at {address}")
    assert "\n" not in str(refused.value)
