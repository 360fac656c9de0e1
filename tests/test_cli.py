"""The command line: what is refused is refused in one line, with its status, before anything has moved."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import h5py
import pytest
from pyarrow import parquet
from typer.testing import CliRunner

from rigctl import cli
from rigctl.campaign.recording import Header
from rigctl.campaign.session import locks, requests
from rigctl.campaign.store.store import Store
from rigctl.cli import commands
from rigctl.cli.application import app
from rigctl.core.errors import RigError
from rigctl.experiments.sensing_axis.observe.store_reduction import recipe
from rigctl.files.rig_file import read_rig

FIRST_ADDRESS = 'address = "sim:"                  # tcp://192.168.0.254:5001'


@pytest.fixture
def dead_port() -> int:
    """A TCP port on which nobody listens."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


# Bad input: files

BAD_CAMPAIGNS = [
    (
        ("amplitude_mm = 5.0", "amplitude_m = 0.005"),
        ["campaign.toml", "unknown key procedure.amplitude_m", "amplitude_mm"],
    ),
    (("amplitude_mm = 5.0", 'amplitude_mm = "5 mm"'), ["campaign.toml", "procedure.amplitude_mm", "valid number"]),
    (("mountings = 1", "mountings = 1.5"), ["campaign.toml", "procedure.mountings", "integer"]),
    (("[targets]", "[target]"), ["campaign.toml", "unknown key target", "targets"]),
    (('title = "small"', "title = small"), ["campaign.toml", "not TOML", "line 2"]),
    (('"sensing-axis"', '"sensing axis"'), ["campaign.toml", "experiment", "sensing-axis"]),
    (('"six-mountings"', '"seven-mountings"'), ["campaign.toml", "procedure.name", "six-mountings"]),
    (('axes = ["X"]', 'axes = ["Q"]'), ["campaign.toml", "procedure.axes", "no axis Q", "X, Y, Z"]),
    (('"flag"', '"upright"'), ["campaign.toml", "procedure.configurations", "upright", "pendulum, flag"]),
    (('["roll-gravity", "resonance"]', '["rol-gravity"]'), ["campaign.toml", "model.effects", "roll-gravity"]),
    (('rig = "rig.toml"', 'rig = "absent.toml"'), ["absent.toml", "no such file"]),
    (('rig = "rig.toml"\n', ""), ["campaign.toml", "rig is missing", "--rig"]),
    (
        ("amplitude_mm = 5.0", "amplitude_mm = 26.0\nstart_deg = 0.0"),
        ["campaign.toml", "stage", "26 mm", "travel", "at most 25 mm"],
    ),
    # The highest drive decides, whichever comes first; at 3.6 Hz its third harmonic is at the Nyquist frequency.
    (
        ("amplitude_mm = 5.0", "amplitude_mm = 5.0\nsample_rate_hz = 1.0"),
        ["campaign.toml", "procedure.sample_rate_hz", "1 Hz", "drive of 0.6 Hz", "more than 3.6 Hz"],
    ),
    (
        ("amplitude_mm = 5.0", "amplitude_mm = 5.0\nsample_rate_hz = 3.6"),
        ["campaign.toml", "procedure.sample_rate_hz", "more than 3.6 Hz"],
    ),
    (("[0.3, 0.6]", "[0.3, 6.0]"), ["campaign.toml", "stage", "5 mm at 6 Hz", "acceleration", "at most 0.704 mm"]),
    (
        ("[0.3, 0.6]\namplitude_mm = 5.0", "[1.0, 0.5]\namplitude_mm = 20.0"),
        ["campaign.toml", "stage", "speed", "at most 15.9 mm"],
    ),
    (
        ("amplitude_mm = 5.0", "amplitude_mm = 5.0\nstart_deg = 171.0"),
        ["campaign.toml", "rotation", "171 deg", "170 deg"],
    ),
    (
        ("amplitude_mm = 5.0", "amplitude_mm = 5.0\nstart_deg = -170.0"),
        ["campaign.toml", "rotation", "-169.95 .. 170"],
    ),
    (("amplitude_mm = 5.0", "amplitude_mm = 5.0\nstart_deg = 3.0"), ["campaign.toml", "spot leaves the 15 mm cube"]),
    (
        ("amplitude_mm = 5.0", "amplitude_mm = 7.6"),
        ["campaign.toml", "spot leaves the 15 mm cube", "less angle or amplitude"],
    ),
    (
        ("amplitude_mm = 5.0", "amplitude_mm = 5.0\nsample_rate_hz = 5000.0"),
        ["campaign.toml", "accelerometer", "0.0002 s"],
    ),
    (
        ("amplitude_mm = 5.0", "amplitude_mm = 5.0\ndwell_s = 1000.0"),
        ["campaign.toml", "1000 s at 100 Hz", "at most 500 s"],
    ),
    (("[0.3, 0.6]", "[0.6]"), ["campaign.toml", "model.effects", "at one frequency roll-gravity cannot be told"]),
    (('"six-mountings"', '"angle-scan"'), ["campaign.toml", "procedure.angles_deg is missing"]),
    (('"six-mountings"', '"angle-scan"\nangles_deg = [0.0, 200.0]'), ["campaign.toml", "rotation", "200 deg"]),
]


@pytest.mark.parametrize(("change", "facts"), BAD_CAMPAIGNS, ids=[facts[-1] for _, facts in BAD_CAMPAIGNS])
def test_a_bad_campaign_file_is_refused_before_a_byte_is_sent(
    desk: Any, wire: Any, change: tuple[str, str], facts: list[str]
) -> None:
    desk.campaign(change)
    desk.run().refused(2, *facts)
    assert wire.sent == []
    assert desk.left == set()


BAD_RIGS = [
    (('clock = "virtual"', 'clocks = "virtual"'), ["rig.toml", "unknown key rig.clocks", "known there: name, clock"]),
    (("angle_min_deg", "angle_min"), ["rig.toml", "unknown key instruments.rotation.angle_min", "angle_min_deg"]),
    (("position_min_mm = -25.0", 'position_min_mm = "-25"'), ["rig.toml", "instruments.stage.position_min_mm"]),
    (("range_v = 10.0", "range_v = 12.0"), ["rig.toml", "instruments.accelerometer.range_v"]),
    (("clock_ppm = 12.0", "clock_pp = 12.0"), ["rig.toml", "unknown key instruments.stage.simulator.clock_pp"]),
    (("seed = 2022", "sed = 2022"), ["rig.toml", "world.s"]),
    (("rho1 = 9.7e-5", "rho = 9.7e-5"), ["rig.toml", "roll-gravity", "rho"]),
    (("[world.effects.roll-gravity]", "[world.effects.rol-gravity]"), ["rig.toml", "unknown effect 'rol-gravity'"]),
    (
        ('"newport-xps"', '"newport-xp"'),
        ["rig.toml", "instruments.rotation.driver 'newport-xp' is unknown", "newport-esp301"],
    ),
    (
        ('role = "rotation"', 'role = "rotating"'),
        ["rig.toml", "instruments.rotation.role 'rotating' is unknown", "linear"],
    ),
    (('role = "rotation"', 'role = "linear"'), ["rig.toml", "a newport-xps cannot be the linear"]),
    (('role = "rotation"', 'role = "spare"'), ["rig.toml", "0 instruments with role 'rotation', needs one"]),
    (
        (
            "[instruments.thermometer]\n",
            '[instruments.second]\ndriver = "newport-xps"\naddress = "sim:"\nrole = "rotation"\n'
            "[instruments.thermometer]\n",
        ),
        ["rig.toml", "2 instruments with role 'rotation', needs one"],
    ),
    (("laser_3_mm = 1 }", "laser_4_mm = 1 }"), ["rig.toml", "[world.lasers.laser_4_mm] is missing"]),
    (('[lasers.laser_3_mm]\nposition = "+z"\ntilt_deg = 5.0\n', ""), ["rig.toml", "[lasers.laser_3_mm] is missing"]),
    (('channel = "accel_v"', 'channel = "volts"'), ["rig.toml", "channel is 'volts'", "accel_v"]),
    (('k = "-z"', 'k = "+z"'), ["rig.toml", "package.configurations.flag", "no right-handed triad"]),
    ((FIRST_ADDRESS, 'address = "tcp://127.0.0.1:5001"'), ["rig.toml", "rig.clock 'virtual'", "use 'real'"]),
    (
        ("[instruments.thermometer]\n", "[instruments.thermometer.faults]\nsilent = {}\n[instruments.thermometer]\n"),
        ["rig.toml", "instruments.thermometer.faults.silent", "say when"],
    ),
    (("[rig]", "[rig"), ["rig.toml", "not TOML"]),
]


@pytest.mark.parametrize(("change", "facts"), BAD_RIGS, ids=[facts[1] for _, facts in BAD_RIGS])
def test_a_bad_rig_file_is_refused_before_a_byte_is_sent(
    desk: Any, wire: Any, change: tuple[str, str], facts: list[str]
) -> None:
    desk.rig(change)
    desk.run().refused(2, *facts)
    assert wire.sent == []
    assert desk.left == set()


@pytest.mark.parametrize(
    ("first", "following", "facts"),
    [
        ("[package]", "[constants.g_m_s2]", ["[package] is missing"]),
        ("# Nature.", None, ["[world] table", "add it"]),
        ("[world.sensors.X]", "[world.sensors.Y]", ["[world.sensors.X] is missing"]),
    ],
)
def test_a_rig_file_without_a_table_that_is_needed_is_refused(
    desk: Any, wire: Any, first: str, following: str | None, facts: list[str]
) -> None:
    text = desk.rig().read_text()
    end = text.index(following) if following else len(text)
    desk.rig((text[text.index(first) : end], ""))
    desk.run().refused(2, "rig.toml", *facts)
    assert wire.sent == []
    assert desk.left == set()


def test_an_address_that_cannot_be_understood_is_refused(desk: Any, wire: Any) -> None:
    desk.rig(('clock = "virtual"', 'clock = "real"'), (FIRST_ADDRESS, 'address = "tcp:127.0.0.1"'))
    desk.run().refused(2, "rig.toml", "instruments.rotation.address", "tcp:127.0.0.1", "tcp://host:port")
    assert wire.sent == []
    assert desk.left == set()


def test_a_quick_check_needs_a_quarter_turn_to_either_side(desk: Any, wire: Any) -> None:
    desk.campaign(('"six-mountings"', '"quick-check"'))
    desk.rig(("angle_max_deg = 170.0", "angle_max_deg = 60.0"))
    desk.run().refused(2, "campaign.toml", "rotation", "90 deg is outside")
    assert wire.sent == []
    assert desk.left == set()


def test_missing_files_and_directories_are_named(desk: Any) -> None:
    desk.rigctl("run", "none.toml").refused(2, "none.toml", "no such file")
    desk.rigctl("run", ".").refused(2, "a directory; name a file")
    desk.rigctl("run", "campaign.toml", "--rig", "other.toml").refused(2, "other.toml", "no such file")
    desk.rigctl("run", "campaign.toml", "--yes", "--store", "no/such/x.rig.sqlite").refused(2, "no/such", "directory")
    assert desk.left == set()


@pytest.mark.parametrize(
    ("words", "facts"),
    [
        (["statu", "x"], ["rigctl: No such command 'statu'", "'status'", "`rigctl --help`"]),
        (["status"], ["rigctl status: Missing argument 'STORE'", "`rigctl status --help`"]),
        (["status", "a", "--foo"], ["rigctl status: No such option: --foo"]),
        (["run", "x.toml", "--seed", "abc"], ["rigctl run: Invalid value for '--seed'", "'abc'"]),
        (["model"], ["rigctl model: Missing command", "`rigctl model --help`"]),
        (["model", "ad", "x"], ["rigctl model: No such command 'ad'", "'add'"]),
    ],
    ids=" ".join,
)
def test_wrong_usage_is_one_line_that_says_where_the_help_is(desk: Any, words: list[str], facts: list[str]) -> None:
    desk.rigctl(*words).refused(2, *facts)
    assert desk.left == set()


# Bad input: instruments


def spoilt(table: str, fault: str) -> tuple[str, str]:
    """A change of the rig file that gives one instrument a fault."""
    return f"[instruments.{table}]\n", f"[instruments.{table}.faults]\n{fault}\n[instruments.{table}]\n"


@pytest.mark.parametrize(
    ("table", "fault", "status", "facts"),
    [
        ("rotation", 'wrong_identity = { text = "XPS-C8", instead = "SMC100" }', 1, ["rotation", "SMC100"]),
        ("lasers_a", 'wrong_identity = { text = "M1,", instead = "MS," }', 1, ["lasers_a"]),
        ("accelerometer", 'wrong_identity = { text = "34465A", instead = "34401A" }', 1, ["accelerometer", "34401A"]),
        ("stage", 'wrong_identity = { text = "4.01", instead = "CONEX" }', 1, ["stage", "CONEX"]),
        ("rotation", "silent = { after = 0 }", 1, ["rotation", "nothing came", "check power, cable"]),
        ("stage", "silent = { after = 0 }", 1, ["stage", "nothing came"]),
        ("lasers_b", "silent = { after = 0 }", 1, ["lasers_b", "nothing came"]),
        ("thermometer", "silent = { after = 0 }", 1, ["thermometer", "nothing came"]),
        ("rotation", "garbage = { after = 0 }", 1, ["rotation"]),
        ("stage", "garbage = { after = 0 }", 1, ["stage"]),
        ("lasers_a", "bits = { after = 0, flips = 4 }", 1, ["lasers_a"]),
        ("accelerometer", "non_ascii = { after = 0 }", 1, ["accelerometer"]),
        ("accelerometer", "truncated = { after = 0, keep_bytes = 3 }", 1, ["accelerometer"]),
    ],
)
def test_a_wrong_silent_or_garbled_instrument_is_refused_before_anything_moves(
    desk: Any, wire: Any, table: str, fault: str, status: int, facts: list[str]
) -> None:
    desk.rig(spoilt(table, fault))
    desk.run().refused(status, *facts)
    assert wire.motions == []
    assert desk.left == set()


def test_all_instruments_that_do_not_answer_are_in_one_error(desk: Any, wire: Any) -> None:
    desk.rig(
        spoilt("rotation", "silent = { after = 0 }"),
        spoilt("lasers_b", "silent = { after = 0 }"),
        spoilt("thermometer", 'wrong_identity = { text = "34465A", instead = "34401A" }'),
    )
    desk.run().refused(1, "rotation", "lasers_b", "thermometer", "34401A")
    assert wire.motions == []
    assert desk.left == set()


def test_stop_tells_of_each_instrument_whether_it_is_known_to_be_at_rest(desk: Any, dead_port: int) -> None:
    desk.rig(('"virtual"', '"real"'), (FIRST_ADDRESS, f'address = "tcp://127.0.0.1:{dead_port}"'))
    found = desk.rigctl("stop", "rig.toml", "--json")
    assert found.status == 1
    assert "stage" in found.json["stopped"]
    (lost,) = found.json["not_confirmed"]
    assert lost["name"] == "rotation"
    assert f"{dead_port}" in lost["why"]
    assert "rotation: NOT CONFIRMED: " in desk.rigctl("stop", "rig.toml").out


def test_an_absent_instrument_is_named_with_its_address(desk: Any, wire: Any, dead_port: int) -> None:
    desk.rig(('"virtual"', '"real"'), (FIRST_ADDRESS, f'address = "tcp://127.0.0.1:{dead_port}"'))
    desk.run("--unchecked").refused(1, f"tcp://127.0.0.1:{dead_port}", "check power and cable")
    checked = desk.rigctl("check", "rig.toml")
    assert checked.status == 1
    assert f"tcp://127.0.0.1:{dead_port}" in checked.err
    assert len(checked.err.splitlines()) == 1
    assert wire.motions == []
    assert desk.left == set()


# Stores


@pytest.fixture
def done(desk: Any) -> Any:
    """A desk with a finished campaign."""
    desk.campaign(('["pendulum", "flag"]', '["flag"]'), ("[0.3, 0.6]", "[0.6]"), ('"roll-gravity", ', ""))
    assert desk.run().status == 0
    return desk


def test_a_store_that_exists_is_not_touched(done: Any, wire: Any) -> None:
    before = done.store.read_bytes()
    done.run().refused(2, "x.rig.sqlite", "exists already", "resume")
    assert wire.sent == []
    assert done.store.read_bytes() == before


def test_a_finished_campaign_is_neither_paused_nor_aborted_and_resuming_it_tells_its_result(
    done: Any, wire: Any
) -> None:
    again = done.rigctl("resume", done.store, "--json")
    assert again.status == 0
    assert again.json["result"] == done.rigctl("result", done.store, "--json").json
    for command in ("pause", "abort"):
        done.rigctl(command, done.store).refused(1, "no campaign is running", "rigctl status")
    assert wire.sent == []
    assert done.rigctl("status", done.store, "--json").json["state"] == "done"


def test_who_asks_a_stalled_campaign_to_pause_or_abort_is_told_that_it_does_not_answer(tmp_path: Path) -> None:
    store = tmp_path / "night.rig.sqlite"
    Store.create(store, Header(experiment="sensing-axis")).close()
    runner = CliRunner()
    with locks.held(locks.store_lock(store), "held"):
        assert "no sign of life" not in runner.invoke(app, ["pause", str(store)]).stderr
        hour_ago = time.time() - 3600.0
        os.utime(locks.store_lock(store), (hour_ago, hour_ago))
        for command in ("pause", "abort"):
            asked = runner.invoke(app, [command, str(store), "--json"])
            assert json.loads(asked.stdout) == {"requested": command}
            assert "no sign of life for 60 min" in asked.stderr
            assert "rigctl stop" in asked.stderr


@pytest.mark.parametrize("command", ["resume", "pause", "abort", "status", "result", "mark", "export", "report"])
def test_a_store_that_is_missing_or_none_is_refused_by_every_command(desk: Any, command: str) -> None:
    more = {"mark": ["1", "--invalid", "x"], "export": ["out"], "report": ["--figures", "out"]}.get(command, [])
    desk.rigctl(command, "none.rig.sqlite", *more).refused(2, "none.rig.sqlite", "no such store")
    desk.rigctl(command, "rig.toml", *more).refused(2, "rig.toml", "not a campaign store")
    assert desk.left == set()


def test_what_runs_are_reduced_to_is_kept_for_what_is_asked_next(done: Any) -> None:
    with Store.open(done.store, readonly=True) as store:
        assert store.reduced_names(str(recipe(()))) == {run.run_id for run in store.runs()}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["looked again", "--invalid", "--valid"], "give --valid or --invalid, one of the two"),
        (["looked again"], "give --valid or --invalid, one of the two"),
        (["", "--invalid"], "REASON is empty"),
        ([" ", "--valid"], "REASON is empty"),
    ],
)
def test_a_mark_says_one_thing_and_why(done: Any, arguments: list[str], said: str) -> None:
    before = done.rigctl("status", done.store, "--json").json["runs_invalid"]
    done.rigctl("mark", done.store, "1", *arguments).refused(2, said)
    assert done.rigctl("status", done.store, "--json").json["runs_invalid"] == before


@pytest.mark.parametrize(
    "arguments",
    [["mark", "S", "T\udcfcr", "x", "--invalid"], ["mark", "S", "1", "T\udcfcr", "--invalid"],
     ["noise", "S", "--run", "T\udcfcr"], ["export", "S", "o.csv", "--run", "T\udcfcr"], ["answer", "S", "T\udcfcr"]],
    ids=["run", "reason", "noise", "export", "answer"],
)  # fmt: skip
def test_words_of_a_terminal_with_another_encoding_are_refused(desk: Any, arguments: list[str]) -> None:
    desk.rigctl(*arguments).refused(2, "is no UTF-8; set the terminal to it")


def test_runs_are_marked_by_their_name(done: Any) -> None:
    done.rigctl("mark", done.store, "77", "--invalid", "a truck").refused(2, "no run 77", "nearest")
    assert done.rigctl("mark", done.store, "1", "--invalid", "a truck went by").status == 0
    assert done.rigctl("status", done.store, "--json").json["runs_invalid"] == 1
    with Store.open(done.store, readonly=True) as store:
        assert next((run.valid, run.reason) for run in store.runs()) == (False, "a truck went by")
    marked = done.rigctl("mark", done.store, "1", "--valid", "looked again", "--json").json
    assert marked == {"run_id": "1", "valid": True, "reason": "looked again"}
    assert done.rigctl("status", done.store, "--json").json["runs_invalid"] == 0


def test_a_broken_bundle_is_refused_and_leaves_no_store(done: Any, tmp_path: Path) -> None:
    assert done.rigctl("export", done.store, "bundle", "--json").json == {"written": "bundle", "lost": []}
    (tmp_path / "bundle" / "recording.toml").write_text("format = 1\nexperiment = \n")
    done.rigctl("import", "bundle", "--store", "y.rig.sqlite").refused(2, "recording.toml", "2")
    done.rigctl("import", "nothing", "--store", "y.rig.sqlite").refused(2, "nothing")
    assert not (tmp_path / "y.rig.sqlite").exists()


def test_a_bundle_comes_back_as_a_finished_store_that_has_nothing_to_resume(done: Any) -> None:
    assert done.rigctl("export", done.store, "bundle").status == 0
    imported = done.rigctl("import", "bundle", "--store", "y.rig.sqlite", "--json")
    assert imported.json["runs"] == 2
    assert imported.err.splitlines()[-1] == "2 of 2 runs reduced, 0 s left"
    assert done.rigctl("status", "y.rig.sqlite", "--json").json["state"] == "done"
    done.rigctl("resume", "y.rig.sqlite").refused(2, "no campaign to go on with")


def test_export_formats(done: Any, tmp_path: Path) -> None:
    assert done.rigctl("export", done.store, "out", "--format", "hdf5", "--json").json["written"].endswith(".h5")
    assert [path.suffix for path in (tmp_path / "out").iterdir()] == [".h5"]
    done.rigctl("export", done.store, "out", "--format", "xls").refused(2, "--format xls is unknown", "or csv")


def test_a_file_for_other_programs_is_told_by_its_name(done: Any, tmp_path: Path) -> None:
    assert "without a result" in done.rigctl("export", done.store, "x.nxs").err
    for name in ("x.h5", "x.parquet"):
        assert done.rigctl("export", done.store, name, "--json").json == {"written": name, "lost": []}
    with h5py.File(tmp_path / "x.nxs") as file, Store.open(done.store, readonly=True) as store:
        data = file["run_1/data"]
        assert data["accel_v"][()].tobytes() == store.samples("1")["accel_v"].tobytes()
        signal = file["campaign/table"].attrs["signal"]
        assert signal == "accel_v_nu_in_phase"
        value, u = (file["campaign/table"][name][()].tolist() for name in (signal, f"{signal}_errors"))
    runs = parquet.read_table(tmp_path / "x.parquet")
    assert [runs[name].to_pylist() for name in ("accel_v nu in-phase", "u_accel_v nu in-phase")] == [value, u]
    assert all(0.0 < each < 1e-3 for each in u)  # volts
    done.rigctl("export", done.store, "x.csv").refused(2, "2 runs in it (1, 2); name one with --run")
    assert done.rigctl("export", done.store, "x.csv", "--run", "2").status == 0
    assert (tmp_path / "x.csv").read_text().startswith("t_s,")
    done.rigctl("export", done.store, "y.nxs", "--run", "2").refused(2, "--run is for the samples of one run as csv")
    done.rigctl("export", done.store, "y.nxs", "--salvage").refused(2, "--salvage writes a bundle")


# Locks


def test_one_campaign_per_store(desk: Any, wire: Any) -> None:
    with locks.held(locks.store_lock(desk.store), "taken"):
        desk.run().refused(1, "x.rig.sqlite is in use by another campaign")
    assert wire.motions == []
    assert not desk.store.exists()


def test_one_campaign_per_instrument_even_under_another_rig_file(desk: Any, wire: Any, dead_port: int) -> None:
    address = f"tcp://127.0.0.1:{dead_port}"
    desk.rig(('"virtual"', '"real"'), (FIRST_ADDRESS, f'address = "{address}"'))
    other = desk.directory / "other.toml"
    other.write_text(
        f'[rig]\nname = "other"\n[instruments.it]\ndriver = "newport-xps"\naddress = "{address}"\nrole = "spare"\n'
    )
    with locks.instruments_held(read_rig(other), "taken"):
        desk.run("--unchecked").refused(1, "rig.toml", "another campaign holds these instruments", address)
        desk.rigctl("move", "rig.toml", "rotation", 1).refused(1, "another campaign holds", address)
        assert wire.sent == []
        stopped = desk.rigctl("stop", "rig.toml")
        assert "another campaign" not in stopped.err, "whoever holds the rig, anybody may stop it"
    desk.run("--unchecked").refused(1, address, "no connection")


# The rig by hand


def test_check_identifies_and_moves_nothing(desk: Any, wire: Any) -> None:
    found = desk.rigctl("check", "rig.toml", "--json").json["instruments"]
    assert set(found) == {"rotation", "stage", "lasers_a", "lasers_b", "accelerometer", "thermometer"}
    assert found["accelerometer"]["model"] == "34465A"
    assert wire.motions == []


def test_stages_are_homed_moved_and_stopped_by_name(desk: Any, wire: Any) -> None:
    assert desk.rigctl("home", "rig.toml", "--json").json == {"homed": ["rotation", "stage"]}
    assert desk.rigctl("home", "rig.toml", "stage", "--json").json == {"homed": ["stage"]}
    moved = desk.rigctl("move", "rig.toml", "rotation", "-5.5", "--json").json
    assert moved == {"name": "rotation", "value": pytest.approx(-5.5, abs=1e-4), "unit": "deg"}
    assert desk.rigctl("move", "rig.toml", "stage", "3", "--json").json["unit"] == "mm"
    wire.sent.clear()
    assert set(desk.rigctl("stop", "rig.toml", "--json").json["stopped"]) >= {"rotation", "stage"}
    assert any(b"GroupMoveAbort" in data or b"GroupKill" in data for data in wire.sent)
    assert any(data.startswith(b"ABORT") for data in wire.sent)


def test_moves_beyond_the_limits_or_of_nothing_are_refused(desk: Any, wire: Any) -> None:
    desk.rigctl("move", "rig.toml", "rotation", "171").refused(2, "rotation", "171 deg", "-170 to 170")
    desk.rigctl("move", "rig.toml", "stage", "-26").refused(2, "stage", "-26 mm")
    desk.rigctl("move", "rig.toml", "lasers_a", "1").refused(2, "no stage 'lasers_a'", "rotation, stage")
    desk.rigctl("home", "rig.toml", "rotor").refused(2, "no stage 'rotor'")
    assert not any(b"MoveAbsolute" in data or b"MOVEABS" in data for data in wire.sent)


def test_a_dry_run_tells_the_plan_and_touches_nothing(desk: Any, wire: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError("a dry run connects to nothing")

    monkeypatch.setattr(socket.socket, "connect", never)
    plan = desk.rigctl("run", "campaign.toml", "--dry-run", "--json", "--store", desk.store).json
    assert plan["mountings"] == ["X pendulum 1", "X flag 2"]
    assert plan["runs_planned"] == 6
    assert plan["effects"] == ["roll-gravity", "resonance"]
    assert plan["theta0_sigma_arcsec"] == 15.0
    assert "X pendulum 1" in desk.rigctl("run", "campaign.toml", "--dry-run").out
    assert wire.sent == []
    assert desk.left == set()


# What nobody expects


def test_a_bug_of_ours_is_one_line_unless_asked_for_in_full(desk: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def bug(_: Path) -> None:
        raise ZeroDivisionError("seven by zero")

    monkeypatch.setattr("rigctl.cli.check.read_rig", bug)
    found = desk.rigctl("check", "rig.toml")
    assert found.status == 1
    assert found.err.splitlines() == [
        "internal error: ZeroDivisionError: seven by zero; please report it with what RIGCTL_TRACEBACK=1 shows"
    ]
    monkeypatch.setenv(cli.TRACEBACK, "1")
    with pytest.raises(ZeroDivisionError):
        desk.rigctl("check", "rig.toml")


def test_files_that_cannot_be_written_are_named(desk: Any) -> None:
    desk.rigctl("simulate", "rig.toml", "--write-rig", "no/dir/client.toml").refused(1, "no/dir", "check the path")


def test_json_is_one_document_on_stdout(done: Any) -> None:
    for command in ("status", "result"):
        found = done.rigctl(command, done.store, "--json")
        assert found.err == ""
        assert json.loads(found.out)
        assert len(found.out.splitlines()) == 1


EVERY_COMMAND = [
    *([name] for names in commands.MODULES.values() for name in names),
    *(["model", name] for name in ("show", "history", "add", "remove")),
]


def test_no_help_needs_what_the_commands_work_with() -> None:
    """It is read from the source, as are the manual and what shells complete: modules are imported when used."""
    asked = [[*command, "--help"] for command in ([], *EVERY_COMMAND)] + [["man"], ["completion", "bash"]]
    code = (
        "import sys, typer.testing, rigctl.cli.application as cli\n"
        f"for words in {asked}:\n"
        "    print(typer.testing.CliRunner().invoke(cli.app, words, catch_exceptions=False).output)\n"
        "print(sorted({name.split('.')[0] for name in sys.modules}))\n"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert "Run a campaign from start to result." in told
    assert "The versions of a store's model." in told
    assert "Seed of a simulated world." in told
    heavy = ("numpy", "sqlite3", "scipy", "textual", "matplotlib", "pydantic")
    assert not [name for name in heavy if f"'{name}'" in told]


def test_a_page_of_help_loads_few_modules() -> None:
    """Counted, and not timed: panels and colours are half of what it once loaded."""
    call = [sys.executable, "-X", "importtime", "-m", "rigctl", "--help"]
    done = subprocess.run(call, capture_output=True, text=True, check=True)
    loaded = [line.rpartition("|")[2].strip() for line in done.stderr.splitlines() if line.startswith("import time:")]
    assert done.stdout.startswith("Usage: ")
    assert not [name for name in loaded if name.partition(".")[0] in {"rich", "markdown_it", "numpy", "pydantic"}]
    # 162 with Python 3.11 and typer 0.28.
    assert len(loaded) < 190


@pytest.mark.parametrize(
    ("module", "needed"),
    [("simulators.worlds.sensing_axis_bench", "scipy.special"), ("rigctl.experiments.inflight.analysis", "numpy")],
)
def test_neither_a_bench_nor_a_calibration_in_orbit_waits_for_scipy_signal(module: str, needed: str) -> None:
    """With scipy.stats it takes as long as all else that a bench needs; samples in orbit are reduced without it."""
    code = f"import sys, {module}\nprint(sorted(sys.modules))"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert f"'{needed}'" in told
    assert "'scipy.signal'" not in told
    assert "'scipy.stats'" not in told
    assert ("'scipy'" in told) == needed.startswith("scipy")


def test_what_asks_for_the_state_of_a_campaign_loads_no_arithmetic(done: Any) -> None:
    code = (
        "import sys\nfrom rigctl.cli import main\n"
        f"sys.argv = ['rigctl', 'status', {str(done.store)!r}]\n"
        "try:\n    main()\nfinally:\n    print(sorted({name.split('.')[0] for name in sys.modules}))\n"
    )
    told = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=done.directory
    ).stdout
    assert told.startswith("done")
    heavy = ("numpy", "scipy", "numba", "textual", "matplotlib", "pydantic")
    assert not [name for name in heavy if f"'{name}'" in told]


@pytest.mark.parametrize(
    ("arguments", "status", "stream"), [(["--help"], 0, "stdout"), (["check", "none.toml"], 2, "stderr")]
)
def test_the_package_runs_as_the_command(arguments: list[str], status: int, stream: str, tmp_path: Path) -> None:
    call = [sys.executable, "-m", "rigctl", *arguments]
    done = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == status
    expected = "Run a campaign from start to result." if status == 0 else "none.toml"
    assert expected in getattr(done, stream)
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("command", EVERY_COMMAND, ids=" ".join)
def test_help_is_that_of_the_command_which_acts(command: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    read = CliRunner().invoke(app, [*command, "--help"])
    monkeypatch.setattr(commands.LazyCommand, "declared", commands.LazyCommand.imported)
    acting = CliRunner().invoke(app, [*command, "--help"])
    assert (read.exit_code, read.output) == (0, acting.output)


def test_help_as_the_value_of_an_option_is_that_value(tmp_path: Path) -> None:
    asked = CliRunner().invoke(app, ["run", str(tmp_path / "none.toml"), "--rig", "--help"])
    assert isinstance(asked.exception, RigError)
    assert "none.toml" in str(asked.exception)
    named = CliRunner().invoke(app, ["model", "add", str(tmp_path / "none.rig.sqlite"), "--", "--help"])
    assert isinstance(named.exception, RigError)


def test_a_campaign_that_ends_while_it_is_asked_to_go_on_is_resumed(
    desk: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    ended = desk.run()
    assert ended.status == 0
    looks = iter([True])
    monkeypatch.setattr(requests, "is_running", lambda store: next(looks, False))
    assert desk.rigctl("resume", desk.store, "--json").json["status"]["state"] == "done"


def test_it_says_which_it_is_and_without_words_what_it_can_do(desk: Any) -> None:
    assert desk.rigctl("--version").out == f"rigctl {version('rigctl')}\n"
    helped = desk.rigctl()
    assert (helped.status, helped.out) == (0, desk.rigctl("--help").out)


@pytest.mark.parametrize("seed", ["-1", "1.5", "1e99"])
def test_a_seed_that_no_world_has_is_refused_before_anything_moves(desk: Any, seed: str) -> None:
    desk.run("--seed", seed).refused(2, "--seed", seed)
    assert desk.left == set()
