"""Readings of three lots cannot tell a lot's offset from what else differs between the lots; this is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rigctl.campaign.bundle.bundle import import_bundle
from rigctl.composition import opened_workbench
from rigctl.report.verdicts import inseparable_sentences
from rigctl.workbench.findings import Diagnosis

READINGS_OF_A_LOT = 10


def _diagnosed(place: Path, lots: int) -> Diagnosis:
    rng = np.random.default_rng(8)
    lot = np.repeat(np.arange(lots), READINGS_OF_A_LOT)
    load_n = rng.uniform(0.0, 10.0, lot.size)
    humidity = rng.uniform(30.0, 60.0, lots)[lot]
    volts = 1.0 + 0.2 * load_n + rng.normal(0.0, 0.3, lots)[lot] + rng.normal(0.0, 0.1, lot.size)
    bundle = place / "lots"
    bundle.mkdir()
    (bundle / "recording.toml").write_text(
        'format = 1\nexperiment = "table"\n[table]\nresponse = "out_v"\nbaseline = "b0 + b1 * load_n"\n'
        'batch = ["lot"]\n'
    )
    rows = np.column_stack([volts, load_n, humidity, rng.uniform(0.0, 1.0, lot.size), lot])
    header = "out_v,load_n,humidity_percent,other_k,lot"
    np.savetxt(bundle / "readings.csv", rows, delimiter=",", header=header, comments="", fmt="%.12g")
    store = place / "lots.rig.sqlite"
    import_bundle(bundle, store).close()
    with opened_workbench(store) as bench:
        return bench.diagnose()


@pytest.mark.parametrize(("lots", "said"), [(3, True), (8, False)])
def test_an_effect_between_few_lots_cannot_be_told_from_their_offsets(tmp_path: Path, lots: int, said: bool) -> None:
    found = _diagnosed(tmp_path, lots)
    beside = {each.effect for each in found.inseparable if each.other == "offset:lot"}
    assert ("linear[humidity_percent]" in beside) is said
    assert "linear[other_k]" not in beside
    assert "linear[humidity_percent]" not in {term.effect for term in found.suggested}
    sentences = inseparable_sentences([each.as_json() for each in found.inseparable])
    told = "linear[humidity_percent] cannot be told from the offsets that readings of one lot share (3 of them"
    assert any(told in sentence for sentence in sentences) is said
