"""The platform's coloured noise beside numpy's white noise of the same length, in one run: at most 8 times.

    python benchmarks/platform_noise.py [--samples 4000000] [--turns 7]

Printed are the medians of the turns, their ratio, and by how much the process has grown while it made a record:
what is kept does not depend on the length.
"""

from __future__ import annotations

import argparse
import resource
import sys

import numpy as np

from benchmarks.machine import conditions
from benchmarks.paired import pairs
from simulators.worlds.platform_noise import NoiseStream, PowerLaw

CHAIN = PowerLaw(white=3.1925e-5, red=9.052e-8, exponent=1.6384)
CHUNK = 10_000
"""Samples taken at a time, as a campaign takes them."""
TARGET = 8.0


def white(samples: int) -> None:
    np.random.default_rng(1).standard_normal(samples)


def coloured(samples: int, rate_hz: float, number: int) -> None:
    stream = NoiseStream(CHAIN, rate_hz, 1, number)
    for _ in range(samples // CHUNK):
        stream.take(CHUNK)


def grown_mib(samples: int, rate_hz: float) -> float:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    coloured(samples, rate_hz, 0)
    return (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=4_000_000)
    parser.add_argument("--turns", type=int, default=7)
    asked = parser.parse_args()
    print(conditions())
    print(f"coloured noise of {asked.samples} samples; numpy's white noise, ours, ratio")
    grown = grown_mib(asked.samples, 10.0)
    missed = False
    for rate_hz in (10.0, 100.0, 200.0):
        found = pairs(lambda: white(asked.samples), lambda n: coloured(asked.samples, rate_hz, n), asked.turns)  # noqa: B023
        print(found.line(f"at {rate_hz:g} Hz", TARGET))
        missed |= found.ratio > TARGET
    print(f"  grown by {grown:.1f} MiB while making {asked.samples} samples ({8e-6 * asked.samples:.0f} MB)")
    sys.exit(missed)


if __name__ == "__main__":
    main()
