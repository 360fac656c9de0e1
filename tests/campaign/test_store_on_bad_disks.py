"""The store on a disk that loses power, is full, refuses or fails."""

import random
import signal
import threading

import numpy as np
import pytest

from rigctl.campaign.recording import Header
from rigctl.campaign.store.store import Store
from rigctl.core.errors import DataError, RigError
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
    assert ended.status != 0
    assert ended.err.splitlines()[-1] == f"{desk.store}: the disk is full; free some space, then `rigctl resume`"
    assert order[-1] == "stop"
    assert desk.rigctl("resume", desk.store, "--yes").status == 0


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
