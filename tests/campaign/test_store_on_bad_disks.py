"""The store on a disk that loses power, is full, refuses or fails."""

import ctypes
import errno
import os
import random
import resource
import shutil
import signal
import threading
from pathlib import Path

import numpy as np
import pytest

from rigctl.campaign.recording import Header
from rigctl.campaign.store import place
from rigctl.campaign.store.store import Store
from rigctl.core.errors import ConfigError, DataError, LimitError, RigError, StorageError
from rigctl.rig import Rig
from tests.reliability import power_cuts
from tests.reliability.file_layer import FULL, IOERR_FSYNC, IOERR_WRITE, OK, READONLY, FileLayer, watched_files


def test_after_a_power_cut_at_any_step_every_finished_run_is_there(tmp_path):
    made, steps, samples = power_cuts.recorded(tmp_path / power_cuts.NAME, 1)
    assert {step.kind for step in steps} == {"write", "truncate", "sync", "note", "said"}
    for at in range(0, len(steps), 29):
        path = tmp_path / str(at) / power_cuts.NAME
        path.parent.mkdir()
        power_cuts.cut(made, steps[:at], path, random.Random(at))
        assert power_cuts.flaw(path, steps[:at], samples) == ""


@pytest.mark.parametrize("kind", ["write", "sync"])
@pytest.mark.parametrize("code", [FULL, READONLY, IOERR_WRITE, IOERR_FSYNC])
def test_a_disk_that_refuses_is_said_in_one_line_and_costs_no_finished_run(tmp_path, kind, code):
    path, rng = tmp_path / "s.rig.sqlite", np.random.default_rng(code)
    Store.create(path, Header("sensing-axis")).close()
    layer, finished = FileLayer(), []

    def write_until_refused(store):
        for number in range(20):
            power_cuts.record(store, number, rng.normal(size=(2, 700)))
            finished.append(f"key {number}")

    refused_at = 40 if kind == "write" else 3
    seen = [0]

    def refuse(step):
        seen[0] += step.kind == kind
        return code if step.kind == kind and seen[0] >= refused_at else OK

    layer.refuse = refuse
    with watched_files(layer):
        with Store.open(path) as store, pytest.raises(RigError) as caught:
            write_until_refused(store)
        layer.refuse = lambda step: OK
    assert isinstance(caught.value, DataError)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert {FULL: "disk is full", READONLY: "reading only"}.get(code, "check the disk") in str(caught.value)
    with Store.open(path) as store:
        assert finished
        assert [run.key for run in store.runs()][: len(finished)] == finished
        power_cuts.record(store, 99, rng.normal(size=(2, 5)))


def test_a_campaign_whose_disk_is_full_stops_the_rig_says_so_and_is_resumed(desk, monkeypatch):
    layer, writes, order = FileLayer(), [0], []
    stop = Rig.stop

    def stopped(rig):
        stop(rig)
        order.append("stop")

    def refuse(step):
        writes[0] += step.kind == "write"
        full = step.kind == "write" and writes[0] > 200
        order.extend(["full"] * full)
        return FULL if full else OK

    layer.refuse = refuse
    monkeypatch.setattr(Rig, "stop", stopped)
    with watched_files(layer):
        ended = desk.rigctl("run", "campaign.toml", "--store", desk.store, "--yes")
    said = f"{desk.store}: the disk is full; free some space, then `rigctl resume`, or give the command again"
    assert (ended.status, ended.err.splitlines()[-1]) == (1, said)
    assert order[-1] == "stop"
    with watched_files(layer):
        for arguments in (["resume", "--yes"], ["mark", "1", "why", "--invalid"]):
            command, *rest = arguments
            again = desk.rigctl(command, desk.store, *rest)
            assert (again.status, again.err.splitlines()[-1]) == (1, said)
    assert desk.rigctl("resume", desk.store, "--yes").status == 0


@pytest.mark.parametrize("kind", [ConfigError, DataError, LimitError])
def test_a_campaign_that_fails_when_something_was_moved_is_no_wrong_usage(desk, wire, monkeypatch, kind):
    begin, begun = Store.begin_run, []

    def refuse_the_third(store, *arguments, **options):
        begun.append(arguments)
        if len(begun) == 3:
            raise kind("run 3: 1.5 Hz is not below the Nyquist frequency")
        return begin(store, *arguments, **options)

    monkeypatch.setattr(Store, "begin_run", refuse_the_third)
    ended = desk.run()
    assert wire.motions
    assert (ended.status, ended.err.splitlines()[-1]) == (1, "run 3: 1.5 Hz is not below the Nyquist frequency")
    assert desk.rigctl("status", desk.store, "--json").json["state"] == "interrupted"


def test_a_file_that_a_full_disk_does_not_take_is_named_with_the_mend(desk, monkeypatch):
    assert desk.run().status == 0

    def full(path, *_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    for method in ("write_bytes", "write_text"):
        monkeypatch.setattr(Path, method, full)
    for arguments in (["export", "out"], ["report", "--out", "r.html"], ["report", "--figures", "figs"]):
        command, *rest = arguments
        told = desk.rigctl(command, desk.store, *rest)
        assert told.status == 1
        assert told.err.splitlines()[-1].startswith(f"{rest[-1]}: ")
        assert told.err.splitlines()[-1].endswith("(No space left on device); free some space")


def test_a_limit_on_the_size_of_files_is_told_where_writing_fails(tmp_path):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    with Store.create(tmp_path / power_cuts.NAME, Header("sensing-axis")) as store:
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, limits[1]))
        try:
            with pytest.raises(
                StorageError, match=r"SQLITE_IOERR_WRITE.*limit of 200000 bytes for a file \(`ulimit -f`"
            ):
                power_cuts.record(store, 1, np.random.default_rng(1).normal(size=(2, 50_000)))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def test_a_disk_that_does_not_come_back_keeps_no_stop_from_the_instruments(desk, monkeypatch):
    layer, stopped, held = FileLayer(), threading.Event(), []
    stop = Rig.stop

    def stop_and_say(rig):
        stop(rig)
        if held:
            stopped.set()

    def hold(step):
        runs_are_measured = sum(earlier.kind == "sync" for earlier in layer.steps) > 20
        if step.kind == "sync" and not held and runs_are_measured:
            held.append(step)
            signal.raise_signal(signal.SIGINT)
            held.append(stopped.wait(20.0))
        return OK

    layer.refuse = hold
    monkeypatch.setattr(Rig, "stop", stop_and_say)
    with watched_files(layer):
        ended = desk.rigctl("run", "campaign.toml", "--store", desk.store, "--yes")
    assert held[1:] == [True]
    assert ended.status == 130
    with Store.open(desk.store) as store:
        assert [run.state for run in store.runs()].count("finished") > 0


PR_CAPBSET_DROP, CAP_DAC_OVERRIDE = 24, 1


def heed_permissions():
    """As for any user, also where tests run as root: which fails, and need not succeed, for any other user."""
    ctypes.CDLL(None).prctl(PR_CAPBSET_DROP, CAP_DAC_OVERRIDE, 0, 0, 0)


@pytest.fixture
def archive(tmp_path):
    """A directory that can only be read, with a finished store and nothing beside it."""
    directory = tmp_path / "archive"
    directory.mkdir()
    path = directory / power_cuts.NAME
    with Store.create(path, Header("sensing-axis", title="kept for ever")) as store:
        power_cuts.record(store, 1, np.random.default_rng(1).normal(size=(2, 700)))
        store.set_status({"state": "done", "step": "", "runs_planned": 1, "eta_s": 0.0}, durable=True)
    assert {each.name for each in directory.iterdir()} == {path.name}
    directory.chmod(0o555)
    yield path
    directory.chmod(0o755)


def test_a_store_on_an_archive_is_read_and_never_written(desk, archive):
    def command(*arguments):
        return desk.end(desk.process(*arguments, preexec_fn=heed_permissions))

    status = command("status", archive, "--json")
    assert (status.status, status.json["runs_done"]) == (0, 1), status.err
    assert command("export", archive, "bundle").status == 0
    assert Path("bundle", "runs", "1.csv").is_file()
    for changing in (("mark", archive, "1", "why", "--invalid"), ("certificate", archive, "--out", "c.html")):
        command(*changing).refused(1, str(archive), "for reading only", "copy the store")
    assert not Path("c.html").exists()
    assert [each.name for each in archive.parent.iterdir()] == [archive.name]


def test_commands_that_keep_what_they_work_out_also_read_an_archive(desk, monkeypatch):
    assert desk.run().status == 0
    fresh = desk.rigctl("fit", desk.store, "--json").json
    # SQLite itself could write here: nothing may be made beside the file.
    Path("archive").mkdir()
    archived = Path("archive", desk.store.name)
    shutil.copy(desk.store, archived)
    read_only(monkeypatch, archived)
    assert desk.rigctl("fit", archived, "--json").json == fresh
    for arguments in (["diagnose"], ["compare"], ["result"], ["report", "--out", "r.html"], ["model", "history"]):
        said = desk.rigctl(*arguments, archived)
        assert said.status == 0, said.err
    desk.rigctl("model", "add", archived, "hysteresis").refused(1, "for reading only", "copy the store")
    assert list(archived.parent.iterdir()) == [archived]


def read_only(monkeypatch, path):
    """The directory of `path`, and what is in it, as permissions say it."""
    access, below = os.access, path.resolve().parent

    def refused(asked, mode):
        return not (mode == os.W_OK and below in (asked, Path(asked).resolve().parent)) and access(asked, mode)

    monkeypatch.setattr(place.os, "access", refused)


def test_changes_in_a_log_that_cannot_be_read_are_not_left_out_without_a_word(archive, monkeypatch):
    read_only(monkeypatch, archive)
    log = archive.with_name(archive.name + "-wal")
    archive.parent.chmod(0o755)
    log.touch()
    assert place.is_archived(archive)
    log.write_bytes(b"the last runs")
    with pytest.raises(StorageError, match=f"its last changes are in {log.name}.*copy both"):
        Store.open(archive, readonly=True)


def test_a_store_at_work_is_read_with_its_log_also_where_the_reader_cannot_write(tmp_path, monkeypatch):
    path = tmp_path / power_cuts.NAME
    with Store.create(path, Header("sensing-axis")) as writer:
        read_only(monkeypatch, path)
        with Store.open(path, readonly=True) as reader:
            seen = reader.commits_seen()
            power_cuts.record(writer, 1, np.zeros((2, 5)))
            assert reader.commits_seen() != seen
            assert len(reader.runs()) == 1
