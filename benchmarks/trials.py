"""Trials that are kept as lines of JSON: what stands in the file is not tried again, a study goes on where it was.

Processes of this machine do them, or a dask cluster; seeds are in the items, so that who does them changes nothing.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from rigctl.core.workers import Workers, outcomes_of
from rigctl.report.time_left import Pace

Item = TypeVar("Item")
Row = dict[str, Any]


def add_workers(parser: argparse.ArgumentParser, processes: int = 0) -> None:
    """The options --workers and --scheduler, as the commands have them."""
    parser.add_argument("--workers", type=int, default=processes, help="processes; 0: one for each core")
    parser.add_argument("--scheduler", default="", help="tcp://HOST:PORT: a dask cluster's workers instead")


def workers_of(given: argparse.Namespace) -> Workers:
    """What those options say."""
    return Workers(given.workers, given.scheduler)


def rows_in(path: Path) -> list[Row]:
    """What has been tried."""
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []


def keep_trials(
    trial: Callable[[Item], Row | Sequence[Row]],
    wanted: Iterable[Item],
    path: Path,
    workers: Workers,
    shown: Callable[[Row], None] = lambda _: None,
) -> None:
    """Try what is wanted and append its rows to the file as they come."""
    items = list(wanted)
    path.parent.mkdir(parents=True, exist_ok=True)
    pace = Pace("tried", lambda text: print(text, file=sys.stderr, flush=True))
    with path.open("a", encoding="utf-8") as file, outcomes_of(trial, items, workers) as outcomes:
        for done, (_, outcome) in enumerate(outcomes, 1):
            for row in [outcome] if isinstance(outcome, dict) else outcome:
                file.write(json.dumps(row) + "\n")
                shown(row)
            file.flush()
            pace.reached(done, len(items))
