"""What an experiment would measure next is a campaign that its rig can run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from procedures.inflight import campaign as inflight
from procedures.inflight.bench import flight_of
from procedures.rotating_platform import campaign as rotating_platform
from procedures.rotating_platform.bias_rejection import Plan
from procedures.rotating_platform.tables import Procedure as PlatformProcedure
from procedures.rotating_platform.wiring import bench_of
from procedures.sensing_axis.runs import scan_of
from procedures.sensing_axis.tables import Procedure
from rigctl import planning, runner
from rigctl.core.errors import ConfigError
from rigctl.files.campaign_file import CampaignFile, ReferenceTable, parse_campaign, read_campaign
from rigctl.files.rig_file import parse_rig, read_rig
from rigctl.files.toml_files import validated
from rigctl.rig import Rig
from rigctl.workbench.study import Proposal

CAMPAIGNS = Path(__file__).parent.parent / "campaigns"
TURN: dict[str, Any] = {"pattern": "c", "modulation_period_s": 60.0, "periods": 3, "v_z_v": 1.5, "v_y_v": 0.0}
POINT: dict[str, Any] = {"theta_deg": -3.0, "frequency_hz": 0.5, "approach": -1, "dwell_s": 20.0, "start_s": 7.0}


def planned(like: CampaignFile, procedure: Any) -> tuple[CampaignFile, dict[str, Any]]:
    text = planning.text_of(like, 'Next: "tell apart"', like.rig, procedure, [])
    campaign = parse_campaign(text, CAMPAIGNS / "next.toml")
    return campaign, runner.dry_run(campaign, read_rig(campaign.rig_path))


def test_a_scan_goes_on_in_its_mounting_and_keeps_what_its_file_says_of_anything_else() -> None:
    reference = ReferenceTable(source="the maker", axes={"X": (1.0, 2e-5, 0.0)}, offset_deg={"X a": -0.5})
    said = {"on_terminal_lost": "stop", "targets": {"noise_m_s2_rthz": 1e-5}, "reference": reference}
    like = read_campaign(CAMPAIGNS / "hidden-effect.toml").model_copy(update=said)
    settings = validated(Procedure, like.procedure, like.path, "procedure")
    campaign, plan = planned(like, scan_of("X", "flag", [Proposal(POINT)] * 2, settings))
    assert campaign.goes_on
    assert {name: getattr(campaign, name) for name in said} == said
    assert plan["runs_planned"] == 2
    assert campaign.title == 'Next: "tell apart"'


def test_patterns_keep_the_guards_of_the_campaign_there_was() -> None:
    like = read_campaign(CAMPAIGNS / "bias-rejection.toml")
    campaign, plan = planned(like, rotating_platform.further(None, [Proposal(TURN)] * 3, like))  # type: ignore[arg-type]
    assert plan["runs_planned"] == 3
    assert not campaign.goes_on
    assert campaign.procedure["rejects"] == like.procedure["rejects"]


@pytest.mark.parametrize(
    ("way", "limits", "possible"),
    [
        ({}, "", True),
        ({"rotation_s": 3.2}, "", True),
        ({"rotation_s": 2.5}, "", False),  # 181 deg/s2, where the rig has 120
        ({"turning": "forward"}, "", False),
        ({"turning": "forward"}, "angle_max_deg = 3000.0", True),
        ({"v_y_v": 3.0}, "", False),
        ({"pattern": "a"}, "", False),  # it does not reject a linear drift, as the campaign wants
    ],
)
def test_what_is_proposed_keeps_to_the_platforms_limits(way: dict[str, Any], limits: str, possible: bool) -> None:
    like = read_campaign(CAMPAIGNS / "bias-rejection.toml")
    text = like.rig_path.read_text().replace("angle_max_deg = 370.0", limits or "angle_max_deg = 370.0")
    settings = validated(PlatformProcedure, like.procedure, like.path, "procedure")
    rig = Rig(parse_rig(text, like.rig_path), reachable=False)
    allowed = rotating_platform.within(bench_of(rig, settings), settings)
    assert allowed(Proposal({**TURN, **way})) is possible


def test_one_run_may_turn_otherwise_than_the_others() -> None:
    like = read_campaign(CAMPAIGNS / "bias-rejection.toml")
    runs = [Proposal(TURN), Proposal({**TURN, "turning": "forward"})]
    asked = rotating_platform.further(None, runs, like)  # type: ignore[arg-type]
    found = Plan(validated(PlatformProcedure, asked, like.path, "procedure")).recordings
    assert [each.conditions["turning"] for each in found] == ["back-and-forth", "forward"]
    back, forward = ([motion.to_deg for motion in each.wanted.table.motions] for each in found)
    assert set(back) == {0.0, 180.0}
    assert set(np.diff(forward)) == {180.0}


def test_a_session_is_flown_once_however_often_it_is_proposed() -> None:
    like = read_campaign(CAMPAIGNS / "microscope.toml")
    runs = [Proposal({"session": name, "orbits": 10.0}) for name in ("dy", "ac13", "dy")]
    _, plan = planned(like, inflight.further(None, runs, like))  # type: ignore[arg-type]
    assert plan["sessions"] == ["dy", "ac13"]


def test_each_session_is_flown_with_the_stimulus_that_is_proposed_for_it() -> None:
    like = read_campaign(CAMPAIGNS / "microscope.toml")
    usual, shifted = 73 / 59500, {"calibration_frequency_hz": 147 / 59500, "phase_rad": 1.5}
    runs = [
        Proposal({"session": "ad11", "orbits": 10.0, "amplitude": 5e-8, "calibration_frequency_hz": usual}),
        Proposal({"session": "ad11", "orbits": 10.0, "amplitude": 5e-8, **shifted}),
        Proposal({"session": "ad11", "orbits": 10.0, "amplitude": 5e-8, **shifted}),
        Proposal({"session": "k2d", "orbits": 10.0, "amplitude": 1e-7}),
        Proposal({"session": "dx", "orbits": 10.0}),
    ]
    campaign, plan = planned(like, inflight.further(None, runs, like))  # type: ignore[arg-type]
    assert plan["sessions"] == ["ad11", "k2d", "dx"]
    asked = inflight.procedure_of(campaign)
    ad11, k2d = asked.stimulus("ad11"), asked.stimulus("k2d")
    assert (ad11.amplitude, ad11.frequency_hz, ad11.phase_rad) == (5e-8, 147 / 59500, 1.5)
    assert (k2d.amplitude, k2d.frequency_hz, k2d.phase_rad) == (1e-7, usual, 0.0)
    assert asked.stimulus("dx").target == "none"


def test_a_stimulus_of_a_session_without_one_is_refused() -> None:
    like = read_campaign(CAMPAIGNS / "microscope.toml")
    with pytest.raises(ConfigError, match="stimuli: session dx injects nothing; leave its stimulus out"):
        inflight.procedure_of(
            like.model_copy(update={"procedure": {**like.procedure, "stimuli": {"dx": {"phase_rad": 1.0}}}})
        )


@pytest.mark.parametrize(
    ("session", "stimulus", "possible"),
    [
        ("k2d", {"amplitude": 1e-7}, True),
        ("k2d", {"amplitude": 3e-7}, False),
        ("k2d", {"calibration_frequency_hz": 8 / 5950}, False),  # a line of the orbit
        ("dy", {"amplitude": 2e-2}, True),
        ("dy", {"amplitude": 3e-2}, False),
        ("dx", {}, True),
    ],
)
def test_what_is_proposed_keeps_to_the_satellites_limits(
    session: str, stimulus: dict[str, float], possible: bool
) -> None:
    like = read_campaign(CAMPAIGNS / "microscope.toml")
    rig = Rig(read_rig(like.rig_path), reachable=False)
    allowed = inflight.within(flight_of(rig), inflight.procedure_of(like))
    assert allowed(Proposal({"session": session, "orbits": 10.0, **stimulus})) is possible


@pytest.mark.parametrize("name", ["bias-rejection.toml", "microscope.toml"])
def test_an_effect_nobody_knows_is_refused_before_anything_moves(name: str) -> None:
    like = read_campaign(CAMPAIGNS / name)
    text = planning.text_of(like, "", like.rig, like.procedure, ["no-such-effect"])
    with pytest.raises(ConfigError, match="no-such-effect"):
        runner.dry_run(parse_campaign(text, CAMPAIGNS / "next.toml"), read_rig(like.rig_path))
