"""Slow noise goes through a scan and whatever is measured after it: the same, whichever runs these are."""

from __future__ import annotations

from pathlib import Path

from benchmarks.blind_courses import TERMS, Rig, noisy
from rigctl.campaign.store.store import Store
from rigctl.composition import study_of
from tests.flag_scan import SCAN


def test_noise_goes_on_from_the_scan_as_it_was(tmp_path: Path) -> None:
    rig = Rig(tmp_path, {}, campaign=SCAN.replace("dwell_s = 6.0", "dwell_s = 20.0"))
    with Store.open(rig.scan, readonly=True) as store:
        study = study_of(store)
        runs = next(each.runs for each in noisy(study, "flicker", 1).courses() if each.kind == "more of the same")
        before = noisy(study, "flicker", 1).model(TERMS).observations.value
    with Store.open(rig.with_runs(runs), readonly=True) as store:
        after = noisy(study_of(store), "flicker", 1).model(TERMS).observations
    of_scan = after.run_of < len(after.run_ids) - len(runs)
    assert (after.value[of_scan] == before).all()
