"""A check meets every reading of the manual and every fault of a wire: a line for it, and never more than that."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from rigctl.check import guide
from rigctl.check.guide import Checked, Wanted
from rigctl.files.rig_file import parse_rig
from simulators.aerotech_ensemble import GENTLE

STAGE = "integer_registers = 50010           # GlobalIntegers, raised by the operator: a record has one each\n"
DISTANCE = 'oscillate_distance = "amplitude"   # of this controller; on yours a millimetre tells: docs/hardware.md\n'
EVERYTHING = Wanted(trigger=True, interlocks=True, move=True)
Check = Callable[[str, str], Checked]


@pytest.fixture
def check(campaigns: Path) -> Check:
    """A check of the shipped rig, its stage and others changed."""

    def checked(stage: str, others: str = "") -> Checked:
        text = (campaigns / "isa-rig.toml").read_text()
        for old, new in (
            (STAGE, STAGE + stage),
            (DISTANCE, ""),
            ("[lasers.laser_1_mm]", f"{others}\n[lasers.laser_1_mm]"),
        ):
            assert old in text
            text = text.replace(old, new, 1)
        return guide.check(parse_rig(text, Path("rig.toml")), EVERYTHING)

    return checked


def dialect(**switches: object) -> str:
    return f"dialect = {{ {', '.join(f'{key} = {json.dumps(value)}' for key, value in switches.items())} }}\n"


@pytest.mark.parametrize("switch", GENTLE.model_dump())
def test_the_distance_is_learned_however_the_controller_reads_the_manual(check: Check, switch: str) -> None:
    value = GENTLE.model_dump()[switch]
    checked = check(dialect(**{switch: value}), "")
    assert checked.record.differing == []
    means = "peak-to-peak" if value == "peak-to-peak" else "amplitude"
    assert checked.record.learned == {"stage": {"oscillate_distance": means}}


def test_by_ascii_commands_alone_two_things_are_learned(check: Check) -> None:
    checked = check("rigctl_program = false\n" + dialect(**GENTLE.model_dump()), "")
    assert checked.record.differing == []
    assert checked.record.learned == {"stage": {"oscillate_distance": "peak-to-peak", "oscillate_answers": "at once"}}


@pytest.mark.parametrize(
    "fault",
    [
        "silent = { after = 5 }",
        "silent = { probability = 0.05 }",
        "garbage = { probability = 0.1 }",
        "truncated = { probability = 0.1 }",
        "duplicated = { probability = 0.1 }",
        "disconnect = { probability = 0.05 }",
    ],
)
@pytest.mark.parametrize("name", ["rotation", "stage", "lasers_a", "accelerometer"])
def test_whatever_befalls_a_wire_the_record_says_so(check: Check, name: str, fault: str) -> None:
    checked = check("", f"[instruments.{name}.faults]\nseed = 3\n{fault}\n")
    assert checked.path.exists()
    assert {line.instrument for line in checked.record.differing} <= {name, ""}
    others = {line.instrument for line in checked.record.lines} - {name, ""}
    assert len(others) == len(checked.record.identities.keys() - {name}) == 5, "the others are asked all the same"
    if "after" in fault:
        assert checked.record.differing
