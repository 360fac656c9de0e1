"""Is the Monte Carlo of the in-flight calibration linear in draws? Here, on all cores, and on a local dask cluster.

    nice python benchmarks/inflight_scaling.py [--draws 8 16 32 64] [--orbits 3] [--whole]

The same study, of short sessions, for each number of draws: on two threads of this process, and on a cluster of two
worker processes. Told are seconds of processor (of this process and the workers) and of the clock for each draw, and
the former over that of the largest study. Sixteen draws fly in lock step, so that eight cost as much. Compilation is
not counted. `--whole` runs the shipped campaign of a hundred draws by the command line besides: its seconds, and the
peak of its memory, that of one process, whose threads fly all draws.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("NUMBA_NUM_THREADS", "1")

import resource
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from distributed import Client, LocalCluster
from machine import conditions

from rigctl import runner
from rigctl.files.campaign_file import read_campaign
from rigctl.files.rig_file import read_rig

CAMPAIGNS = Path(__file__).parents[1] / "campaigns"
WORKERS = 2
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
workers = {workers}
scheduler = "{scheduler}"
"""


def study(directory: Path, draws: int, orbits: float, scheduler: str) -> None:
    directory.mkdir()
    (directory / "rig.toml").write_text((CAMPAIGNS / "microscope-rig.toml").read_text())
    text = STUDY.format(draws=draws, orbits=orbits, workers=WORKERS, scheduler=scheduler)
    (directory / "campaign.toml").write_text(text)
    campaign = read_campaign(directory / "campaign.toml")
    rig = read_rig(campaign.rig_path)
    runner.start(campaign, rig, directory / "x.rig.sqlite", runner.Options(unattended=True))


def timed(action: Callable[[], None], processor_s: Callable[[], float]) -> tuple[float, float]:
    """Seconds of processor and of the clock."""
    processor, clock = processor_s(), time.perf_counter()
    action()
    return processor_s() - processor, time.perf_counter() - clock


def peak_bytes() -> float:
    return 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


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
    _, status, used = os.wait4(child, 0)
    if status:
        raise SystemExit("the campaign failed; run it by hand")
    return used.ru_utime + used.ru_stime, time.perf_counter() - began, 1024.0 * used.ru_maxrss


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, nargs="+", default=[8, 16, 32, 64])
    parser.add_argument("--orbits", type=float, default=3.0)
    parser.add_argument("--whole", action="store_true")
    asked = parser.parse_args()
    print(conditions())
    missed = False
    with (
        tempfile.TemporaryDirectory() as name,
        LocalCluster(n_workers=WORKERS, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        directory = Path(name)
        places: dict[str, tuple[str, Callable[[], float]]] = {
            "two threads": ("", time.process_time),
            "two dask workers": (
                cluster.scheduler_address,
                lambda: time.process_time() + sum(client.run(time.process_time).values()),
            ),
        }
        for number, (place, (scheduler, processor_s)) in enumerate(places.items()):
            study(directory / f"warm {number}", 16 * WORKERS, asked.orbits, scheduler)
            taken = {}
            for draws in asked.draws:
                flown = partial(study, directory / f"{number} {draws}", draws, asked.orbits, scheduler)
                taken[draws] = timed(flown, processor_s)
            most = max(taken)
            print(f"  {place}: draws, seconds of processor a draw (over the largest study's), of the clock")
            for draws, (processor, clock) in taken.items():
                ratio = processor / draws / (taken[most][0] / most)
                missed |= draws % 16 == 0 and not 1.0 / PER_DRAW < ratio < PER_DRAW
                print(f"    {draws:4d}  {processor / draws:7.3f} ({ratio:.2f})  {clock / draws:7.3f}")
        there = ", ".join(f"{peak / 1e6:.0f}" for peak in client.run(peak_bytes).values())
        print(f"    peak {peak_bytes() / 1e6:.0f} MB here, {there} MB there")
        if asked.whole:
            processor, clock, peak = whole(directory)
            missed |= peak >= PEAK_BYTES or processor > 100 * DRAW_S
            print(f"  whole campaign, 100 draws: {processor:.0f} s of processor, {clock:.0f} s of the clock")
            print(f"    peak of its process {peak / 1e6:.0f} MB, < {PEAK_BYTES / 1e6:.0f}")
    print("  MISSED" if missed else "  targets met")
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
