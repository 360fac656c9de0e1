"""The simulated 3458A, as programs that run on real ones speak to it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from simulators.clock import VirtualClock
from simulators.keysight_3458a import GENTLE, Meter3458ASimulatorSettings, Simulated3458A
from simulators.wiring import TriggerLine


class Bench:
    def __init__(self, dialect: Any = GENTLE, **settings: Any) -> None:
        self.clock = VirtualClock()
        self.line = TriggerLine()
        said = Meter3458ASimulatorSettings(dialect=dialect, **settings)
        meter = Simulated3458A(self.clock, lambda t: np.floor(1e-9 + 100 * t) / 100, self.line, None, said)
        self.received = bytearray()
        self.connection = meter.connect(self.received.extend)

    def __call__(self, *lines: str) -> str:
        for line in lines:
            self.connection.receive(line.encode() + b"\n")
        reply = self.received.decode()
        self.received.clear()
        return reply


def test_a_block_as_others_take_it() -> None:
    bench = Bench()
    assert bench("PRESET NORM", "TARM HOLD", "ID?") == "HP3458A\r\n"
    assert bench("DCV 10;APER 0.001;AZERO OFF", "MEM FIFO;MCOUNT?") == "0\r\n"
    assert bench("TIMER 0.1", "NRDGS 4,TIMER", "TRIG AUTO", "TARM SGL", "TARM?") == "3\r\n"
    bench.clock.sleep_s(0.5)
    assert bench("TARM?", "MCOUNT?", "ERRSTR?") == '4\r\n4\r\n0,"NO ERROR"\r\n'
    # Each 0.5 ms before an edge at 1, 101, 201, 301 ms.
    assert bench("RMEM 1,4") == "+0.000000000E+00,+1.000000015E-01,+2.000000030E-01,+3.000000119E-01\r\n"
    assert bench("RMEM 1,1") == "+3.000000119E-01\r\n"


AFTER_RESET = """ID? HP3458A
TEMP? 37.0
TARM? 4
TRIG? 1
NRDGS? 1,1
NPLC? 10.0000000E+00
APER? 200.000000E-03
FUNC? 1,.1
RANGE? .1
AZERO? 1
MEM? 0
OFORMAT? 1
MFORMAT? 4
INBUF? 1
END? 2
ISCALE? 1.00000000E+00"""
"""As a public program's log has them, but for the range and what it had set before."""


def test_after_reset_it_says_what_it_is_set_to_as_a_real_one_did() -> None:
    bench = Bench()
    bench("RESET", "TARM HOLD", "END ALWAYS", "INBUF ON", "DCV .1")
    for query, said in map(str.split, AFTER_RESET.splitlines()):
        assert bench(query) == said.replace(",", ", ") + "\r\n", query


def test_what_a_photometry_laboratory_sets_and_asks() -> None:
    bench = Bench()
    bench("RESET", "FUNC DCV,10;NPLC 1.0;AZERO ON;NRDGS 3,AUTO;DELAY 0.0;TRIG HOLD;TARM HOLD;LFREQ LINE;MEM FIFO")
    assert bench("FIXEDZ ON;", "ERRSTR?") == '0,"NO ERROR"\r\n'
    assert bench("FUNC?", "ARANGE?", "NRDGS?", "NPLC?") == "1, 10\r\n0\r\n3, 1\r\n1.00000000E+00\r\n"
    assert bench("DELAY?", "FIXEDZ?", "MEM?") == "0.00000000E+00\r\n1\r\n2\r\n"
    # Triggered by nothing: armed, it waits for ever.
    bench("TARM SGL,1")
    bench.clock.sleep_s(100.0)
    assert bench("MCOUNT?") == "0\r\n"
    bench("TRIG AUTO;MEM FIFO;TARM SGL,1")
    bench.clock.sleep_s(1.0)
    assert bench("MCOUNT?", "TARM?") == "3\r\n4\r\n"


def test_a_single_trigger_gives_one_reading_while_it_is_armed() -> None:
    bench = Bench()
    bench("PRESET 1", "DCV;NPLC 1;AZERO 0", "TRIG 4")
    for _ in range(2):
        assert bench("TRIG SGL") == ""
        bench.clock.sleep_s(0.04)
        assert bench("TRIG?", "TARM?").endswith("\r\n4\r\n1\r\n")
    bench("TARM HOLD", "TRIG SGL")
    bench.clock.sleep_s(0.1)
    assert bench("ERRSTR?") == '0,"NO ERROR"\r\n'


def test_on_its_own_range_it_is_overloaded_beyond_all_ranges_alone() -> None:
    bench = Bench()
    bench.clock.sleep_s(50.0)
    bench("PRESET NORM", "DCV AUTO;NPLC 1;AZERO OFF;NRDGS 1,AUTO;TRIG AUTO", "TARM SGL")
    bench.clock.sleep_s(0.1)
    reading, *said = bench("RANGE?", "ARANGE?").split()
    assert (float(reading), said) == (pytest.approx(50.0, abs=0.1), ["100", "1"])
    bench("ARANGE OFF;RANGE 10", "TARM SGL")
    bench.clock.sleep_s(0.1)
    assert bench("RANGE?") == "+1.000000000E+38\r\n10\r\n"


def test_the_newest_first_if_it_reads_the_manual_so() -> None:
    bench = Bench(GENTLE.model_copy(update={"recall_order": "newest first"}))
    bench("PRESET NORM", "DCV 10;APER 0.001;AZERO OFF", "MEM FIFO", "TIMER 0.1;NRDGS 2,TIMER;TRIG AUTO;TARM SGL")
    bench.clock.sleep_s(0.5)
    assert bench("RMEM 1,2") == "+1.000000015E-01,+0.000000000E+00\r\n"


def test_without_memory_readings_are_sent_as_they_come() -> None:
    bench = Bench()
    assert bench("PRESET NORM", "DCV 10;APER 0.001;AZERO OFF", "NRDGS 1,AUTO;TRIG AUTO", "TARM SGL") == ""
    bench.clock.sleep_s(0.01)
    assert bench() == "+0.000000000E+00\r\n"


def test_while_it_samples_it_hears_nothing_but_keeps_what_it_is_told() -> None:
    bench = Bench(GENTLE.model_copy(update={"hears_while_sampling": False}))
    bench("PRESET NORM", "APER 0.001;AZERO OFF", "MEM FIFO", "TIMER 0.1", "NRDGS 10,TIMER;TRIG AUTO;TARM SGL")
    assert bench("ID?") == ""
    bench.clock.sleep_s(0.8)
    assert bench() == ""
    bench.clock.sleep_s(0.2)
    assert bench("MCOUNT?") == "HP3458A\r\n10\r\n"


@pytest.mark.parametrize(
    ("line", "error"),
    [
        ("NONSENSE 5", "SYNTAX ERROR"),
        ("?", "SYNTAX ERROR"),
        ("NONSENSE?", "SYNTAX ERROR"),
        ("TARM PERHAPS", "UNDEFINED PARAMETER RECEIVED"),
        ("TARM", "UNDEFINED PARAMETER RECEIVED"),
        ("APER 5", "PARAMETER OUT OF RANGE"),
        ("NRDGS 1.5", "PARAMETER OUT OF RANGE"),
        ("RMEM 1,5", "MEMORY ERROR"),
        ("\xff", "SYNTAX ERROR"),
    ],
)
def test_an_error_is_kept_until_it_is_asked_for_and_nothing_is_answered(line: str, error: str) -> None:
    bench = Bench()
    assert bench(line) == ""
    assert bench("ERRSTR?").rstrip().endswith(f'"{error}"')
    assert bench("ERRSTR?") == '0,"NO ERROR"\r\n'


def test_edges_come_when_the_converter_has_integrated() -> None:
    bench = Bench()
    bench("PRESET NORM", "APER 0.002;AZERO OFF", "TIMER 0.1;NRDGS 3,TIMER;TRIG AUTO", "TARM SGL")
    bench.clock.sleep_s(1.0)
    assert len(bench.line.edges(-1.0, 10.0)) == 0
    began_s = bench.clock.now_s()
    bench("EXTOUT ICOMP,NEG", "TARM SGL")
    np.testing.assert_allclose(bench.line.edges(-1.0, 10.0), began_s + 0.002 + 0.1 * np.arange(3))
