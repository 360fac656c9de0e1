"""The simulated 33500B, asked in its own bytes."""

import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import pyvisa
from hypothesis import given, settings
from hypothesis import strategies as st

from simulators.clock import ScaledClock, VirtualClock
from simulators.keysight_33500b import GeneratorSettings, Simulated33500B
from simulators.serve import Server
from simulators.wiring import VoltageLine

NO_ERROR = '+0,"No error"'


class Bench:
    """One generator with one client on a virtual clock, and the wires at its outputs."""

    def __init__(self, **options: Any) -> None:
        self.clock = VirtualClock()
        self.lines = {1: VoltageLine(), 2: VoltageLine()}
        self.generator = Simulated33500B(self.clock, self.lines, GeneratorSettings(**options))
        self.received = bytearray()
        self.session = self.generator.connect(self.received.extend)

    def send(self, *messages: str) -> None:
        for message in messages:
            self.session.receive(message.encode() + b"\n")

    def ask(self, message: str) -> str:
        self.received.clear()
        self.send(message)
        return self.received.decode().removesuffix("\n")

    def number(self, message: str) -> float:
        return float(self.ask(message))

    def error(self) -> str:
        return self.ask("SYST:ERR?")

    def volts(self, output: int, *times_s: float) -> Any:
        return self.lines[output].sample(np.array(times_s))


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_the_session_of_the_protocols_page_byte_for_byte(bench: Bench) -> None:
    silent = [
        *("*RST", "*CLS", "UNIT:ANGL DEG", "OUTP1:LOAD INF", "SOUR1:FUNC DC", "SOUR1:VOLT:OFFS 0.000000", "OUTP1 ON"),
        *("OUTP2:LOAD INF", "SOUR2:VOLT:OFFS 0", "SOUR2:FUNC RAMP", "SOUR2:FREQ 2.777777778E-04"),
        *("SOUR2:FUNC:RAMP:SYMM 50", "SOUR2:VOLT:UNIT VPP", "SOUR2:VOLT 2.000000", "SOUR2:VOLT:OFFS 0.000000"),
        *("SOUR2:PHAS 0.000000", "OUTP2 ON", "PHAS:SYNC"),
    ]
    assert [bench.ask(command) for command in silent] == [""] * len(silent)
    assert bench.error() == NO_ERROR
    assert bench.ask("SOUR1:VOLT:OFFS?") == "+0.00000000000000E+00"
    assert bench.ask("SOUR2:FREQ?") == "+2.78000000000000E-04"
    assert bench.ask("SOUR2:VOLT?") == "+2.00000000000000E+00"
    assert bench.ask("SOUR2:PHAS?") == "+0.00000000000000E+00"
    assert bench.ask("*IDN?") == "Agilent Technologies,33522B,MY57800256,5.00-1.19-2.00-58-00"


def test_after_a_reset_it_is_as_the_manual_says(bench: Bench) -> None:
    bench.send("SOUR2:FUNC DC", "SOUR2:VOLT:OFFS 1", "OUTP2 ON", "OUTP2:LOAD INF", "*RST")
    for n in (1, 2):
        assert bench.ask(f"SOUR{n}:FUNC?") == "SIN"
        assert bench.number(f"SOUR{n}:FREQ?") == 1000.0
        assert bench.number(f"SOUR{n}:VOLT?") == pytest.approx(0.1)
        assert bench.number(f"SOUR{n}:VOLT:OFFS?") == 0.0
        assert bench.number(f"OUTP{n}:LOAD?") == 50.0
        assert bench.ask(f"OUTP{n}?") == "0"
        assert bench.ask(f"SOUR{n}:VOLT:UNIT?;:UNIT:ANGL?") == "VPP;DEG"


def test_a_constant_is_on_the_wire_while_the_relay_is_closed(bench: Bench) -> None:
    bench.send("OUTP1:LOAD INF", "SOUR1:FUNC DC", "SOUR1:VOLT:OFFS 1.5")
    bench.clock.sleep_s(1.0)
    bench.send("OUTP1 ON")
    bench.clock.sleep_s(1.0)
    bench.send("SOUR1:VOLT:OFFS -0.25")
    bench.clock.sleep_s(1.0)
    bench.send("OUTP1 OFF")
    assert bench.volts(1, 0.5, 1.5, 2.5, 3.5) == pytest.approx([0.0, 1.5, -0.25, 0.0])
    assert bench.volts(2, 0.5, 1.5) == pytest.approx([0.0, 0.0])


def test_sine_and_triangle_begin_together_each_at_its_phase(bench: Bench) -> None:
    bench.send("OUTP1:LOAD INF", "OUTP2:LOAD INF", "SOUR1:FREQ 0.1", "SOUR1:VOLT 2", "SOUR1:PHAS 90", "OUTP1 ON")
    bench.send("SOUR2:FUNC RAMP", "SOUR2:FUNC:RAMP:SYMM 50", "SOUR2:FREQ 0.05", "SOUR2:VOLT 4", "OUTP2 ON")
    bench.clock.sleep_s(3.7)
    bench.send("SOUR2:PHAS:SYNC")
    times_s = 3.7 + np.linspace(0.0, 40.0, 81)
    assert bench.volts(1, *times_s) == pytest.approx(np.cos(0.2 * np.pi * (times_s - 3.7)), abs=1e-9)
    corners_s, corners_v = [0.0, 5.0, 15.0, 25.0, 35.0, 40.0], [0.0, 2.0, -2.0, 2.0, -2.0, 0.0]
    assert bench.volts(2, *times_s) == pytest.approx(np.interp(times_s - 3.7, corners_s, corners_v), abs=1e-9)


def test_tri_is_a_ramp_of_symmetry_50_and_other_symmetries_rise_as_long_as_they_say(bench: Bench) -> None:
    bench.send("FUNC TRI")
    assert bench.ask("FUNC?;:FUNC:RAMP:SYMM?").split(";")[0] == "RAMP"
    assert bench.number("FUNC:RAMP:SYMM?") == 50.0
    bench.send("OUTP:LOAD INF", "FUNC:RAMP:SYMM 80", "FREQ 0.1", "VOLT 2", "OUTP ON", "PHAS:SYNC")
    assert bench.volts(1, 0.0, 2.0, 4.0, 5.0, 6.0) == pytest.approx([0.0, 0.5, 1.0, 0.0, -1.0], abs=1e-9)


def test_inverted_it_is_upside_down_about_its_offset(bench: Bench) -> None:
    bench.send("OUTP1:LOAD INF", "SOUR1:FREQ 1", "SOUR1:VOLT 2", "SOUR1:VOLT:OFFS 0.5", "OUTP1 ON", "PHAS:SYNC")
    upright = bench.volts(1, 0.0, 0.25, 0.75)
    bench.send("OUTP1:POL INV")
    assert bench.ask("OUTP1:POL?;:OUTP2:POL?") == "INV;NORM"
    np.testing.assert_allclose(upright, [0.5, 1.5, -0.5])
    np.testing.assert_allclose(bench.volts(1, 0.0, 0.25, 0.75), [0.5, -0.5, 1.5])
    bench.send("*RST")
    assert bench.ask("OUTP1:POL?") == "NORM"


def test_another_frequency_goes_on_from_the_phase_there_is(bench: Bench) -> None:
    bench.send("OUTP1:LOAD INF", "FREQ 0.1", "VOLT 2", "OUTP1 ON", "PHAS:SYNC")
    bench.clock.sleep_s(2.5)
    bench.send("FREQ 0.05")
    assert bench.volts(1, 2.5 - 1e-9, 2.5 + 1e-9, 7.5, 12.5) == pytest.approx([1.0, 1.0, 0.0, -1.0], abs=1e-6)


def test_the_load_changes_the_numbers_and_not_the_wire(bench: Bench) -> None:
    bench.send("FUNC DC", "VOLT:OFFS 1", "OUTP1 ON")
    bench.clock.sleep_s(1.0)
    bench.send("OUTP1:LOAD INF")
    assert bench.number("VOLT:OFFS?") == 2.0
    assert bench.ask("OUTP1:LOAD?") == "+9.90000000000000E+37"
    bench.clock.sleep_s(1.0)
    assert bench.volts(1, 0.5, 1.5) == pytest.approx([2.0, 2.0])
    bench.send("OUTP1:LOAD 150")
    assert bench.number("VOLT:OFFS?") == pytest.approx(1.5)
    assert bench.number("VOLT? MAX") == pytest.approx(15.0)


@pytest.mark.parametrize(
    ("before", "message", "query", "value", "error"),
    [
        ("FUNC RAMP", "FREQ 1E6", "FREQ?", 200e3, '-222,"Data out of range; value clipped to upper limit"'),
        ("FUNC SIN", "FREQ 40E6", "FREQ?", 30e6, '-222,"Data out of range; value clipped to upper limit"'),
        ("FUNC SIN", "FREQ 1E-9", "FREQ?", 1e-6, '-222,"Data out of range; value clipped to lower limit"'),
        ("FREQ 1E6", "FUNC RAMP", "FREQ?", 200e3, '-221,"Settings conflict; frequency reduced for ramp function"'),
        ("VOLT 4", "VOLT:OFFS 9", "VOLT:OFFS?", 8.0, '-222,"Data out of range; value clipped to upper limit"'),
        ("VOLT 4", "VOLT:OFFS -9", "VOLT:OFFS?", -8.0, '-222,"Data out of range; value clipped to lower limit"'),
        ("VOLT:OFFS 9", "VOLT 4", "VOLT:OFFS?", 8.0, '-221,"Settings conflict; offset changed due to amplitude"'),
        ("VOLT:OFFS 9", "VOLT 4", "VOLT?", 4.0, '-221,"Settings conflict; offset changed due to amplitude"'),
        ("FUNC DC", "VOLT 25", "VOLT?", 20.0, '-222,"Data out of range; value clipped to upper limit"'),
        ("FUNC DC", "VOLT 0", "VOLT?", 2e-3, '-222,"Data out of range; value clipped to lower limit"'),
        ("FUNC DC", "PHAS 361", "PHAS?", 360.0, '-222,"Data out of range; value clipped to upper limit"'),
    ],
)
def test_what_cannot_be_is_bent_and_told(
    bench: Bench, before: str, message: str, query: str, value: float, error: str
) -> None:
    bench.send("OUTP1:LOAD INF", before)
    assert bench.error() == NO_ERROR
    bench.send(message)
    assert bench.error() == error
    assert bench.number(query) == pytest.approx(value, rel=1e-12)


def test_an_offset_too_large_for_the_sine_gives_way_on_leaving_dc(bench: Bench) -> None:
    bench.send("OUTP1:LOAD INF", "VOLT 10", "FUNC DC", "VOLT:OFFS 9", "FUNC SIN")
    assert bench.error() == '-221,"Settings conflict; offset changed on exit from dc function"'
    assert bench.number("VOLT:OFFS?") == 5.0


@pytest.mark.parametrize(
    ("message", "code"),
    [
        ("SOUR3:FREQ 1", -114),
        ("OUTP0 ON", -114),
        ("VOLTS 1", -113),
        ("FUNC SQUASH", -224),
        ("FUNC 5", -104),
        ("FREQ", -109),
        ("FREQ 1,2", -108),
        ("FREQ 1 V", -131),
        ("VOLT:UNIT DBM", -224),
        ("UNIT:ANGL RAD", -224),
        ("OUTP1:LOAD 0.5", -222),
    ],
)
def test_refused_messages_change_nothing(bench: Bench, message: str, code: int) -> None:
    asked = "FUNC?;:FREQ?;:VOLT?;:VOLT:OFFS?;:OUTP1?;:OUTP1:LOAD?"
    before = bench.ask(asked)
    assert bench.ask(message) == ""
    assert bench.error().startswith(f"{code},")
    assert bench.error() == NO_ERROR
    assert bench.ask(asked) == before


def test_frequencies_come_in_steps_and_at_the_generators_own_clock() -> None:
    bench = Bench(frequency_step_hz=1e-3, clock_ppm=100.0)
    bench.send("OUTP1:LOAD INF", "FREQ 0.1004", "VOLT 2", "OUTP1 ON", "PHAS:SYNC")
    assert bench.number("FREQ?") == pytest.approx(0.1)
    turns = 0.1 * 1.0001 * 5002.5
    assert bench.volts(1, 5002.5) == pytest.approx([np.sin(2 * np.pi * turns)], abs=1e-9)


def test_units_and_long_headers_are_read(bench: Bench) -> None:
    bench.send(
        "OUTPUT1:LOAD INFINITY", "SOURCE1:VOLTAGE 500 MVPP", "SOURCE1:FREQUENCY 2.5 KHZ", "SOUR1:VOLT:OFFS 20 MV"
    )
    assert bench.error() == NO_ERROR
    assert bench.number("VOLT?") == pytest.approx(0.5)
    assert bench.number("FREQ?") == pytest.approx(2500.0)
    assert bench.number("VOLT:OFFS?") == pytest.approx(0.02)


@settings(max_examples=100, deadline=None)
@given(
    st.lists(
        st.sampled_from(
            [
                *("FUNC DC", "FUNC RAMP", "FUNC SIN", "SOUR2:FUNC TRI", "FREQ MAX", "FREQ MIN", "VOLT MAX"),
                *("VOLT MIN", "VOLT:OFFS MAX", "VOLT:OFFS -3", "PHAS 77", "PHAS:SYNC", "OUTP1 ON", "OUTP2 ON"),
                *("OUTP1 OFF", "OUTP1:LOAD INF", "OUTP1:LOAD 1", "FUNC:RAMP:SYMM 0", "FUNC:RAMP:SYMM 100", "*RST"),
            ]
        ),
        max_size=25,
    ),
    st.binary(max_size=12),
)
def test_whatever_it_is_told_its_outputs_stay_within_ten_volts(commands: list[str], noise: bytes) -> None:
    bench = Bench()
    for command in commands:
        bench.send(command)
        bench.clock.sleep_s(0.3)
    bench.session.receive(noise + b"\n")
    bench.clock.sleep_s(0.3)
    times_s = np.linspace(0.0, bench.clock.now_s(), 500)
    for line in bench.lines.values():
        assert np.abs(line.sample(times_s)).max() <= 10.0 + 1e-9
    fresh = bytearray()
    bench.generator.connect(fresh.extend).receive(b"*CLS;*IDN?;:SYST:ERR?\n")
    assert fresh.endswith(b'+0,"No error"\n')


@pytest.fixture
def served() -> Iterator[str]:
    clock = ScaledClock(20.0)
    server = Server(clock)
    port = server.add_tcp("source", Simulated33500B(clock)).port
    thread = threading.Thread(target=server.serve)
    thread.start()
    yield f"TCPIP0::127.0.0.1::{port}::SOCKET"
    server.stop()
    thread.join()
    server.close()


def test_pyvisa_sets_it_over_a_raw_socket(served: str) -> None:
    manager = pyvisa.ResourceManager("@py")
    try:
        source: Any = manager.open_resource(served, read_termination="\n", write_termination="\n")
        assert source.query("*IDN?").split(",")[1] == "33522B"
        source.write("OUTP2:LOAD INF;:SOUR2:FUNC SIN;FREQ 0.5;VOLT 3;VOLT:OFFS 0.25;:OUTP2 ON")
        assert source.query_ascii_values("SOUR2:VOLT:OFFS?") == [0.25]
        assert source.query("OUTP2?") == "1"
        assert source.query("SYST:ERR?") == NO_ERROR
    finally:
        manager.close()


SNAPSHOT = {
    "OUTPut:SYNC": "1",
    "OUTPut:SYNC:SOURce": "CH1",
    "OUTPut:TRIGger": "0",
    "OUTPut:TRIGger:SLOPe": "POS",
    "OUTPut1:MODE": "NORM",
    "OUTPut2:POLarity": "NORM",
    "OUTPut1:SYNC:MODE": "NORM",
    "OUTPut2:SYNC:POLarity": "NORM",
    "ROSCillator:SOURce": "INT",
    "SOURce1:AM:STATe": "0",
    "SOURce2:FSKey:STATe": "0",
    "SOURce1:SWEep:STATe": "0",
    "SOURce1:FUNCtion:PULSe:HOLD": "WIDT",
    "SOURce1:VOLTage:LIMit:STATe": "0",
    "SOURce2:VOLTage:COUPle": "0",
    "SOURce1:VOLTage:RANGe:AUTO": "1",
    "SOURce1:BURSt:STATe": "0",
    "SOURce2:BURSt:MODE": "TRIG",
    "SOURce1:FREQuency:MODE": "CW",
    "TRIGger2:SOURce": "IMM",
}


@pytest.mark.parametrize(("header", "value"), SNAPSHOT.items())
def test_what_is_not_simulated_says_so_and_stays_as_it_is(bench: Bench, header: str, value: str) -> None:
    assert bench.ask(f"{header}?") == value
    bench.send(f"{header} {value}")
    assert bench.error() == '+0,"No error"'


def test_a_voltage_by_its_ends(bench: Bench) -> None:
    assert bench.ask("VOLT:HIGH?;LOW?") == "+5.00000000000000E-02;-5.00000000000000E-02"
    bench.send("OUTP1:LOAD INF", "VOLT:HIGH 3", "VOLT:LOW 1")
    assert (bench.number("VOLT?"), bench.number("VOLT:OFFS?")) == (2.0, 2.0)
    bench.send("VOLT:LOW 4")
    assert bench.error() == '-222,"Data out of range; value clipped to upper limit"'
    assert (bench.number("VOLT:LOW?"), bench.number("VOLT:HIGH?")) == (2.998, 3.0)
    bench.send("SOUR1:VOLT:HIGH 11")
    assert bench.error().startswith("-222")
    assert bench.number("VOLT:HIGH?") == pytest.approx(10.0)


def test_its_panel_shows_a_text_and_beeps(bench: Bench) -> None:
    bench.send("DISP:TEXT 'in use'", "DISP OFF", "SYST:BEEP", "SYST:BEEP:STAT OFF")
    assert bench.ask("DISP:TEXT?;:DISP?;:SYST:BEEP:STAT?") == '"in use";0;0'
    bench.send("DISP:TEXT:CLE", "DISP ON")
    assert bench.ask("DISP:TEXT?;:DISP?") == '"";1'
    assert bench.error() == NO_ERROR


@pytest.mark.parametrize(
    ("command", "code"),
    [
        ("SOUR1:FM:STAT ON", "-221"),
        ("VOLT:LIM:STAT ON", "-221"),
        ("OUTP:SYNC OFF", "-221"),
        ("SOUR1:BURS:STAT 1", "-221"),
        ("TRIG2:SOUR EXT", "-221"),
        ("TRIG2:SOUR MAYBE", "-224"),
        ("OUTP3:POL NORM", "-114"),
    ],
)
def test_nothing_else_is_taken_for_done(bench: Bench, command: str, code: str) -> None:
    bench.send(command)
    assert bench.error().startswith(code)
