"""A scan of one axis in the flag configuration on the rig with hidden effects, small enough for a test."""

from __future__ import annotations

from pathlib import Path

from rigctl import runner
from rigctl.files.campaign_file import parse_campaign
from rigctl.files.rig_file import read_rig

SCAN = """\
experiment = "sensing-axis"
rig = "rig.toml"

[procedure]
name = "scan"
axes = ["X"]
configurations = ["flag"]
angles_deg = [-20.0, -0.8, 0.8, 20.0]
frequencies_hz = [0.3, 0.6]
approaches = [1, -1]
dwell_s = 6.0
"""


def flown(directory: Path, further_world: str = "") -> Path:
    """The store of the scan in `directory`, its rig file beside it with further tables of its world."""
    campaigns = Path(__file__).parents[1] / "campaigns"
    rig = directory / "rig.toml"
    rig.write_text(
        (campaigns / "hidden-effect-rig.toml").read_text(encoding="utf-8") + further_world, encoding="utf-8"
    )
    store = directory / "x.rig.sqlite"
    campaign = parse_campaign(SCAN, directory / "x.toml")
    runner.start(campaign, read_rig(rig), store, runner.Options(unattended=True))
    return store
