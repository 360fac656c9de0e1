"""The rehearsal of docs/hardware.md: six things are wrong with a rig, and one check names each with its mend."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

Findings = list[dict[str, Any]]

OLD = "A.02.14-02.40-02.14-00.49-02-01"
TABLES = f"""\
[instruments.rotation.simulator]
unit = 9

[instruments.lasers.faults]
missing_edges = {{ at_s = 0.0, lasting_s = 1e6, share = 0.8 }}

[instruments.accelerometer.simulator]
firmware = "{OLD}"

"""
AT_THE_INSTRUMENTS = (
    ('clock = "virtual"', 'clock = "virtual"\nclock_speed = 20.0'),
    ("[world]\n", "[world]\nremount_s = 0.0\n"),
    ("integer_registers = 50010", "position_max_mm = 20.0\ninteger_registers = 50010"),
    ("[lasers.laser_main_mm]", f"{TABLES}[lasers.laser_main_mm]"),
)
IN_THE_FILE = (
    ("baud=19200", "baud=921600&rtscts=1"),
    ("laser_main_mm = 1, laser_side_mm = 2", "laser_main_mm = 2, laser_side_mm = 1"),
)


@pytest.fixture
def wrong_rig(real_rig: Any) -> Path:
    """A rig file in which unit, limit, edges and firmware differ at the instruments, rate and heads in the file."""
    rig: Path = real_rig(*AT_THE_INSTRUMENTS, of="one-axis.rig.toml")
    text = rig.read_text()
    for old, new in IN_THE_FILE:
        assert old in text
        text = text.replace(old, new)
    rig.write_text(text)
    return rig


def test_six_wrong_things_are_named_with_their_mends_in_one_check(desk: Any, wrong_rig: Path) -> None:
    checked = desk.rigctl("check", wrong_rig, "--trigger", "--move", "--json")
    assert checked.status == 1
    differing = [line for line in checked.json["findings"] if line["outcome"] == "differs"]
    # How late an edge is, at twenty times the clock's speed, depends on what else the computer does.
    differing = [line for line in differing if line["item"] != "delay"]
    assert {(line["instrument"], line["step"], line["item"]) for line in differing} == {
        ("rotation", "found", "address"),
        ("rotation", "capability", "unit"),
        ("rotation", "motion", "homing"),
        ("stage", "limits", "travel"),
        ("lasers", "trigger", "edges"),
        ("lasers", "motion", "heads"),
        ("accelerometer", "identity", "firmware"),
    }
    baud = line_of(differing, "found")
    assert "it answers at 19200 baud" in baud["found"]
    assert re.search(r'write address = "serial:/dev/pts/\d+\?baud=19200&rtscts=1"', baud["mend"])
    unit = line_of(differing, "capability")
    assert "counts in rad, not in deg" in unit["found"]
    assert "1SN7" in unit["mend"]
    limit = line_of(differing, "limits")
    assert limit["rig_file"] == {"position_min_mm": -25.0, "position_max_mm": 20.0}
    assert "position_max_mm = 20" in limit["mend"]
    edges = line_of(differing, "trigger")
    assert re.search(r"[0-9] of 10 trigger edges came", edges["found"])
    assert "the wire to the TIMING input" in edges["mend"]
    heads = next(line for line in differing if line["item"] == "heads")
    assert "the two are exchanged" in heads["found"]
    assert "exchange laser_main_mm and laser_side_mm" in heads["mend"]
    firmware = line_of(differing, "identity")
    assert OLD in firmware["found"]
    assert "update it" in firmware["mend"]
    assert all(line["mend"] for line in differing)
    told = checked.err.splitlines()[-1]
    assert all(line["found"] in told for line in differing), "and all of it in the one line that ends it"


def line_of(lines: Findings, step: str) -> dict[str, Any]:
    return next(line for line in lines if line["step"] == step)
