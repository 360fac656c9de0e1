"""A drafted effect: its parameters have the units of what they multiply."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from rigctl.campaign.bundle.bundle import import_bundle
from rigctl.composition import opened_workbench
from rigctl.effects.plugins import load
from rigctl.workbench.draft import drafted
from rigctl.workbench.findings import Unexplained

TABLE = """\
format = 1
experiment = "table"
[table]
response = "reading_mv"
baseline = "b0 + b1 * load_n"
"""


def test_what_is_added_to_a_tables_response_has_its_unit(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    load_n, temp_k = rng.uniform(0.0, 10.0, (2, 40))
    reading_mv = 2.0 * load_n + 0.5 * temp_k + rng.normal(0.0, 0.1, 40)
    bundle, store, plugin = tmp_path / "bundle", tmp_path / "a.rig.sqlite", tmp_path / "drafted.py"
    bundle.mkdir()
    (bundle / "recording.toml").write_text(TABLE)
    rows = "\n".join(",".join(map(repr, row)) for row in np.stack([reading_mv, load_n, temp_k], axis=1).tolist())
    (bundle / "readings.csv").write_text(f"reading_mv,load_n,temp_k\n{rows}\n")
    import_bundle(bundle, store).close()
    described = Unexplained("reading_mv", "", "with temp_k", 1e-9, {"covariate": "temp_k", "harmonic_of_angle": 0})
    with opened_workbench(store) as bench:
        found = replace(bench.diagnose(), suggested=(), unexplained=described)
        plugin.write_text(drafted(bench, found))
    (effect,) = load(plugin).effects.values()
    assert list(effect.parameters.values()) == ["mV/K"]
