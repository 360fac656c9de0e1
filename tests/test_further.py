"""What an experiment would measure next is a campaign that its rig can run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from procedures.tables import Procedure
from rigctl import config, planning, runner
from rigctl.errors import ConfigError
from rigctl.kinds import inflight, rotating_platform
from rigctl.kinds.sensing_axis import scan_of
from rigctl.workbench.study import Proposal

CAMPAIGNS = Path(__file__).parent.parent / "campaigns"
TURN: dict[str, Any] = {"pattern": "c", "modulation_period_s": 60.0, "periods": 3, "v_z_v": 1.5, "v_y_v": 0.0}
POINT: dict[str, Any] = {"angle_deg": -3.0, "frequency_hz": 0.5, "approach": -1, "dwell_s": 20.0, "start_s": 7.0}


def planned(like: config.CampaignFile, procedure: Any) -> tuple[config.CampaignFile, dict[str, Any]]:
    text = planning.text_of(like.experiment, 'Next: "tell apart"', like.rig, procedure, [])
    campaign = config.parse_campaign(text, CAMPAIGNS / "next.toml")
    return campaign, runner.dry_run(campaign, config.read_rig(campaign.rig_path))


def test_a_scan_goes_on_in_its_mounting() -> None:
    like = config.read_campaign(CAMPAIGNS / "hidden-effect.toml")
    settings = config.validated(Procedure, like.procedure, like.path, "procedure")
    campaign, plan = planned(like, scan_of("X", "flag", [Proposal(POINT)] * 2, settings))
    assert campaign.goes_on
    assert plan["runs_planned"] == 2
    assert campaign.title == 'Next: "tell apart"'


def test_patterns_keep_the_guards_of_the_campaign_there_was() -> None:
    like = config.read_campaign(CAMPAIGNS / "bias-rejection.toml")
    campaign, plan = planned(like, rotating_platform.further(None, [Proposal(TURN)] * 3, like))  # type: ignore[arg-type]
    assert plan["runs_planned"] == 3
    assert not campaign.goes_on
    assert campaign.procedure["rejects"] == like.procedure["rejects"]


def test_a_session_is_flown_once_however_often_it_is_proposed() -> None:
    like = config.read_campaign(CAMPAIGNS / "microscope.toml")
    runs = [Proposal({"session": name, "orbits": 10.0}) for name in ("dy", "ac13", "dy")]
    _, plan = planned(like, inflight.further(None, runs, like))  # type: ignore[arg-type]
    assert plan["sessions"] == ["dy", "ac13"]


@pytest.mark.parametrize("name", ["bias-rejection.toml", "microscope.toml"])
def test_an_effect_nobody_knows_is_refused_before_anything_moves(name: str) -> None:
    like = config.read_campaign(CAMPAIGNS / name)
    text = planning.text_of(like.experiment, "", like.rig, like.procedure, ["no-such-effect"])
    with pytest.raises(ConfigError, match="no-such-effect"):
        runner.dry_run(config.parse_campaign(text, CAMPAIGNS / "next.toml"), config.read_rig(like.rig_path))
