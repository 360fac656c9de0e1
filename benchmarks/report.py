"""Processor time of a report, and its size, beside what it cannot do without: its fits and its diagnosis.

    python benchmarks/report.py [STORE...]

Without stores: two examples, imported, and a line through 3000 readings. Stores are copied. A first report of a
store that keeps no fit and no diagnosis makes both; again, it uses them. Each is a process of its own, on one core; a
report and its floor both begin with the program's start.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.machine import conditions
from benchmarks.processes import ROOT, python, rigctl
from rigctl.campaign.bundle.bundle import import_bundle

EXAMPLES = ("pontius", "unknown-effect")
MAX_RATIO, MAX_BYTES = 1.5, 5_000_000
ROWS = 3000

FLOOR = """
import sys
from pathlib import Path
from rigctl.composition import opened_workbench
from rigctl.core.errors import UNFIT
with opened_workbench(Path(sys.argv[1]), ()) as bench:
    try:
        bench.history()
        bench.diagnose()
    except UNFIT:
        pass
"""


def main() -> int:
    print(conditions())
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        stores = [Path(each) for each in sys.argv[1:]] or made(place)
        print(f"{'store':24} {'report':>8} {'again':>8} {'floor':>8} {'ratio':>6} {'page':>8}")
        met = [measured(store, place) for store in stores]
    return 0 if all(met) else 1


def measured(store: Path, place: Path) -> bool:
    """Print a store's figures; whether they are within what they should be."""
    copy, page = place / f"copy-{store.name}", place / "report.html"
    shutil.copy(store, copy)
    floor = python("-c", FLOOR, copy).processor_s
    shutil.copy(store, copy)
    first, again = (rigctl("report", copy, "--out", page).processor_s for _ in range(2))
    ratio, size = first / floor, page.stat().st_size
    name = store.name.removesuffix(".rig.sqlite")
    print(f"{name:24} {first:6.1f} s {again:6.1f} s {floor:6.1f} s {ratio:6.2f} {size / 1e6:5.2f} MB", flush=True)
    return ratio <= MAX_RATIO and size <= MAX_BYTES


def made(place: Path) -> list[Path]:
    """Stores of recordings that are at hand."""
    bundles = [ROOT / "examples" / name for name in EXAMPLES]
    line = place / "line"
    line.mkdir()
    header = 'format = 1\nexperiment = "table"\n[table]\nresponse = "y"\nbaseline = "b0 + b1 * x"\n'
    (line / "recording.toml").write_text(header)
    x = np.linspace(0.0, 1.0, ROWS)
    y = 2.0 + 3.0 * x + 1e-3 * np.random.default_rng(1).standard_normal(ROWS)
    rows = "\n".join(f"{a!r},{b!r}" for a, b in zip(x.tolist(), y.tolist(), strict=True))
    (line / "readings.csv").write_text(f"x,y\n{rows}\n")
    stores = []
    for bundle in (*bundles, line):
        stores.append(place / f"{bundle.name}.rig.sqlite")
        import_bundle(bundle, stores[-1]).close()
    return stores


if __name__ == "__main__":
    sys.exit(main())
