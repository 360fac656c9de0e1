"""How fast a recording of days is demodulated as a stream, beside reading the same arrays once.

    python benchmarks/bias_rejection_stream.py [--samples N] [--chunk N] [--turns N]

Two channels of 60 million samples (83.3 h at 200 Hz), pattern c of one minute and of fifty, in chunks of four
million samples. What counts is all that a recording needs, saturation looked for, beside the fastest pass over memory
that numpy has, its maximum; its sum is printed too. All are taken in turn, after one turn that does not count; the
median of the ratios within a turn counts, since others' work comes and goes. Each record is also cut in another way,
which must change neither results nor memory. Exit status 1 when a target is missed.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import sys
import time
from collections.abc import Callable

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from machine import conditions

from rigctl.core.arrays import FloatArray
from rigctl.experiments.rotating_platform.observe.demodulation import Demodulator, PeriodSums
from rigctl.experiments.rotating_platform.observe.estimates import estimates
from rigctl.experiments.rotating_platform.observe.estimators import OUTPUTS
from rigctl.experiments.rotating_platform.observe.patterns import SampledPattern, named_pattern

RATE_HZ, PERIODS_S = 200.0, (60.0, 3000.0)
LEVELS, NOISE, FULL_SCALE = (-1.2, 0.9), 0.08, 10.0
MAX_RATIO, MAX_GROWTH_MB, MAX_DIFFERENCE = 1.5, 150.0, 1e-9


def record(samples: int) -> list[FloatArray]:
    """Two channels of noise about their biases [V]."""
    rng = np.random.default_rng(1)
    channels = []
    for level in LEVELS:
        channel = np.empty(samples)
        for at in range(0, samples, 2**20):
            channel[at : at + 2**20] = rng.normal(level, NOISE, channel[at : at + 2**20].size)
        channels.append(channel)
    return channels


def demodulated(
    sampled: SampledPattern, channels: list[FloatArray], chunk: int, full_scale: float | None
) -> PeriodSums:
    """All periods of the record, chunk by chunk."""
    stream = Demodulator(sampled, len(channels), full_scale=full_scale)
    parts = (
        stream.feed([channel[at : at + chunk] for channel in channels]) for at in range(0, channels[0].size, chunk)
    )
    return PeriodSums.joined(parts)


def timed_s(action: Callable[[], object]) -> float:
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def measure(sampled: SampledPattern, channels: list[FloatArray], chunk: int, turns: int) -> float:
    """Print the medians and their ratios; give the ratio that counts."""
    actions: dict[str, Callable[[], object]] = {
        "read once: sum": lambda: [channel.sum() for channel in channels],
        "read once: maximum": lambda: [channel.max() for channel in channels],
        "demodulated": lambda: demodulated(sampled, channels, chunk, None),
        "demodulated, saturation looked for": lambda: demodulated(sampled, channels, chunk, FULL_SCALE),
    }
    taken: dict[str, list[float]] = {name: [] for name in actions}
    for action in actions.values():
        action()
    for _ in range(turns):
        for name, action in actions.items():
            taken[name].append(timed_s(action))
    print(f"  {sampled.pattern.label}, chunks of {chunk}")
    fastest = taken["read once: maximum"]
    for name, times in taken.items():
        print(
            f"    {name:<36} {statistics.median(times):6.3f} s ({min(times):.3f} .. {max(times):.3f})"
            f"  {ratio(times, taken['read once: sum']):5.2f} of the sum  {ratio(times, fastest):5.2f} of the maximum"
        )
    return ratio(taken["demodulated, saturation looked for"], fastest)


def ratio(times: list[float], others: list[float]) -> float:
    return statistics.median(a / b for a, b in zip(times, others, strict=True))


def difference(sampled: SampledPattern, channels: list[FloatArray], chunk: int) -> float:
    """How much the outputs change, in units of their scatter, when the record is cut in another way."""
    one, other = (estimates(sampled, demodulated(sampled, channels, size, None)) for size in (chunk, 123_457))
    return max(
        float(np.abs(one.output(name) - other.output(name)).max() / one.output(name).std()) for name in OUTPUTS
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=60_000_000)
    parser.add_argument("--chunk", type=int, default=4_000_000)
    parser.add_argument("--turns", type=int, default=15)
    given = parser.parse_args()
    print(conditions())
    channels = record(given.samples)
    print(
        f"  {given.samples} samples x {len(channels)} channels, {sum(each.nbytes for each in channels) / 1e9:.2f} GB"
    )
    before_mb, ratios, differences = peak_mb(), [], []
    for period_s in PERIODS_S:
        sampled = named_pattern("c", period_s).sampled(RATE_HZ)
        ratios.append(measure(sampled, channels, given.chunk, given.turns))
        differences.append(difference(sampled, channels, given.chunk))
    growth_mb = peak_mb() - before_mb
    print(f"  cut in another way: {max(differences):.1g} of the scatter (<= {MAX_DIFFERENCE:g})")
    print(f"  growth of memory: {growth_mb:.0f} MB (<= {MAX_GROWTH_MB:g})")
    print(f"  all of it over the fastest pass: {', '.join(f'{ratio:.2f}' for ratio in ratios)} (<= {MAX_RATIO:g})")
    missed = max(ratios) > MAX_RATIO or growth_mb > MAX_GROWTH_MB or max(differences) > MAX_DIFFERENCE
    print("  MISSED" if missed else "  targets met")
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
