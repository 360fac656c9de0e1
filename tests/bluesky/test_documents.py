"""Stores as documents: valid by the event model's own schemas, every number, each run once, also while it runs."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import event_model
import numpy as np
import pytest

from rigctl import Campaign, Store
from rigctl.bluesky import documents
from rigctl.campaign.recording import OWN_CLOCK, ChannelInfo, Header
from rigctl.campaign.session.locks import held, store_lock
from rigctl.core.errors import DamagedStore, DataError, RigError

T_S, PAGE_ROWS = np.arange(121) / 100.0, 50


@pytest.fixture(autouse=True)
def small_pages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rigctl.bluesky.campaign_documents.PAGE_ROWS", PAGE_ROWS)


@dataclass
class Read:
    """Documents put together again as any reader of them would; each is held to its schema, of pages the first."""

    start: dict[str, Any] = field(default_factory=dict)
    stop: dict[str, Any] = field(default_factory=dict)
    streams: dict[str, dict[str, Any]] = field(default_factory=dict)
    rows: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    pages: list[int] = field(default_factory=list)

    def take(self, found: Iterable[tuple[str, dict[str, Any]]]) -> Read:
        for name, document in found:
            # A whole campaign's pages, number by number, would take the schema's validator half a minute.
            if name != "event_page" or document["seq_num"][0] == 1:
                event_model.schema_validators[event_model.DocumentNames[name]].validate(document)
            if name in {"start", "stop"}:
                assert not getattr(self, name)
                setattr(self, name, document)
            elif name == "descriptor":
                assert document["run_start"] == self.start["uid"]
                self.streams[document["uid"]] = document
                self.rows[document["name"]] = []
            else:
                self._take_events(document if name == "event_page" else event_model.pack_event_page(document))
        return self

    def _take_events(self, page: dict[str, Any]) -> None:
        stream = self.streams[page["descriptor"]]
        assert page["data"].keys() == stream["data_keys"].keys()
        rows = self.rows[stream["name"]]
        self.pages.append(len(page["seq_num"]))
        for event in event_model.unpack_event_page(page):
            assert event["seq_num"] == len(rows) + 1
            rows.append({**event["data"], "time": event["time"], "uid": event["uid"]})

    def column(self, stream: str, name: str, run_id: str = "") -> list[Any]:
        """Of all streams whose names begin so."""
        rows = (row for each, rows in self.rows.items() if each.startswith(stream) for row in rows)
        return [row[name] for row in rows if name in row and run_id in ("", row["run_id"])]


@contextmanager
def small_store(path: Path) -> Iterator[Store]:
    """Two runs of a long record, one of them with another condition and a channel on a clock of its own."""
    header = Header(
        experiment="sensing-axis",
        title="two runs",
        started="2026-11-21T01:00:00Z",
        rig_toml="[rig]\n",
        constants={"g_m_s2": 9.803},
        channels={"accel_v": ChannelInfo(unit="V"), "laser_1_mm": ChannelInfo(unit="mm", clock=OWN_CLOCK)},
    )
    with Store.create(path, header) as store:
        store.set_identity("rotation", {"model": "XPS-C8", "serial": "7", "firmware": "", "text": ""})
        add_run(store, "a", theta_deg=0.5)
        add_run(
            store, "b", theta_deg=-0.5, room="cold", at={"laser_1_mm": T_S[:50], "laser_1_mm.t_s": T_S[:50] + 0.3}
        )
        store.set_status({"state": "done", "step": "", "runs_planned": 2, "eta_s": 0.0})
        yield store


def add_run(store: Store, key: str, at: dict[str, Any] | None = None, **conditions: Any) -> None:
    with store.begin_run(key, "step", {"start_s": 10.0, **conditions}) as writer:
        for part in (slice(0, 70), slice(70, None)):
            writer.stream({"t_s": T_S[part], "accel_v": np.sin(T_S[part])})
        if at:
            writer.stream(at)
        writer.finish({}, valid=key != "b", reason="a door" if key == "b" else "", rig_time_s=140.0)


def test_documents_hold_what_the_store_holds(tmp_path: Path) -> None:
    with small_store(tmp_path / "x.rig.sqlite"):
        pass
    read = Read().take(documents(tmp_path / "x.rig.sqlite"))
    assert read.start["title"] == "two runs"
    assert read.start["time"] == 1795222800.0
    assert (read.start["rig_toml"], read.start["constants"]) == ("[rig]\n", {"g_m_s2": 9.803})
    first, second = read.rows["runs"] + read.rows["runs_2"]
    assert (first["run_id"], first["theta_deg"], first["valid"], first["reason"]) == ("1", 0.5, True, "")
    assert (second["run_id"], second["room"], second["valid"], second["reason"]) == ("2", "cold", False, "a door")
    for run_id in "12":
        assert read.column("samples", "t_s", run_id=run_id) == T_S.tolist()
        assert read.column("samples", "accel_v", run_id=run_id) == np.sin(T_S).tolist()
    assert read.column("samples_laser_1_mm", "laser_1_mm") == T_S[:50].tolist()
    assert read.column("samples_laser_1_mm", "laser_1_mm_t_s") == (T_S[:50] + 0.3).tolist()
    # The rig's clock said 140 s at the run's end, and 10 s at its start.
    began_s = first["time"] - 130.0
    assert read.column("samples", "time", run_id="1") == pytest.approx((began_s + T_S).tolist(), abs=1e-6)
    assert max(read.pages) == PAGE_ROWS
    assert read.stop["exit_status"] == "success"
    assert read.stop["num_events"] == {name: len(rows) for name, rows in read.rows.items()}
    descriptors = {each["name"]: each for each in read.streams.values()}
    assert descriptors["samples"]["data_keys"]["accel_v"]["units"] == "V"
    assert descriptors["runs"]["data_keys"]["theta_deg"]["units"] == "deg"
    assert descriptors["runs"]["configuration"]["rigctl"]["data"]["rotation_model"] == "XPS-C8"
    uids = [row["uid"] for rows in read.rows.values() for row in rows]
    assert len(set(uids)) == len(uids)


def test_a_store_read_again_gives_the_same_documents(tmp_path: Path) -> None:
    with small_store(tmp_path / "x.rig.sqlite"):
        pass
    first = list(documents(tmp_path / "x.rig.sqlite"))
    (tmp_path / "x.rig.sqlite").rename(tmp_path / "moved.rig.sqlite")
    again = list(documents(tmp_path / "moved.rig.sqlite"))
    assert [document.get("uid") for _, document in again] == [document.get("uid") for _, document in first]


def test_columns_and_constants_of_any_name_are_keys(tmp_path: Path) -> None:
    header = Header(experiment="table", constants={"a/b.c": 1.0})
    with Store.create(tmp_path / "x.rig.sqlite", header) as store, store.begin_run("a", "", {"words": ["x"]}) as run:
        run.stream({"p/q": T_S[:1], "p.q": T_S[1:2]})
        run.finish({})
    read = Read().take(documents(tmp_path / "x.rig.sqlite"))
    (row,) = read.rows["samples"]
    assert (row["p_q"], row["p_q_2"]) == (0.0, 0.01)
    assert read.start["constants"] == {"a_b_c": 1.0}
    assert read.rows["runs"][0]["words"] == ["x"]


def test_a_campaign_is_followed_while_it_runs(campaigns: Path, tmp_path: Path, small: str) -> None:
    store_path = tmp_path / "x.rig.sqlite"
    (tmp_path / "campaign.toml").write_text(small)
    campaign = Campaign(tmp_path / "campaign.toml", campaigns / "isa-rig.toml")
    running = threading.Thread(target=campaign.run, args=[store_path], kwargs={"unattended": True})
    running.start()
    while not store_path.exists() and running.is_alive():
        running.join(0.005)
    followed, in_sight_early = Read(), 0
    for name, document in documents(store_path, follow=True, look_s=0.01):
        followed.take([(name, document)])
        in_sight_early += name == "event" and running.is_alive()
    running.join()
    assert in_sight_early > 2
    with Store.open(store_path, readonly=True) as store:
        runs = store.runs()
        seen = Counter(row["run_id"] for stream, rows in followed.rows.items() if "runs" in stream for row in rows)
        assert seen == dict.fromkeys((run.run_id for run in runs), 1)
        for name, column in store.samples(runs[-1].run_id).items():
            assert followed.column("samples", name.replace(".", "_"), run_id=runs[-1].run_id) == column.tolist()
    assert followed.stop["exit_status"] == "success"
    # The same as afterwards.
    replayed = Read().take(documents(store_path))
    assert replayed.rows == followed.rows
    assert replayed.start == followed.start


def test_a_mark_behind_a_followed_run_goes_out_too(tmp_path: Path) -> None:
    path = tmp_path / "x.rig.sqlite"
    with small_store(path) as store, held(store_lock(path), "held"):
        found = documents(path, follow=True, look_s=0.01)
        before = [next(found) for _ in range(3)]
        assert [name for name, _ in before] == ["start", "descriptor", "event"]
        store.mark("1", False, "doubtful")
        store.mark("2", False, "a door")  # as it was told already
        marks: list[dict[str, Any]] = []
        for name, document in found:
            if name == "event" and "room" not in document["data"]:
                marks.append(document["data"])
                break
    assert marks == [{"run_id": "1", "valid": False, "reason": "doubtful"}]
    found.close()
    replayed = Read().take(documents(path))
    assert "marks" not in replayed.rows
    assert replayed.rows["runs"][0]["reason"] == "doubtful"


@pytest.mark.parametrize(
    ("state", "kind", "data", "expected"),
    [
        ("aborted", "aborted", {"reason": "interrupted by SIGINT"}, ("abort", "aborted: interrupted by SIGINT")),
        ("interrupted", "failed", {"error": "stage: gone"}, ("fail", "interrupted: stage: gone")),
        ("running", "note", {}, ("fail", "interrupted")),  # killed: nobody holds the store
    ],
)
def test_how_a_campaign_ended_is_in_its_stop(
    tmp_path: Path, state: str, kind: str, data: dict[str, str], expected: tuple[str, str]
) -> None:
    with small_store(tmp_path / "x.rig.sqlite") as store:
        store.set_status({**store.status(), "state": state})
        store.add_event(kind, data)
    stop = Read().take(documents(tmp_path / "x.rig.sqlite")).stop
    assert (stop["exit_status"], stop["reason"]) == expected


def test_what_cannot_be_read_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "x.rig.sqlite"
    with pytest.raises(DataError, match=r"x\.rig\.sqlite") as missing:
        next(documents(path))
    with small_store(path), held(store_lock(path), "held"), pytest.raises(RigError) as running:
        next(documents(path))
    assert "a campaign is running on it; follow it, or wait until it has ended" in str(running.value)
    data = path.read_bytes()
    value = np.sin(T_S[80:81]).tobytes()
    assert data.count(value) == 2
    path.write_bytes(data.replace(value, b"\0" * 8))
    with pytest.raises(DamagedStore, match="the samples of run 1 are not as they were written") as damaged:
        list(documents(path))
    assert not any("\n" in str(each.value) for each in (missing, running, damaged))
