"""A session of the test of the equivalence principle, 120 orbits at 4 Hz: seconds of one core from samples to delta.

    nice python benchmarks/mission.py [--orbits 120] [--session ep_spin]

One satellite's session is simulated, which is not counted; then pulses are looked for, all series are fitted with
weights, and delta is corrected, as for `rigctl result`. Beside it, a plain way: one design matrix of the same columns
for numpy's `lstsq`, all samples at once, on eight orbits and scaled, without weights or pulses. Times are of the
processor.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import resource
import sys
import time
from collections.abc import Callable

import numpy as np

from benchmarks.machine import conditions
from rigctl.core.arrays import FloatArray
from rigctl.core.satellites import FlightSession
from rigctl.experiments.inflight.model.parameters import SHARED
from rigctl.experiments.inflight.observe.equivalence import GRAVITY, TestRun, known_lines, reduce_test
from rigctl.experiments.inflight.observe.series import NEEDED
from rigctl.experiments.inflight.observe.waves import templates
from rigctl.experiments.inflight.result.equivalence import ALIKE, calibrated_of, equivalence
from simulators.worlds.satellite.ensemble import Ensemble
from simulators.worlds.satellite.settings import SatelliteSettings

ORBIT_S, SPIN_HZ, PLAIN_ORBITS = 5950.0, 17.5 / 5950.0, 8.0
TARGET_S = 20.0
NATURE = SatelliteSettings(kind="drag-free-satellite", seed=1)
USED = (*NEEDED, *GRAVITY, "att_x", "att_y")


def recorded(session: str, orbits: float) -> dict[str, FloatArray]:
    """The columns that are used, of one satellite."""
    ensemble = Ensemble(NATURE)
    places = [ensemble.columns.index(name) for name in USED]
    asked = FlightSession(orbits * ORBIT_S, spin_hz=SPIN_HZ if session == "ep_spin" else 0.0)
    count = round(asked.duration_s / ensemble.sample_period_s)
    kept, at = np.empty((len(USED), count)), 0
    for chunk in ensemble.telemetry((0,), 1, asked, 4096):
        kept[:, at : at + len(chunk)] = chunk[:, places, 0].T
        at += len(chunk)
    return {"t_s": ensemble.sample_period_s * np.arange(count), **dict(zip(USED, kept, strict=True))}


def processor_s(action: Callable[[], object]) -> float:
    began = time.process_time()
    action()
    return time.process_time() - began


def plain(samples: dict[str, FloatArray], run: TestRun) -> None:
    """The same columns as one matrix."""
    t_s = samples["t_s"]
    x = t_s / t_s[-1]
    lines_hz = [*(wave / t_s[-1] for wave in (1, 2, 3)), *known_lines(run.session, t_s[-1]), *run.beside_hz]
    design = np.vstack([*(samples[name] for name in GRAVITY), np.ones_like(x), x, x**2, templates(t_s, lines_hz)])
    np.linalg.lstsq(design.T, np.stack([samples[name] for name in NEEDED], axis=1), rcond=None)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--orbits", type=float, default=120.0)
    parser.add_argument("--session", choices=["ep_inertial", "ep_spin"], default="ep_spin")
    asked = parser.parse_args()
    print(conditions())
    samples = recorded(asked.session, asked.orbits)
    told = {"session": asked.session, "spin_frequency_hz": SPIN_HZ}
    found: list[TestRun] = []

    def ours() -> None:
        run = reduce_test("1", told, samples, ORBIT_S)
        equivalence([run], calibrated_of(ALIKE, np.zeros((SHARED, SHARED)), {}))
        found.append(run)

    ours_s = processor_s(ours)
    part = {name: column[: round(PLAIN_ORBITS * ORBIT_S * 4)] for name, column in samples.items()}
    short = reduce_test("1", told, part, ORBIT_S)
    plain_s = processor_s(lambda: plain(part, short)) * asked.orbits / PLAIN_ORBITS
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024.0 / 1e6
    held_mb = sum(column.nbytes for column in samples.values()) / 1e6
    missed = ours_s > TARGET_S
    print(f"  {asked.session}, {asked.orbits:g} orbits, {len(samples['t_s'])} samples, pulses {found[0].pulses}")
    print(f"  plain least squares {plain_s:6.1f} s; ours {ours_s / plain_s:.2f} of it")
    print(f"  {ours_s:6.1f} s, <= {TARGET_S:g}; {peak_mb:.0f} MB, the samples {held_mb:.0f}" + "  MISSED" * missed)
    sys.exit(missed)


if __name__ == "__main__":
    main()
