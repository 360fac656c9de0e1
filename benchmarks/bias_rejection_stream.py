"""How fast a recording of a day is demodulated as a stream, beside reading the same arrays once.

    python benchmarks/bias_rejection_stream.py [--samples N] [--chunk N] [--turns N]

A record as a store gives it, eight columns of 12 million samples (16.7 h at 200 Hz), pattern c of one minute and of
fifty, in chunks of half a million samples: cut into cells, then every period estimated. It is the path of results
and of the live estimates of a run. Beside it stands the fastest pass over the same memory that numpy has, its
maximum. Both are taken in turn, after one turn that does not count; the median of the ratios within a turn counts,
since others' work comes and goes. Each record is also cut in another way, which must change neither results nor
memory. Exit status 1 when a target is missed.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import sys
import time
from collections.abc import Callable, Iterator

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from benchmarks.machine import conditions
from rigctl.core.arrays import FloatArray
from rigctl.experiments.rotating_platform.observe.cutter import cells_of
from rigctl.experiments.rotating_platform.observe.estimates import PeriodEstimates, estimates, outside_guard
from rigctl.experiments.rotating_platform.observe.estimators import OUTPUTS
from rigctl.experiments.rotating_platform.observe.patterns import SampledPattern, named_pattern
from rigctl.experiments.rotating_platform.observe.recorded import Chains

RATE_HZ, PERIODS_S = 200.0, (60.0, 3000.0)
LEVELS, NOISE_V, FULL_SCALE_V = {"q_a_v": -1.2, "q_b_v": 0.9}, 0.08, 10.0
CHAINS = Chains(
    {"z": 846.73, "y": 804.32}, {"z": 825.0, "y": 825.0}, {}, {"z": FULL_SCALE_V, "y": FULL_SCALE_V}, 9.81
)
MAX_RATIO, MAX_GROWTH_MB, MAX_DIFFERENCE = 60.0, 250.0, 1e-9


def record(sampled: SampledPattern, samples: int) -> dict[str, FloatArray]:
    """The columns of a run at rest but for its turns, with noise about two biases."""
    rng = np.random.default_rng(1)
    sign = np.resize(sampled.sign, samples)
    columns = {name: rng.normal(level, NOISE_V, samples) for name, level in LEVELS.items()}
    return {
        "t_s": np.arange(samples) / RATE_HZ,
        "theta_deg": np.where(sign < 0, 180.0, 0.0),
        "moving": (sign == 0).astype(np.float64),
        "dm1_z_v": np.ones(samples),
        "dm1_y_v": np.zeros(samples),
        "temperature_c": np.full(samples, 22.0),
        **columns,
    }


def chunks(columns: dict[str, FloatArray], size: int) -> Iterator[dict[str, FloatArray]]:
    for at in range(0, columns["t_s"].size, size):
        yield {name: values[at : at + size] for name, values in columns.items()}


def demodulated(sampled: SampledPattern, columns: dict[str, FloatArray], chunk: int) -> PeriodEstimates:
    """All periods of the record, chunk by chunk."""
    cells = cells_of(chunks(columns, chunk), CHAINS, sampled.pattern.period_s, RATE_HZ)
    return estimates(cells, outside_guard(cells, 0.0, 0.0), sampled)


def timed_s(action: Callable[[], object]) -> float:
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def measure(sampled: SampledPattern, columns: dict[str, FloatArray], chunk: int, turns: int) -> float:
    """Print the medians and their ratio, and give the ratio."""
    actions: dict[str, Callable[[], object]] = {
        "read once: maximum": lambda: [column.max() for column in columns.values()],
        "demodulated": lambda: demodulated(sampled, columns, chunk),
    }
    taken_s: dict[str, list[float]] = {name: [] for name in actions}
    for turn in range(turns + 1):
        for name, action in actions.items():
            time_s = timed_s(action)
            if turn:
                taken_s[name].append(time_s)
    print(f"  {sampled.pattern.label}, chunks of {chunk}")
    for name, times in taken_s.items():
        print(f"    {name:<20} {statistics.median(times):6.3f} s ({min(times):.3f} .. {max(times):.3f})")
    fastest, whole = taken_s.values()
    return statistics.median(a / b for a, b in zip(whole, fastest, strict=True))


def difference(sampled: SampledPattern, columns: dict[str, FloatArray], chunk: int) -> float:
    """How much the outputs change, in units of their scatter, when the record is cut in another way."""
    one, other = (demodulated(sampled, columns, size) for size in (chunk, 123_457))
    return max(
        float(np.abs(one.output(name) - other.output(name)).max() / one.output(name).std()) for name in OUTPUTS
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=12_000_000)
    parser.add_argument("--chunk", type=int, default=500_000)
    parser.add_argument("--turns", type=int, default=5)
    given = parser.parse_args()
    print(conditions())
    ratios, differences, growths_mb = [], [], []
    for period_s in PERIODS_S:
        sampled = named_pattern("c", period_s).sampled(RATE_HZ)
        columns = record(sampled, given.samples)
        held_mb = sum(each.nbytes for each in columns.values()) / 1e6
        print(f"  {given.samples} samples x {len(columns)} columns, {held_mb:.0f} MB")
        before_mb = peak_mb()
        ratios.append(measure(sampled, columns, given.chunk, given.turns))
        differences.append(difference(sampled, columns, given.chunk))
        growths_mb.append(peak_mb() - before_mb)
    print(f"  cut in another way: {max(differences):.1g} of the scatter (<= {MAX_DIFFERENCE:g})")
    print(f"  growth of memory: {max(growths_mb):.0f} MB (<= {MAX_GROWTH_MB:g})")
    print(f"  all of it over the fastest pass: {', '.join(f'{ratio:.0f}' for ratio in ratios)} (<= {MAX_RATIO:g})")
    missed = max(ratios) > MAX_RATIO or max(growths_mb) > MAX_GROWTH_MB or max(differences) > MAX_DIFFERENCE
    print("  MISSED" if missed else "  targets met")
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
