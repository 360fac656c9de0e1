"""A draw of the in-flight calibration's Monte Carlo: seconds of one core, beside a plain loop and scipy's `dlsim`.

    nice python benchmarks/inflight_speed.py [--turns 5] [--orbits 2]

Sixteen draws fly a stretch of one session in lock step and are reduced to the lines of both estimates; what that
takes is scaled to the 140 orbits of all ten sessions, with the time to settle before each. The plain loop
(benchmarks/inflight_plain.py) and scipy.signal.dlsim with the loop's linear part do a short stretch of the same, one
draw at a time. Times are of the processor: the machine may have other things to do. Compilation is not counted, nor
are the sessions' weights, which a study makes once for all of its draws. Those of the longest session are made at the
end, for the memory it takes.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import resource
import statistics
import sys
import time
from collections.abc import Callable

import numpy as np
from scipy import signal

from benchmarks.inflight_plain import PlainSatellite, State
from benchmarks.machine import conditions
from procedures.inflight.monte_carlo import Unit, reduce_unit
from procedures.inflight.tables import MonteCarlo
from rigctl.core.arrays import FloatArray
from rigctl.experiments.inflight.result.draws import weights_of
from simulators.worlds.satellite.ensemble import Ensemble
from simulators.worlds.satellite.forcing import Command
from simulators.worlds.satellite.instrument import drawn
from simulators.worlds.satellite.settings import SatelliteSettings
from simulators.worlds.satellite.simulation import Simulation

ORBIT_S, STEP_S, SETTLE_S = 5950.0, 0.25, 6000.0
STEPS_OF_A_DRAW = round((140 * ORBIT_S + 11 * SETTLE_S) / STEP_S)
TARGET_S, TARGET_MB = 1.2, 500.0
PLAIN_STEPS, LINEAR_STEPS = 600, 4000
NATURE = SatelliteSettings(kind="drag-free-satellite", seed=1)


def processor_s(action: Callable[[], object]) -> float:
    began = time.process_time()
    action()
    return time.process_time() - began


def plain(satellite: PlainSatellite, noise: FloatArray) -> None:
    state = State()
    for k, drawn_noise in enumerate(noise):
        satellite.step(state, STEP_S * k, drawn_noise)


def linear_part(satellite: PlainSatellite) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, float]:
    """State space of the loop about rest, by differences: inputs are the noises, outputs the telemetry."""

    def step(flat: FloatArray, noise: FloatArray) -> tuple[FloatArray, FloatArray]:
        state = State.of(flat)
        out = satellite.step(state, 0.0, noise)
        return state.flat(), out

    rest, quiet = State().flat(), np.zeros(18)
    after, out = step(rest, quiet)
    size = 1e-9
    by_state = [step(rest + size * unit, quiet) for unit in np.eye(len(rest))]
    by_noise = [step(rest, size * unit) for unit in np.eye(18)]
    a, c = (np.stack([(both[i] - (after, out)[i]) / size for both in by_state], axis=1) for i in (0, 1))
    b, d = (np.stack([(both[i] - (after, out)[i]) / size for both in by_noise], axis=1) for i in (0, 1))
    return a, b, c, d, STEP_S


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--orbits", type=float, default=2.0)
    asked = parser.parse_args()
    print(conditions())
    study = MonteCarlo(name="monte-carlo", orbits=asked.orbits)
    ensemble = Ensemble(NATURE)
    unit = Unit(ensemble, study, ORBIT_S, "ac13", 5, tuple(range(ensemble.at_once)))
    steps = round((asked.orbits * ORBIT_S + SETTLE_S) / STEP_S)
    weights_s = processor_s(lambda: weights_of(unit.flown))
    reduce_unit(unit)

    command = Command(round(asked.orbits * ORBIT_S / STEP_S))
    noise = np.random.default_rng(1).standard_normal((PLAIN_STEPS, 18)) * 1e-9
    satellite = PlainSatellite(NATURE, drawn(NATURE, 0), command)
    system, driven = linear_part(satellite), np.random.default_rng(1).standard_normal((LINEAR_STEPS, 18)) * 1e-9

    def simulate() -> None:
        simulation = Simulation(NATURE, unit.draws, 5, command)
        while simulation.taken < command.samples:
            simulation.take(1024)

    lanes = len(unit.draws)
    actions: dict[str, tuple[Callable[[], object], float]] = {
        "ours": (lambda: reduce_unit(unit), steps * lanes),
        "simulated only": (simulate, steps * lanes),
        "plain loop": (lambda: plain(satellite, noise), PLAIN_STEPS),
        "scipy dlsim": (lambda: signal.dlsim(system, driven), LINEAR_STEPS),
    }
    taken: dict[str, list[float]] = {name: [] for name in actions}
    for _ in range(asked.turns):
        for name, (action, count) in actions.items():
            taken[name].append(processor_s(action) / count)
    median = {name: statistics.median(each) for name, each in taken.items()}
    print(f"a step of a draw; a draw of {STEPS_OF_A_DRAW} steps; ours that many times faster")
    for name, step_s in median.items():
        draw_s = step_s * STEPS_OF_A_DRAW
        ratio = "" if name in {"ours", "simulated only"} else f"  {step_s / median['ours']:7.0f}"
        print(f"  {name:<16} {1e9 * step_s:10.1f} ns {draw_s:10.2f} s{ratio}")
    longest = Unit(ensemble, MonteCarlo(name="monte-carlo"), ORBIT_S, "ac12", 4, (0,)).flown
    longest_s = processor_s(lambda: weights_of(longest))
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024.0 / 1e6
    draw_s = median["ours"] * STEPS_OF_A_DRAW
    print(f"  weights of the lines: {weights_s:.2f} s for this stretch, {longest_s:.2f} s for forty orbits")
    missed = draw_s > TARGET_S or peak_mb >= TARGET_MB
    verdict = "  MISSED" if missed else ""
    print(f"  {draw_s:.2f} s of one core per draw, <= {TARGET_S:g}; {peak_mb:.0f} MB, < {TARGET_MB:g}{verdict}")
    sys.exit(missed)


if __name__ == "__main__":
    main()
