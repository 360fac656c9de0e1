"""Wire logs: any bytes come back, what is missing is told to the byte, a killed process leaves a readable file."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.connect import connector, serial_ways
from drivers.transport_serial import SerialSettings
from drivers.wire.lines import BYTES, CLOSED, OPENED, READ, SENT, UNASKED, Header, Record, line_of
from drivers.wire.logged import LoggedConnect, LoggedTransport, WireLogger
from drivers.wire.reading import WireLog, read_wire_log
from drivers.wire.ring import RingFile
from drivers.wire.secrets import MASK, address_without_secret
from rigctl.core.clock import RealClock
from rigctl.core.errors import DataError, LinkLost, LinkTimeout

HEADER = Header("rotation", "newport-xps", "tcp://192.168.0.254:5001", "asked", "0.1.0", "", 1 << 20, 1 << 20)
SMALL = Header("rotation", "newport-xps", "", "asked", "0.1.0", "", 512, 2048)


@dataclass
class Still:
    """A clock that is set."""

    at_s: float = 0.0
    speed: float = 1.0

    def now_s(self) -> float:
        return self.at_s

    def sleep_s(self, duration_s: float) -> None:
        self.at_s += duration_s


class Line:
    """A transport that gives what it was given."""

    address = "test"
    guarded = True

    def __init__(self, *pieces: bytes | Exception) -> None:
        self.pieces = list(pieces)

    def write(self, data: bytes) -> None: ...

    def read_until(self, terminator: bytes, timeout_s: float) -> bytes:
        return self.unread()

    def read_exactly(self, count: int, timeout_s: float) -> bytes:
        return self.unread()

    def unread(self) -> bytes:
        piece = self.pieces.pop(0)
        if isinstance(piece, Exception):
            raise piece
        return piece

    def close(self) -> None: ...


def logger(directory: Path, header: Header = HEADER, secrets: Iterable[str] = ()) -> WireLogger:
    return WireLogger(directory, header, Still(), secrets)


def log_of(made: WireLogger) -> WireLog:
    assert made.path is not None
    return read_wire_log(made.path)


def said(records: Iterable[Record]) -> list[tuple[str, bytes]]:
    return [(record.kind, record.data) for record in records]


@given(st.lists(st.tuples(st.sampled_from([SENT, READ, UNASKED]), st.binary(min_size=1, max_size=200)), max_size=30))
def test_any_bytes_come_back(pieces: list[tuple[str, bytes]]) -> None:
    with TemporaryDirectory() as name:
        made = logger(Path(name))
        made.happened(1, OPENED, "guarded")
        for kind, data in pieces:
            if kind == SENT:
                made.sent(1, data)
            else:
                made.came(1, data, kind)
        log = log_of(made)
    # Random bytes can say "password"; that is another test's.
    if not log.masked:
        assert said(log.records[1:]) == pieces
    assert log.gaps() == {}
    assert log.header.instrument == "rotation"


@given(st.lists(st.binary(min_size=20, max_size=90), min_size=1, max_size=120))
def test_of_a_long_log_beginning_and_end_are_there_and_what_is_missing_is_told(pieces: list[bytes]) -> None:
    with TemporaryDirectory() as name:
        made = logger(Path(name), SMALL)
        for data in pieces:
            made.came(1, data)
        log, size = log_of(made), made.path.stat().st_size  # type: ignore[union-attr]
    assert size <= SMALL.head_bytes + SMALL.ring_bytes
    # What a line may hold is a part of the ring: a piece can be several records.
    numbers = [record.number for record in log.records]
    assert numbers == sorted(set(numbers))
    total = sum(map(len, pieces))
    assert log.records[-1].total == total
    missing = sum(gap.wire_bytes for gap in log.gaps().values())
    assert sum(len(record.data) for record in log.records) + missing == total
    assert b"".join(record.data for record in log.contiguous) == b"".join(pieces)[: log.contiguous[-1].total]
    assert len(log.gaps()) <= 1
    for number, gap in log.gaps().items():
        assert gap.lines == number - len(log.contiguous) - 1
        behind = [record for record in log.records if record.number >= number]
        assert (
            b"".join(record.data for record in behind) == b"".join(pieces)[total - sum(len(r.data) for r in behind) :]
        )
        # Nothing is written over before its time: all of the ring but two lines is there.
        kept = sum(len(line_of(r.number, r.at_s, 1, READ, r.total, r.data)) for r in behind)
        assert kept >= SMALL.ring_bytes - 2 * 180


@given(st.integers(0, 100), st.integers(0, 90))
def test_a_line_that_was_cut_off_is_left_out_also_where_it_writes_over_others(count: int, cut: int) -> None:
    with TemporaryDirectory() as name:
        path = Path(name) / "torn.wire"
        file = RingFile(path, SMALL.head_bytes, SMALL.ring_bytes)
        file.append(SMALL.line())
        for number in range(1, count + 1):
            file.append(line_of(number, 0.1 * number, 1, READ, 9 * number, b"%09d" % number))
        torn = line_of(count + 1, 0.1 * count, 1, READ, 9 * count + 9, b"0123456789" * 7)[:-1]
        # With its last character the record is whole: only the end of the line is missing then.
        file.append(torn[: min(cut, len(torn) - 1)])
        file.close()
        log = read_wire_log(path)
    assert [int(record.data) for record in log.records] == [record.number for record in log.records]
    assert log.records[-1:] == [] if count == 0 else log.records[-1].number == count


def test_a_killed_process_leaves_a_readable_log(tmp_path: Path) -> None:
    program = (
        "import os, signal, sys; from pathlib import Path; from drivers.wire.lines import Header; "
        "from drivers.wire.logged import WireLogger; from rigctl.core.clock import RealClock; "
        f"log = WireLogger(Path({str(tmp_path)!r}), {HEADER!r}, RealClock()); "
        "[log.sent(1, b'TP?%d' % n) for n in range(1000)]; os.kill(os.getpid(), signal.SIGKILL)"
    )
    ended = subprocess.run([sys.executable, "-c", program], check=False)
    assert ended.returncode == -signal.SIGKILL
    (path,) = tmp_path.iterdir()
    assert [record.data for record in read_wire_log(path).records] == [b"TP?%d" % n for n in range(1000)]


@given(st.text("QXZ#%$^!?\\", min_size=4, max_size=20), st.integers(0, 60))
def test_a_password_is_not_in_the_file_nor_in_what_the_instrument_repeats(password: str, cut: int) -> None:
    command = f"Login(Admin, {password})".encode()
    echo = b"-106," + command + b",EndOfAPI"
    with TemporaryDirectory() as name:
        made = logger(Path(name))
        line = LoggedTransport(Line(echo[:cut], echo[cut:], b"0,late " + password.encode()), made, 1)
        line.write(command)
        came = line.read_exactly(cut, 1.0) + line.read_until(b"I", 1.0)
        line.write(b"GroupStatusGet(G,int *)")
        assert line.unread() == b"0,late " + password.encode()
        line.close()
        log = log_of(made)
    assert came == echo
    assert password.encode() not in b"".join(record.data for record in log.records)
    assert said(log.records)[:2] == [
        (SENT, b"Login(Admin, ***)"),
        (READ, b"-106,Login(Admin, ***),EndOfAPI"),
    ]
    assert len(log.masked) == 3


@pytest.mark.parametrize(
    ("command", "masked"),
    [
        (b"Login(Administrator,Administrator)", b"Login(***,***)"),
        (b"Login(Admin,hunter(2)", b"Login(Admin,***)"),
        (b"Login(Admin,hunt", b"Login(Admin,***"),
        (b"CAL:SEC:STAT OFF,AT34465A\n", b"CAL:SEC:STAT OFF,***\n"),
        (b"calibration:secure:code FACTORY\n", b"calibration:secure:code ***\n"),
        (b"SYST:PASS:CEN 1234\n", b"SYST:PASS:CEN ***\n"),
        (b"CCL 1 advanced\n", b"CCL 1 ***\n"),
        (b'password="swordfish"', b"password=***"),
        (b"CAL:SEC:CODE ABCD;:CAL:SEC:STAT OFF, ABCD", b"CAL:SEC:CODE ***;:CAL:SEC:STAT OFF, ***"),
        (b"PASS 5 of 5", b"PASS 5 of 5"),
        (b"GroupMoveAbsolute(Group1,10)", b"GroupMoveAbsolute(Group1,10)"),
    ],
)
def test_what_is_masked(tmp_path: Path, command: bytes, masked: bytes) -> None:
    made = logger(tmp_path)
    made.sent(1, command)
    assert said(log_of(made).records) == [(SENT, masked)]


def test_secrets_of_the_rig_file_are_masked_wherever_they_stand(tmp_path: Path) -> None:
    made = logger(tmp_path, secrets=["swordfish", "a"])
    made.sent(1, b"OPEN swordfish a")
    made.came(1, b"OK, sword")
    made.came(1, b"fish")
    made.failed(1, "!", LinkLost("rotation: swordfish: gone"))
    assert said(log_of(made).records)[:2] == [(SENT, b"OPEN *** a"), (READ, b"OK, ***")]
    assert b"swordfish" not in made.path.read_bytes()  # type: ignore[union-attr]
    assert (
        address_without_secret("http://me:swordfish@lab/x?token=abc&baud=1") == "http://me:***@lab/x?token=***&baud=1"
    )


def test_a_code_of_digits_is_not_taken_out_of_a_reading(tmp_path: Path) -> None:
    made = logger(tmp_path)
    made.sent(1, b"CAL:SEC:CODE 1234\n")
    made.came(1, b"+5.1234E+00\n")
    made.came(1, b"CODE 1234?\n", UNASKED)
    made.sent(1, b"READ?\n")
    made.came(1, b"+5.1234E+00\n")
    made.came(1, b"0\n", UNASKED)
    made.happened(1, CLOSED, "")
    assert said(log_of(made).records)[1:-1] == [
        (READ, b"+5.1234E+00\nCODE ***?\n"),
        (SENT, b"READ?\n"),
        (READ, b"+5.1234E+00\n"),
        (UNASKED, b"0\n"),
    ]


def test_a_repeated_password_that_was_cut_off_is_masked(tmp_path: Path) -> None:
    made, late = logger(tmp_path), LinkTimeout("test: waited 2 s, only b'-106,Login(Admin,hunt' came")
    late.received = b"-106,Login(Admin,hunt"
    made.sent(1, b"Login(Admin,hunter2)")
    made.failed(1, "!", late)
    assert b"hunt" not in made.path.read_bytes()  # type: ignore[union-attr]


def test_what_had_come_before_a_time_out_is_logged(tmp_path: Path) -> None:
    made, late = logger(tmp_path), LinkTimeout("test: waited 2 s")
    late.received = b"\x00" * 100
    line = LoggedTransport(Line(late), made, 1)
    with pytest.raises(LinkTimeout):
        line.read_until(b"\n", 2.0)
    assert said(log_of(made).records) == [("?", b"\x00" * 100), ("!", b"LinkTimeout test: waited 2 s")]


def test_settings_of_a_line_are_tried_through_the_log(tmp_path: Path) -> None:
    connect = LoggedConnect(connector("serial:/dev/null/no", RealClock()), logger(tmp_path))
    ways = serial_ways(connect, [SerialSettings(baud=921600), SerialSettings(baud=19200)])
    assert [words for words, _ in ways] == ["921600 baud", "19200 baud"]
    with pytest.raises(LinkLost):
        ways[0][1]()
    (failed,) = log_of(connect.logger).records
    assert (failed.kind, failed.connection) == ("!", 1)


def test_a_log_that_cannot_be_written_ends_and_says_so_and_nothing_else_does(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    made = logger(tmp_path / "file" / "below")
    line = LoggedTransport(Line(b"1\n"), made, 1)
    for _ in range(3):
        line.write(b"TP?\n")
    assert line.read_until(b"\n", 1.0) == b"1\n"
    (told,) = capsys.readouterr().err.splitlines()
    assert "the wire log ends here" in told


def test_no_log_is_written_over(tmp_path: Path) -> None:
    for number in range(3):
        logger(tmp_path).sent(1, b"%d" % number)
    assert sorted(read_wire_log(path).records[0].data for path in tmp_path.iterdir()) == [b"0", b"1", b"2"]


@pytest.mark.parametrize(
    "text", [b"", b"\xff\xfe\n", b"t_s,v\n0,1\n", b"rigctl wire log 1 {}\n", b"rigctl wire log 1 [\n"]
)
def test_what_is_no_log_is_refused_in_a_line(tmp_path: Path, text: bytes) -> None:
    path = tmp_path / "x.wire"
    path.write_bytes(text)
    with pytest.raises(DataError, match=r"x\.wire: line 1: .*; name a file") as refused:
        read_wire_log(path)
    assert len(str(refused.value).splitlines()) == 1
    assert MASK == b"***"
    assert SENT in BYTES
