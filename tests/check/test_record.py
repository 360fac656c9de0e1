"""The record of a check: what is in it, and what `run` makes of it."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest

from rigctl.campaign.bundle.recording_toml import header_to_toml
from rigctl.campaign.session.operator import Operator
from rigctl.campaign.store.store import Store
from rigctl.check import record, required
from rigctl.check.required import Clearance, clearance_of
from rigctl.core.errors import DataError, NotChecked
from rigctl.core.findings import differs, ok
from rigctl.core.interfaces import Identity
from rigctl.files.rig_file import RigFile, parse_rig, read_rig
from tests.check.conftest import FASTER

AT_A_PORT = ('address = "sim:"                  # tcp://192.168.0.254:5001', 'address = "tcp://192.0.2.7:5001"')


@pytest.fixture
def file(campaigns: Path) -> RigFile:
    """The shipped rig with a rotation stage at an address where nobody simulates."""
    return parse_rig((campaigns / "isa-rig.toml").read_text().replace(*AT_A_PORT, 1), Path("rig.toml"))


def kept_for(file: RigFile, *lines: record.Line, **changes: Any) -> record.CheckRecord:
    """A record of these lines, kept."""
    made = record.CheckRecord(
        rig=file.rig.name,
        instruments_sha256=record.instruments_sha256(file),
        checked=record.utc_now(),
        identities={"rotation": record.Who(model="XPS-C8", serial="", firmware="V2.6.2")},
        lines=list(lines),
        **changes,
    )
    record.keep(made)
    return made


def test_a_run_asks_for_a_check_and_keeps_its_record(
    desk: Any, real_rig: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Operator, "remount", interrupted)
    rig = real_rig(FASTER)
    desk.run("--rig", rig).refused(1, "rotation, stage, lasers_a", "not checked", "rigctl check", "--unchecked")
    assert not desk.store.exists()

    checked = desk.rigctl("check", rig, "--json").json
    assert desk.run("--rig", rig).status == 130
    with Store.open(desk.store, readonly=True) as store:
        kept = store.header.extra["check"]["record"]
        assert tomllib.loads(header_to_toml(store.header))["check"]["record"] == kept, "a bundle takes it along"
    assert kept["instruments_sha256"] == checked["instruments_sha256"]
    assert kept["identities"]["accelerometer"]["serial"] == "MY12345678"
    assert json.loads(Path(checked["record"]).read_text()) == kept

    text = rig.read_text()
    rig.write_text(text.replace("angle_min_deg = -170.0", "angle_min_deg = -160.0"))
    other = desk.directory / "other.rig.sqlite"
    desk.rigctl("run", "campaign.toml", "--rig", rig, "--store", other, "--yes").refused(1, "not checked")
    unchecked = desk.rigctl("run", "campaign.toml", "--rig", rig, "--store", other, "--yes", "--unchecked")
    assert unchecked.status == 130
    with Store.open(other, readonly=True) as store:
        assert store.header.extra["check"] == {"unchecked": True}


def test_simulated_instruments_need_no_check(desk: Any, campaigns: Path) -> None:
    assert clearance_of(read_rig(campaigns / "isa-rig.toml"), unchecked=False).kept() == {}
    with desk.process("simulate", "rig.toml", "--write-rig", "client.toml") as process:
        desk.until((desk.directory / "client.toml").exists, process)
        assert required.real_instruments(read_rig(desk.directory / "client.toml")) == ()
        process.terminate()
    # Who has ended simulates nothing: something else may answer there now.
    assert "stage" in required.real_instruments(read_rig(desk.directory / "client.toml"))


def test_a_certificate_that_no_budget_reads_is_told(desk: Any) -> None:
    rig = desk.rig(("[certificates.accel_v]", "[certificates.accelerometer]"))
    findings = desk.rigctl("check", rig, "--json").json["findings"]
    (told,) = [each for each in findings if each["item"] == "certificates"]
    assert told["outcome"] == "unknown"
    assert told["found"].endswith("certificates.accelerometer.uncertainty: no budget reads it")


def test_what_differed_has_to_be_mended_first(file: RigFile) -> None:
    kept_for(file, record.Line.of("rotation", differs("limits", "travel", "-10 to 10 deg", "widen it")))
    with pytest.raises(NotChecked, match=r"rotation differed \(limits, travel: -10 to 10 deg\); mend it"):
        clearance_of(file, unchecked=False).require()
    assert clearance_of(file, unchecked=True).kept()["check"]["unchecked"] is True


def test_another_instrument_than_at_the_check_is_refused(file: RigFile) -> None:
    kept_for(file, record.Line.of("rotation", ok("found", "address", "there")))
    clearance = clearance_of(file, unchecked=False)
    clearance.require()
    clearance.require_same({"rotation": Identity("XPS-C8", "", "V2.6.2", "in other words")})
    with pytest.raises(NotChecked, match=r"rotation is XPS-C8, V3, at the check it was XPS-C8, V2\.6\.2"):
        clearance.require_same({"rotation": Identity("XPS-C8", "", "V3", "")})
    Clearance(file, clearance.record, clearance.real, unchecked=True).require_same({})


def test_remarks_are_no_other_instruments_but_keys_are(file: RigFile) -> None:
    def sha256(old: str, new: str) -> str:
        assert old in file.text
        return record.instruments_sha256(parse_rig(file.text.replace(old, new, 1), Path("rig.toml")))

    same = record.instruments_sha256(file)
    assert sha256('role = "rotation"', '# remounted in May\nrole = "rotation"') == same
    assert sha256("tilt_deg = 5.0", "tilt_deg = 6.0") == same, "lasers' places are no instruments"
    assert sha256("angle_max_deg = 170.0", "angle_max_deg = 160.0") != same


def test_what_motion_told_is_kept_by_a_later_check_that_moves_nothing(file: RigFile) -> None:
    moved = record.Line.of("stage", ok("motion", "oscillate_distance", "0 to 1 mm"), "2026-01-01T00:00:00+00:00")
    earlier = kept_for(file, moved, learned={"stage": {"oscillate_distance": "amplitude"}})
    later = kept_for(file, record.Line.of("rotation", ok("found", "address", "there")))
    going_on = later.going_on(earlier, set())
    assert going_on.lines[-1] == moved
    assert going_on.learned == earlier.learned
    assert later.going_on(earlier, {"motion"}).lines == later.lines, "it was moved again"
    swapped = later.model_copy(update={"identities": {}})
    assert swapped.going_on(earlier, set()) == swapped, "of another instrument nothing is known"


def test_what_motion_told_counts_where_the_rig_file_says_nothing(file: RigFile) -> None:
    learned = {"stage": {"oscillate_distance": "peak-to-peak"}, "gone": {"key": "value"}}
    assert record.with_learned(file, learned).instruments["stage"].settings["oscillate_distance"] == "amplitude"
    silent = parse_rig(file.text.replace('oscillate_distance = "amplitude"', "", 1), Path("rig.toml"))
    informed = record.with_learned(silent, learned)
    assert informed.instruments["stage"].settings["oscillate_distance"] == "peak-to-peak"
    assert informed.text == silent.text


def test_a_damaged_record_is_named(file: RigFile) -> None:
    path = record.keep(kept_for(file))
    path.write_text("{}")
    with pytest.raises(DataError, match=r"checks/\w+\.json: it is no record of a check"):
        clearance_of(file, unchecked=False)
    path.unlink()


def test_a_record_that_cannot_be_kept_is_named(desk: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    (desk.directory / "file").write_text("")
    monkeypatch.setenv("XDG_DATA_HOME", str(desk.directory / "file"))
    failed = desk.rigctl("check", "rig.toml")
    assert failed.status == 2
    assert "cannot be written" in failed.err
    assert len(failed.err.splitlines()) == 1
