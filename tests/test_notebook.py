"""The Python front door does what the commands do."""

from __future__ import annotations

from pathlib import Path

import pytest

import rigctl

CAMPAIGNS = Path(__file__).parents[1] / "campaigns"


def test_a_rig_is_opened_moved_and_left_safe() -> None:
    with rigctl.Rig.from_file(CAMPAIGNS / "isa-rig.toml") as rig:
        rotation = rig.only("rotation")
        rotation.home()
        rotation.move_to(3.0)
        assert rotation.angle().value == pytest.approx(3.0, abs=1e-4)
    with pytest.raises(rigctl.RigError):
        rotation.angle()


def test_a_campaign_runs_and_its_store_gives_the_same_result_again(tmp_path: Path) -> None:
    campaign = rigctl.Campaign(CAMPAIGNS / "one-axis.toml")
    assert campaign.dry_run()["runs_planned"] > 0
    store = tmp_path / "one.rig.sqlite"
    result = campaign.run(store, unattended=True, seed=3)
    assert campaign.status(store)["state"] == "done"
    again = rigctl.Campaign.result(store)
    assert again.as_json() == result.as_json()
    assert result.fit.result.verdict == "converged"


def test_an_unknown_name_is_no_part_of_the_package() -> None:
    with pytest.raises(AttributeError, match="nonsense"):
        _ = rigctl.nonsense
