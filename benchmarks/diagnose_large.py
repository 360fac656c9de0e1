"""How long a diagnosis of thousands of runs takes, and how much memory: 5004 runs, six mountings, two hidden effects.

    python benchmarks/diagnose_large.py

Times are of the processor, on one core.
"""

from __future__ import annotations

import os
import resource
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from benchmarks import blind_world
from benchmarks.blind_sampler import Design
from rigctl.campaign.bundle.bundle import import_bundle
from rigctl.composition import study_of
from rigctl.workbench.study import Term
from rigctl.workbench.verdict.diagnose import diagnose

DESIGN = Design(
    axes=("X", "Y", "Z"),
    angles_deg=tuple(float(angle) for angle in np.linspace(-30.0, 30.0, 139).round(3)),
    dwell_s=10.0,
    sample_rate_hz=20.0,
)
SIZED_FOR = Design()
"""Sizes are drawn for this smaller design: in so many runs the two are large."""

MAX_S, MAX_MB = 120.0, 2000.0


def main() -> int:
    drawn = blind_world.draw(5, "two", SIZED_FOR, sigma=(8.0, 14.0))
    made = blind_world.Trial(drawn.nature, DESIGN, drawn.truth)
    with tempfile.TemporaryDirectory() as scratch:
        blind_world.record(made, Path(scratch) / "bundle")
        with import_bundle(Path(scratch) / "bundle", Path(scratch) / "x.rig.sqlite") as store:
            began_s = time.process_time()
            study = study_of(store)
            study.model(())
            print(f"read from what is kept: {time.process_time() - began_s:.1f} s", flush=True)
            began_s = time.process_time()
            found = diagnose(study, (Term("roll-gravity"), Term("resonance")))
            took_s = time.process_time() - began_s
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(f"diagnose: {took_s:.0f} s, peak {peak_mb:.0f} MB; {found.verdict}", end=": ")
    print(", ".join(term.effect for term in found.suggested), f"(hidden: {', '.join(drawn.truth.effects)})")
    return 0 if took_s <= MAX_S and peak_mb <= MAX_MB else 1


if __name__ == "__main__":
    sys.exit(main())
