"""What a dry run promises: rig time, and what will be known of the null."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from procedures.sensing_axis.campaign import plan as plan_of
from procedures.sensing_axis.forecast import theta0_sigma_arcsec
from procedures.sensing_axis.wiring import bench_of
from rigctl import runner
from rigctl.files.campaign_file import read_campaign
from rigctl.files.rig_file import read_rig
from rigctl.rig import Rig

CAMPAIGNS = Path(__file__).parent.parent / "campaigns"


def told(name: str, **changes: Any) -> dict[str, Any]:
    campaign = read_campaign(CAMPAIGNS / name)
    changed = campaign.model_copy(update={"procedure": {**campaign.procedure, **changes}})
    return runner.dry_run(changed, read_rig(campaign.rig_path))


@pytest.mark.parametrize("name", ["angle-scan.toml", "hidden-effect.toml"])
def test_four_times_the_time_at_each_point_halves_the_sigma(name: str) -> None:
    short, long = told(name, dwell_s=20.0), told(name, dwell_s=80.0)
    # Priors (of the damping, of delta) hold less when the runs say more.
    assert short["theta0_sigma_arcsec"] / long["theta0_sigma_arcsec"] == pytest.approx(2.0, rel=0.05)
    assert long["rig_time_s"] - short["rig_time_s"] == pytest.approx(60.0 * short["runs_planned"], abs=1.0)


def test_runs_that_do_not_determine_the_null_promise_nothing() -> None:
    assert told("hidden-effect.toml", frequencies_hz=[0.5], angles_deg=[1.0])["theta0_sigma_arcsec"] is None


@pytest.mark.parametrize("target_arcsec", [1.0, 4.0])
def test_the_durations_planned_for_a_null_search_reach_its_target(target_arcsec: float) -> None:
    """The same runs as a list, in noise as assumed of a room before anything is measured (3e-6 m/s2/rtHz)."""
    campaign = read_campaign(CAMPAIGNS / "one-axis.toml")
    targets = {"theta0_sigma_arcsec": target_arcsec, "noise_m_s2_rthz": 3e-6}
    plan = plan_of(campaign.model_copy(update={"targets": targets}))
    bench = bench_of(Rig(read_rig(campaign.rig_path)))
    first = [point for point in plan.points if point.mounting == 1]
    sensor = bench.package.axes[first[0].axis].sensor[first[0].configuration]
    noise_v = 3e-4 / sensor.gain_v_per_m_s2 / 3e-6
    runs = [
        {
            "theta_deg": 0.0,
            "frequency_hz": point.frequency_hz,
            "amplitude_mm": point.amplitude_mm,
            "dwell_s": point.dwell_s * noise_v**2,
        }
        for point in first
    ]
    as_list = {
        "name": "scan",
        "axes": [first[0].axis],
        "configurations": [first[0].configuration],
        "sample_rate_hz": first[0].sample_rate_hz,
        "runs": runs,
    }
    listed = plan_of(campaign.model_copy(update={"procedure": as_list, "targets": {}}))
    assert len(listed.points) == len(first)
    sigma = theta0_sigma_arcsec(bench, listed.points, plan.effects)
    assert sigma is not None
    assert sigma <= target_arcsec
    assert sigma == pytest.approx(target_arcsec, rel=0.15)
