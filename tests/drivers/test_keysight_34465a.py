"""The 34465A driver against its simulator, against golden bytes, and against misbehaving instruments."""

import math
import struct
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.keysight_34465a import MeterThermometer, PacedVoltmeter, PacingVoltmeter
from drivers.keysight_settings import ThermometerSettings, VoltmeterSettings
from drivers.scpi import ScpiLink
from drivers.transport import InProcessTransport
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import BadReply, InstrumentError, LimitError, LinkLost, LinkTimeout, WrongInstrument
from rigctl.core.interfaces import Instrument, PacedRecorder, PacingRecorder, StreamedRecorder, Thermometer, Voltmeter
from simulators.clock import ScaledClock, SimulationClock, VirtualClock
from simulators.keysight_34465a import MeterSettings, Simulated34465A
from simulators.keysight_34465a import instrument as simulated_instrument
from simulators.scpi import Command
from simulators.wiring import TriggerLine

IDENTITY = "Keysight Technologies,34465A,MY12345678,A.03.01-03.15-03.01-00.52-04-02"
NO_ERROR = b'+0,"No error"\n'


def sine(times_s: FloatArray) -> FloatArray:
    return 5.0 * np.sin(2.0 * np.pi * 0.5 * times_s)


@dataclass
class Bench:
    """A master and a slave meter on one trigger line."""

    clock: SimulationClock = field(default_factory=VirtualClock)
    volts: Callable[[FloatArray], FloatArray] = sine
    simulator: dict[str, Any] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        line = TriggerLine()
        options = MeterSettings(**{"resolution_v": 1e-9, "latency_s": 0.0, **self.simulator})
        self.master = Simulated34465A(self.clock, self.volts, self.celsius, line, None, options)
        self.slave = Simulated34465A(self.clock, self.volts, self.celsius, None, line, options)
        settings = VoltmeterSettings(**self.settings)
        self.pacing = PacingVoltmeter("readout", settings, lambda: self.wire(self.master), self.clock)
        self.paced = PacedVoltmeter("monitor", settings, lambda: self.wire(self.slave), self.clock)
        self.thermometer = MeterThermometer(
            "thermometer", ThermometerSettings(), lambda: self.wire(self.slave), self.clock
        )
        for instrument in (self.pacing, self.paced, self.thermometer):
            instrument.open()

    def celsius(self, times_s: FloatArray) -> FloatArray:
        return np.full_like(times_s, 21.25)

    def wire(self, meter: Simulated34465A) -> InProcessTransport:
        return InProcessTransport("sim:", meter, self.clock)

    def tell(self, meter: Simulated34465A, message: bytes) -> bytes:
        """What another client of the meter is answered."""
        replies = bytearray()
        connection = meter.connect(replies.extend)
        connection.receive(message + b"\n")
        connection.close()
        return bytes(replies)

    def record(self, samples: int, period_s: float, every_s: float) -> FloatArray:
        """A whole record of the master, fetched every `every_s`."""
        rows = [self.pacing.fetch()]
        while sum(map(len, rows)) < samples:
            self.clock.sleep_s(every_s)
            rows.append(self.pacing.fetch())
        return np.concatenate(rows)


class Scripted:
    """Answers each message with what the script says; `pieces` cuts replies, one piece every millisecond."""

    def __init__(self, clock: SimulationClock, script: dict[str, bytes], piece: int = 1 << 30) -> None:
        self.clock, self.script, self.piece = clock, script, piece
        self.heard = bytearray()
        self.closed = False

    def connect(self, send: Callable[[bytes], None]) -> "Scripted":
        self.send = send
        return self

    def receive(self, data: bytes) -> None:
        self.heard += data
        reply = self.script.get(data.decode().removesuffix("\n"), b"")
        for index, start in enumerate(range(0, len(reply), self.piece)):
            piece = reply[start : start + self.piece]
            if index == 0:
                self.send(piece)
            else:
                self.clock.call_at(self.clock.now_s() + 1e-3 * index, lambda piece=piece: self.send(piece))

    def close(self) -> None:
        self.closed = True


REPLIES = {
    "*IDN?": IDENTITY.encode() + b"\n",
    "SYST:ERR?": NO_ERROR,
    "SAMP:TIM? MIN": b"+1.10000000E-03\n",
    "STAT:QUES:EVEN?": b"+0\n",
    "CALC:SCAL:STAT?": b"0\n",
    "CALC:SMO:STAT?": b"0\n",
    "DATA:POIN?": b"+1000000\n",
}


def scripted(
    script: dict[str, bytes] | None = None, piece: int = 1 << 30, **settings: Any
) -> tuple[PacingVoltmeter, Scripted]:
    clock = VirtualClock()
    endpoint = Scripted(clock, REPLIES | (script or {}), piece)
    meter = PacingVoltmeter(
        "readout",
        VoltmeterSettings(**settings),
        lambda: InProcessTransport("tcp://meter:5025", endpoint, clock),
        clock,
    )
    return meter, endpoint


def test_they_are_what_procedures_ask_for() -> None:
    bench = Bench()
    for kind in (Instrument, Voltmeter, PacingRecorder):
        assert isinstance(bench.pacing, kind)
    for kind in (Instrument, Voltmeter, PacedRecorder):
        assert isinstance(bench.paced, kind)
    assert isinstance(bench.thermometer, Instrument)
    assert isinstance(bench.thermometer, Thermometer)


def test_the_wire_of_a_record_byte_for_byte() -> None:
    block = b"#47999" + b",".join([b"+1.00000000E-03"] * 500) + b"\n"
    meter, endpoint = scripted({"R? 500": block}, transfer="ascii")
    meter.open()
    assert bytes(endpoint.heard) == b"*IDN?\nABOR\n*CLS\nSYST:ERR?\n"
    endpoint.heard.clear()
    meter.start(500, 0.01)
    assert bytes(endpoint.heard).decode().splitlines() == [
        *("ABOR", "*CLS", "CONF:VOLT:DC 10", "SENS:VOLT:DC:IMP:AUTO OFF", "SENS:VOLT:DC:ZERO:AUTO OFF"),
        *("SENS:VOLT:DC:APER 1.000000E-03", "TRIG:DEL 0", "SAMP:SOUR TIM"),
        *("CALC:SCAL:STAT?", "CALC:SMO:STAT?", "SYST:ERR?", "SAMP:TIM? MIN", "SAMP:TIM 0.010000", "SAMP:COUN 500"),
        *("FORM:DATA ASC", "TRIG:SOUR BUS", "INIT", "SYST:ERR?", "*TRG", "SYST:ERR?"),
    ]
    endpoint.heard.clear()
    rows = meter.fetch()
    assert bytes(endpoint.heard).decode().splitlines() == [
        *("DATA:POIN?", "R? 500", "STAT:QUES:EVEN?", "CALC:SCAL:STAT?", "CALC:SMO:STAT?", "SYST:ERR?"),
    ]
    assert rows.shape == (500, 1)
    assert np.all(rows == 1e-3)
    assert meter.fetch().shape == (0, 1)


SCALED = b"CALC:SCAL:FUNC SCAL;GAIN 100;OFFS 5;STAT ON"


def test_scaling_that_another_client_switched_on_is_switched_off() -> None:
    bench = Bench(volts=lambda times: np.full_like(times, 1.25))
    assert bench.pacing.voltage().value == 1.25
    bench.tell(bench.master, SCALED)
    assert bench.pacing.voltage().value == 1.25
    bench.tell(bench.master, SCALED)
    bench.pacing.start(10, 0.1)
    assert np.all(bench.record(10, 0.1, 0.5) == 1.25)
    assert bench.thermometer.temperature().value == 21.25
    bench.tell(bench.slave, SCALED)
    assert bench.thermometer.temperature().value == 21.25


def test_the_input_is_of_ten_megohms_whatever_another_client_has_set() -> None:
    bench = Bench()
    for meter, measure in ((bench.master, bench.pacing.voltage), (bench.slave, lambda: bench.paced.arm(10, 0.1))):
        bench.tell(meter, b"VOLT:DC:IMP:AUTO ON")
        measure()
        assert bench.tell(meter, b"VOLT:DC:IMP:AUTO?") == b"0\n"


SMOOTHED = b"CALC:SMO:RESP SLOW;STAT ON"


def test_smoothing_that_another_client_switched_on_is_switched_off() -> None:
    bench = Bench()
    for meter in (bench.master, bench.slave):
        bench.tell(meter, SMOOTHED)
    bench.paced.arm(40, 0.1)
    started_s = bench.pacing.start(40, 0.1)
    true = sine(started_s + 1e-3 + 0.1 * np.arange(40))
    assert bench.record(40, 0.1, 0.5)[:, 0] == pytest.approx(true, abs=1e-6)
    assert bench.paced.collect()[:, 0] == pytest.approx(true, abs=1e-6)


def test_a_meter_without_smoothing_is_asked_for_it_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    everything, write, asked = simulated_instrument.scaling_commands, InProcessTransport.write, list[bytes]()

    def without_smoothing(meter: Any) -> tuple[Command, ...]:
        return tuple(each for each in everything(meter) if "SMOothing" not in each.pattern)

    def heard(transport: InProcessTransport, data: bytes) -> None:
        asked.append(data)
        write(transport, data)

    monkeypatch.setattr(simulated_instrument, "scaling_commands", without_smoothing)
    monkeypatch.setattr(InProcessTransport, "write", heard)
    bench = Bench()
    for _ in range(2):
        bench.paced.arm(10, 0.1)
        started_s = bench.pacing.start(10, 0.1)
        expected = sine(started_s + 1e-3 + 0.1 * np.arange(10))
        assert bench.record(10, 0.1, 0.5)[:, 0] == pytest.approx(expected, abs=1e-6)
        assert bench.paced.collect()[:, 0] == pytest.approx(expected, abs=1e-6)
    # Twice by each of the two: a question may have been garbled on its way.
    assert asked.count(b"CALC:SMO:STAT?\n") == 4
    assert asked.count(b"CALC:SCAL:STAT?\n") == 8


@pytest.mark.parametrize(
    ("altered", "said"),
    [(SCALED, r"scaling was switched on.*CALC:SCAL"), (SMOOTHED, r"smoothing was switched on.*CALC:SMO")],
)
def test_a_record_that_was_altered_on_its_way_is_refused(altered: bytes, said: str) -> None:
    bench = Bench()
    bench.paced.arm(10, 0.1)
    bench.pacing.start(10, 0.1)
    bench.clock.sleep_s(0.55)
    for meter in (bench.master, bench.slave):
        bench.tell(meter, altered)
    bench.clock.sleep_s(1.0)
    for record in (bench.pacing.fetch, bench.paced.collect):
        with pytest.raises(InstrumentError, match=said):
            record()


@pytest.mark.parametrize("transfer", ["real64", "ascii"])
@pytest.mark.parametrize("piece", [1, 7, 64])
def test_blocks_may_arrive_in_pieces(transfer: str, piece: int) -> None:
    values = [1.5, -2.25, 9.9e37, 0.0]
    text = ",".join(f"{v:+.8E}" for v in values).encode()
    payload = text if transfer == "ascii" else np.array(values, ">f8").tobytes()
    block = f"#2{len(payload)}".encode() + payload + b"\n"
    meter, _ = scripted({"R? 4": block}, piece, transfer=transfer)
    meter.open()
    meter.start(4, 0.01)
    rows = meter.fetch()
    assert np.array_equal(rows, [[1.5], [-2.25], [np.nan], [0.0]], equal_nan=True)


@pytest.mark.parametrize("transfer", ["real64", "ascii"])
def test_a_record_has_the_signal_at_the_edges(transfer: str) -> None:
    bench = Bench(settings={"transfer": transfer})
    bench.clock.sleep_s(3.0)
    started_s = bench.pacing.start(600, 0.01)
    assert started_s == pytest.approx(3.0)
    rows = bench.record(600, 0.01, 0.7)
    times_s = started_s + 1e-3 + 0.01 * np.arange(600)
    assert rows.shape == (600, 1)
    assert rows[:, 0] == pytest.approx(sine(times_s), abs=2e-8)
    assert bench.pacing.channels()[0].full_scale == 10.0


def test_both_meters_read_at_the_same_edges() -> None:
    bench = Bench(simulator={"latency_s": 2e-3}, settings={"latency_s": 2e-3, "channel": "flag_v"})
    bench.paced.arm(300, 0.02)
    bench.pacing.start(300, 0.02)
    master = bench.record(300, 0.02, 0.5)
    assert np.array_equal(bench.paced.collect(), master)
    channel = bench.paced.channels()[0]
    assert (channel.name, channel.unit, channel.latency_s) == ("flag_v", "V", 2e-3)


@pytest.mark.parametrize("aperture_s", [1e-3, 5e-3])
def test_a_reading_stands_for_the_middle_of_its_aperture(aperture_s: float) -> None:
    bench = Bench(simulator={"latency_s": None}, settings={"aperture_s": aperture_s})
    bench.paced.arm(300, 0.02)
    started_s = bench.pacing.start(300, 0.02)
    edges_s = started_s + bench.pacing.first_sample_after_s + 0.02 * np.arange(300)
    for meter, rows in ((bench.pacing, bench.record(300, 0.02, 0.5)), (bench.paced, bench.paced.collect())):
        late_s = meter.channels()[0].latency_s
        assert abs(late_s) == 0.5 * aperture_s
        assert rows[:, 0] == pytest.approx(sine(edges_s + late_s), rel=1e-4, abs=1e-6)


def test_a_record_longer_than_the_memory_streams() -> None:
    bench = Bench(simulator={"memory_readings": 200}, volts=lambda times: np.mod(times, 10.0))
    started_s = bench.pacing.start(1500, 0.005)
    rows = bench.record(1500, 0.005, 0.8)[:, 0]
    assert rows == pytest.approx(np.mod(started_s + 1e-3 + 0.005 * np.arange(1500), 10.0), abs=1e-8)


def test_readings_lost_to_a_full_memory_are_an_error() -> None:
    bench = Bench(simulator={"memory_readings": 200})
    bench.pacing.start(1500, 0.005)
    bench.clock.sleep_s(1.5)
    with pytest.raises(InstrumentError, match=r"memory overflowed.*fetch more often"):
        bench.pacing.fetch()
    assert bench.tell(bench.master, b"*OPC?") == b"1\n"


def test_a_record_that_somebody_else_ended_is_an_error() -> None:
    bench = Bench()
    bench.pacing.start(100, 0.1)
    bench.clock.sleep_s(3.05)
    bench.tell(bench.master, b"ABOR")
    assert bench.pacing.fetch().shape == (31, 1)
    bench.clock.sleep_s(8.0)
    assert bench.pacing.fetch().shape == (0, 1)
    bench.clock.sleep_s(2.0)
    with pytest.raises(InstrumentError, match="69 readings never came; was it stopped"):
        bench.pacing.fetch()
    assert bench.pacing.voltage().unit == "V"


def test_fifty_thousand_readings_are_fetched() -> None:
    bench = Bench(settings={"aperture_s": 20e-6})
    bench.pacing.start(50_000, 20e-6)
    bench.clock.sleep_s(1.1)
    assert bench.pacing.fetch().shape == (50_000, 1)


def test_overloads_are_nan() -> None:
    bench = Bench(volts=lambda times: np.where(np.mod(times, 1.0) < 0.5, 20.0, 1.0))
    bench.pacing.start(10, 0.25)
    rows = bench.record(10, 0.25, 1.0)[:, 0]
    assert np.isnan(rows).tolist() == [True, True, False, False] * 2 + [True, True]
    assert math.isnan(bench.pacing.voltage().value) == (bench.clock.now_s() % 1.0 < 0.5)


def test_single_readings_have_their_unit_and_time() -> None:
    bench = Bench(volts=lambda times: np.full_like(times, 1.25))
    bench.clock.sleep_s(7.0)
    for reading in (bench.pacing.voltage(), bench.paced.voltage()):
        assert (reading.value, reading.unit) == (1.25, "V")
        assert reading.time_s == pytest.approx(7.0, abs=0.01)
    temperature = bench.thermometer.temperature()
    assert (temperature.value, temperature.unit) == (21.25, "degC")
    assert bench.pacing.identify().text == IDENTITY


def test_a_single_reading_never_ends_a_running_record() -> None:
    bench = Bench()
    bench.pacing.start(100, 0.01)
    with pytest.raises(InstrumentError, match="a record is running"):
        bench.pacing.voltage()
    assert len(bench.record(100, 0.01, 0.2)) == 100
    bench.pacing.start(100, 0.01)
    bench.pacing.stop()
    assert bench.pacing.voltage().unit == "V"
    assert bench.pacing.fetch().shape == (0, 1)


def test_a_record_that_did_not_start_is_not_running() -> None:
    bench = Bench()

    class Interfered(InProcessTransport):
        """Somebody else aborts right before our trigger."""

        def write(self, data: bytes) -> None:
            if data == b"*TRG\n":
                bench.tell(bench.master, b"ABOR")
            super().write(data)

    meter = PacingVoltmeter(
        "readout", VoltmeterSettings(), lambda: Interfered("sim:", bench.master, bench.clock), bench.clock
    )
    meter.open()
    with pytest.raises(InstrumentError, match=r'-211,"Trigger ignored" after \*TRG'):
        meter.start(10, 0.01)
    assert meter.voltage().unit == "V"


def test_an_open_probe_is_nan_and_probes_are_configured() -> None:
    bench = Bench()
    bench.celsius = lambda times: np.full_like(times, np.nan)  # type: ignore[method-assign]
    meter = Simulated34465A(bench.clock, sine, bench.celsius)
    settings = ThermometerSettings(probe="thermistor")
    thermometer = MeterThermometer("t", settings, lambda: bench.wire(meter), bench.clock)
    thermometer.open()
    assert math.isnan(thermometer.temperature().value)
    assert bench.tell(meter, b"CONF?").startswith(b'"TEMP THER,5000')


@pytest.mark.parametrize(
    ("samples", "period_s", "text"),
    [
        (0, 0.01, "0 samples"),
        (1_000_001, 0.01, "1 to 1000000"),
        (10, 0.9e-3, "aperture_s"),
        (10, 3601.0, "3600 s"),
        (10, 1.0 / 300.0, "use 0.003333 s"),
    ],
)
def test_impossible_records_are_refused_before_a_byte(samples: int, period_s: float, text: str) -> None:
    meter, endpoint = scripted()
    meter.open()
    endpoint.heard.clear()
    with pytest.raises(LimitError, match=text):
        meter.start(samples, period_s)
    assert endpoint.heard == b""


def test_a_slave_refuses_what_its_memory_cannot_hold() -> None:
    bench = Bench(settings={"memory_readings": 100})
    bench.paced.arm(100, 0.01)
    with pytest.raises(LimitError, match="1 to 100 are possible"):
        bench.paced.arm(101, 0.01)


def test_an_interval_that_the_meter_cannot_do_is_refused() -> None:
    bench = Bench()
    for begin in (bench.pacing.start, bench.paced.arm):
        with pytest.raises(InstrumentError, match=r"too fast, the meter needs 0\.0011 s"):
            begin(10, 1.05e-3)


def test_a_follower_is_read_while_the_edges_come_and_its_memory_is_no_limit() -> None:
    bench = Bench(simulator={"memory_readings": 100}, settings={"memory_readings": 100})
    assert isinstance(bench.paced, StreamedRecorder)
    with pytest.raises(LimitError):
        bench.paced.arm(1000, 0.02)
    bench.paced.follow(1000, 0.02)
    bench.pacing.start(1000, 0.02)
    master, slave = [], []
    while sum(map(len, slave)) < 1000:
        bench.clock.sleep_s(1.5)
        master.append(bench.pacing.fetch())
        slave.append(bench.paced.fetch())
    assert np.array_equal(np.concatenate(slave), np.concatenate(master))
    assert bench.paced.fetch().shape == (0, 1)
    assert np.isfinite(bench.paced.voltage().value), "the record has ended"


def test_a_follower_that_nobody_reads_says_so() -> None:
    bench = Bench(simulator={"memory_readings": 100})
    bench.paced.follow(1000, 0.02)
    bench.pacing.start(1000, 0.02)
    bench.clock.sleep_s(5.0)
    with pytest.raises(InstrumentError, match="monitor: its memory overflowed and the oldest readings are lost"):
        bench.paced.fetch()
    for samples in (0, 1_000_001):
        with pytest.raises(LimitError, match=f"{samples} samples asked for; 1 to 1000000 are possible"):
            bench.paced.follow(samples, 0.02)
    with pytest.raises(LimitError, match="a sample every"):
        bench.paced.follow(10, 1e-5)


def test_missing_edges_are_an_error() -> None:
    bench = Bench()
    bench.paced.arm(30, 0.02)
    bench.pacing.start(20, 0.02)
    bench.record(20, 0.02, 0.5)
    with pytest.raises(InstrumentError, match="monitor: 20 of 30 trigger edges came; check the cable"):
        bench.paced.collect()
    with pytest.raises(InstrumentError, match="20 of 30"):
        bench.paced.collect()
    with pytest.raises(InstrumentError, match="not armed"):
        Bench().paced.collect()


def test_a_refused_setting_carries_the_instruments_code_and_text() -> None:
    bench = Bench(
        simulator={"options": (), "firmware": "A.02.16-02.40-02.16-00.51-03-01"}, settings={"aperture_s": 20e-6}
    )
    with pytest.raises(InstrumentError, match=r"readout: -222.*Data out of range.*APER 2") as caught:
        bench.pacing.start(10, 0.01)
    assert (caught.value.instrument, caught.value.code, caught.value.text) == ("readout", "-222", "Data out of range")


def test_all_queued_errors_are_taken_from_the_queue() -> None:
    bench = Bench()
    bench.tell(bench.master, b"FIRST")
    bench.tell(bench.master, b"SAMP:COUN 0")
    link = ScpiLink("meter", lambda: bench.wire(bench.master), 1.0)
    link.open(("Keysight",), ("34465A",))
    with pytest.raises(InstrumentError, match=r"-113.*and 1 more"):
        link.check("at a look")
    assert link.errors() == []


def test_a_query_that_is_not_understood_times_out_with_the_instruments_error() -> None:
    bench = Bench()
    link = ScpiLink("meter", lambda: bench.wire(bench.master), 1.0)
    link.open(("Keysight",), ("34465A",))
    with pytest.raises(
        LinkTimeout, match=r'meter: no reply to NONSENSE\?; the instrument says -113,"Undefined header"'
    ):
        link.query("NONSENSE?")
    assert link.query("*IDN?") == IDENTITY


@pytest.mark.parametrize(
    "answer",
    [
        b"Keysight Technologies,34461A,MY1,A.02\n",
        b"NEWPORT XPS\n",
        b"\xff\xfe\x00garbage\n",
        b"\n",
        b"a,34465A,c,d\n",
    ],
)
def test_another_instrument_is_named(answer: bytes) -> None:
    meter, endpoint = scripted({"*IDN?": answer})
    with pytest.raises(WrongInstrument, match="readout at tcp://meter:5025: expected a Keysight 34465A") as caught:
        meter.open()
    assert endpoint.closed
    assert caught.value.text == answer.decode("ascii", "replace").strip()
    assert repr(caught.value.text) in str(caught.value)


def test_silence_is_a_time_out() -> None:
    meter, endpoint = scripted({"*IDN?": b""})
    with pytest.raises(LinkTimeout, match="tcp://meter:5025: waited 2 s"):
        meter.open()
    assert endpoint.closed
    meter, endpoint = scripted({"SYST:ERR?": b""})
    with pytest.raises(LinkTimeout, match="waited 2 s"):
        meter.open()


@pytest.mark.parametrize(
    ("script", "transfer", "error", "text"),
    [
        ({"R? 4": b"+1.0,+2.0\n"}, "ascii", BadReply, "begins with #"),
        ({"R? 4": b"#0+1.0\n"}, "ascii", BadReply, "begins with #"),
        ({"R? 4": b"#2x1+1.0\n"}, "ascii", BadReply, "in digits"),
        ({"R? 4": b"#14+1.0,\n"}, "ascii", BadReply, "line feed"),
        ({"R? 4": b"#14+1x0\n"}, "ascii", BadReply, "numbers with commas"),
        ({"R? 4": b"#171,2,3,4,5\n"}, "ascii", BadReply, "line feed"),
        ({"R? 4": b"#191,2,3,4,5\n"}, "ascii", BadReply, "5 readings.*expected 4"),
        ({"R? 4": b"#15+1.0,\n"}, "real64", BadReply, "8-byte doubles"),
        (
            {"R? 4": b"#232" + struct.pack(">4d", 1.0, 2.0, math.nan, 4.0) + b"\n"},
            "real64",
            BadReply,
            r"answered '3f f0 .* \(hex\)', expected finite numbers, but number 3 of 4 is nan",
        ),
        ({"R? 4": b"#18" + struct.pack(">2d", 1.0, 2.0)}, "real64", BadReply, r"40 \(hex\)', expected a line feed"),
        ({"R? 4": b"#248" + b"+1.0"}, "real64", LinkTimeout, r"no reply to R\? 4; the instrument says \+0"),
        ({"STAT:QUES:EVEN?": b"what\n", "DATA:POIN?": b"+0\n"}, "ascii", BadReply, "a (whole )?number"),
        ({"SYST:ERR?": b"fine\n"}, "ascii", BadReply, "a code and a text"),
    ],
)
def test_what_no_manual_allows_is_a_bad_reply(
    script: dict[str, bytes], transfer: str, error: type[Exception], text: str
) -> None:
    meter, endpoint = scripted({"R? 4": b"#10\n"}, transfer=transfer)
    meter.open()
    meter.start(4, 0.01)
    endpoint.script.update(script)
    with pytest.raises(error, match=text):
        _ = meter.start(4, 0.01) if "SYST:ERR?" in script else meter.fetch()


@given(
    st.lists(st.floats(-1e6, 1e6), max_size=30), st.booleans(), st.integers(1, 40), st.sampled_from([b"\n", b"\r\n"])
)
def test_any_block_survives_the_wire(values: list[float], as_text: bool, piece: int, end: bytes) -> None:
    transfer = "ascii" if as_text else "real64"
    payload = ",".join(map(repr, values)).encode() if as_text else np.array(values, ">f8").tobytes()
    length = str(len(payload))
    block = f"#{len(length)}{length}".encode() + payload + end
    there = f"{len(values):+d}\n".encode()
    meter, _ = scripted({f"R? {len(values)}": block, "DATA:POIN?": there}, piece, transfer=transfer)
    meter.open()
    meter.start(max(len(values), 1), 0.01)
    assert meter.fetch()[:, 0].tolist() == values


@given(st.binary(max_size=60).filter(lambda garbage: not garbage.startswith(b"#")))
def test_garbage_instead_of_a_block_is_a_typed_error(garbage: bytes) -> None:
    meter, _ = scripted({"R? 40": garbage})
    meter.open()
    meter.start(40, 0.01)
    with pytest.raises((BadReply, LinkTimeout), match="readout"):
        meter.fetch()


@given(st.integers(1, 9), st.binary(max_size=30))
def test_a_block_that_goes_wrong_later_is_one_too(digit: int, garbage: bytes) -> None:
    meter, _ = scripted({"R? 40": f"#{digit}".encode() + garbage})
    meter.open()
    meter.start(40, 0.01)
    with suppress(BadReply, LinkTimeout):
        assert 0 <= len(meter.fetch()) <= 40


def test_nothing_is_touched_before_open_and_after_close() -> None:
    connected: list[str] = []

    def connect() -> InProcessTransport:
        connected.append("now")
        raise LinkLost("refused")

    meter = PacingVoltmeter("readout", VoltmeterSettings(), connect, VirtualClock())
    meter.close()
    with pytest.raises(LinkLost, match="open it first"):
        meter.voltage()
    assert connected == []
    with pytest.raises(LinkLost, match="refused"):
        meter.stop()
    bench = Bench()
    bench.pacing.start(10, 0.01)
    bench.pacing.close()
    bench.pacing.close()
    bench.pacing.stop()
    with pytest.raises(LinkLost, match="readout: not connected"):
        bench.pacing.fetch()


def test_opening_ends_what_an_earlier_program_left_running() -> None:
    bench = Bench()
    bench.pacing.start(1000, 1.0)
    bench.pacing.close()
    bench.pacing.open()
    assert bench.tell(bench.master, b"*OPC?;STAT:OPER:COND?") == b"1;+0\n"
    assert not math.isnan(bench.pacing.voltage().value)


def test_stop_from_another_thread_ends_a_record() -> None:
    bench = Bench(clock=ScaledClock(100.0))
    bench.paced.arm(100_000 // 2, 0.01)
    bench.pacing.start(100_000, 0.01)
    stop_now = threading.Event()

    def stop() -> None:
        stop_now.wait()
        for _ in range(3):
            bench.pacing.stop()

    stopper = threading.Thread(target=stop, daemon=True)
    stopper.start()
    rows = [bench.pacing.fetch()]
    while stopper.is_alive():
        bench.clock.sleep_s(0.2)
        rows.append(bench.pacing.fetch())
        if sum(map(len, rows)) > 50:
            stop_now.set()
    rows.append(bench.pacing.fetch())
    bench.clock.sleep_s(1.0)
    assert bench.pacing.fetch().shape == (0, 1)
    assert 50 < sum(map(len, rows)) < 100_000
    assert bench.tell(bench.master, b"*OPC?") == b"1\n"
    with pytest.raises(InstrumentError, match="of 50000 trigger edges"):
        bench.paced.collect()


@pytest.mark.parametrize(
    "wrong", [{"range_v": 5.0}, {"aperture_s": 1e-6}, {"transfer": "xml"}, {"chanel": "x"}, {"memory_readings": 0}]
)
def test_wrong_settings_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        VoltmeterSettings(**wrong)
