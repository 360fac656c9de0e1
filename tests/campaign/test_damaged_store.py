"""Damage in a store: named with its mend, or without effect; what is as it was written is saved."""

import sqlite3

import numpy as np
import pytest

from rigctl.campaign.bundle.bundle import read_bundle, salvage_bundle
from rigctl.campaign.store.store import Store
from rigctl.core.errors import DamagedStore, DataError
from tests.reliability import damaged_stores
from tests.reliability.damaged_stores import HARMLESS, SILENT, told, verdict


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    path = tmp_path_factory.mktemp("made") / "s.rig.sqlite"
    damaged_stores.make(path, 1, unclean=False)
    return path.read_bytes(), told(path)


@pytest.fixture
def path(made, tmp_path):
    path = tmp_path / "s.rig.sqlite"
    path.write_bytes(made[0])
    return path


def flip(path, at, bit=0):
    data = bytearray(path.read_bytes())
    data[at] ^= 1 << bit
    path.write_bytes(data)


def places(data, pattern):
    found = [at for at in range(len(data)) if data.startswith(pattern, at)]
    assert found, pattern
    return found


@pytest.mark.parametrize(
    ("pattern", "message"),
    [
        (b'{"experiment":"sens', "the header is not as it was written"),
        (b'"theta_deg":0.25', r"run \d+ is not as it was written"),
        (b"finisheddoor", "run 3 is not as it was written"),
        (b'{"key":"level"', "row 1 of the table events"),
        (b'{"axes":[', "row 1 of the table documents"),
        (b'{"model":"34465A"', "row dmm of the table identities"),
        (b'{"state":"done"', "the status is not as it was written"),
        (b"samples (id INTEGER", "the store is damaged"),
    ],
)
def test_a_flipped_bit_in_any_row_is_named(path, made, pattern, message):
    flip(path, places(made[0], pattern)[0] + 4)
    with pytest.raises(DamagedStore, match=message):
        told(path)


def test_a_flipped_bit_in_samples_names_run_column_and_mend(path, made):
    for run_id in ("1", "2"):  # in one of them a chunk goes on on pages of its own
        first = dict(made[1]["samples"][int(run_id) - 1])["accel_v"]
        flip(path, places(made[0], first[40:80])[0], bit=3)
    with Store.open(path) as store:
        for run_id in ("1", "2"):
            with pytest.raises(
                DamagedStore, match=rf"run {run_id} .*\(accel_v\); .*mark .* {run_id} REASON --invalid"
            ):
                store.samples(run_id)
            with pytest.raises(DamagedStore, match=f"run {run_id}"):
                next(store.sample_chunks(run_id))
            store.mark(run_id, valid=False, reason="damaged")
        for run in store.runs(valid_only=True):
            store.samples(run.run_id)


def test_no_bit_of_the_first_page_and_none_of_an_index_changes_anything_unsaid(path, made, tmp_path):
    keys = [at + 2 for at in places(made[0], b"X 13")]
    for at in [*range(16, 100), *keys]:
        path.write_bytes(made[0])
        flip(path, at, bit=at % 8)
        found = verdict(path, made[1])
        assert found["failed"] == "", (at, found)


def test_a_damaged_index_of_keys_stops_what_looks_for_a_key_and_nothing_else(path, made):
    (at, *_) = places(made[0], b"X 13")
    flip(path, at + 2)
    with Store.open(path) as store:
        store.mark("2", valid=False, reason="door")
        for look in (lambda: store.run_by_key("X 1"), lambda: store.begin_run("X 99", "", {})):
            with pytest.raises(DamagedStore, match="export --salvage"):
                look()


@pytest.mark.parametrize(("byte", "damaged"), [(5, 11), (5, 113), (3, ord("9"))], ids=["another", "none", "lost"])
def test_an_index_of_names_that_leads_to_another_run_or_nowhere_marks_no_other(path, made, byte, damaged):
    # An entry of the index: lengths of its header, of the name and of the number, then these.
    (at,) = places(made[0], b"\x03\x11\x0112\x0c")
    data = bytearray(path.read_bytes())
    data[at + byte] = damaged
    path.write_bytes(data)
    with Store.open(path) as store:
        if damaged == ord("9"):
            store.mark("12", valid=False, reason="door")
            assert [run.run_id for run in store.runs() if not run.valid] == ["3", "12"]
            return
        with pytest.raises(DamagedStore):
            store.mark("12", valid=False, reason="door")
        assert [run.run_id for run in store.runs() if not run.valid] == ["3"]


ODD = {
    "a row of another run": "UPDATE runs SET conditions = (SELECT conditions FROM runs WHERE number = 5), "
    "sum = (SELECT sum FROM runs WHERE number = 5) WHERE number = 4",
    "runs that are gone": "DELETE FROM runs WHERE number > 12",
    "an answer that is gone": "DELETE FROM events WHERE id = 1",
    "a fit that is gone": "DELETE FROM documents",
    "samples of another run": "UPDATE samples SET id = id + (1 << 40) WHERE id >> 32 = 2",
    "a chunk that is gone": "DELETE FROM samples WHERE id = (2 << 32)",
    "a mark that is undone": "UPDATE runs SET valid = 1 WHERE run_id = '3'",
    "a value of another type": "UPDATE runs SET reason = X'00' WHERE run_id = '3'",
    "columns in another order": "UPDATE samples SET name = CASE name WHEN 't_s' THEN 'accel_v' ELSE 't_s' END "
    "WHERE name IN ('t_s', 'accel_v')",
}


@pytest.mark.parametrize("statement", ODD.values(), ids=ODD)
def test_what_is_whole_but_not_what_was_written_is_named(path, made, statement):
    connection = sqlite3.connect(path)
    connection.execute(statement)
    connection.commit()
    connection.close()
    assert verdict(path, made[1])["outcome"] == "named"


def test_a_damaged_reduction_is_worked_out_again(path, made):
    flip(path, places(made[0], made[1]["reductions"]["7"])[0] + 50)
    with Store.open(path) as store:
        assert store.reduction("sines 1", "7") is None
        assert store.reduced_names("sines 1") == {name for name in made[1]["reductions"] if name != "7"}
        store.keep_reductions("sines 1", {"7": b"again"})
        assert store.reduction("sines 1", "7") == b"again"


@pytest.mark.parametrize("left", [None, 0, 0.5, 0.9])
def test_a_log_that_is_cut_or_gone_is_named_and_what_it_still_holds_is_saved(tmp_path, left):
    path = tmp_path / "s.rig.sqlite"
    damaged_stores.make(path, 2, unclean=True)
    truth = told(path)
    wal = path.with_name(path.name + "-wal")
    data = wal.read_bytes()
    wal.unlink() if left is None else wal.write_bytes(data[: int(left * len(data))])
    for readonly in (True, False):
        with pytest.raises(DamagedStore, match="write-ahead log"):
            Store.open(path, readonly=readonly)
    assert left is None or wal.read_bytes() == data[: int(left * len(data))]
    saved, wrong = damaged_stores.salvaged(path, truth)
    assert not wrong
    assert saved >= {None: 1, 0: 1, 0.5: 5, 0.9: 10}[left]


def test_without_its_note_a_store_opens_as_far_as_it_goes(tmp_path):
    path = tmp_path / "s.rig.sqlite"
    damaged_stores.make(path, 2, unclean=True)
    path.with_name(path.name + "-wal").unlink()
    path.with_name(path.name + "-synced").unlink()
    with Store.open(path) as store:
        assert 0 < len(store.runs()) < damaged_stores.RUNS


def test_salvage_of_a_store_that_is_whole_is_its_export(path, made, tmp_path):
    found = salvage_bundle(path, tmp_path / "out")
    assert found.lost == ()
    assert found.saved == tuple(str(number) for number in range(1, damaged_stores.RUNS + 2))
    assert damaged_stores.salvaged(path, made[1]) == (damaged_stores.RUNS, "")


@pytest.mark.parametrize(("cut", "least"), [(0.0001, 0), (0.3, 0), (0.7, 5), (0.999, 13)])
def test_salvage_of_a_store_that_lost_its_end(path, made, cut, least):
    path.write_bytes(made[0][: int(cut * len(made[0]))])
    assert verdict(path, made[1])["outcome"] == "named"
    saved, wrong = damaged_stores.salvaged(path, made[1])
    assert not wrong
    assert saved >= least


def test_salvage_without_the_first_page_guesses_the_experiment_and_says_so(path, made, tmp_path):
    pages = len(made[0]) // 4096
    header = places(made[0], b'{"experiment":"sens')[0] // 4096
    path.write_bytes(b"".join(bytes(4096) if n in {0, header} else made[0][n * 4096 :][:4096] for n in range(pages)))
    with pytest.raises(DataError, match="salvage"):
        Store.open(path)
    found = salvage_bundle(path, tmp_path / "out")
    assert len(found.saved) == damaged_stores.RUNS + 1
    assert "the header was lost" in found.lost[0]
    assert "salvaged = " in (tmp_path / "out/recording.toml").read_text()
    recording = read_bundle(tmp_path / "out")
    assert recording.header.experiment == "sensing-axis"
    np.testing.assert_array_equal(
        recording.samples("2")["accel_v"], np.frombuffer(dict(made[1]["samples"][1])["accel_v"])
    )


def test_commands_name_the_damage_in_one_line_and_save_the_rest(desk, made):
    desk.store.write_bytes(made[0])
    flip(desk.store, places(made[0], dict(made[1]["samples"][4])["t_s"][:40])[0] + 7)
    desk.rigctl("export", desk.store, desk.directory / "out").refused(1, "run 5", "t_s", "--invalid")
    saved = desk.rigctl("export", desk.store, desk.directory / "out", "--salvage", "--json")
    assert saved.status == 0
    assert saved.json["lost"] == ["run 5: its samples are not as they were written (t_s)"]
    assert "5" not in saved.json["saved"]
    assert len(saved.json["saved"]) == damaged_stores.RUNS


def test_fixed_trials_are_never_silent(tmp_path):
    outcomes = []
    for seed in range(1, 13):
        (tmp_path / str(seed)).mkdir()
        found = damaged_stores.trial(seed, tmp_path / str(seed))
        assert found["failed"] == "", found
        outcomes.append(found["outcome"])
    assert SILENT not in outcomes
    assert {"named", HARMLESS} == set(outcomes)
