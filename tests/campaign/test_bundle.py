"""Bundles that are as they should be: read, kept and written again without loss."""

import gzip
import io
import math
import unicodedata
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from rigctl.campaign.bundle.bundle import import_bundle, import_report, read_bundle, salvage_bundle, write_bundle
from rigctl.campaign.bundle.files import BundleFiles
from rigctl.campaign.bundle.sample_file import csv_bytes, read_sample_file
from rigctl.campaign.bundle.writer import LONG_RUN_VALUES
from rigctl.campaign.days import first_day, last_day
from rigctl.campaign.recording import ChannelInfo, Header, ImportReport, LaserInfo, Recording, RunRecord
from rigctl.campaign.store.store import Store
from rigctl.core.errors import DamagedStore, DataError
from rigctl.core.numbers import MAGNITUDE_MAX


def plain(value):
    """A value in which NaN equals NaN."""
    return repr(value) if isinstance(value, float) and math.isnan(value) else value


def assert_same(one, other):
    """Both hold the same recording, floats bit for bit."""
    assert one.header == other.header
    assert len(one.runs()) == len(other.runs())
    for left, right in zip(one.runs(), other.runs(), strict=True):
        assert (left.run_id, left.valid, left.reason) == (right.run_id, right.valid, right.reason)
        assert {k: plain(v) for k, v in left.conditions.items()} == {k: plain(v) for k, v in right.conditions.items()}
        mine, theirs = one.samples(left.run_id), other.samples(right.run_id)
        assert list(mine) == list(theirs)
        for name, column in mine.items():
            np.testing.assert_array_equal(column, theirs[name], strict=True)
            assert column[np.isfinite(column)].tobytes() == theirs[name][np.isfinite(column)].tobytes()


def test_bundle_to_store_to_bundle_loses_nothing(any_bundle, tmp_path):
    first = read_bundle(any_bundle.write())
    with import_bundle(any_bundle.path, tmp_path / "s.rig.sqlite") as store:
        assert_same(first, store)
        write_bundle(store, tmp_path / "again")
        assert import_report(store) == first.report
    assert_same(first, read_bundle(tmp_path / "again"))


def test_sensing_axis_bundle_says_what_it_holds(sensing):
    recording = read_bundle(sensing.write())
    header = recording.header
    assert (header.experiment, header.title) == ("sensing-axis", "X and Y, night run")
    assert header.started == "2026-11-21T01:00:00Z"
    assert header.constants == {"g_m_s2": 9.803, "gain_v_per_m_s2": 100.0}
    assert header.channels["accel_v"] == ChannelInfo("V", "accelerometer", 4e-4, 10.0, 1e-5)
    assert header.lasers == {"laser_1_mm": LaserInfo("x", 5.0), "laser_2_mm": LaserInfo(None, 5.0)}
    one, two, three = recording.runs()
    assert one.conditions == {
        "axis": "X",
        "configuration": "pendulum",
        "mounting": 1,
        "theta_deg": 0.1,
        "approach": 1,
        "frequency_hz": 0.5,
        "amplitude_mm": 5.0,
        "temperature_c": 21.5,
        "start_s": 10.0,
        "laser_2_face": "y",
        "pressure_hpa": 1013.2,
        "shift": "late",
    }
    assert math.isnan(two.conditions["temperature_c"])
    assert math.isnan(two.conditions["pressure_hpa"])
    assert math.isnan(three.conditions["approach"])
    assert (three.conditions["laser_2_face"], three.conditions["shift"]) == ("", "")
    assert recording.runs(valid_only=True) == [one, two]
    assert recording.report == ImportReport(3, (("3", "marked invalid in runs.csv"),), ())
    assert np.isnan(recording.samples("1")["laser_1_mm"][300:]).all()


def test_platform_bundle_carries_its_own_pattern(platform):
    recording = read_bundle(platform.write())
    assert recording.header.extra["patterns"] == {
        "pattern": ["custom", "custom"],
        "period_s": [60.0, 60.0],
        "dwell_index": [0.0, 1.0],
        "sign_cos_theta": [1.0, -1.0],
        "start_s": [5.0, 35.0],
        "stop_s": [25.5, 55.0],
    }
    flip = recording.runs()[2].conditions
    assert (flip["g_sign"], flip["external"]) == (-1, "")
    assert math.isnan(flip["modulation_period_s"])
    assert recording.report == ImportReport(4)


def test_inflight_bundle_keeps_two_parameters_in_one_session(inflight):
    recording = read_bundle(inflight.write())
    assert [run.conditions["session"] for run in recording.runs()] == ["dx+dz", "dy", "k2c_1"]
    assert recording.runs()[1].conditions["phase_rad"] == -1.5707963267948966
    assert recording.report == ImportReport(3)


def test_table_keeps_its_question_numbers_and_texts(readings):
    recording = read_bundle(readings.write())
    spec = recording.header.table
    assert spec is not None
    assert (spec.response, spec.baseline) == ("deflection_in", "b0 + b1 * load_lb")
    assert (spec.start, spec.order, spec.block) == ({"b0": 0.0, "b1": 1e-6}, "time_s", "day")
    (run,) = recording.runs()
    assert run.conditions == {"day": ["Mon"] * 6 + ["Tue"] * 6}
    samples = recording.samples(run.run_id)
    assert list(samples) == ["load_lb", "deflection_in", "time_s", "empty"]
    np.testing.assert_array_equal(samples["time_s"], np.arange(12.0))
    assert np.isnan(samples["empty"]).all()


@pytest.mark.parametrize("inside", ["", "night/"])
def test_zip_of_a_bundle_is_the_bundle(sensing, tmp_path, inside):
    sensing.write()
    packed = tmp_path / "night.zip"
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sensing.path.rglob("*.*"):
            archive.write(file, f"{inside}{file.relative_to(sensing.path)}")
        archive.writestr("__MACOSX/night/._recording.toml", "junk")
    assert_same(read_bundle(sensing.path), read_bundle(packed))


def test_run_files_may_be_csv_gz_or_npz(sensing):
    plain_csv = read_bundle(sensing.write())
    one, two = sensing.path / "runs/1.csv", sensing.path / "runs/2.csv"
    (sensing.path / "runs/1.csv.gz").write_bytes(gzip.compress(one.read_bytes()))
    np.savez_compressed(sensing.path / "runs/2.npz", **plain_csv.samples("2"))
    one.unlink()
    two.unlink()
    assert_same(plain_csv, read_bundle(sensing.path))


def test_long_runs_are_written_as_npz_and_come_back(tmp_path):
    t_s = np.arange(LONG_RUN_VALUES // 3 + 1) * 0.1
    samples = {"t_s": t_s, "q_a_v": np.sin(t_s), "q_b_v": np.cos(t_s)}
    record = RunRecord("1", "1", "import", {"pattern": "noise"})
    recording = Recording(Header("rotating-platform"), (record,), {"1": samples}, ImportReport(1))
    write_bundle(recording, tmp_path / "b")
    assert [p.name for p in (tmp_path / "b/runs").iterdir()] == ["1.npz"]
    back = read_bundle(tmp_path / "b").samples("1")
    assert all(back[name].tobytes() == column.tobytes() for name, column in samples.items())


def test_spreadsheet_habits_are_understood(sensing):
    bundle = sensing.write()
    runs = (bundle / "runs.csv").read_text()
    (bundle / "runs.csv").write_bytes(b"\xef\xbb\xbf" + runs.replace("\n", "\r\n").encode() + b",,,,,,,,,,,,,\r\n")
    samples = (bundle / "runs/1.csv").read_text().replace(",nan,", ", ,").replace("\n", "\r\n")
    (bundle / "runs/1.csv").write_text(samples + "\r\n", newline="")
    recording = read_bundle(bundle)
    assert [run.run_id for run in recording.runs()] == ["1", "2", "3"]
    assert np.isnan(recording.samples("1")["laser_1_mm"][300:]).all()
    assert np.isfinite(recording.samples("1")["laser_1_mm"][:300]).all()


def test_numbers_may_be_written_in_any_way(sensing):
    for line, text in ((2, "1e-3"), (3, " 0.001 "), (4, "1.0E-03")):
        sensing.set("runs.csv", line, "theta_deg", text)
    assert {run.conditions["theta_deg"] for run in read_bundle(sensing.write()).runs()} == {0.001}


def test_optional_columns_and_channels_may_be_absent(sensing):
    sensing.toml = 'format = 1\nexperiment = "sensing-axis"\n'
    sensing.table("runs.csv", "run_id,axis,configuration,mounting,theta_deg,frequency_hz", "only,X,flag,1,0.1,0.5")
    sensing.tables = {
        "runs.csv": sensing.tables["runs.csv"],
        "runs/only.csv": [row[:3] for row in sensing.tables["runs/1.csv"]],
    }
    recording = read_bundle(sensing.write())
    (run,) = recording.runs()
    assert run.valid
    assert "valid" not in run.conditions
    assert (recording.header.started, recording.header.channels) == ("", {})
    assert recording.report == ImportReport(1)


def test_keys_of_a_laboratory_s_own_are_kept(sensing, tmp_path):
    sensing.toml += 'serial = "LK 7"\n\n[room]\nbench = 3\nsince = 2020-01-02\nnotes = ["a", "b"]\n'
    recording = read_bundle(sensing.write())
    assert recording.header.extra == {"room": {"bench": 3, "since": "2020-01-02", "notes": ["a", "b"]}}
    assert recording.header.lasers["laser_2_mm"].extra == {"serial": "LK 7"}
    write_bundle(recording, tmp_path / "again")
    assert_same(recording, read_bundle(tmp_path / "again"))


def test_any_text_and_key_survives_toml(tmp_path):
    odd = 'tab\t quote" back\\slash \x7f \x01 line\n π 🛰'
    constants = {"g m/s²": 9.8, 'π."': 1e40, "": -0.0}
    header = Header("sensing-axis", title=odd, constants=constants, extra={odd: {"list": [odd, 1, {"a": True}]}})
    record = RunRecord("1", "1", "import", conditions(1.0), True)
    columns = {name: np.arange(2.0) for name in ("t_s", "stage_x_mm", "accel_v")}
    recording = Recording(header, (record,), {"1": columns}, ImportReport(1))
    write_bundle(recording, tmp_path / "b")
    assert_same(recording, read_bundle(tmp_path / "b"))


def test_start_in_another_time_zone_is_kept_as_utc(sensing):
    sensing.toml = sensing.toml.replace("2026-11-21T01:00:00Z", "2026-11-21T02:00:00.25+01:00")
    assert read_bundle(sensing.write()).header.started == "2026-11-21T01:00:00.250000Z"


names = st.text(min_size=1, max_size=60).filter(lambda s: s.isprintable() and s == s.strip())
run_ids = names.filter(lambda s: not set(s) & set("/\\") and s not in {".", ".."} and len(s.encode()) < 200)
finite = st.floats(-MAGNITUDE_MAX, MAGNITUDE_MAX)
measured = finite | st.just(math.nan)
texts = st.text(max_size=20).filter(lambda s: s == s.strip() and "\r" not in s and s != "")


@st.composite
def recordings(draw):
    """A sensing-axis recording as a campaign or a laboratory may have made it."""
    count = draw(st.integers(1, 3))
    ids = draw(
        st.lists(
            run_ids, min_size=count, max_size=count, unique_by=lambda s: unicodedata.normalize("NFKC", s).casefold()
        )
    )
    reserved = {"t_s", "stage_x_mm", "accel_v", "run_id", "valid", "reason"}
    own = draw(st.lists(names.filter(lambda s: s not in reserved), max_size=2, unique=True))
    note = draw(st.booleans())
    records, columns = [], {}
    for run_id in ids:
        size = draw(st.integers(3, 8))
        conditions = {
            "axis": draw(st.sampled_from("XYZ")),
            "configuration": draw(st.sampled_from(["pendulum", "flag"])),
            "mounting": draw(st.integers(1, 10**6)),
            "theta_deg": draw(st.floats(-360, 360)),
            "frequency_hz": draw(st.floats(1e4, 1e6)),
            "temperature_c": draw(st.floats(-273, 1000) | st.just(math.nan)),
            "own number": draw(measured),
            **({"own text": "text " + draw(texts)} if note else {}),
        }
        valid = draw(st.booleans())
        reason = "door" if not valid else draw(st.sampled_from(["", 'said, "so"']))
        records.append(RunRecord(run_id, run_id, "import", conditions, valid, reason))
        columns[run_id] = {
            "t_s": np.arange(size) * draw(st.floats(1e-3, 1e3)),
            "stage_x_mm": draw(hnp.arrays(np.float64, size, elements=finite)),
            "accel_v": draw(hnp.arrays(np.float64, size, elements=finite)),
            **{name: draw(hnp.arrays(np.float64, size, elements=measured)) for name in own},
        }
    header = Header(
        "sensing-axis",
        title=draw(st.text(max_size=30)),
        started=draw(st.sampled_from(["", "2026-11-21T01:00:00Z", "2026-11-21T01:00:00.123456Z"])),
        constants=draw(st.dictionaries(names, finite, max_size=3)),
        channels=draw(
            st.dictionaries(st.just("accel_v"), st.builds(ChannelInfo, st.just("V"), st.text(max_size=5)), max_size=1)
        ),
        lasers=draw(
            st.dictionaries(names, st.builds(LaserInfo, st.sampled_from(["x", "-z"]), st.floats(-89, 89)), max_size=2)
        ),
        extra=draw(st.dictionaries(st.just("lab"), st.text(max_size=9), max_size=1)),
    )
    return Recording(header, tuple(records), columns, ImportReport(count))


@settings(max_examples=30, deadline=None)
@given(recording=recordings())
def test_any_recording_survives_bundle_store_and_bundle(tmp_path_factory, recording):
    folder = tmp_path_factory.mktemp("round")
    write_bundle(recording, folder / "one")
    with import_bundle(folder / "one", folder / "s.rig.sqlite") as store:
        assert_same(recording, store)
        write_bundle(store, folder / "two")
    assert_same(recording, read_bundle(folder / "two"))


@settings(deadline=None)
@given(
    columns=st.integers(1, 4).flatmap(
        lambda width: hnp.arrays(np.float64, st.tuples(st.integers(0, 9), st.just(width)), elements=measured)
    ),
    missing=st.sampled_from(["", "nan", "NaN", " "]),
)
def test_sample_text_reads_back_bit_for_bit(tmp_path_factory, columns, missing):
    bundle = tmp_path_factory.mktemp("b")
    (bundle / "runs").mkdir()
    (bundle / "recording.toml").write_text('format = 1\nexperiment = "rotating-platform"\n')
    (bundle / "runs.csv").write_text("run_id,pattern,valid\n1,noise,0\n")
    own = {f"c{i}": columns[:, i] for i in range(columns.shape[1])}
    rows = np.arange(float(len(columns)))
    text = csv_bytes({"t_s": rows, "q_a_v": rows, "q_b_v": rows, **own}).decode()
    (bundle / "runs/1.csv").write_text(text.replace("nan", missing))
    samples = read_bundle(bundle).samples("1")
    for name, column in own.items():
        np.testing.assert_array_equal(samples[name], column)
        assert (np.signbit(samples[name]) == np.signbit(column))[~np.isnan(column)].all()


def test_a_night_s_run_is_read_whole(tmp_path):
    rng = np.random.default_rng(0)
    values = np.round(rng.normal(size=(40_000, 6)), 6)
    values[:, 0] = np.arange(40_000) / 1000
    names = ["t_s", "stage_x_mm", "accel_v", "laser_1_mm", "laser_2_mm", "laser_3_mm"]
    (tmp_path / "runs").mkdir()
    (tmp_path / "recording.toml").write_text('format = 1\nexperiment = "sensing-axis"\n')
    (tmp_path / "runs.csv").write_text(
        "run_id,axis,configuration,mounting,theta_deg,frequency_hz\n1,X,flag,1,0.1,0.5\n"
    )
    (tmp_path / "runs/1.csv").write_bytes(csv_bytes({n: values[:, i] for i, n in enumerate(names)}))
    recording = read_bundle(tmp_path)
    for place, name in enumerate(names):
        np.testing.assert_array_equal(recording.samples("1")[name], values[:, place])


def record_two_and_die(store):
    for key in ("a", "b"):
        with store.begin_run(key, "s", conditions(0.5)) as writer:
            writer.append({"t_s": np.arange(300) * 0.01, "stage_x_mm": np.zeros(300)})
            writer.append({"accel_v": np.ones(300)})
            writer.finish()
    cut = store.begin_run("c", "s", conditions(0.5))
    cut.append({"t_s": np.arange(100) * 0.01, "stage_x_mm": np.zeros(100), "accel_v": np.ones(90)})
    store.begin_run("d", "s", conditions(0.5))


def conditions(frequency_hz):
    return {
        "axis": "X",
        "configuration": "flag",
        "mounting": 1,
        "theta_deg": 0.1,
        "frequency_hz": frequency_hz,
    }


@pytest.fixture
def died(tmp_path):
    path = tmp_path / "died.rig.sqlite"
    channels = {name: ChannelInfo() for name in ("accel_v", "laser_1_mm")}
    with Store.create(path, Header("sensing-axis", channels=channels)) as store:
        record_two_and_die(store)
    return path


def test_export_leaves_out_what_was_cut_off(died, tmp_path):
    with Store.open(died, readonly=True) as store:
        write_bundle(store, tmp_path / "out")
    assert [run.run_id for run in read_bundle(tmp_path / "out").runs()] == ["1", "2"]


def test_salvage_brings_what_there_is_of_a_run_that_was_cut_off(died, tmp_path):
    assert salvage_bundle(died, tmp_path / "out").lost == ("run 4: acquiring, without samples",)
    recording = read_bundle(tmp_path / "out")
    assert [(run.run_id, run.valid) for run in recording.runs()] == [("1", True), ("2", True), ("3", False)]
    cut = recording.runs()[2]
    assert cut.reason.startswith("interrupted: cut off; ")
    samples = recording.samples("3")
    assert samples["t_s"].shape == (100,)
    assert np.isnan(samples["accel_v"][90:]).all()
    assert (samples["accel_v"][:90] == 1).all()
    assert np.isnan(samples["laser_1_mm"]).all()


def test_export_never_mixes_with_what_is_there(sensing, tmp_path):
    recording = read_bundle(sensing.write())
    with pytest.raises(DataError, match="night: exists and is not an empty directory; name another"):
        write_bundle(recording, sensing.path)
    (tmp_path / "empty").mkdir()
    write_bundle(recording, tmp_path / "empty")
    assert_same(recording, read_bundle(tmp_path / "empty"))


def test_failed_export_leaves_nothing(died, tmp_path):
    with Store.open(died) as store:
        store._connection.execute("UPDATE samples SET name = 'x' WHERE name = 'accel_v'")
        store._connection.execute("DELETE FROM samples WHERE name = 'x' AND id = (SELECT MAX(id) FROM samples)")
        store._connection.execute("UPDATE samples SET data = X'00' WHERE id = (SELECT MIN(id) FROM samples)")
        with pytest.raises(DamagedStore, match=r"run 1 .*mark"):
            write_bundle(store, tmp_path / "out")
    assert [p.name for p in tmp_path.iterdir()] == ["died.rig.sqlite"]


@pytest.mark.parametrize(
    ("start_s", "ended"),
    # The last valid run sets out two seconds before midnight and takes four; the third is marked invalid.
    [("20.5", "2026-11-21"), (f"{10 + 71 * 3600 - 2}", "2026-11-24"), ("", "2026-11-21"), ("1e30", "2026-11-21")],
)
def test_the_runs_tell_on_which_day_a_recording_ended(sensing, tmp_path, start_s, ended):
    sensing.set("runs.csv", 3, "start_s", start_s)
    sensing.set("runs.csv", 4, "start_s", "9e6")
    with import_bundle(sensing.write(), tmp_path / "s.rig.sqlite") as store:
        assert (first_day(store), last_day(store)) == ("2026-11-21", ended)
        assert last_day(store, "2026-12-01") == "2026-12-01"


def test_recording_names_an_unknown_run(sensing):
    with pytest.raises(DataError, match="no run 9"):
        read_bundle(sensing.write()).samples("9")


def test_npz_can_be_read_by_numpy(tmp_path):
    from rigctl.campaign.bundle.sample_file import npz_bytes

    columns = {"t_s": np.arange(3.0), "file": np.array([1.5, np.nan, -0.0])}
    with np.load(io.BytesIO(npz_bytes(columns)), allow_pickle=False) as archive:
        assert archive.files == ["t_s", "file"]
        np.testing.assert_array_equal(archive["file"], columns["file"])


def test_bundle_may_be_named_with_a_relative_path(sensing, monkeypatch):
    sensing.write()
    monkeypatch.chdir(sensing.path.parent)
    assert len(read_bundle(Path("night")).runs()) == 3


def test_the_file_of_a_run_is_found_without_going_through_those_of_all_runs():
    class Sizes(dict):
        def __iter__(self):
            pytest.fail("with a hundred thousand runs this takes longer than to read them")

    sizes = Sizes({"runs/r1.csv": 8, "runs/r2.csv": 8})
    files = BundleFiles(Path("bundle"), sizes, lambda _: io.BytesIO(b"t_s\n0\n1\n"))
    assert read_sample_file(files, "r2", 2).columns["t_s"].tolist() == [0.0, 1.0]
