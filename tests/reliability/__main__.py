"""Trials of what rigctl promises under faults.

    python -m tests.reliability --form short            # 30 minutes on 2 cores
    python -m tests.reliability --form full             # hours; interrupt it, and run it again to go on
    python -m tests.reliability --only signals --first-seed 201 --seeds 100
    python -m tests.reliability --table                 # the table of docs/reliability.md, from what is there
    python -m tests.reliability --table --out A --and-from B C --write docs/reliability.md    # of several directories

Each kind has a file of JSON lines in --out, one line per seed. A seed that has its line is not tried again, so that
runs add up. Exit status 1 when a promise was broken.
"""

from __future__ import annotations

import argparse
import itertools
import math
import signal
import sys
import time
from pathlib import Path

import numpy as np

from tests.reliability import single_faults
from tests.reliability.bounds import upper_bound
from tests.reliability.plan import KINDS
from tests.reliability.records import Line, Records, tally
from tests.reliability.workers import Task, carry_out


def main() -> int:
    """The trials asked for, then the table."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    asked = _asked()
    records = Records(asked.out, *asked.and_from)
    kinds = asked.only or list(KINDS)
    if not asked.table:
        until_s = time.monotonic() + asked.minutes * 60.0
        try:
            carry_out(_tasks(asked, records, kinds), records, asked.workers, until_s, _told)
        except KeyboardInterrupt:
            print("interrupted; the same command goes on", file=sys.stderr)
    for rows in [table(records, kinds), *([single_faults.rows()] if asked.messages else [])]:
        print("\n".join(rows))
        if asked.write:
            asked.write.write_text(with_table(asked.write.read_text(encoding="utf-8"), rows), encoding="utf-8")
    if asked.latencies:
        print("\n".join(latencies(records)))
    return int(any(line["failed"] for kind in kinds for line in records.lines(kind)))


def table(records: Records, kinds: list[str]) -> list[str]:
    """Rows for docs/reliability.md: what was tried of each promise, what failed, what rate that leaves possible."""
    rows = ["| kind | promise | seeds | tried | failed | rate at most (95 %) |", "|---|---|---|---|---|---|"]
    for name in kinds:
        found = tally(records.lines(name))
        if found.tried:
            bound = upper_bound(found.failures, found.tried)
            rows.append(
                f"| `{name}` | {KINDS[name].trials.PROMISE} | {found.seeds} | {found.tried} {KINDS[name].unit} "
                f"| {found.failures} | {bound:.1e} |"
            )
    return rows


def with_table(page: str, rows: list[str]) -> str:
    """The page with these rows in place of the table of the same header; `ValueError` when it has none."""
    before, header, rest = page.partition(f"{rows[0]}\n")
    if not header:
        raise ValueError("the page has no such table to be replaced")
    lines = rest.splitlines(keepends=True)
    after = next((place for place, line in enumerate(lines) if not line.startswith("|")), len(lines))
    return before + "".join(f"{row}\n" for row in rows) + "".join(lines[after:])


def latencies(records: Records) -> list[str]:
    """How long after a signal the stop was on the wire, by command and ending, for benchmarks/RESULTS.md."""
    taken_ms: dict[tuple[str, str], list[float]] = {}
    for line in records.lines("signals"):
        if "latency_s" in line:
            for cell in ((line["command"], line["ending"]), ("all", "all")):
                taken_ms.setdefault(cell, []).append(1e3 * line["latency_s"])
    rows = ["", "| command | ended by | trials | p50 [ms] | p99 [ms] | worst [ms] |", "|---|---|---|---|---|---|"]
    for (command, ending), each in sorted(taken_ms.items()):
        p50, p99 = np.quantile(each, [0.5, 0.99], method="inverted_cdf")
        rows.append(f"| {command} | {ending} | {len(each)} | {p50:.1f} | {p99:.1f} | {max(each):.1f} |")
    return rows


def _tasks(asked: argparse.Namespace, records: Records, kinds: list[str]) -> list[Task]:
    """Kinds take turns, so that a run cut short has tried all of them."""
    queues = []
    for name in kinds:
        done = {line["seed"] for line in records.lines(name)}
        count = KINDS[name].seeds(asked.form) if asked.seeds is None else asked.seeds
        seeds = range(asked.first_seed, asked.first_seed + count)
        queues.append([(place / max(count, 1), name, seed) for place, seed in enumerate(seeds) if seed not in done])
    return [(name, seed) for _, name, seed in sorted(itertools.chain.from_iterable(queues))]


def _told(kind: str, line: Line) -> None:
    if line["failed"]:
        print(f"{kind} {line['seed']}: {line['failed']}", file=sys.stderr, flush=True)


def _asked() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m tests.reliability", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=list(KINDS), metavar="KIND", help=", ".join(KINDS))
    parser.add_argument("--form", choices=("ci", "short", "full"), default="short")
    parser.add_argument("--seeds", type=int, help="this many of each kind, whatever the form")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=math.inf, help="begin no trial after so many")
    parser.add_argument("--out", type=Path, default=Path("out/reliability"))
    parser.add_argument("--and-from", nargs="+", type=Path, default=[], metavar="DIRECTORY", help="add up with --out")
    parser.add_argument("--write", type=Path, metavar="PAGE", help="put the table into this page")
    parser.add_argument("--table", action="store_true", help="only the table of what is there")
    parser.add_argument(
        "--messages", action="store_true", help="also what the operator is told of each kind of fault, tried now"
    )
    parser.add_argument("--latencies", action="store_true", help="also how soon after a signal a stop was sent")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
