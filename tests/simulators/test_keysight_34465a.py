"""The simulated 34465A, asked in its own bytes."""

import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
import pyvisa
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.core.arrays import FloatArray
from simulators.clock import ScaledClock, VirtualClock
from simulators.keysight_34465a import MeterSettings, Simulated34465A
from simulators.serve import Server
from simulators.wiring import TriggerLine

FAST = ("CONF:VOLT:DC 10", "SENS:VOLT:DC:ZERO:AUTO OFF", "SENS:VOLT:DC:APER 1E-3")


def ramp(times_s: FloatArray) -> FloatArray:
    """A volt per second, so that a reading tells when it was taken."""
    return times_s


class Bench:
    """One meter with one client on a virtual clock; `asked` are the instants its signal was asked for."""

    def __init__(
        self,
        volts: Callable[[FloatArray], FloatArray] = ramp,
        celsius: Callable[[FloatArray], FloatArray] = ramp,
        *,
        trigger_in: TriggerLine | None = None,
        clock: VirtualClock | None = None,
        **options: Any,
    ) -> None:
        self.clock = clock or VirtualClock()
        self.asked: list[FloatArray] = []
        self.pace = TriggerLine()
        self.meter = Simulated34465A(
            self.clock,
            lambda times: self.record(volts, times),
            celsius,
            self.pace,
            trigger_in,
            MeterSettings(**{"resolution_v": 1e-9, "latency_s": 0.0, **options}),
        )
        self.received = bytearray()
        self.session = self.meter.connect(self.received.extend)

    def record(self, volts: Callable[[FloatArray], FloatArray], times_s: FloatArray) -> FloatArray:
        self.asked.append(times_s.copy())
        return volts(times_s)

    def send(self, *messages: str) -> None:
        for message in messages:
            self.session.receive(message.encode() + b"\n")

    def ask_bytes(self, message: str, wait_s: float = 0.0) -> bytes:
        self.received.clear()
        self.send(message)
        self.clock.sleep_s(wait_s)
        return bytes(self.received)

    def ask(self, message: str, wait_s: float = 0.0) -> str:
        return self.ask_bytes(message, wait_s).decode().removesuffix("\n")

    def numbers(self, message: str, wait_s: float = 0.0) -> list[float]:
        return [float(n) for n in self.ask(message, wait_s).split(",")]

    def block(self, message: str) -> list[float]:
        reply = self.ask(message)
        digits = int(reply[1])
        payload = reply[2 + digits :]
        assert len(payload) == int(reply[2 : 2 + digits])
        return [float(n) for n in payload.split(",") if n]

    def error(self) -> int:
        return int(self.ask("SYST:ERR?").split(",")[0])

    def record_on_timer(self, samples: int, period_s: float) -> None:
        self.send(*FAST, "SAMP:SOUR TIM", f"SAMP:TIM {period_s}", f"SAMP:COUN {samples}", "TRIG:SOUR BUS")
        self.send("INIT", "*TRG")
        assert self.error() == 0


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_the_rigs_sequence_byte_for_byte() -> None:
    bench = Bench(lambda times: np.full_like(times, 1e-3))
    silent = [
        *("*CLS", "CONF:VOLT:DC 10", "SENS:VOLT:DC:ZERO:AUTO OFF", "SENS:VOLT:DC:APER 1E-3", "SAMP:SOUR TIM"),
        *("SAMP:TIM 0.01", "SAMP:COUN 6000", "TRIG:SOUR BUS", "INIT", "*TRG"),
    ]
    assert [bench.ask_bytes(command) for command in silent[:5]] == [b""] * 5
    assert bench.ask_bytes("SAMP:TIM? MIN") == b"+1.10000000E-03\n"
    assert [bench.ask_bytes(command) for command in silent[5:]] == [b""] * 5
    bench.clock.sleep_s(5.5)
    block = bench.ask_bytes("R? 500")
    assert block == b"#47999" + b",".join([b"+1.00000000E-03"] * 500) + b"\n"
    assert bench.ask_bytes("SYST:ERR?") == b'+0,"No error"\n'
    assert bench.ask_bytes("DATA:POIN?") == b"+50\n"


def test_identity_options_and_licences() -> None:
    bench = Bench(options=("DIG", "MEM"), serial="MY1", line_frequency_hz=60)
    assert bench.ask("*IDN?") == "Keysight Technologies,34465A,MY1,A.03.01-03.15-03.01-00.52-04-02"
    assert bench.ask("*OPT?") == "0,0,DIG,MEM,0"
    assert bench.ask("SYST:LIC:CAT?") == '"DIG","MEM"'
    assert bench.ask("SYST:LFR?") == "+60"
    assert bench.ask("*TST?;:SYST:COMM:TCP:CONT?") == "+0;+0"
    assert Bench(options=()).ask("*OPT?;:SYST:LIC:CAT?") == '0,0,0,0,0;""'


def test_what_qcodes_asks_when_it_connects(bench: Bench) -> None:
    assert bench.ask("SYSTem:LFRequency?") == "+50"
    bench.send('DISPLAY:TEXT ""')
    assert bench.ask("DISPLAY:TEXT?") == '""'
    assert bench.ask("SENSe:FUNCtion?") == '"VOLT"'
    assert bench.ask("SENSe:VOLTage:DC:RANGe:AUTO?") == "1"
    bench.send("*CLS", "SENSe:VOLTage:DC:APERture 0.001000", "SAMPle:COUNt:PRETrigger 0", "TRIGger:COUNt 1")
    asked = "SENSe:VOLTage:DC:APERture:ENABled?", "SENSe:VOLTage:DC:APERture?", "SAMPle:TIMer? MIN", "TRIGger:LEVel?"
    assert [float(bench.ask(query)) for query in asked] == [1.0, 1e-3, 2 * 1.1e-3 + 20e-3, 0.0]
    bench.send("TRIGger:SOURce BUS", "SAMPle:SOURce TIM", "SAMPle:TIMer 0.1", "SAMPle:COUNt 5", "INIT", "*TRG")
    assert len(bench.numbers("FETCH?", wait_s=1.0)) == 5
    assert bench.error() == 0


def test_the_timer_paces_and_reads_at_its_edges(bench: Bench) -> None:
    bench.clock.sleep_s(2.0)
    bench.record_on_timer(5, 0.25)
    train = bench.pace.train
    assert train is not None
    assert (train.first_s, train.period_s, train.count) == (pytest.approx(2.001), 0.25, 5)
    assert bench.numbers("FETC?", wait_s=2.0) == pytest.approx([2.001, 2.251, 2.501, 2.751, 3.001])
    assert np.array_equal(np.concatenate(bench.asked), train.edges(-np.inf, np.inf))


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(0.0, 0.7), max_size=20), st.floats(-2e-3, 5e-3))
def test_the_signal_is_asked_once_per_edge_and_in_order(waits_s: list[float], latency_s: float) -> None:
    bench = Bench(latency_s=latency_s)
    bench.record_on_timer(200, 0.01)
    for wait_s in waits_s:
        bench.ask_bytes("R?", wait_s)
    bench.clock.sleep_s(3.0)
    bench.ask_bytes("DATA:POIN?")
    assert bench.pace.train is not None
    assert np.array_equal(np.concatenate(bench.asked), bench.pace.train.edges(-1, 9) + latency_s)


@pytest.mark.parametrize("aperture_s", [1e-3, 0.02, 0.2])
def test_a_reading_is_the_mean_over_the_aperture_that_its_edge_ends_or_begins(aperture_s: float) -> None:
    hz = 2.0
    pacing = Bench(lambda t: np.sin(2.0 * np.pi * hz * t), latency_s=None)
    following = Bench(
        lambda t: np.sin(2.0 * np.pi * hz * t), latency_s=None, trigger_in=pacing.pace, clock=pacing.clock
    )
    for bench in (pacing, following):
        bench.send(f"SENS:VOLT:DC:ZERO:AUTO OFF;:SENS:VOLT:DC:RANG 1;APER {aperture_s}")
    following.send("TRIG:SOUR EXT", "TRIG:DEL 0", "TRIG:COUN 20", "INIT")
    pacing.send("SAMP:SOUR TIM", "SAMP:TIM 0.25", "SAMP:COUN 20", "TRIG:SOUR BUS", "TRIG:DEL 0", "INIT", "*TRG")
    pacing.clock.sleep_s(0.25 * 20)
    assert pacing.pace.train is not None
    edges_s = pacing.pace.train.edges(-1.0, 9.0)
    for bench, middle_s in ((pacing, edges_s - 0.5 * aperture_s), (following, edges_s + 0.5 * aperture_s)):
        read = np.array(bench.numbers("FETC?", wait_s=1.0))
        # The mean of a sine over a window is that of its middle, by sin(x) / x; of a short one to some 1e-5.
        mean = np.sinc(hz * aperture_s) * np.sin(2.0 * np.pi * hz * middle_s)
        assert read == pytest.approx(mean, abs=1e-5 if aperture_s == 1e-3 else 1e-8)


def test_a_meter_that_follows_has_its_reading_when_the_aperture_is_over() -> None:
    line = TriggerLine()
    bench = Bench(latency_s=None, trigger_in=line)
    bench.send("SENS:VOLT:DC:ZERO:AUTO OFF", "SENS:VOLT:DC:APER 0.2", "TRIG:SOUR EXT", "TRIG:DEL 0", "INIT")
    line.begin(1.0, 1.0, 1)
    bench.clock.sleep_s(1.19)
    assert bench.ask("DATA:POIN?") == "+0"
    bench.clock.sleep_s(0.0101)
    assert bench.ask("DATA:POIN?") == "+1"


def test_a_reading_is_not_there_before_its_instant() -> None:
    bench = Bench(latency_s=0.1)
    bench.record_on_timer(1, 1.0)
    bench.clock.sleep_s(0.1)
    assert bench.ask("DATA:POIN?") == "+0"
    bench.clock.sleep_s(0.0011)
    assert bench.ask("DATA:POIN?") == "+1"
    assert bench.numbers("FETC?") == pytest.approx([0.101])


def test_r_takes_what_is_there_and_does_not_wait(bench: Bench) -> None:
    assert bench.ask_bytes("R?") == b"#10\n"
    bench.record_on_timer(4, 0.5)
    bench.clock.sleep_s(1.1)
    assert bench.ask_bytes("R? 2") == b"#231+1.00000000E-03,+5.01000000E-01\n"
    assert bench.ask_bytes("R? 500") == b"#215+1.00100000E+00\n"
    assert bench.ask_bytes("R?") == b"#10\n"


def test_real_readings_come_as_doubles_in_either_order(bench: Bench) -> None:
    bench.record_on_timer(3, 0.5)
    bench.send("FORM:DATA REAL,64")
    big = bench.ask_bytes("FETC?", wait_s=2.0)
    assert big[:4] == b"#224"
    assert big[-1:] == b"\n"
    assert np.frombuffer(big[4:-1], ">f8") == pytest.approx([0.001, 0.501, 1.001])
    bench.send("FORM:BORD SWAP")
    assert np.frombuffer(bench.ask_bytes("R? 3")[4:-1], "<f8") == pytest.approx([0.001, 0.501, 1.001])
    assert bench.ask("FORM:DATA?;BORD?") == "REAL,64;SWAP"
    bench.send("FORM:DATA REAL,32")
    assert bench.error() == -224


def test_when_memory_is_full_the_oldest_are_lost_and_bit_14_tells() -> None:
    bench = Bench(memory_readings=10)
    bench.record_on_timer(25, 0.1)
    bench.clock.sleep_s(0.95)
    assert bench.ask("DATA:POIN?;:STAT:QUES?") == "+10;+0"
    bench.clock.sleep_s(3.0)
    assert bench.numbers("FETC?") == pytest.approx(0.001 + 0.1 * np.arange(15, 25))
    assert bench.ask("STAT:QUES?;:STAT:QUES?") == "+16384;+0"
    assert bench.error() == 0


def test_options_decide_how_much_memory_there_is() -> None:
    assert MeterSettings(options=("DIG",)).memory == 50_000
    assert MeterSettings(options=("DIG", "MEM")).memory == 2_000_000


def test_a_record_longer_than_the_memory_streams() -> None:
    bench = Bench(memory_readings=100)
    bench.record_on_timer(1000, 0.01)
    rows: list[float] = []
    for _ in range(13):
        bench.clock.sleep_s(0.8)
        rows += bench.block("R?")
    assert len(rows) == 1000
    assert rows == pytest.approx(0.001 + 0.01 * np.arange(1000), abs=1e-8)


def test_a_too_short_interval_is_refused_or_flagged(bench: Bench) -> None:
    bench.send(*FAST, "SAMP:TIM 1E-3")
    assert bench.error() == -222
    bench.send("SAMP:TIM 5E-3", "SENS:VOLT:APER 20E-3", "SAMP:SOUR TIM", "SAMP:COUN 3")
    times = bench.numbers("READ?", wait_s=1.0)
    assert np.diff(times) == pytest.approx([20.1e-3, 20.1e-3])
    assert bench.ask("STAT:QUES?") == "+4"


def test_the_shortest_interval_follows_the_configuration(bench: Bench) -> None:
    bench.send(*FAST)
    minima = [float(bench.ask("SAMP:TIM? MIN"))]
    for command in ("SENS:VOLT:ZERO:AUTO ON", "SENS:VOLT:RANG:AUTO ON", "SENS:VOLT:APER 20E-6"):
        bench.send(command)
        minima.append(float(bench.ask("SAMP:TIM? MIN")))
    assert minima == pytest.approx([1.1e-3, 2.2e-3, 22.2e-3, 20.04e-3])
    bench.send("CONF:VOLT:DC 10", "SENS:VOLT:APER 20 us;ZERO:AUTO OFF")
    assert float(bench.ask("SAMP:TIM? MIN")) == pytest.approx(20e-6)


@pytest.mark.parametrize(
    ("volts", "range_v", "reading"),
    [
        (11.9, "10", "+1.19000000E+01"),
        (12.1, "10", "+9.90000000E+37"),
        (-12.1, "10", "-9.90000000E+37"),
        (1049.0, "1000", "+1.04900000E+03"),
        (1051.0, "1000", "+9.90000000E+37"),
        (1051.0, "AUTO", "+9.90000000E+37"),
        (300.0, "AUTO", "+3.00000000E+02"),
        (0.121, "0.1", "+9.90000000E+37"),
        (np.nan, "10", "+9.91000000E+37"),
    ],
)
def test_overloads_are_beyond_120_percent_of_range(volts: float, range_v: str, reading: str) -> None:
    bench = Bench(lambda times: np.full_like(times, volts))
    assert bench.ask(f"MEAS:VOLT:DC? {range_v}", wait_s=1.0) == reading
    assert bench.ask("STAT:QUES?") == ("+1" if "9.90" in reading else "+0")


def test_readings_are_multiples_of_the_adc_step() -> None:
    bench = Bench(lambda times: np.linspace(-9.0, 9.0, len(times)), resolution_v=None)
    bench.record_on_timer(400, 0.01)
    readings = np.array(bench.numbers("FETC?", wait_s=5.0))
    steps = readings / 30e-6
    assert steps == pytest.approx(np.round(steps), abs=1e-3)
    assert len(np.unique(readings)) == 400
    coarse = Bench(lambda times: np.full_like(times, 1.234), resolution_v=0.5)
    assert coarse.numbers("READ?", wait_s=1.0) == [1.0]


def test_noise_is_white_seeded_and_independent_of_how_it_is_fetched() -> None:
    def readings(polls: int, *key: int, seed: int = 3) -> FloatArray:
        bench = Bench(np.zeros_like, noise_v_rms=1e-3, seed=seed)
        bench.meter.key_noise(*key)
        bench.record_on_timer(2000, 0.002)
        for _ in range(polls):
            bench.clock.sleep_s(4.1 / polls)
            bench.ask("DATA:POIN?")
        return np.array(bench.numbers("FETC?"))

    once = readings(1)
    assert np.array_equal(once, readings(7))
    assert np.std(once) == pytest.approx(1e-3, rel=0.05)
    assert abs(np.mean(once[1:] * once[:-1])) < 1e-7
    assert not np.array_equal(once, readings(1, 5))
    assert np.array_equal(readings(1, 5), readings(2, 5))
    assert not np.array_equal(once, readings(1, seed=4))


def test_an_externally_triggered_meter_reads_at_the_masters_edges(bench: Bench) -> None:
    slave = Bench(trigger_in=bench.pace, clock=bench.clock)
    slave.send(*FAST, "TRIG:SOUR EXT", "TRIG:COUN 50", "INIT")
    bench.record_on_timer(50, 0.02)
    for _ in range(8):
        bench.clock.sleep_s(0.15)
        slave.ask("DATA:POIN?")
        bench.ask("DATA:POIN?")
    assert len(np.concatenate(slave.asked)) == 50
    assert np.array_equal(np.concatenate(slave.asked), np.concatenate(bench.asked))
    assert slave.ask("*OPC?") == "1"


def test_edges_faster_than_a_reading_are_missed(bench: Bench) -> None:
    slave = Bench(trigger_in=bench.pace, clock=bench.clock)
    slave.send(*FAST, "SENS:VOLT:APER 5E-3", "TRIG:SOUR EXT", "TRIG:COUN 100", "INIT")
    bench.record_on_timer(60, 0.002)
    bench.clock.sleep_s(1.0)
    assert slave.ask("DATA:POIN?") == "+20"
    assert np.diff(np.concatenate(slave.asked)) == pytest.approx(0.006)


def test_each_edge_may_give_several_readings(bench: Bench) -> None:
    slave = Bench(trigger_in=bench.pace, clock=bench.clock)
    slave.send(*FAST, "TRIG:SOUR EXT;COUN 2;DEL 0.01", "SAMP:COUN 3;SOUR TIM;TIM 0.1", "INIT")
    bench.record_on_timer(2, 1.0)
    assert slave.numbers("FETC?", wait_s=3.0) == pytest.approx([0.011, 0.111, 0.211, 1.011, 1.111, 1.211])


def test_only_edges_after_arming_count(bench: Bench) -> None:
    slave = Bench(trigger_in=bench.pace, clock=bench.clock)
    bench.record_on_timer(10, 0.1)
    bench.clock.sleep_s(0.55)
    slave.send(*FAST, "TRIG:SOUR EXT", "TRIG:COUN 10", "INIT")
    bench.clock.sleep_s(0.22)
    bench.send("ABOR")
    bench.clock.sleep_s(1.0)
    assert slave.ask("DATA:POIN?") == "+2"
    assert np.concatenate(slave.asked) == pytest.approx([0.601, 0.701])


def test_the_bus_trigger_is_needed_once_per_count(bench: Bench) -> None:
    bench.send(*FAST, "TRIG:SOUR BUS", "TRIG:COUN 2", "SAMP:COUN 2", "INIT")
    assert bench.ask("STAT:OPER:COND?") == "+32"
    bench.send("*TRG")
    assert bench.ask("STAT:OPER:COND?") == "+16"
    bench.send("*TRG")
    assert bench.error() == -211
    bench.clock.sleep_s(1.0)
    assert bench.ask("STAT:OPER:COND?") == "+32"
    bench.send("*TRG")
    assert len(bench.numbers("FETC?", wait_s=1.0)) == 4
    assert bench.ask("STAT:OPER:COND?") == "+0"


def test_trigger_errors(bench: Bench) -> None:
    bench.send("*TRG")
    assert bench.error() == -211
    bench.send("TRIG:SOUR BUS", "READ?")
    assert bench.error() == -214
    bench.send("INIT", "INIT")
    assert bench.error() == -213
    bench.send("TRIG:SOUR INT")
    assert bench.error() == -224
    bench.send("*RST", "FETC?")
    assert bench.error() == -230


def test_fetch_waits_and_may_be_repeated_without_holding_up_others(bench: Bench) -> None:
    bench.record_on_timer(10, 0.1)
    others = bytearray()
    neighbour = bench.meter.connect(others.extend)
    assert bench.ask("FETC?", wait_s=0.5) == ""
    neighbour.receive(b"DATA:POIN?\n")
    assert others == b"+5\n"
    bench.clock.sleep_s(0.402)
    first = bytes(bench.received)
    assert first.count(b",") == 9
    assert bench.ask_bytes("FETC?") == first
    assert others == b"+5\n"


def test_abort_from_another_client_ends_what_fetch_waits_for(bench: Bench) -> None:
    bench.record_on_timer(10, 0.1)
    neighbour = bench.meter.connect(bytearray().extend)
    assert bench.ask("FETC?", wait_s=0.25) == ""
    neighbour.receive(b"ABOR\n")
    assert [float(n) for n in bench.received.split(b",")] == pytest.approx([0.001, 0.101, 0.201])
    assert bench.pace.train is not None
    assert bench.pace.train.count == 3


def test_opc_answers_when_the_record_is_over(bench: Bench) -> None:
    bench.record_on_timer(10, 0.1)
    assert bench.ask("*OPC?", wait_s=0.9) == ""
    bench.clock.sleep_s(0.1)
    assert bench.received == b"1\n"


def test_a_slave_that_is_waited_for_answers_when_edges_come_later(bench: Bench) -> None:
    slave = Bench(trigger_in=bench.pace, clock=bench.clock)
    slave.send(*FAST, "TRIG:SOUR EXT", "TRIG:COUN 3")
    assert slave.ask("READ?", wait_s=1.0) == ""
    bench.record_on_timer(3, 0.1)
    bench.clock.sleep_s(0.25)
    assert [float(n) for n in slave.received.split(b",")] == pytest.approx([1.001, 1.101, 1.201])


def test_remove_takes_exactly_what_it_is_asked_for(bench: Bench) -> None:
    bench.record_on_timer(4, 0.1)
    bench.clock.sleep_s(0.15)
    assert bench.ask("DATA:REM? 3") == ""
    assert bench.error() == -222
    assert bench.ask("DATA:REM? 2") == "+1.00000000E-03,+1.01000000E-01"
    assert bench.ask("DATA:REM? 1,WAIT") == ""
    bench.clock.sleep_s(0.1)
    assert bench.received == b"+2.01000000E-01\n"
    assert bench.ask("DATA:REM? 5,WAIT", wait_s=1.0) == ""
    assert bench.error() == -222


def test_last_is_the_latest_reading_even_when_it_was_taken_away(bench: Bench) -> None:
    assert bench.ask("DATA:LAST?") == "+9.91000000E+37"
    bench.record_on_timer(2, 0.5)
    bench.clock.sleep_s(1.0)
    bench.ask("R?")
    assert bench.ask("DATA:LAST?") == "+5.01000000E-01 VDC"


@pytest.mark.parametrize(
    "change", ["SENS:VOLT:RANG 1", "CONF:VOLT:DC 10", "*RST", "SYST:PRES", 'FUNC "TEMP"', "NPLC 1"]
)
def test_a_change_of_the_measurement_clears_the_memory(bench: Bench, change: str) -> None:
    bench.record_on_timer(2, 0.5)
    bench.clock.sleep_s(1.0)
    assert bench.ask("DATA:POIN?") == "+2"
    bench.send(change if change != "NPLC 1" else "VOLT:NPLC 1")
    assert bench.ask("DATA:POIN?") == "+0"
    assert bench.error() == 0


def test_a_new_acquisition_clears_the_memory(bench: Bench) -> None:
    first, second = bench.numbers("READ?", wait_s=1.0), bench.numbers("READ?", wait_s=1.0)
    assert (len(first), len(second)) == (1, 1)
    assert second > first


def test_conf_puts_triggers_and_samples_back(bench: Bench) -> None:
    bench.send("TRIG:SOUR EXT;COUN 7;DEL 1", "SAMP:COUN 9;SOUR TIM", "CONF:VOLT:DC 10,0.001")
    assert bench.ask("CONF?") == '"VOLT +1.00000000E+01,+1.00000000E-03"'
    assert bench.ask("TRIG:SOUR?;COUN?;DEL:AUTO?") == "IMM;+1;1"
    assert bench.ask("SAMP:COUN?;SOUR?") == "+1;IMM"
    bench.send("CONF:VOLT:DC AUTO,0.001")
    assert bench.error() == -221


def test_scaling_changes_what_is_read_until_the_function_changes(bench: Bench) -> None:
    bench.send("CONF:VOLT:DC 10", "CALC:SCAL ON")
    assert bench.error() == -221
    bench.send("CALC:SCAL:FUNC SCAL;GAIN 100;OFFS 5;:CALC:SCAL:STAT ON")
    assert bench.ask("CALC:SCAL:FUNC?;GAIN?;OFFS?;STAT?") == "SCAL;+1.00000000E+02;+5.00000000E+00;1"
    bench.clock.sleep_s(2.0)
    assert bench.numbers("READ?", wait_s=1.0)[0] == pytest.approx(100.0 * bench.asked[-1][0] - 5.0)
    bench.send("CONF:VOLT:DC 1")
    assert bench.ask("CALC:SCAL?") == "1"
    bench.send("CONF:TEMP")
    assert bench.ask("CALC:SCAL?") == "0"


@pytest.mark.parametrize(
    ("header", "value", "other"),
    [
        ("CALC:AVER:STAT", "0", "ON"),
        ("CALC:LIM:STAT", "0", "1"),
        ("CALC:TRAN:HIST:STAT", "0", "ON"),
        ("VOLT:DC:NULL:STAT", "0", "ON"),
        ("VOLT:DC:NULL:VAL", "+0.00000000E+00", "1.5"),
        ("TEMP:NULL", "0", "ON"),
        ("DISP:VIEW", "NUM", "MET"),
    ],
)
def test_what_is_not_simulated_says_so_and_stays_as_it_is(bench: Bench, header: str, value: str, other: str) -> None:
    assert bench.ask(f"{header}?") == value
    bench.send(f"{header} {value}")
    assert bench.error() == 0
    bench.send(f"{header} {other}")
    assert bench.ask("SYST:ERR?") == '-221,"Settings conflict; not simulated"'
    assert bench.ask(f"{header}?") == value


def test_it_beeps_and_bears_a_label(bench: Bench) -> None:
    bench.send("SYST:BEEP", 'SYST:LAB "bench 3"', "SYST:BEEP:STAT OFF")
    assert bench.ask("SYST:LAB?;BEEP:STAT?") == '"bench 3";0'
    assert bench.error() == 0


def test_smoothing_gives_the_mean_of_the_last_readings_of_an_acquisition(bench: Bench) -> None:
    assert bench.ask("CALC:SMO:STAT?;RESP?") == "0;FAST"
    bench.send("CONF:VOLT:DC 100", "SENS:VOLT:DC:APER 1E-3;ZERO:AUTO OFF", "SAMP:SOUR TIM;TIM 0.1;COUN 25")
    bench.send("CALC:SMO:STAT ON")
    for _ in range(2):
        # A volt per second, in steps of 0.1 s.
        rise = np.diff(bench.numbers("READ?", wait_s=3.0))
        np.testing.assert_allclose(rise, [0.05] * 9 + [0.1] * 15, atol=1e-6)
    bench.send("CALC:SMO:RESP MEDIUM")
    np.testing.assert_allclose(np.diff(bench.numbers("READ?", wait_s=3.0)), [0.05] * 24, atol=1e-6)
    assert bench.ask("CALC:SMO:RESP?;STAT?") == "MED;1"
    bench.send("*RST")
    assert bench.ask("CALC:SMO:STAT?;RESP?") == "0;FAST"


def test_smoothing_begins_anew_after_an_overload() -> None:
    bench = Bench(lambda times: np.where(np.abs(times - 1.001) < 0.01, 50.0, times))
    bench.send("CONF:VOLT:DC 10", "SENS:VOLT:DC:APER 1E-3;ZERO:AUTO OFF", "SAMP:SOUR TIM;TIM 0.5;COUN 5")
    bench.send("CALC:SMO ON")
    assert bench.numbers("READ?", wait_s=3.0) == pytest.approx([0.001, 0.251, 9.9e37, 1.501, 1.751], abs=1e-6)


def test_aperture_and_line_cycles_exclude_each_other(bench: Bench) -> None:
    bench.send("SENS:VOLT:DC:APER 2E-3")
    assert bench.ask("VOLT:APER:ENAB?;:VOLT:APER?") == "1;+2.00000000E-03"
    bench.send("SENS:VOLT:DC:NPLC 0.05")
    assert bench.ask("VOLT:APER:ENAB?;:VOLT:NPLC?;RES?") == "0;+6.00000000E-02;+1.50000000E-05"
    bench.send("SENS:VOLT:DC:RES 1E-6")
    assert bench.ask("VOLT:NPLC?;NPLC? MIN;NPLC? MAX") == "+1.00000000E+01;+1.00000000E-03;+1.00000000E+02"


def test_without_dig_and_firmware_3_apertures_are_longer() -> None:
    bench = Bench(options=(), firmware="A.02.16-02.40-02.16-00.51-03-01")
    assert bench.ask("VOLT:NPLC? MIN;APER? MIN") == "+2.00000000E-02;+3.00000000E-04"
    bench.send("VOLT:APER 20E-6")
    assert bench.error() == -222


def test_ranges_are_chosen_upwards(bench: Bench) -> None:
    bench.send("VOLT:RANG 3")
    assert bench.ask("VOLT:RANG?;RANG:AUTO?") == "+1.00000000E+01;0"
    bench.send("VOLT:RANG 1001")
    assert bench.error() == -222
    once = Bench(lambda times: np.full_like(times, 0.7))
    once.numbers("READ?", wait_s=1.0)
    once.send("VOLT:RANG:AUTO ONCE")
    assert once.ask("VOLT:RANG?;RANG:AUTO?") == "+1.00000000E+00;0"


def test_settings_are_stored_and_told(bench: Bench) -> None:
    bench.send("TRIG:SLOP POS;LEV -3", "OUTP:TRIG:SLOP POS", "VOLT:IMP:AUTO ON;:VOLT:ZERO:AUTO ONCE", "DISP OFF")
    assert bench.ask("TRIG:SLOP?;LEV?;:OUTP:TRIG:SLOP?") == "POS;-3.00000000E+00;POS"
    assert bench.ask("VOLT:IMP:AUTO?;:VOLT:ZERO:AUTO?;:DISP:STAT?;:ROUT:TERM?") == "1;0;0;FRON"
    bench.send("TRIG:COUN INF;DEL:AUTO OFF", 'DISP:TEXT "hello"')
    assert bench.ask("TRIG:COUN?;DEL:AUTO?;:DISP:TEXT?") == '+9.90000000E+37;0;"hello"'
    bench.send("DISP:TEXT:CLE", "*RST")
    assert bench.ask("DISP:TEXT?;:TRIG:COUN?;SLOP?") == '"";+1;NEG'
    assert bench.error() == 0


def test_a_free_running_meter_reads_until_aborted(bench: Bench) -> None:
    bench.send(*FAST, "TRIG:COUN INF", "INIT")
    bench.clock.sleep_s(1.1005)
    assert bench.ask("DATA:POIN?") == "+1000"
    bench.send("ABOR")
    bench.clock.sleep_s(1.0)
    assert bench.ask("DATA:POIN?;*OPC?") == "+1000;1"


@pytest.mark.parametrize(
    ("message", "reading"),
    [
        ("MEAS:TEMP?", 21.5),
        ("MEAS:TEMP? FRTD,85", 21.5),
        ("MEAS:TEMP? THER,5000,1,DEF", 21.5),
        ("UNIT:TEMP F;:MEAS:TEMP? RTD", 70.7),
        ("UNIT:TEMP K;:MEAS:TEMP? FTH,DEF", 294.65),
    ],
)
def test_temperatures_are_read_in_the_chosen_unit(message: str, reading: float) -> None:
    bench = Bench(celsius=lambda times: np.full_like(times, 21.5))
    assert bench.numbers(message, wait_s=1.0) == pytest.approx([reading])
    assert bench.asked == []


def test_temperature_configuration_is_told_and_checked(bench: Bench) -> None:
    bench.send("CONF:TEMP FTHERMISTOR", "TEMP:NPLC 1;TRAN:FRTD:RES 1000")
    assert bench.ask("CONF?;:FUNC?;:TEMP:TRAN:TYPE?") == '"TEMP FTH,5000,1,+1.00000000E-03";"TEMP";FTH'
    assert bench.ask("TEMP:NPLC?;TRAN:FRTD:RES?;:VOLT:NPLC?") == "+1.00000000E+00;+1.00000000E+03;+1.00000000E+01"
    bench.send("CONF:TEMP FRTD,91")
    assert bench.error() == -224
    open_probe = Bench(celsius=lambda times: np.full_like(times, np.nan))
    assert open_probe.ask("MEAS:TEMP?", wait_s=1.0) == "+9.91000000E+37"
    assert open_probe.ask("DATA:LAST?") == "+9.91000000E+37 C"


@pytest.mark.parametrize(
    ("message", "code"),
    [
        ("NONSENSE?", -113),
        ("SAMP:COUN", -109),
        ("SAMP:COUN 1,2", -108),
        ("SAMP:COUN 0", -222),
        ("SAMP:COUN 1000001", -222),
        ("SAMP:COUN:PRET 5", -222),
        ("SAMP:COUN abc", -148),
        ("SAMP:COUN 'x'", -104),
        ("SAMP:SOUR NEVER", -224),
        ('FUNC "CURR"', -224),
        ("FUNC VOLT", -104),
        ('DISP:TEXT "half', -151),
        ("SAMP,COUN", -103),
        ("1?", -102),
        ("DATA:REM? 1,SOON", -224),
        ("CONF:TEMP FRTD,85,4", -224),
    ],
)
def test_refused_messages_get_no_reply_and_an_error(bench: Bench, message: str, code: int) -> None:
    assert bench.ask_bytes(message) == b""
    assert bench.error() == code
    assert bench.error() == 0


@settings(max_examples=150, deadline=None)
@given(
    st.lists(
        st.sampled_from(
            [
                *("INIT", "*TRG", "ABOR", "R? 3", "FETC?", "READ?", "*OPC?", "*WAI", "*RST", "DATA:REM? 2,WAIT"),
                *("TRIG:SOUR BUS", "TRIG:SOUR EXT", "TRIG:COUN INF", "SAMP:COUN 3", "SAMP:SOUR TIM"),
                *("FORM REAL,64", "CONF:TEMP", "CONF:VOLT:DC AUTO", "VOLT:APER MIN", "*ESR?;*STB?", "DATA:LAST?"),
            ]
        ),
        max_size=25,
    ),
    st.binary(max_size=12),
)
def test_no_order_of_commands_crashes_it(commands: list[str], noise: bytes) -> None:
    bench = Bench()
    other = bench.meter.connect(bytearray().extend)
    for index, command in enumerate(commands):
        (bench.session if index % 3 else other).receive(command.encode() + b"\n")
        bench.clock.sleep_s(0.003)
    bench.session.receive(noise + b"\n")
    other.close()
    fresh = bytearray()
    bench.meter.connect(fresh.extend).receive(b"ABOR;*CLS;*IDN?;:SYST:ERR?\n")
    assert fresh.startswith(b"Keysight Technologies,34465A")
    assert fresh.endswith(b'+0,"No error"\n')


@pytest.fixture
def served() -> Iterator[str]:
    clock = ScaledClock(20.0)
    meter = Simulated34465A(clock, ramp, ramp, settings=MeterSettings(resolution_v=1e-9))
    server = Server(clock)
    port = server.add_tcp("meter", meter).port
    thread = threading.Thread(target=server.serve)
    thread.start()
    yield f"TCPIP0::127.0.0.1::{port}::SOCKET"
    server.stop()
    thread.join()
    server.close()


def test_pyvisa_reads_it_over_a_raw_socket(served: str) -> None:
    manager = pyvisa.ResourceManager("@py")
    try:
        meter: Any = manager.open_resource(served, read_termination="\n", write_termination="\n")
        assert meter.query("*IDN?").split(",")[1] == "34465A"
        meter.write(
            "CONF:VOLT:DC 10;:VOLT:APER 1E-3;ZERO:AUTO OFF;:SAMP:SOUR TIM;TIM 0.01;COUN 50;:TRIG:SOUR BUS;:INIT;*TRG"
        )
        readings = meter.query_ascii_values("FETC?")
        assert np.diff(readings) == pytest.approx(np.full(49, 0.01), abs=1e-6)
        meter.write("FORM REAL,64")
        block = meter.query_binary_values("R?", datatype="d", is_big_endian=True)
        assert block == pytest.approx(readings, abs=1e-6)
        assert meter.query("SYST:ERR?") == '+0,"No error"'
    finally:
        manager.close()


@pytest.mark.parametrize(
    ("said", "is_on"), [("0", "0"), ("1", "1"), ("OFF", "0"), ("ON", "1"), ("once", "0"), ("+0.0E0", "0")]
)
@pytest.mark.parametrize("header", ["SENS:VOLT:DC:ZERO:AUTO", "SENS:VOLT:DC:RANG:AUTO"])
def test_a_switch_that_can_be_once_takes_numbers_as_well(header: str, said: str, is_on: str) -> None:
    bench = Bench()
    bench.send(f"{header} {said}")
    assert (bench.ask("SYST:ERR?"), bench.ask(f"{header}?")) == ('+0,"No error"', is_on)


@pytest.mark.parametrize(("said", "code"), [("TWICE", "-224"), ("'0'", "-104")])
def test_a_switch_that_can_be_once_takes_nothing_else(said: str, code: str) -> None:
    bench = Bench()
    bench.send(f"SENS:VOLT:DC:ZERO:AUTO {said}")
    assert bench.ask("SYST:ERR?").startswith(code)
