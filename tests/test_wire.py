"""Wire logs of whole rigs: written, read, and replayed to the drivers."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from drivers.wire.lines import READ, SENT, Header, Record
from drivers.wire.reading import WireLog, read_wire_log
from procedures.sensing_axis.bench import Bench
from rigctl import runner
from rigctl.campaign.store.store import Store
from rigctl.core.errors import DataError, LinkError, RigError
from rigctl.files.campaign_file import read_campaign
from rigctl.files.rig_file import RigFile, parse_rig, read_rig
from rigctl.replay import follow, replayed
from rigctl.rig import Rig
from rigctl.serving import Served
from rigctl.wire_view import repeats, shown, text_lines

SHORT = (('["pendulum", "flag"]', '["pendulum"]'), ("noise_check_s = 20.0", "noise_check_s = 0.0"))

Call = tuple[str, tuple[Any, ...], dict[str, Any]]


@dataclass
class Spied:
    """An instrument whose calls from outside are noted."""

    instrument: Any
    calls: list[Call]

    def __post_init__(self) -> None:
        # Calls within calls are the driver's own, and it makes them again.
        self._depth = threading.local()
        for name in dir(type(self.instrument)):
            method = getattr(type(self.instrument), name)
            if name[0] != "_" and callable(method):
                setattr(self.instrument, name, self._noting(name, getattr(self.instrument, name)))

    def _noting(self, name: str, method: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(method)
        def noting(*values: Any, **named: Any) -> Any:
            depth = getattr(self._depth, "value", 0)
            if not depth:
                self.calls.append((name, values, named))
            self._depth.value = depth + 1
            try:
                return method(*values, **named)
            finally:
                self._depth.value = depth

        return noting


@dataclass(frozen=True)
class Measured:
    """A campaign's wire logs, and what its procedure asked of the drivers."""

    file: RigFile
    logs: Mapping[str, Path]
    calls: Mapping[str, list[Call]]
    events: list[Any]


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory, campaigns: Path, small: str) -> Measured:
    """One mounting, two runs and what belongs to them, on the shipped rig."""
    directory = tmp_path_factory.mktemp("measured")
    text = small
    for old, new in SHORT:
        text = text.replace(old, new)
    (directory / "campaign.toml").write_text(text)
    (directory / "rig.toml").write_text((campaigns / "isa-rig.toml").read_text())
    file, calls = read_rig(directory / "rig.toml"), {}
    made: list[Rig] = []

    class SpiedRig(Rig):
        def __init__(self, *values: Any, **named: Any) -> None:
            super().__init__(*values, **named)
            made.append(self)
            for name, instrument in self.instruments.items():
                calls[name] = Spied(instrument, []).calls

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runner, "Rig", SpiedRig)
        options = runner.Options(unattended=True, wire_log=directory / "wire")
        runner.start(read_campaign(directory / "campaign.toml"), file, directory / "x.rig.sqlite", options)
    with Store.open(directory / "x.rig.sqlite", readonly=True) as store:
        events = list(store.events())
    return Measured(file, made[0].wire_logs.files, calls, events)


def repeat(measured: Measured, name: str, log: Path) -> int:
    """Ask of the driver on the log what the campaign asked of it."""
    with replayed(log, measured.file, name) as each:
        for method, values, named in measured.calls[name]:
            came = getattr(each.instrument, method)(*values, **named)
            if isinstance(came, Iterator):
                list(came)
        return each.replay.replayed


@pytest.mark.parametrize("name", ["rotation", "stage", "lasers_a", "lasers_b", "accelerometer", "thermometer"])
def test_a_campaigns_conversation_is_repeated_on_its_log(measured: Measured, name: str) -> None:
    log = read_wire_log(measured.logs[name])
    assert log.header.opening == "in charge"
    assert len(measured.calls[name]) > 10
    assert repeat(measured, name, log.path) == len(log.records) > 20


def test_the_store_says_where_the_logs_are(measured: Measured) -> None:
    (event,) = [event for event in measured.events if event.kind == "wire-logs"]
    assert {name: Path(path) for name, path in event.data["files"].items()} == measured.logs


def changed(log: Path, old: bytes, new: bytes, to: Path) -> Path:
    """The log with its last occurrence of some bytes changed."""
    before, _, after = log.read_bytes().rpartition(old)
    assert before
    to.write_bytes(before + new + after)
    return to


def test_a_changed_byte_of_a_command_fails_in_a_line_that_says_where(measured: Measured, tmp_path: Path) -> None:
    log = changed(
        measured.logs["rotation"], b"GroupMoveAbsolute(Group1,", b"GroupMoveAbsolute(Group2,", tmp_path / "r"
    )
    (record,) = [each for each in read_wire_log(log).records if b"(Group2," in each.data]
    with pytest.raises(DataError) as failed:
        repeat(measured, "rotation", log)
    text = str(failed.value)
    assert len(text.splitlines()) == 1
    assert text.startswith(f"{log}: record {record.number} ({record.at_s:.6f} s): rotation: expected b'GroupMove")
    assert "(Group2," in text
    assert "(Group1," in text.partition(" to be sent; ")[2]


def test_a_changed_byte_of_a_reply_is_found_by_the_driver(measured: Measured, tmp_path: Path) -> None:
    log = changed(measured.logs["rotation"], b",EndOfAPI", b";EndOfAPI", tmp_path / "r")
    with pytest.raises(RigError) as failed:
        repeat(measured, "rotation", log)
    assert len(str(failed.value).splitlines()) == 1


def test_other_settings_send_other_bytes(measured: Measured) -> None:
    text = measured.file.text.replace("speed_deg_s = 10.0", "speed_deg_s = 9.0", 1)
    other = Measured(parse_rig(text, measured.file.path), measured.logs, measured.calls, [])
    with pytest.raises(DataError, match=r"expected b'PositionerSGammaParametersSet\(.*10.* was sent; compare driver"):
        repeat(other, "rotation", measured.logs["rotation"])


def test_a_driver_that_asks_more_than_was_recorded_is_told_where_the_log_ends(measured: Measured) -> None:
    def often() -> None:
        with replayed(measured.logs["thermometer"], measured.file) as each:
            for _ in range(10):
                each.instrument.open()

    with pytest.raises(
        DataError, match=r"thermometer: expected nothing more, the log ends here; a further connection"
    ):
        often()


@contextmanager
def served(rig: Path) -> Iterator[RigFile]:
    """The instruments of a rig file on loopback, and the rig file of a client."""
    with Served(read_rig(rig)) as server:
        serving = threading.Thread(target=server.serve)
        with pytest.MonkeyPatch.context() as patch:
            # Signals are the main thread's, which here is the client's.
            patch.setattr("rigctl.serving._STOPS", ())
            serving.start()
            try:
                yield parse_rig(server.rig_text(), rig)
            finally:
                server.stop()
                serving.join()


def test_over_tcp_and_pseudo_terminals_as_in_this_process(campaigns: Path, tmp_path: Path) -> None:
    with served(campaigns / "all-instruments.rig.toml") as file:
        rig = Rig(file.with_wire_log(tmp_path))
        rig.open()
        try:
            identities = rig.identities()
            rig.moving()
        finally:
            rig.close()
    # The servers have gone: whoever answers now is the log.
    assert set(rig.wire_logs.files) == set(file.instruments)
    for name, path in rig.wire_logs.files.items():
        outcome = follow(path, file)
        assert (outcome.instrument, outcome.identity) == (name, identities[name])
        assert outcome.replayed == outcome.records


def test_what_failed_fails_again_in_the_same_words(campaigns: Path, tmp_path: Path) -> None:
    text = (campaigns / "isa-rig.toml").read_text()
    text += "\n[instruments.rotation.faults.truncated]\nprobability = 1.0\n"
    file = parse_rig(text, tmp_path / "rig.toml").with_wire_log(tmp_path)
    rig = Rig(file)
    with pytest.raises(LinkError) as failed:
        rig.open()
    log = rig.wire_logs.files["rotation"]
    assert {record.kind for record in read_wire_log(log).records} >= {"?", "!"}
    with pytest.raises(LinkError) as again:
        follow(log, file)
    assert str(again.value) == str(failed.value)


def test_a_log_is_read_and_replayed_by_commands(desk: Any) -> None:
    told = desk.rigctl("check", "rig.toml", "--wire-log", "logs", "--json").json["wire_logs"]
    assert {Path(path).parent.name for path in told.values()} == {"logs"}
    log = told["rotation"]
    assert "> FirmwareVersionGet(char *)\n" in desk.rigctl("wire", log).out
    document = desk.rigctl("wire", log, "--json").json
    assert document["header"]["instrument"] == "rotation"
    assert {"kind": ">", "text": "FirmwareVersionGet(char *)"}.items() <= document["records"][2].items()
    assert "XPS-C8" in desk.rigctl("replay", log, "--rig", "rig.toml").out
    outcome = desk.rigctl("replay", log, "--rig", "rig.toml", "--instrument", "rotation", "--json").json
    assert outcome["identity"]["model"] == "XPS-C8"
    assert outcome["replayed"] == outcome["records"] > 5
    text = Path(log).read_text().replace("FirmwareVersionGet(char *)", "FirmwareVersionGet(char*)")
    Path(log).write_text(text)
    desk.rigctl("replay", log, "--rig", "rig.toml").refused(
        2, "record 3", "expected b'FirmwareVersionGet(char*)'", "; b'FirmwareVersionGet(char *)' was sent"
    )


def test_moves_are_logged_as_well_and_the_rig_file_can_say_so(desk: Any) -> None:
    desk.rig(("[rig]\n", '[rig]\nwire_log = "logs"\n'))
    assert desk.rigctl("move", "rig.toml", "rotation", "5").status == 0
    (log,) = (desk.directory / "logs").glob("rotation-*.wire")
    assert any(b"GroupMoveAbsolute(Group1,5" in record.data for record in read_wire_log(log).records)
    outcome = desk.rigctl("replay", log, "--rig", "rig.toml", "--json").json
    # As far as whoever takes charge goes; the move is asked for by the command.
    assert 5 < outcome["replayed"] < outcome["records"]
    assert desk.rigctl("run", "campaign.toml", "--dry-run").status == 0
    assert len(list((desk.directory / "logs").iterdir())) == len(read_rig(desk.directory / "rig.toml").instruments)


def test_a_campaign_that_is_resumed_is_logged_too(desk: Any) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    desk.patch.setattr(Bench, "run", interrupted)
    assert desk.run("--wire-log", "first").status == 130
    assert desk.rigctl("resume", desk.store, "--wire-log", "second").status == 130
    for directory in ("first", "second"):
        (log,) = (desk.directory / directory).glob("stage-*.wire")
        assert any(b"ABORT" in record.data for record in read_wire_log(log).records)
    with Store.open(desk.store, readonly=True) as store:
        named = [Path(event.data["files"]["stage"]).parent.name for event in store.events("wire-logs")]
    assert named == ["first", "second"]


def test_what_cannot_be_is_told_in_a_line_before_anything_is_connected(desk: Any, wire: Any) -> None:
    (desk.directory / "file").write_text("")
    desk.rigctl("check", "rig.toml", "--wire-log", "file/logs").refused(
        2, "file/logs cannot be written", "--wire-log"
    )
    desk.run("--wire-log", "file").refused(2, "the directory file cannot be written")
    desk.rig(("[instruments.lasers_b]", "[instruments.LASERS_A]"))
    desk.rigctl("check", "rig.toml", "--wire-log", "logs").refused(2, "'lasers_a' and 'LASERS_A' would share")
    assert wire.sent == []
    (desk.directory / "bytes").write_bytes(b"SQLite format 3\x00\x90")
    for name in ("rig.toml", "bytes"):
        desk.rigctl("wire", name).refused(
            2, f"{name}: line 1: no wire log; name a file that rigctl wrote as a wire log"
        )


def test_a_stop_needs_no_log(desk: Any) -> None:
    (desk.directory / "file").write_text("")
    desk.rig(("[rig]\n", '[rig]\nwire_log = "file"\n'))
    stopped = desk.rigctl("stop", "rig.toml", "--json")
    assert stopped.json["not_confirmed"] == []
    assert all("the wire log ends here" in line for line in stopped.err.splitlines())


def test_a_log_of_another_instrument_is_refused(desk: Any) -> None:
    told = desk.rigctl("check", "rig.toml", "--wire-log", "logs", "--json").json["wire_logs"]
    replay = functools.partial(desk.rigctl, "replay", told["rotation"], "--rig", "rig.toml", "--instrument")
    replay("stage").refused(2, "instruments.stage.driver is aerotech-ensemble", "of a newport-xps")
    replay("nobody").refused(2, "no instrument 'nobody'", "rotation, stage")


def test_a_replay_ends_where_the_ring_has_written_over(measured: Measured, tmp_path: Path) -> None:
    file = measured.logs["thermometer"].read_bytes().splitlines(keepends=True)
    log = tmp_path / "gap.wire"
    log.write_bytes(b"".join([*file[:30], *file[40:]]))
    with pytest.raises(
        DataError, match=r"after record 29: .*expected nothing more, 10 lines with \d+ bytes are missing"
    ):
        repeat(measured, "thermometer", log)


def log_of(*records: tuple[str, bytes], first: int = 1) -> WireLog:
    header = Header("stage", "aerotech-ensemble", "sim:", "asked", "0.1.0", "", 1 << 20, 1 << 20)
    numbered = [Record(first + n, 0.1 * n, 1, kind, 0, data) for n, (kind, data) in enumerate(records)]
    return WireLog(Path("x"), header, numbered)


def test_repeated_polls_are_folded() -> None:
    poll = [(SENT, b"TP?"), (READ, b"0")] * 50
    _, *lines = text_lines(log_of((SENT, b"MO"), *poll, (SENT, b"ST")))
    assert [line.split(maxsplit=2)[-1] for line in lines] == [
        "> MO",
        "> TP?",
        "< 0",
        "last 2 lines 49 times more, until 10.000000 s",
        "> ST",
    ]
    assert len(list(text_lines(log_of(*poll), full=True))) == 101
    assert repeats(list(log_of(*poll[:4]).records), 0) == (1, 1)


def test_an_answer_read_in_pieces_is_one_line() -> None:
    _, *lines = text_lines(log_of((SENT, b"AXISSTATUS(X)"), (READ, b"%"), (READ, b"7\n"), (SENT, b"a"), (READ, b"%")))
    assert [line[18:] for line in lines] == ["> AXISSTATUS(X)", "< %7\\n", "> a", "< %"]


def test_what_is_missing_and_what_was_masked_is_said() -> None:
    log = log_of((SENT, b"a"), (READ, b"b"))
    behind = Record(12, 3.0, 1, READ, 102, b"cc", masked=True)
    lines = list(text_lines(WireLog(log.path, log.header, [*log.records, behind])))
    assert lines[1] == "masked when it was written: secrets in 1 lines, shown as ***"
    assert "[9 lines with 100 bytes are missing here, 0.100000 to 3.000000 s]" in lines[-2]


def test_text_is_shown_with_escapes_and_numbers_as_numbers() -> None:
    assert shown(b"1PA10\r\n") == "1PA10\\r\\n"
    assert shown(bytes(range(4))) == "hex 00 01 02 03"
    assert shown(b"x" * 200) == "x" * 160 + " ... (200 bytes)"
    assert shown(b"x" * 200, full=True) == "x" * 200
    assert shown(b"") == ""


def test_what_a_check_has_asked_is_replayed_of_every_instrument(desk: Any) -> None:
    desk.rig(of="all-instruments.rig.toml")
    told = desk.rigctl("check", "rig.toml", "--wire-log", "logs", "--json").json
    for name, log in told["wire_logs"].items():
        again = desk.rigctl("replay", log, "--rig", "rig.toml", "--instrument", name, "--json").json
        assert again["identity"] == told["instruments"][name]
        assert again["replayed"] == again["records"], name
