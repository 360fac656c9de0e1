"""Is the Monte Carlo of the in-flight calibration linear in draws, and in workers? By processes and a dask cluster.

    nice python benchmarks/inflight_scaling.py [--draws 8 16 32 64] [--workers 1 2] [--orbits 3] [--whole]

The same study, of short sessions, for each number of draws, in this process: seconds of processor and of the clock
for each draw, and the former over that of the largest study. Sixteen draws fly in lock step, so that eight cost as
much. Compilation is not counted. Then by each number of workers, processes of this machine (one is this process) and
those of a local dask cluster: seconds of the clock that another draw takes, from a study of sixteen draws for each
worker to the largest, and whether the scores are the same; missed if they are not. `--whole` runs the shipped
campaign of a hundred draws by the command line besides: its seconds, and the peak of its largest process.
"""

from __future__ import annotations

import argparse
import json
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("NUMBA_NUM_THREADS", "1")

import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path

from distributed import LocalCluster

from benchmarks.machine import conditions
from rigctl import runner
from rigctl.campaign.store.store import Store
from rigctl.core.workers import HERE, Workers
from rigctl.experiments.inflight.result.monte_carlo import DRAW
from rigctl.files.campaign_file import read_campaign
from rigctl.files.rig_file import read_rig

CAMPAIGNS = Path(__file__).parents[1] / "campaigns"
AT_ONCE = 16
"""Draws that fly in lock step: a unit of work is so many of one session."""
PER_DRAW = 1.25
"""A study of the least full lanes may cost so much more for each draw than the largest."""
PEAK_BYTES, DRAW_S = 500e6, 1.2

STUDY = """\
experiment = "inflight-calibration"
rig = "rig.toml"

[procedure]
name = "monte-carlo"
draws = {draws}
orbits = {orbits}
orbits_ac12 = {orbits}
common_hz = 1.2324929971988796e-3
turn_hz = 1.2324929971988796e-3
displacement_hz = 3.0812324929971988e-3
quadratic_hz = 8.963585434173669e-3
"""


def study(directory: Path, draws: int, orbits: float, workers: Workers) -> str:
    """Its scores."""
    directory.mkdir()
    (directory / "rig.toml").write_text((CAMPAIGNS / "microscope-rig.toml").read_text())
    (directory / "campaign.toml").write_text(STUDY.format(draws=draws, orbits=orbits))
    campaign, path = read_campaign(directory / "campaign.toml"), directory / "x.rig.sqlite"
    runner.start(campaign, read_rig(campaign.rig_path), path, runner.Options(unattended=True, workers=workers))
    with Store.open(path, readonly=True) as store:
        return json.dumps([document.data for document in store.documents(DRAW)])


def whole(directory: Path) -> tuple[float, float, float]:
    """The shipped campaign as a process of its own: seconds of processor and of the clock, peak in bytes."""
    command = [sys.executable, "-c", "from rigctl.cli import main; raise SystemExit(main())", "run"]
    command += [str(CAMPAIGNS / "microscope-table2.toml")]
    command += ["--store", str(directory / "whole.rig.sqlite"), "--yes", "--json"]
    began = time.perf_counter()
    silent = os.open(os.devnull, os.O_WRONLY)
    child = os.posix_spawn(
        sys.executable, command, os.environ, file_actions=[(os.POSIX_SPAWN_DUP2, silent, n) for n in (1, 2)]
    )
    # What its processes used is in it; the peak is that of the largest.
    _, status, used = os.wait4(child, 0)
    if status:
        raise SystemExit("the campaign failed; run it by hand")
    return used.ru_utime + used.ru_stime, time.perf_counter() - began, 1024.0 * used.ru_maxrss


def linear_in_draws(directory: Path, draws: list[int], orbits: float) -> bool:
    """Whether each draw costs the same however many there are."""
    study(directory / "warm", 16, orbits, HERE)
    taken = {}
    for count in draws:
        processor, clock = time.process_time(), time.perf_counter()
        study(directory / f"{count}", count, orbits, HERE)
        taken[count] = time.process_time() - processor, time.perf_counter() - clock
    most = max(taken)
    print("  draws, seconds of processor a draw (over the largest study's), of the clock")
    linear = True
    for count, (processor, clock) in taken.items():
        ratio = processor / count / (taken[most][0] / most)
        linear &= count % 16 != 0 or 1.0 / PER_DRAW < ratio < PER_DRAW
        print(f"    {count:4d}  {processor / count:7.3f} ({ratio:.2f})  {clock / count:7.3f}")
    return linear


def linear_in_workers(directory: Path, draws: int, orbits: float, counts: list[int]) -> bool:
    """Whether so many workers find the same; how much sooner is told, as a busy machine has no cores to give."""
    print(f"  workers, up to {draws} draws: seconds of the clock for another draw (times as fast as one worker)")
    first: dict[str, float] = {}
    scores = set()
    for count in counts:
        said = []
        for place, workers in places(count):
            with workers as by:
                clock, found = another_draw_s(directory / f"{place} {count}", draws, orbits, by, count)
            scores.add(found)
            said.append(f"{place} {clock:6.3f} ({first.setdefault(place, clock) / clock:.2f})")
        print(f"    {count:4d}  {'  '.join(said)}", flush=True)
    print(f"    scores {'are the same' if len(scores) == 1 else 'DIFFER'}")
    return len(scores) == 1


def places(count: int) -> list[tuple[str, AbstractContextManager[Workers]]]:
    return [("processes", nullcontext(Workers(count))), ("dask", cluster_of(count))]


@contextmanager
def cluster_of(count: int) -> Iterator[Workers]:
    with LocalCluster(count, threads_per_worker=1, processes=True, dashboard_address=":0") as cluster:
        yield Workers(scheduler=cluster.scheduler_address)


def another_draw_s(directory: Path, draws: int, orbits: float, workers: Workers, count: int) -> tuple[float, str]:
    """What a draw more takes, and the scores of all.

    Two studies differ by draws, and not by what each worker loads and prepares.
    """
    few = AT_ONCE * count
    began_s = time.perf_counter()
    study(directory.with_name(f"{directory.name} few"), few, orbits, workers)
    between_s = time.perf_counter()
    found = study(directory, draws, orbits, workers)
    return (time.perf_counter() - between_s - (between_s - began_s)) / (draws - few), found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, nargs="+", default=[8, 16, 32, 64])
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--orbits", type=float, default=3.0)
    parser.add_argument("--whole", action="store_true")
    asked = parser.parse_args()
    if max(asked.draws) <= AT_ONCE * max(asked.workers):
        parser.error(f"the largest study needs more than {AT_ONCE} draws for each worker")
    print(conditions())
    with tempfile.TemporaryDirectory() as name:
        missed = not linear_in_draws(Path(name), asked.draws, asked.orbits)
        missed |= not linear_in_workers(Path(name), max(asked.draws), asked.orbits, asked.workers)
        if asked.whole:
            processor, clock, peak = whole(Path(name))
            missed |= peak >= PEAK_BYTES or processor > 100 * DRAW_S
            print(f"  whole campaign, 100 draws: {processor:.0f} s of processor, {clock:.0f} s of the clock")
            print(f"    peak of its largest process {peak / 1e6:.0f} MB, < {PEAK_BYTES / 1e6:.0f}")
    print("  MISSED" if missed else "  targets met")
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
