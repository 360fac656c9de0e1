"""The shipped hidden-effect campaign: 48 runs of one mounting, and a nature that its model does not know."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl import runner
from rigctl.campaign.status import status_of
from rigctl.campaign.store.store import Store
from rigctl.files.campaign_file import read_campaign
from rigctl.files.rig_file import read_rig


@pytest.mark.parametrize(("name", "with_lasers"), [("hidden-effect", 24), ("hidden-effect-near", 48)])
def test_all_48_runs_of_the_scan_are_made_and_good(
    tmp_path: Path, campaigns: Path, name: str, with_lasers: int
) -> None:
    campaign = read_campaign(campaigns / f"{name}.toml")
    store_path = tmp_path / "x.rig.sqlite"
    runner.start(campaign, read_rig(campaign.rig_path), store_path, runner.Options(unattended=True))
    assert status_of(store_path)["state"] == "done"
    with Store.open(store_path, readonly=True) as store:
        runs = store.runs(valid_only=True)
        seen = [run for run in runs if "laser_1_mm" in store.samples(run.run_id)]
    assert len(runs) == 48
    assert len(seen) == with_lasers
    assert {run.conditions["mounting"] for run in runs} == {1}
    assert sum(run.conditions["approach"] for run in runs) == 0
    assert len({(run.conditions["theta_asked_deg"], run.conditions["frequency_hz"]) for run in runs}) == 24


def test_what_is_hidden_is_in_the_rigs_world_and_not_in_the_model(campaigns: Path) -> None:
    campaign = read_campaign(campaigns / "hidden-effect.toml")
    world = read_rig(campaign.rig_path).world
    assert world is not None
    assert set(campaign.model.effects) == {"roll-gravity", "resonance"}
    assert set(world["effects"]) - set(campaign.model.effects) == {"cable-hysteresis", "quadratic"}
