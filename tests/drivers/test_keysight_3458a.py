"""The 3458A driver: the bytes of its manual, and records that are right whatever reading the meter has of it."""

from __future__ import annotations

import itertools
import os
import threading
from typing import Any

import numpy as np
import pytest

from drivers.connect import connector
from drivers.keysight_3458a import Keysight3458A, Meter3458ASettings, PacedMeter, PacingMeter
from drivers.transport import Endpoint, InProcessTransport
from rigctl.core.clock import RealClock
from rigctl.core.errors import (
    BadReply,
    EdgesMissing,
    InstrumentError,
    LimitError,
    LinkError,
    LinkTimeout,
    WrongInstrument,
)
from rigctl.core.interfaces import Instrument, PacedRecorder, PacingRecorder, Voltmeter
from simulators.clock import ScaledClock, SimulationClock, VirtualClock
from simulators.keysight_3458a import GENTLE, Meter3458ADialect, Meter3458ASimulatorSettings, Simulated3458A
from simulators.serve import Server
from simulators.wiring import TriggerLine
from tests.drivers.ensemble_bench import Tap
from tests.drivers.expected import Expected

HARDEST = Meter3458ADialect()
SWITCHES = tuple(Meter3458ADialect.model_fields)


def hard(*switches: str) -> Meter3458ADialect:
    return GENTLE.model_copy(update={switch: getattr(HARDEST, switch) for switch in switches})


COMBINATIONS = [
    SWITCHES,
    (),
    *((switch,) for switch in SWITCHES),
    *(itertools.combinations(SWITCHES, 2) if os.environ.get("RIGCTL_ALL_PAIRS") else ()),
]
DIALECTS = pytest.mark.parametrize(
    "dialect",
    [hard(*chosen) for chosen in COMBINATIONS],
    ids=[" and ".join(each) or "gentle" for each in COMBINATIONS],
)


def volts(times_s: np.ndarray) -> np.ndarray:
    return 3.0 * np.sin(2 * np.pi * 0.7 * times_s) + 0.1 * times_s


class Bench:
    """A meter that paces and one that follows it, with a driver each."""

    def __init__(
        self,
        dialect: Meter3458ADialect = HARDEST,
        *,
        clock: SimulationClock | None = None,
        simulated: dict[str, Any] | None = None,
        **configured: Any,
    ) -> None:
        self.clock = clock or VirtualClock()
        self.line = TriggerLine()
        settings = Meter3458ASimulatorSettings(dialect=dialect, **(simulated or {}))
        self.tap = Tap(Simulated3458A(self.clock, volts, self.line, None, settings))
        self.pacing = PacingMeter("readout", Meter3458ASettings(**configured), self._to(self.tap), self.clock)
        following = Simulated3458A(self.clock, volts, None, self.line, settings)
        self.paced = PacedMeter("volts", Meter3458ASettings(**configured), self._to(following), self.clock)

    def _to(self, endpoint: Endpoint) -> Any:
        return lambda: InProcessTransport("sim:meter", endpoint, self.clock)

    def opened(self) -> Bench:
        self.pacing.open()
        self.paced.open()
        return self


OPENING = (("TARM HOLD", ""), ("END ALWAYS", ""), ("ID?", "HP3458A\r\n"), ("ERRSTR?", '0,"NO ERROR"\r\n'))
MEASUREMENT = (
    "PRESET NORM", "TARM HOLD", "INBUF ON", "DCV 10", "APER 0.0010000", "AZERO OFF", "DELAY 0", "MFORMAT SREAL",
    "OFORMAT ASCII",
)  # fmt: skip


def exchanges(*said: str | tuple[str, str]) -> Expected:
    pairs = ((each, "") if isinstance(each, str) else each for each in said)
    return Expected(*((line.encode() + b"\n", reply.encode()) for line, reply in pairs))


def test_a_record_byte_by_byte() -> None:
    conversation = exchanges(
        *OPENING, *MEASUREMENT, "MEM FIFO", "TIMER 0.0100000", "NRDGS 3,TIMER", "TRIG AUTO", "EXTOUT ICOMP,NEG",
        ("ERRSTR?", '0,"NO ERROR"\r\n'), ("MCOUNT?", " 0\r\n"), "TARM SGL", ("MCOUNT?", " 3\r\n"),
        ("ERRSTR?", '0,"NO ERROR"\r\n'),
        ("RMEM 1,3", "-1.500911593E+00,-1.500911355E+00,+1.000000000E+38\r\n"), ("RMEM 1,1", "-1.500911593E+00\r\n"),
    )  # fmt: skip
    clock = VirtualClock()
    meter = PacingMeter(
        "readout", Meter3458ASettings(), lambda: InProcessTransport("sim:meter", conversation, clock), clock
    )
    meter.open()
    began_s = meter.start(3, 0.01)
    rows = meter.fetch()
    # Number 1 is the newest, and it came first: the order is turned round.
    np.testing.assert_array_equal(rows, [[np.nan], [-1.500911355], [-1.500911593]])
    assert clock.now_s() >= began_s + 0.021
    assert not conversation.left


def test_what_they_are() -> None:
    bench = Bench()
    assert isinstance(bench.pacing, PacingRecorder)
    assert isinstance(bench.paced, PacedRecorder)
    for meter in (bench.pacing, bench.paced):
        assert isinstance(meter, Instrument)
        assert isinstance(meter, Voltmeter)


@DIALECTS
def test_a_record_is_right_whatever_reading_the_meter_has(dialect: Meter3458ADialect) -> None:
    bench = Bench(dialect).opened()
    for samples in (1, 2, 240):
        bench.paced.arm(samples, 0.01)
        began_s = bench.pacing.start(samples, 0.01)
        rows, followed = bench.pacing.fetch(), bench.paced.collect()
        edges_s = began_s + bench.pacing.first_sample_after_s + 0.01 * np.arange(samples)
        (ours,), (theirs,) = bench.pacing.channels(), bench.paced.channels()
        # Single reals, 24 bits of 3 V; the middle of the aperture is what the latency says.
        np.testing.assert_allclose(rows[:, 0], volts(edges_s + ours.latency_s), atol=5e-7)
        np.testing.assert_allclose(followed[:, 0], volts(edges_s + theirs.latency_s), atol=5e-7)
        assert (ours.latency_s, theirs.latency_s) == (-0.5e-3, 0.5e-3)
        assert len(bench.pacing.fetch()) == 0
        bench.pacing.confirm_in_step()


@DIALECTS
def test_nothing_is_asked_while_it_samples(dialect: Meter3458ADialect) -> None:
    bench = Bench(dialect).opened()
    began_s = bench.pacing.start(100, 0.01)
    asked_s: list[float] = []
    bench.tap.on_line = lambda _: asked_s.append(bench.clock.now_s()) or True
    bench.pacing.fetch()
    assert min(asked_s) >= began_s + 0.991


@DIALECTS
def test_single_readings(dialect: Meter3458ADialect) -> None:
    bench = Bench(dialect).opened()
    for meter in (bench.pacing, bench.paced):
        reading = meter.voltage()
        assert reading.value == pytest.approx(volts(np.array([reading.time_s]))[0], abs=0.05)
        assert reading.unit == "V"


@DIALECTS
def test_a_stop_is_answered_when_the_meter_has_ended(dialect: Meter3458ADialect) -> None:
    bench = Bench(dialect, link_timeout_s=30.0).opened()
    bench.paced.arm(100, 0.01)
    began_s = bench.pacing.start(100, 0.01)
    bench.clock.sleep_s(0.2)
    bench.paced.stop()
    bench.pacing.stop()
    took_s = bench.clock.now_s() - began_s
    assert took_s < 0.3 if dialect.hears_while_sampling else took_s >= 0.99
    bench.pacing.confirm_in_step()
    assert len(bench.pacing.fetch()) == 0
    with pytest.raises(InstrumentError, match="nothing to collect"):
        bench.paced.collect()
    assert bench.pacing.voltage().unit == "V"


@pytest.mark.parametrize("heeds", [True, False])
def test_a_stop_over_visa_clears_the_device_and_is_confirmed_at_once_where_it_heeds_that(
    monkeypatch: pytest.MonkeyPatch, heeds: bool
) -> None:
    """HiSLIP has the device clear of GPIB: pyvisa's `clear`, to a meter that hears nothing else while it samples."""
    clock = ScaledClock(1.0)
    dialect = hard("hears_while_sampling", *(() if heeds else ("heeds_device_clear",)))
    settings = Meter3458ASimulatorSettings(dialect=dialect)
    server = Server(clock)
    simulated = Simulated3458A(clock, volts, None, None, settings)
    served = server.add_hislip("meter", simulated)
    serving = threading.Thread(target=server.serve)
    samples = threading.Event()

    def received(line: str, client: Any, heard: Any = simulated.received) -> None:
        heard(line, client)
        if line == "TARM SGL":
            samples.set()

    monkeypatch.setattr(simulated, "received", received)
    serving.start()
    address = f"TCPIP::127.0.0.1::hislip0,{served.port}::INSTR"
    meter = PacingMeter("readout", Meter3458ASettings(), connector(address, RealClock()), RealClock())
    try:
        meter.open()
        # An hour, of which nobody waits for the end.
        meter.start(3600, 1.0)
        # A clear that comes first would take the command out of the meter's input.
        assert samples.wait(20.0)
        if heeds:
            meter.stop()
            assert len(meter.fetch()) == 0
            meter.confirm_in_step()
            assert meter.voltage().unit == "V"
        else:
            with pytest.raises(LinkTimeout, match=r"waited 2 s"):
                meter.stop()
    finally:
        meter.close()
        server.stop()
        serving.join(20.0)
        server.close()


class WithDeviceClear(InProcessTransport):
    """In this process, as GPIB."""

    def device_clear(self) -> bool:
        self._received.clear()
        self._connection.device_clear()
        return True


def test_a_meter_that_another_program_has_left_in_a_long_record_is_opened_at_once() -> None:
    clock = VirtualClock()
    settings = Meter3458ASimulatorSettings(dialect=hard("hears_while_sampling"))
    simulated = Simulated3458A(clock, volts, None, None, settings)
    other = simulated.connect(lambda _: None)
    other.receive(b"PRESET NORM;TARM HOLD;INBUF ON;MEM FIFO;TIMER 1;NRDGS 3600,TIMER;TRIG AUTO;TARM SGL\n")
    clock.sleep_s(1.0)
    meter = PacingMeter("readout", Meter3458ASettings(), lambda: WithDeviceClear("sim:", simulated, clock), clock)
    meter.open()
    assert clock.now_s() == pytest.approx(1.0)
    assert meter.voltage().unit == "V"


def test_a_stop_before_it_is_open_connects_by_itself() -> None:
    bench = Bench()
    bench.pacing.stop()
    assert bench.tap.lines == ["TARM HOLD", "ID?"]
    with pytest.raises(LinkError):
        bench.pacing.voltage()


def test_a_stop_from_another_thread_ends_the_wait_for_a_record() -> None:
    bench = Bench(GENTLE, clock=ScaledClock(5.0)).opened()
    bench.pacing.start(1000, 0.01)
    stopper = threading.Timer(0.2, bench.pacing.stop)
    stopper.start()
    rows = bench.pacing.fetch()
    stopper.join(10.0)
    assert rows.shape == (0, 1)


def test_missing_edges_are_told_with_their_number() -> None:
    bench = Bench().opened()
    bench.paced.arm(50, 0.01)
    bench.pacing.start(40, 0.01)
    bench.pacing.fetch()
    bench.clock.sleep_s(0.01)
    assert bench.paced.edges_seen() == 40
    with pytest.raises(EdgesMissing, match="40 of 50 trigger edges came") as missing:
        bench.paced.collect()
    assert (missing.value.came, missing.value.armed) == (40, 50)


def test_surplus_edges_are_left_out_at_the_end() -> None:
    bench = Bench().opened()
    bench.paced.arm(30, 0.01)
    began_s = bench.pacing.start(40, 0.01)
    bench.pacing.fetch()
    edges_s = began_s + 1e-3 + 0.01 * np.arange(30)
    np.testing.assert_allclose(bench.paced.collect()[:, 0], volts(edges_s + 0.5e-3), atol=5e-7)


def test_equal_readings_need_no_order() -> None:
    bench = Bench().opened()
    meter = bench.pacing
    assert meter._oldest_first([1.0, 2.0, 1.0], 1)
    bench.tap.lines.clear()
    assert meter._oldest_first([1.0], 1)
    assert bench.tap.lines == []


def test_an_order_that_cannot_be_is_refused() -> None:
    bench = Bench().opened()
    bench.pacing.start(3, 0.01)
    bench.pacing.fetch()
    with pytest.raises(BadReply, match="a reading that was recalled just before"):
        bench.pacing._oldest_first([1.0, 2.0, 3.0], 1)


@pytest.mark.parametrize(
    ("samples", "period_s", "says"),
    [
        (5001, 0.01, r"1 to 5000 are possible \(memory_readings\)"),
        (0, 0.01, "1 to 5000"),
        (10, 0.5e-3, "possible are 0.001 s"),
        (10, 7000.0, "to 6000 s"),
        (10, 0.01 / 3, "steps of 100 ns"),
    ],
)
def test_what_it_cannot_do_is_refused_before_a_byte_is_sent(samples: int, period_s: float, says: str) -> None:
    bench = Bench().opened()
    bench.tap.lines.clear()
    with pytest.raises(LimitError, match=says):
        bench.pacing.start(samples, period_s)
    assert bench.tap.lines == []


@pytest.mark.parametrize("ppm", [-100.0, 100.0])
def test_a_clock_that_is_slow_or_fast_as_far_as_the_maker_allows_loses_nothing(ppm: float) -> None:
    bench = Bench(GENTLE, simulated={"clock_ppm": ppm}).opened()
    began_s = bench.pacing.start(5000, 0.01)
    taken_s = began_s + 1e-3 + 0.01 / (1.0 + 1e-6 * ppm) * np.arange(5000)
    np.testing.assert_allclose(bench.pacing.fetch()[:, 0], volts(taken_s - 0.5e-3), atol=1e-6)


def test_a_memory_that_is_smaller_than_said_is_noticed() -> None:
    bench = Bench(simulated={"memory_bytes": 100}).opened()
    bench.pacing.start(30, 0.01)
    with pytest.raises(InstrumentError, match="25 of 30 readings are there"):
        bench.pacing.fetch()


@pytest.mark.parametrize("dialect", [HARDEST, GENTLE], ids=["hundreds", "bits"])
def test_an_error_of_the_meter_is_told_with_its_number_and_text(dialect: Meter3458ADialect) -> None:
    bench = Bench(dialect, aperture_s=1e-3).opened()
    # Too fast for the aperture and the overhead, which the driver does not know.
    bench.pacing.start(10, 1e-3)
    code = 102 if dialect is HARDEST else 4
    with pytest.raises(InstrumentError, match=rf'{code},"TRIGGER TOO FAST" at the end of the record'):
        bench.pacing.fetch()


def test_another_instrument_is_refused() -> None:
    bench = Bench(simulated={"identity": "HP3478A"})
    with pytest.raises(WrongInstrument, match="expected a 3458A, but 'HP3478A' answers"):
        bench.pacing.open()


def test_an_examination_looks_at_one_reading_and_leaves_the_meter_holding() -> None:
    bench = Bench()
    findings = list(bench.pacing.examine())
    assert [finding.outcome for finding in findings] == ["ok"] * 3
    assert findings[-1].found.endswith("V now")
    bench.pacing.close()


def test_an_overload_is_no_number() -> None:
    bench = Bench(range_v=1.0).opened()
    bench.clock.sleep_s(0.35)
    assert isinstance(bench.pacing, Keysight3458A)
    assert np.isnan(bench.pacing.voltage().value)
