import json
import os
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from rigctl.campaign.recording import ChannelInfo, Header, LaserInfo
from rigctl.campaign.store import schema, synced
from rigctl.campaign.store.header_json import header_to_json
from rigctl.campaign.store.store import Store
from rigctl.core.errors import DamagedStore, DataError
from rigctl.core.interfaces import Identity
from rigctl.exchange.frames import run_dataset

HEADER = Header(
    experiment="sensing-axis",
    title="X and Y, Nacht µ",
    started="2026-11-21T01:00:00Z",
    rig_toml='[rig]\nname = "isa"\n',
    world_sha256="ab" * 32,
    seed=7,
    versions={"rigctl": "0.1.0"},
    constants={"g_m_s2": 9.803, "odd": float("inf")},
    channels={"accel_v": ChannelInfo("V", "accelerometer", 4e-4, 10.0, 1e-5, {"serial": "A1"})},
    lasers={"laser_1_mm": LaserInfo("x", 5.0)},
    extra={"table": {"response": "y", "baseline": "a"}, "nested": {"list": [1, 2.5, None]}},
)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "night.rig.sqlite"


@pytest.fixture
def store(path):
    with Store.create(path, HEADER) as store:
        yield store


def record(store, key, columns=None, **finish):
    with store.begin_run(key, "phase 1", {"theta_deg": 0.25}) as writer:
        writer.append({"t_s": np.arange(3.0)} if columns is None else columns)
        return writer.finish(**finish)


def test_header_comes_back_as_it_was_written(store, path):
    with Store.open(path, readonly=True) as reader:
        assert reader.header == HEADER
        assert reader.header.table is not None
        assert reader.header.table.response == "y"


def test_run_carries_what_was_known_at_its_start_and_at_its_end(store):
    finished = record(store, "X 0.25", conditions={"temperature_c": 21.5}, valid=False, reason="saturated")
    assert finished == store.run_by_key("X 0.25")
    assert finished.conditions == {"theta_deg": 0.25, "temperature_c": 21.5}
    assert (finished.run_id, finished.step, finished.valid, finished.reason, finished.state) == (
        "1",
        "phase 1",
        False,
        "saturated",
        "finished",
    )


@settings(max_examples=30, deadline=None)
@given(columns=st.lists(hnp.arrays(np.float64, st.integers(0, 20), elements=st.floats(width=64)), min_size=1))
def test_samples_come_back_bit_for_bit_however_they_were_chunked(tmp_path_factory, columns):
    path = tmp_path_factory.mktemp("store") / "s.rig.sqlite"
    with Store.create(path, HEADER) as store, store.begin_run("k", "s", {}) as writer:
        for chunk in columns:
            writer.append({"a": chunk})
        writer.append({"late": np.concatenate(columns)})
        writer.finish()
        samples = store.samples("1")
    assert samples["a"].tobytes() == np.concatenate(columns).tobytes()
    assert samples["late"].tobytes() == samples["a"].tobytes()


def committed_samples(store, column):
    with Store.open(store.path, readonly=True) as reader:
        return len(reader.samples("1").get(column, ()))


def test_a_stream_is_committed_once_a_second_and_at_the_end(store, monkeypatch):
    now = [100.0]
    monkeypatch.setattr("rigctl.campaign.store.run_writer.time", SimpleNamespace(monotonic=lambda: now[0]))
    seen = []
    with store.begin_run("k", "s", {}) as writer:
        for _ in range(5):
            writer.stream({"a": np.arange(2.0)})
            seen.append(committed_samples(store, "a"))
            now[0] += 0.5
        writer.finish()
    assert seen == [0, 0, 6, 6, 10]
    assert committed_samples(store, "a") == 10


def test_what_streamed_before_an_error_is_kept(store):
    def stream_and_fail(writer):
        writer.stream({"t_s": np.arange(2.0)})
        assert committed_samples(store, "t_s") == 0
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError), store.begin_run("k", "s", {}) as writer:
        stream_and_fail(writer)
    assert committed_samples(store, "t_s") == 2


@pytest.mark.parametrize("hard_links", [True, False])
def test_of_two_makers_of_one_store_the_second_is_refused(tmp_path, monkeypatch, hard_links):
    path = tmp_path / "s.rig.sqlite"
    link = os.link

    def meanwhile(source, target):
        Path(target).write_text("somebody else's")
        if not hard_links:
            raise PermissionError(1, "Operation not permitted")
        link(source, target)

    monkeypatch.setattr(os, "link", meanwhile)
    with pytest.raises(DataError, match="exists already"):
        Store.create(path, HEADER)
    assert path.read_text() == "somebody else's"
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_a_store_is_made_where_there_are_no_hard_links(tmp_path, monkeypatch):
    def refused(*_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "link", refused)
    with Store.create(tmp_path / "s.rig.sqlite", HEADER) as made:
        assert made.header == HEADER


def test_strided_and_integer_columns_are_kept_as_numbers(store):
    record(store, "k", {"t_s": np.arange(6)[::2], "y": np.arange(6.0).reshape(3, 2)[:, 1]})
    samples = store.samples("1")
    np.testing.assert_array_equal(samples["t_s"], [0, 2, 4])
    np.testing.assert_array_equal(samples["y"], [1, 3, 5])


def test_runs_are_numbered_past_names_already_taken(store):
    with store.begin_run("a", "s", {}, run_id="2") as writer:
        writer.finish()
    assert record(store, "b").run_id == "3"
    assert record(store, "c").run_id == "4"


def test_a_key_is_recorded_once(store):
    record(store, "k")
    with pytest.raises(DataError, match="k is recorded already; give the run another key"):
        store.begin_run("k", "s", {})
    assert [r.key for r in store.runs()] == ["k"]


@pytest.mark.parametrize("run_id", ["", " 1", "../x", "a/b", "a\\b", "..", "a\nb", "x" * 201])
def test_run_id_that_cannot_name_a_file_is_refused(store, run_id):
    with pytest.raises(DataError, match="run_id"):
        store.begin_run("k", "s", {}, run_id=run_id)


def test_taken_run_id_is_refused(store):
    record(store, "k")
    with pytest.raises(DataError, match="run 1 exists already"):
        store.begin_run("other", "s", {}, run_id="1")


def acquire_and_fail(writer):
    writer.append({"t_s": np.arange(2.0)})
    raise ZeroDivisionError("boom")


def test_error_inside_a_run_leaves_it_interrupted_with_what_it_has(store):
    with pytest.raises(ZeroDivisionError), store.begin_run("k", "s", {"a": 1}) as writer:
        acquire_and_fail(writer)
    assert store.runs() == []
    assert store.run_by_key("k") is None
    (cut,) = store.interrupted_runs()
    assert (cut.run_id, cut.state, cut.reason) == ("1", "interrupted", "ZeroDivisionError: boom")
    np.testing.assert_array_equal(store.samples("1")["t_s"], [0, 1])


def test_interrupted_key_may_begin_again(store):
    store.begin_run("k", "s", {}).append({"t_s": np.arange(2.0)})
    again = record(store, "k")
    assert again.run_id == "2"
    assert [(r.run_id, r.state, r.reason) for r in store.interrupted_runs()] == [("1", "interrupted", "cut off")]
    assert [r.run_id for r in store.runs()] == ["2"]


def test_run_under_way_is_seen_as_acquiring(store, path):
    store.begin_run("k", "s", {})
    with Store.open(path, readonly=True) as reader:
        assert [r.state for r in reader.interrupted_runs()] == ["acquiring"]


def test_columns_of_different_length_do_not_finish(store):
    with store.begin_run("k", "s", {}) as writer:
        writer.append({"t_s": np.arange(3.0), "accel_v": np.arange(2.0)})
        with pytest.raises(DataError, match=r"run 1: columns differ in length \(t_s 3, accel_v 2\)"):
            writer.finish()
    assert store.runs() == []


def test_ended_run_takes_no_more(store):
    with store.begin_run("k", "s", {}) as writer:
        writer.finish()
        with pytest.raises(DataError, match="run 1 is ended"):
            writer.append({"t_s": np.arange(3.0)})


@pytest.mark.parametrize(
    ("column", "data", "message"),
    [("a\nb", np.zeros(2), "rename the channel"), ("a", np.zeros((2, 2)), r"shape \(2, 2\)")],
)
def test_columns_that_are_none_are_refused(store, column, data, message):
    with store.begin_run("k", "s", {}) as writer:
        with pytest.raises(DataError, match=message):
            writer.append({column: data})
        writer.finish()


def test_mark_changes_validity_and_says_so_in_the_events(store):
    record(store, "k")
    store.mark("1", valid=False, reason="door slammed")
    assert store.runs(valid_only=True) == []
    assert (store.runs()[0].valid, store.runs()[0].reason) == (False, "door slammed")
    assert [e.data for e in store.events("mark")] == [{"run_id": "1", "valid": False, "reason": "door slammed"}]
    store.mark("1", valid=True, reason="")
    assert store.runs(valid_only=True)[0].run_id == "1"


def test_a_store_that_is_filled_is_one_transaction_and_no_note_is_ahead_of_it(tmp_path):
    path = tmp_path / "filled.rig.sqlite"

    def there():
        with closing(sqlite3.connect(path)) as other:
            return other.execute("SELECT COUNT(*) FROM runs").fetchone()[0]

    with Store.create(path, HEADER) as store:
        before = synced.read(path)
        with store.filling():
            record(store, "k0")
            record(store, "k1")
            assert there() == 0
            assert synced.read(path) == before
        assert there() == 2
        record(store, "k2")
        assert synced.read(path) != before
    with Store.open(path, readonly=True) as store:
        assert [run.key for run in store.runs()] == ["k0", "k1", "k2"]


def test_a_run_is_looked_up_without_going_through_all(store, monkeypatch):
    for number in range(3):
        record(store, f"k{number}")
    store.begin_run("k3", "s", {})
    everything = store.runs()
    monkeypatch.setattr(Store, "runs", lambda *_: pytest.fail("with a hundred thousand runs this takes two seconds"))
    assert [store.run(str(number)) for number in (1, 2, 3)] == everything
    assert store.run("4") is store.run("112") is None
    assert run_dataset(store, "2").attrs["theta_deg"] == 0.25


def test_mark_of_an_unknown_run_names_the_nearest(store):
    for i in range(12):
        record(store, f"k{i}")
    with pytest.raises(DataError, match="no run 112; the nearest are 12, 11"):
        store.mark("112", valid=False, reason="?")
    assert store.events() == []


def test_mark_of_an_interrupted_run_is_refused(store):
    store.begin_run("k", "s", {})
    with pytest.raises(DataError, match="run 1 is acquiring"):
        store.mark("1", valid=False, reason="?")


def test_events_keep_their_order_kind_and_rig_time(store):
    store.add_event("once", {"key": "level", "values": np.array([1.0, 2.0])}, rig_time_s=12.5)
    store.add_event("note", {"text": "°"})
    first, second = store.events()
    assert (first.kind, first.rig_time_s, first.data) == ("once", 12.5, {"key": "level", "values": [1.0, 2.0]})
    assert second.rig_time_s is None
    assert store.events("note") == [second]
    assert first.time.endswith("+00:00")


def test_a_reader_in_the_middle_never_holds_up_the_writer(store, path):
    record(store, "before")
    with Store.open(path, readonly=True) as reader:
        reader._connection.execute("BEGIN")
        assert [run.key for run in reader.runs()] == ["before"]
        record(store, "while read")
        assert [run.key for run in reader.runs()] == ["before"]
        reader._connection.execute("COMMIT")
        assert [run.key for run in reader.runs()] == ["before", "while read"]


def test_what_ends_a_run_is_on_stable_storage_and_chunks_do_not_wait_for_it(store):
    statements = []
    with store.begin_run("k", "s", {}) as writer:
        store._connection.set_trace_callback(statements.append)
        writer.append({"t_s": np.arange(2.0)})
        assert not any("synchronous" in text for text in statements)
        writer.finish()
    full = statements.index("PRAGMA synchronous = FULL")
    finished = next(i for i, text in enumerate(statements) if "state = 'finished'" in text)
    commit = statements.index("COMMIT", finished)
    assert full < finished < commit < statements.index("PRAGMA synchronous = NORMAL")
    assert store._connection.execute("PRAGMA synchronous").fetchone() == (1,)


def test_requests_are_taken_once_oldest_first_across_connections(store, path):
    with Store.open(path) as console:
        console.add_request("pause")
        console.add_request("abort")
        assert store.take_request() == "pause"
        assert console.take_request() == "abort"
        assert store.take_request() is None


def test_status_identities_and_documents(store):
    assert store.status() == {}
    store.set_status({"state": "running", "runs_done": 3})
    store.set_status({"state": "done", "runs_done": np.int64(4)})
    assert store.status() == {"state": "done", "runs_done": 4}
    store.set_identity("dmm", Identity("34465A", "MY1", "A.02", "Keysight,34465A"))
    store.set_identity("stage", {"model": "XPS"})
    assert store.identities()["dmm"]["serial"] == "MY1"
    assert list(store.identities()) == ["dmm", "stage"]
    number = store.add_document("fit", {"chi2": float("nan"), "covariance": np.eye(2)})
    (fit,) = store.documents("fit")
    assert (fit.id, fit.data["covariance"]) == (number, [[1.0, 0.0], [0.0, 1.0]])
    assert store.documents("diagnosis") == []


def test_existing_file_is_never_made_into_a_store(path):
    path.write_text("notes")
    with pytest.raises(DataError, match="exists already"):
        Store.create(path, HEADER)
    assert path.read_text() == "notes"


def test_store_cannot_be_made_in_a_missing_directory(tmp_path):
    with pytest.raises(DataError, match="cannot be made"):
        Store.create(tmp_path / "no" / "s.rig.sqlite", HEADER)


def test_missing_store_and_other_files_are_refused_by_name(tmp_path):
    with pytest.raises(DataError, match=r"gone.rig.sqlite: no such store"):
        Store.open(tmp_path / "gone.rig.sqlite")
    text = tmp_path / "text.rig.sqlite"
    text.write_text("not a database, but long enough to be read as one" * 40)
    with pytest.raises(DataError, match="not a campaign store"):
        Store.open(text)
    other = tmp_path / "other.sqlite"
    with sqlite3.connect(other) as connection:
        connection.execute("CREATE TABLE t (a)")
    connection.close()
    data = other.read_bytes()
    for readonly in (True, False):
        with pytest.raises(DataError, match="not a campaign store"):
            Store.open(other, readonly=readonly)
    assert other.read_bytes() == data


def test_reader_cannot_write(store, path):
    record(store, "k")
    with Store.open(path, readonly=True) as reader, pytest.raises(DataError, match="reading only"):
        reader.mark("1", valid=False, reason="?")
    assert store.runs()[0].valid


def test_the_note_beside_a_store_goes_with_its_log_also_where_nothing_can_be_written(store, monkeypatch):
    record(store, "k")
    note = store.path.with_name(store.path.name + "-synced")
    assert note.exists()
    store.close()
    assert not note.exists()

    def refused(*_, **__):
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(Path, "unlink", refused)
    with Store.open(store.path, readonly=True) as reader:
        assert len(reader.runs()) == 1


def test_newer_schema_is_refused_in_one_line(store, path):
    store._connection.execute("PRAGMA user_version = 99")
    with pytest.raises(DataError, match=r"store schema 99 is newer than this program reads \(3\)") as caught:
        Store.open(path)
    assert "\n" not in str(caught.value)


OLDER = (
    "CREATE TABLE header (id INTEGER PRIMARY KEY, title TEXT)",
    "CREATE TABLE notes (text TEXT)",
)
TO_CURRENT = (
    *schema.MIGRATIONS[0][1:],
    "ALTER TABLE header RENAME TO old_header",
    schema.MIGRATIONS[0][0],
    """INSERT INTO header SELECT 1, json_object('experiment', 'table', 'title', title, 'channels',
       json_object(), 'lasers', json_object()) FROM old_header""",
    "INSERT INTO events (time, kind, data) SELECT 'then', 'note', json_object('text', text) FROM notes",
    "DROP TABLE old_header",
    "DROP TABLE notes",
)


@pytest.fixture
def older(path, monkeypatch):
    connection = sqlite3.connect(path)
    connection.execute(f"PRAGMA application_id = {schema.APPLICATION_ID}")
    for statement in OLDER:
        connection.execute(statement)
    connection.execute("INSERT INTO header VALUES (1, 'from before')")
    connection.execute("INSERT INTO notes VALUES ('kept')")
    connection.execute("PRAGMA user_version = 1")
    connection.commit()
    connection.close()
    monkeypatch.setattr(schema, "MIGRATIONS", (OLDER, TO_CURRENT, *schema.MIGRATIONS[1:]))
    monkeypatch.setattr(schema, "READABLE_FROM", 2)
    return path


@pytest.fixture
def without_reductions(path):
    """A store as the program before reductions and checksums made it, with one run."""
    connection = sqlite3.connect(path, isolation_level=None)
    connection.execute(f"PRAGMA application_id = {schema.APPLICATION_ID}")
    schema.migrate(connection, schema.MIGRATIONS[:1])
    connection.execute("INSERT INTO header VALUES (1, ?)", (header_to_json(HEADER),))
    run = "INSERT INTO runs VALUES (1, '1', 'k', 'phase 1', '{}', 'finished', 1, '')"
    connection.execute(run)
    connection.execute(
        "INSERT INTO samples VALUES (?, 't_s', ?)", (schema.first_chunk_id(1), np.arange(3.0).tobytes())
    )
    connection.close()
    return path


def test_store_from_before_reductions_is_read_as_it_is_and_gets_its_table_when_written(without_reductions):
    with Store.open(without_reductions, readonly=True) as reader:
        assert [run.key for run in reader.runs()] == ["k"]
        assert reader.reduced_names("recipe") == set()
    with Store.open(without_reductions) as store:
        store.keep_reductions("recipe", {"1": b"amplitudes"})
        store.keep_reductions("recipe", {"1": b"better", "2": b"others"})
        assert store.reduced_names("recipe") == {"1", "2"}
        assert (store.reduction("recipe", "1"), store.reduction("other", "1")) == (b"better", None)


def test_a_store_from_before_checksums_says_so_until_it_is_written(desk, without_reductions):
    without_reductions.rename(desk.store)
    assert "before checksums were kept" in desk.rigctl("status", desk.store).err
    with Store.open(desk.store) as store:
        assert store.has_checksums
        record(store, "new")
        store._connection.execute("UPDATE samples SET data = X'0000000000000000' WHERE id >> 32 = 1")
        with pytest.raises(DamagedStore, match="run 1"):
            store.samples("1")
    assert desk.rigctl("status", desk.store).err == ""


def test_older_store_is_brought_up_with_what_it_holds(older):
    with Store.open(older) as store:
        assert store.header.title == "from before"
        assert [e.data for e in store.events()] == [{"text": "kept"}]
        record(store, "new")
    with Store.open(older, readonly=True) as reader:
        assert [r.key for r in reader.runs()] == ["new"]


def test_older_store_opened_for_reading_says_what_to_do(older):
    with pytest.raises(DataError, match="older than 4; open it once for writing"):
        Store.open(older, readonly=True)


def test_failing_migration_leaves_the_older_store_as_it_was(older, monkeypatch):
    monkeypatch.setattr(schema, "MIGRATIONS", (OLDER, (*TO_CURRENT, "INSERT INTO nowhere VALUES (1)")))
    with pytest.raises(DamagedStore, match="nowhere"):
        Store.open(older)
    connection = sqlite3.connect(older)
    assert connection.execute("PRAGMA user_version").fetchone() == (1,)
    assert connection.execute("SELECT text FROM notes").fetchall() == [("kept",)]
    connection.close()


def test_damaged_store_is_named_with_its_mend(store, path):
    for i in range(20):
        record(store, f"k{i}", {"t_s": np.arange(2000.0)})
    store.close()
    size = path.stat().st_size
    with path.open("r+b") as file:
        file.seek(8192)
        file.write(b"\xa5" * (size - 8192))
    with pytest.raises(DamagedStore, match=r"night.rig.sqlite: the store is damaged .* --salvage"):
        Store.open(path).runs()


def test_conditions_keep_odd_floats(store):
    odd = {"tiny": 5e-324, "third": 1 / 3, "big": 1.7976931348623157e308, "whole": 3}
    with store.begin_run("k", "s", odd) as writer:
        writer.finish({"missing": float("nan")})
    conditions = store.runs()[0].conditions
    assert {name: conditions[name] for name in odd} == odd
    assert np.isnan(conditions["missing"])
    assert isinstance(conditions["whole"], int)


def test_header_is_json_that_others_can_read(store):
    (text,) = store._connection.execute("SELECT data FROM header").fetchone()
    assert json.loads(text)["title"] == HEADER.title
    assert replace(HEADER, title="") != HEADER


def test_a_store_is_whole_from_the_moment_it_is_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[list[str]] = []
    link = os.link

    def look(source: Path, target: Path) -> None:
        seen.append([path.name for path in tmp_path.iterdir() if not path.name.startswith(".")])
        link(source, target)

    monkeypatch.setattr(os, "link", look)
    Store.create(tmp_path / "x.rig.sqlite", Header("sensing-axis")).close()
    assert seen == [[]]
    assert [path.name for path in tmp_path.iterdir() if path.suffix == ".new"] == []
    with pytest.raises(DataError, match="exists already"):
        Store.create(tmp_path / "x.rig.sqlite", Header("sensing-axis"))
