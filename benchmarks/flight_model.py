"""Wall time and memory of the whole flight-model campaign in virtual time, on one core.

    PYTHONPATH=.:benchmarks python benchmarks/flight_model.py

Six configurations, ten mountings each, every byte through drivers and simulated instruments, then the result with its
budget. The floor beside it is the least that any program has to do with the same records: read them from the store
and fit a sine to every channel with numpy. Exit status 1 over 60 s or 500 MB.
"""

from __future__ import annotations

import os
import resource
import sys
import tempfile
import time
from pathlib import Path

os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})

import numpy as np
from machine import machine
from twin import CAMPAIGNS

from rigctl import Campaign, Store

LIMIT_S, LIMIT_MB = 60.0, 500.0


def sine_fits_s(path: Path) -> tuple[float, int]:
    """Seconds to read every run and fit its channels by least squares; and the number of samples."""
    start, samples = time.perf_counter(), 0
    with Store.open(path, readonly=True) as store:
        for run in store.runs():
            columns = store.samples(run.run_id)
            t = columns.pop("t_s")
            w = 2 * np.pi * run.conditions["frequency_hz"]
            design = np.stack([np.ones_like(t), np.cos(w * t), np.sin(w * t)], axis=1)
            np.linalg.lstsq(design, np.stack(list(columns.values()), axis=1), rcond=None)
            samples += len(t)
    return time.perf_counter() - start, samples


def main() -> int:
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / "flight.rig.sqlite"
        start = time.perf_counter()
        Campaign(CAMPAIGNS / "isa-flight-model.toml").run(path, unattended=True)
        took_s = time.perf_counter() - start
        peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        floor_s, samples = sine_fits_s(path)
        with Store.open(path, readonly=True) as store:
            runs = store.runs()
            rig_s = runs[-1].conditions["start_s"]
    print(machine() + ", one core used")
    print(f"{len(runs)} runs, {samples} samples of 5 channels, {rig_s / 3600:.1f} h of rig time")
    print(f"  campaign and result    {took_s:7.1f} s   (limit {LIMIT_S:g} s)")
    print(f"  reading and sine fits  {floor_s:7.2f} s   campaign over this: {took_s / floor_s:.0f}")
    print(f"  peak memory            {peak_mb:7.0f} MB  (limit {LIMIT_MB:g} MB)")
    return 0 if took_s <= LIMIT_S and peak_mb <= LIMIT_MB else 1


if __name__ == "__main__":
    sys.exit(main())
