"""Bundles that are not as they should be: refused in one line that names file, line and mend."""

import gzip
import re
import zipfile

import numpy as np
import pytest

from rigctl.campaign.bundle.bundle import import_bundle, read_bundle
from rigctl.core.errors import DataError

HEADER_FLAWS = [
    ("format = 1", "format = ", "recording.toml, line 1: not TOML (Invalid value); mend the line"),
    ("format = 1\n", "", "recording.toml: format is missing; write format = 1 in the first line"),
    (
        "format = 1",
        "format = 2",
        "recording.toml, line 1: format = 2 is not read by this program; write 1, or update rigctl",
    ),
    (
        '"sensing-axis"',
        '"sensing"',
        "recording.toml, line 2: experiment 'sensing' is unknown; write sensing-axis, rotating-platform, "
        "inflight-calibration, table or frequency-response",
    ),
    (
        '"sensing-axis"',
        "[1]",
        "recording.toml, line 2: experiment [1] is unknown; write sensing-axis, "
        "rotating-platform, inflight-calibration, table or frequency-response",
    ),
    (
        'experiment = "sensing-axis"\n',
        "",
        "recording.toml: experiment is missing; write sensing-axis, rotating-platform, inflight-calibration, table "
        "or frequency-response",
    ),
    (
        "2026-11-21T01:00:00Z",
        "2026-11-21T01:00:00",
        "recording.toml, line 4: started 2026-11-21 01:00:00 has no time zone; write UTC with a Z at its end",
    ),
    (
        "2026-11-21T01:00:00Z",
        '"tonight"',
        "recording.toml, line 4: started 'tonight' is no time; write e.g. 2026-11-21T01:00:00Z",
    ),
    ('"X and Y, night run"', "7", "recording.toml, line 3: title is 7, not a text; put it in quotes"),
    (
        "g_m_s2 = 9.803",
        'g_m_s2 = "9.8 m/s2"',
        "recording.toml, line 7: constants.g_m_s2 is '9.8 m/s2', not a number; write it without quotes or unit",
    ),
    (
        'unit = "V"',
        'unit = "mV"',
        "recording.toml, line 11: channels.accel_v.unit 'mV' contradicts the column's name; "
        "write 'V', or rename the column",
    ),
    (
        'unit = "mm"',
        'unit = "m"',
        "recording.toml, line 18: channels.stage_x_mm.unit 'm' contradicts the column's name; "
        "write 'mm', or rename the column",
    ),
    (
        "full_scale = 10.0",
        "full_scale = -10.0",
        "recording.toml, line 14: channels.accel_v.full_scale is not positive; "
        "write the largest reading, or leave it out",
    ),
    (
        "noise_rms = 0.0004",
        "noise_rms = -1",
        "recording.toml, line 13: channels.accel_v.noise_rms is negative; "
        "write the rms of one sample, or leave it out",
    ),
    (
        'face = "x"',
        'face = "left"',
        "recording.toml, line 22: lasers.laser_1_mm.face 'left' is no face; write x, y, z, -x, -y or -z",
    ),
    (
        "[constants]\ng_m_s2 = 9.803",
        "constants = 3\n[other]",
        "recording.toml, line 6: constants is 3; make it a table [constants]",
    ),
]


@pytest.mark.parametrize(("was", "flaw", "message"), HEADER_FLAWS)
def test_flaw_in_recording_toml_is_refused(refusal, sensing, was, flaw, message):
    assert was in sensing.toml
    sensing.toml = sensing.toml.replace(was, flaw, 1)
    assert refusal(sensing.write()) == f"night/{message}"


@pytest.mark.parametrize("unit", ["V", "volt", " v"])
def test_unit_may_be_spelt_otherwise(sensing, unit):
    sensing.toml = sensing.toml.replace('unit = "V"', f'unit = "{unit}"')
    assert read_bundle(sensing.write()).header.channels["accel_v"].unit == unit


def test_third_sensor_is_no_temperature(refusal, sensing):
    sensing.toml += '[channels.sensor_c]\nunit = "pF"\n[channels.temperature_c]\nunit = "K"\n'
    assert refusal(sensing.write()).startswith(
        "night/recording.toml, line 30: channels.temperature_c.unit 'K' contradicts"
    )


RUN_TABLE_FLAWS = [
    (2, "axis", "Q", "line 2: axis is 'Q'; write X, Y or Z"),
    (3, "axis", "", "line 3: axis is missing; write it"),
    (3, "configuration", "hanging", "line 3: configuration is 'hanging'; write pendulum or flag"),
    (4, "mounting", "1.5", "line 4: mounting is '1.5'; write a whole number"),
    (2, "theta_deg", "left", "line 2: theta_deg is 'left'; write a number"),
    (2, "theta_deg", "nan", "line 2: theta_deg is missing; write it"),
    (3, "approach", "0", "line 3: approach is '0'; write +1 or -1"),
    (2, "frequency_hz", "-0.5", "line 2: frequency_hz is '-0.5'; write a number above 0"),
    (4, "valid", "yes", "line 4: valid is 'yes'; write 1 or 0"),
    (3, "laser_2_face", "up", "line 3: laser_2_face is 'up'; write x, y, z, -x, -y or -z"),
    (4, "temperature_c", "warm", "line 4: temperature_c is 'warm'; write a number"),
    (3, "run_id", "1", "line 3: run_id 1 is in line 2 already; give every run its own"),
    (3, "run_id", "", "line 3: run_id '' is empty or begins or ends with a space; give the run another"),
    (3, "run_id", "../2", "line 3: run_id '../2' cannot name a file; give the run another"),
    (3, "run_id", "7", "line 3: runs/7.csv is missing; add it, or remove run 7"),
    (1, "theta_deg", "theta", "line 1: column theta_deg is missing; rename theta"),
    (
        1,
        "axis",
        "configuration",
        "line 1: column configuration is there twice; rename or remove one",
    ),
    (
        1,
        "shift",
        "",
        "line 1: the name of column 14 is empty, or has spaces at its ends or unprintable characters; "
        "name it in the header",
    ),
]


@pytest.mark.parametrize(("line", "column", "text", "message"), RUN_TABLE_FLAWS)
def test_flaw_in_runs_csv_is_refused(refusal, sensing, line, column, text, message):
    sensing.set("runs.csv", line, column, text)
    assert refusal(sensing.write()) == f"night/runs.csv, {message}"


def test_row_of_another_width_is_refused(refusal, sensing):
    sensing.tables["runs.csv"][2].append("7")
    assert (
        refusal(sensing.write())
        == "night/runs.csv, line 3: 15 fields where the header has 14; leave a missing value empty"
    )


RAW_FLAWS = [
    ("runs.csv", b"", "runs.csv, line 1: empty; write the column names in the first line"),
    (
        "runs.csv",
        b"run_id;axis\n1;X\n",
        "runs.csv, line 1: fields are separated by semicolons; save it with commas and decimal points",
    ),
    (
        "runs.csv",
        "run_id,axis\n1,X\n2,°\n".encode("latin-1"),
        "runs.csv, line 3: byte 0xb0 is not UTF-8; save it as UTF-8",
    ),
    ("runs.csv", b'run_id,axis\n1,X\n2,"X"Y\n', "runs.csv, line 3: ',' expected after '\"'; mend the quotes"),
    (
        "runs/2.csv",
        b"t_s,stage_x_mm,accel_v\n",
        "runs/2.csv: no samples; record longer, remove the run, or set its valid to 0",
    ),
    (
        "runs/2.csv",
        b"0.0,1.0,2.0\n0.1,1.0,2.0\n",
        "runs/2.csv, line 1: numbers where the header belongs; write the column names in the first line",
    ),
    (
        "runs/2.csv",
        b"t_s,stage_x_mm,accel\n0,1,2\n",
        "runs/2.csv, line 1: column accel_v is missing; rename accel (there are t_s, stage_x_mm, accel)",
    ),
    (
        "runs/2.csv",
        b"t_s,stage_x_mm,accel_v\n0,1,2\n1,2\n2,3,4\n",
        "runs/2.csv, line 3: 2 fields where the header has 3; leave a missing value empty",
    ),
    (
        "runs/2.csv",
        b"t_s,stage_x_mm,accel_v\n0,1,2\n\n1,2,over\n",
        "runs/2.csv, line 4: column accel_v holds 'over', not a number; leave a missing value empty or write nan",
    ),
    (
        "runs/2.csv",
        b"t_s,stage_x_mm,accel_v\n0,1,2\n1,2,1_0\n",
        "runs/2.csv, line 3: column accel_v holds '1_0', not a number; leave a missing value empty or write nan",
    ),
    (
        "runs/2.csv",
        b"t_s,stage_x_mm,accel_v\n0,1,2\n1,2,3\n\n,3,4\n",
        "runs/2.csv, line 5: t_s is nan; write the time of every sample",
    ),
    (
        "runs/2.csv",
        b"t_s,stage_x_mm,accel_v\n0,1,2\ninf,2,3\n",
        "runs/2.csv, line 3: column t_s holds inf, which nobody can have measured; "
        "mend it, or leave a missing value empty",
    ),
    (
        "runs/2.csv",
        b"t_s,stage_x_mm,accel_v\n0,1,2\n1,2,1e400\n",
        "runs/2.csv, line 3: column accel_v holds 1e400, which nobody can have measured; "
        "mend it, or leave a missing value empty",
    ),
    (
        "runs/2.csv",
        b"t_s,stage_x_mm,accel_v\n0,1,2\n2,2,3\n1.5,2,3\n3,3,4\n",
        "runs/2.csv, line 4: time does not go on: t_s 1.5 follows 2; sort or repair the samples",
    ),
    (
        "runs/2.csv",
        b"t_s,stage_x_mm,accel_v\n0,1,2\n1,2,3\n1,3,4\n",
        "runs/2.csv, line 4: time does not go on: t_s 1 follows 1; sort or repair the samples",
    ),
    (
        "runs/2.csv",
        b"t_s,stage_x_mm,accel_v\n0,1,2\n1,2,3\n2,3,4\n",
        "runs/2.csv: 3 s is too short: one period takes 3.33333 s; "
        "record longer, remove the run, or set its valid to 0",
    ),
    (
        "runs/2.csv",
        b"t_s,t_s,accel_v\n0,1,2\n",
        "runs/2.csv, line 1: column t_s is there twice; rename or remove one",
    ),
    (
        "runs/2.npz",
        b"",
        "runs.csv, line 3: run 2 has both runs/2.csv and runs/2.npz; remove all but one",
    ),
]


@pytest.mark.parametrize(("name", "data", "message"), RAW_FLAWS)
def test_flaw_in_a_csv_file_is_refused(refusal, sensing, name, data, message):
    sensing.tables.pop(name, None)
    sensing.raw[name] = data
    assert refusal(sensing.write()) == f"night/{message}"


def test_four_samples_are_long_enough_where_three_were_not(sensing):
    sensing.tables.pop("runs/2.csv")
    sensing.raw["runs/2.csv"] = b"t_s,stage_x_mm,accel_v\n0,1,2\n1,2,3\n2,3,4\n3,4,5\n"
    assert read_bundle(sensing.write()).runs()[1].valid


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("recording.toml", "recording.toml: missing; a bundle says there what it holds"),
        ("runs.csv", "runs.csv: missing; add it, one row per run"),
        ("runs/3.csv", "runs.csv, line 4: runs/3.csv is missing; add it, or remove run 3"),
    ],
)
def test_missing_file_is_refused(refusal, sensing, name, message):
    (sensing.write() / name).unlink()
    assert refusal(sensing.path) == f"night/{message}"


def npz(path, **arrays):
    with path.open("wb") as file:
        np.savez(file, **arrays)


T = np.arange(400) * 0.01


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        (
            {"t_s": T, "stage_x_mm": T, "accel_v": T[:-1]},
            "columns differ in length (t_s 400, stage_x_mm 400, accel_v 399); ",
        ),
        ({"t_s": T, "stage_x_mm": T, "accel_v": np.array(["x"] * 400)}, "column accel_v is 1-dimensional <U1; "),
        ({"t_s": T, "stage_x_mm": T.reshape(2, 200)}, "column stage_x_mm is 2-dimensional float64; "),
        (
            {"t_s": T, "accel_v": np.array([{}, 1], dtype=object)},
            "column accel_v is 1-dimensional object; ",
        ),
        ({}, "no arrays in it; "),
    ],
)
def test_flaw_in_an_npz_file_is_refused(refusal, sensing, arrays, message):
    sensing.write()
    (sensing.path / "runs/2.csv").unlink()
    npz(sensing.path / "runs/2.npz", **arrays)
    assert refusal(sensing.path) == f"night/runs/2.npz: {message}write it with numpy.savez, one array per column"


def test_time_running_back_in_an_npz_file_names_the_sample(refusal, sensing):
    sensing.write()
    (sensing.path / "runs/2.csv").unlink()
    back = T.copy()
    back[17] = 0
    npz(sensing.path / "runs/2.npz", t_s=back, stage_x_mm=T, accel_v=T)
    assert refusal(sensing.path) == (
        "night/runs/2.npz, sample 18: time does not go on: t_s 0 follows 0.16; sort or repair the samples"
    )


def test_pickle_in_npz_clothes_is_refused(refusal, sensing):
    sensing.tables.pop("runs/2.csv")
    sensing.raw["runs/2.npz"] = b"\x80\x04K\x01."
    assert refusal(sensing.write()).startswith("night/runs/2.npz: not a readable zip (")


@pytest.mark.parametrize("data", [b"t_s,stage_x_mm", gzip.compress(b"t_s" * 999)[:-9]], ids=["no gzip", "cut off"])
def test_broken_gzip_is_refused(refusal, sensing, data):
    sensing.tables.pop("runs/2.csv")
    sensing.raw["runs/2.csv.gz"] = data
    message = refusal(sensing.write())
    assert re.fullmatch(r"night/runs/2.csv.gz: not a readable gzip file \(.+\); compress it again", message)


def test_what_is_no_bundle_is_refused(refusal, tmp_path):
    assert refusal(tmp_path / "gone") == (
        f"{tmp_path.name}/gone: no such bundle; name a directory with recording.toml, or a .zip of one"
    ).removeprefix(f"{tmp_path.name}/")
    (tmp_path / "note.zip").write_text("no zip")
    assert refusal(tmp_path / "note.zip") == (
        "note.zip: not a readable zip (File is not a zip file); pack the directory again"
    )


@pytest.mark.parametrize("name", ["../evil.csv", "/etc/evil.csv", "a/../../evil.csv", "..\\evil.csv"])
def test_zip_that_points_outside_is_refused(refusal, sensing, tmp_path, name):
    packed = tmp_path / "night.zip"
    with zipfile.ZipFile(packed, "w") as archive:
        archive.write(sensing.write() / "recording.toml", "recording.toml")
        archive.writestr(name, "x")
    assert refusal(packed) == f"night.zip: member {name!r} points outside the bundle; pack the directory again"


def test_damaged_member_of_a_zip_is_named(refusal, sensing, tmp_path):
    packed = tmp_path / "night.zip"
    with zipfile.ZipFile(packed, "w") as archive:
        for file in sensing.write().rglob("*.*"):
            archive.write(file, file.relative_to(sensing.path))
    data = bytearray(packed.read_bytes())
    at = data.index(b"run_id,axis")
    data[at] ^= 1
    packed.write_bytes(data)
    assert refusal(packed) == (
        "night.zip/runs.csv: cannot be read (Bad CRC-32 for file 'runs.csv'); copy or pack it again"
    )


def test_nothing_is_half_imported(sensing, tmp_path):
    sensing.set("runs/3.csv", 9, "t_s", "never")
    before = set(tmp_path.iterdir()) | {sensing.write()}
    with pytest.raises(DataError, match=r"3\.csv, line 9: column t_s holds 'never'"):
        import_bundle(sensing.path, tmp_path / "s.rig.sqlite")
    assert set(tmp_path.iterdir()) == before


def test_existing_store_is_left_alone(sensing, tmp_path):
    store = tmp_path / "s.rig.sqlite"
    store.write_text("mine")
    with pytest.raises(DataError, match=r"s\.rig\.sqlite: exists already; name another store"):
        import_bundle(sensing.write(), store)
    assert store.read_text() == "mine"
    with pytest.raises(DataError, match="no such directory"):
        import_bundle(sensing.path, tmp_path / "no/s.rig.sqlite")
