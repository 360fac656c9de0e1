"""The simulated PI controller, as the C-863's manual has it."""

from __future__ import annotations

from typing import Any

import pytest

from simulators.clock import VirtualClock
from simulators.motion import MotionAxis
from simulators.pi_gcs2 import Gcs2Dialect, Gcs2SimulatorSettings, SimulatedGcs2

GENTLE = Gcs2Dialect(tells_unit=True, numbers="decimal", settle_s=0.0)


class Bench:
    def __init__(self, dialect: Gcs2Dialect = GENTLE, **settings: Any) -> None:
        self.clock = VirtualClock()
        self.axis = MotionAxis(2.0)
        said = Gcs2SimulatorSettings(dialect=dialect, **settings)
        self.received = bytearray()
        self.connection = SimulatedGcs2(self.clock, self.axis, said).connect(self.received.extend)

    def __call__(self, line: str) -> str:
        self.connection.receive(line.encode() + (b"" if len(line) == 1 else b"\n"))
        reply = self.received.decode("latin-1")
        self.received.clear()
        return reply


def test_a_reference_move_and_a_motion() -> None:
    bench = Bench()
    assert bench("SVO 1 1") == bench("FRF 1") == ""
    assert (bench("\x05"), bench("FRF? 1")) == ("1\n", "1=0\n")
    bench.clock.sleep_s(3.0)
    assert (bench("\x05"), bench("FRF? 1"), bench("POS? 1")) == ("0\n", "1=1\n", "1=0.000000\n")
    bench("MOV 1 12.5")
    assert (bench("MOV? 1"), bench("ONT? 1")) == ("1=12.500000\n", "1=0\n")
    bench.clock.sleep_s(3.0)
    assert (bench("ONT? 1"), bench("POS?"), bench("ERR?")) == ("1=1\n", "1=12.500000\n", "0\n")
    assert (bench("PUN? 1"), bench("TMX? 1"), bench("SAI?")) == ("1=deg\n", "1=170.000000\n", "1\n")


def test_a_position_can_be_said_where_no_reference_is_searched() -> None:
    bench = Bench()
    bench("POS 1 33")
    assert (bench("ERR?"), bench("FRF? 1")) == ("17\n", "1=0\n")
    bench("RON 1 0")
    bench("POS 1 33")
    assert [bench(query) for query in ("RON? 1", "FRF? 1", "POS? 1", "MOV? 1", "ERR?")] == [
        *("1=0\n", "1=1\n", "1=33.000000\n", "1=33.000000\n", "0\n"),
    ]
    bench("SVO 1 1")
    bench("FRF 1")
    assert (bench("ERR?"), bench("FRF? 1")) == ("50\n", "1=1\n")
    bench("DFH 1")
    assert (bench("DFH? 1"), bench("POS? 1"), bench("ERR?")) == ("1=33.000000\n", "1=0.000000\n", "0\n")
    bench("RON 1 1")
    bench("FRF 1")
    bench.clock.sleep_s(5.0)
    assert (bench("FRF? 1"), bench("DFH? 1"), bench("POS? 1")) == ("1=1\n", "1=0.000000\n", "1=0.000000\n")


def test_what_epics_asks_of_an_axis() -> None:
    bench = Bench()
    assert [bench(query) for query in ("CSV?", "LIM? 1", "TRS? 1", "ERR?")] == ["2.0\n", "1=1\n", "1=1\n", "0\n"]


@pytest.mark.parametrize("stop", ["STP", "HLT 1", "\x18"])
def test_a_stop_leaves_error_10(stop: str) -> None:
    bench = Bench()
    bench("SVO 1 1")
    bench("FRF 1")
    bench.clock.sleep_s(3.0)
    bench("MOV 1 100")
    bench.clock.sleep_s(1.0)
    assert bench(stop) == ""
    bench.clock.sleep_s(1.0)
    assert bench("\x05") == "0\n"
    assert bench.axis.velocity(bench.clock.now_s()) == 0.0
    assert [bench("ERR?"), bench("ERR?"), bench("ONT? 1")] == ["10\n", "0\n", "1=1\n"]


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("MOV 1 5", 5), ("FRF 1", 5), ("NONSENSE", 2), ("NONSENSE? 1", 2), ("MOV 1", 24), ("MOV 2 5", 15),
        ("POS? 2", 15),
        ("VEL 1 1000", 8), ("ACC 1 0", 17), ("SVO 1 2", 17), ("VEL 1 fast", 1), ("VEL 1 inf", 1),
    ],
)  # fmt: skip
def test_what_is_refused_is_not_answered_and_leaves_its_code(line: str, code: int) -> None:
    bench = Bench()
    assert bench(line) == ""
    assert bench("ERR?") == f"{code}\n"


def test_single_characters_are_answered_wherever_they_come() -> None:
    bench = Bench()
    assert bench("\x07") == "\xb1\n"
    bench("SVO 1 1")
    bench("FRF 1")
    # Within a line of another, as from a second program; the line is not cut by it.
    assert bench("SVO\x05? 1") == "1\n1=1\n"
    bench("MVR 1 2.5")
    assert bench("ERR?") == "5\n"
    bench.clock.sleep_s(3.0)
    bench("MOV 1 5")
    bench("MVR 1 2.5")
    assert bench("MOV? 1") == "1=7.500000\n"
    # The motion is stopped, and the command that it stood in is carried out.
    assert bench("MO\x18V 1 1") == ""
    assert (bench("MOV? 1"), bench("ERR?")) == ("1=1.000000\n", "10\n")


def test_help_lists_what_is_answered() -> None:
    bench = Bench()
    first, *commands, last = bench("HLP?").removesuffix("\n").split("\n")
    assert all(line.endswith(" ") for line in (first, *commands))
    assert not last.endswith(" ")
    assert {"#5 ", "#7 ", "MOV ", "MOV? ", "FRF ", "FRF? ", "POS? ", "PUN? "} <= set(commands)
    assert bench("SAI? ALL") == "1\n"
    assert bench("ERR?") == "0\n"


def test_the_harder_reading() -> None:
    bench = Bench(Gcs2Dialect())
    assert bench("POS? 1") == "1=0.000000000e+00\n"
    assert bench("PUN? 1") == ""
    assert bench("ERR?") == "2\n"
