"""The 33500B driver against its simulator, against golden bytes, and against misbehaving instruments."""

from collections.abc import Callable, Mapping
from typing import Any

import pytest
from pydantic import ValidationError

from drivers.keysight_33500b import Keysight33500B, SourceSettings
from drivers.transport import InProcessTransport
from rigctl.core.errors import BadReply, InstrumentError, LimitError, LinkLost, LinkTimeout, WrongInstrument
from rigctl.core.voltage_sources import Waveform
from simulators.clock import VirtualClock
from simulators.keysight_33500b import GeneratorSettings, Simulated33500B

IDENTITY = "Agilent Technologies,33522B,MY57800256,5.00-1.19-2.00-58-00"
SINE = Waveform("sine", 0.25, 1.0, 60.0, 90.0)


class Tap:
    """Passes bytes on to an endpoint and keeps what was sent; `script` answers in its stead, `once` one time each."""

    def __init__(self, endpoint: Any, script: Mapping[str, bytes]) -> None:
        self.endpoint, self.script = endpoint, script
        self.once: dict[str, bytes] = {}
        self.heard = bytearray()
        self.closed = False

    def connect(self, send: Callable[[bytes], None]) -> "Tap":
        self.send = send
        self.connection = self.endpoint.connect(send)
        return self

    def receive(self, data: bytes) -> None:
        self.heard += data
        message = data.decode().removesuffix("\n")
        if message in self.once:
            self.send(self.once.pop(message))
        elif message in self.script:
            self.send(self.script[message])
        else:
            self.connection.receive(data)

    def close(self) -> None:
        self.closed = True
        self.connection.close()


class Bench:
    """A source, and what goes over its wire."""

    def __init__(self, script: Mapping[str, bytes] | None = None, simulator: Any = None, **settings: Any) -> None:
        self.clock = VirtualClock()
        self.generator = Simulated33500B(self.clock, None, GeneratorSettings(**(simulator or {})))
        self.tap = Tap(self.generator, script or {})
        self.source = Keysight33500B(
            "source",
            SourceSettings(**settings),
            lambda: InProcessTransport("tcp://source:5025", self.tap, self.clock),
            self.clock,
        )

    def opened(self) -> "Bench":
        self.source.open()
        self.tap.heard.clear()
        return self

    @property
    def lines(self) -> list[str]:
        return bytes(self.tap.heard).decode().splitlines()

    def tell(self, *messages: str) -> None:
        """What somebody else says to the generator."""
        connection = self.generator.connect(lambda _: None)
        for message in messages:
            connection.receive(message.encode() + b"\n")
        connection.close()


def test_opening_asks_who_it_is_and_leaves_the_outputs_alone() -> None:
    bench = Bench()
    bench.source.open()
    assert bench.lines == ["*IDN?", "*CLS", "SYST:ERR?"]
    assert bench.source.identify().text == IDENTITY


def test_the_session_of_the_protocols_page_byte_for_byte() -> None:
    bench = Bench().opened()
    bench.source.start({"dm1_z_v": Waveform("triangle", 0.0, 1.0, 3600.0)})
    assert bench.lines == [
        *("*RST", "*CLS", "UNIT:ANGL DEG", "SYST:ERR?"),
        *("OUTP1:LOAD INF", "OUTP1:POL NORM", "SOUR1:FUNC DC", "SOUR1:VOLT:OFFS 0.000000", "SYST:ERR?", "OUTP1 ON"),
        *("OUTP2:LOAD INF", "OUTP2:POL NORM", "SOUR2:VOLT:OFFS 0", "SOUR2:FUNC RAMP", "SOUR2:FREQ 2.777777778E-04"),
        *("SOUR2:FUNC:RAMP:SYMM 50", "SOUR2:VOLT:UNIT VPP", "SOUR2:VOLT 2.000000", "SOUR2:VOLT:OFFS 0.000000"),
        *("SOUR2:PHAS 0.000000", "SYST:ERR?", "OUTP2 ON", "PHAS:SYNC", "SYST:ERR?"),
        *("SOUR1:FUNC?", "OUTP1:POL?", "SOUR1:VOLT:OFFS?", "SOUR2:FUNC?", "OUTP2:POL?", "SOUR2:FUNC:RAMP:SYMM?"),
        *("SOUR2:FREQ?", "SOUR2:VOLT?", "SOUR2:VOLT:OFFS?", "SOUR2:PHAS?"),
    ]


def test_it_resets_once_after_each_opening() -> None:
    bench = Bench().opened()
    for resets in ([True], [False], [False]):
        bench.source.start({"dm1_y_v": SINE})
        assert ["*RST" in bench.lines] == resets
        bench.tap.heard.clear()
    bench.source.open()
    bench.source.start({})
    assert "*RST" in bench.lines


def test_a_sine_has_no_symmetry_and_its_amplitude_is_half_of_peak_to_peak() -> None:
    bench = Bench().opened()
    bench.source.start({"dm1_y_v": SINE})
    sent = [line for line in bench.lines if line.startswith("SOUR1:")]
    assert "SOUR1:FUNC SIN" in sent
    assert "SOUR1:VOLT 2.000000" in sent
    assert "SOUR1:PHAS 90.000000" in sent
    assert not any("SYMM" in line for line in sent)


def test_what_the_generator_made_of_it_is_told() -> None:
    bench = Bench().opened()
    started = bench.source.start({"dm1_y_v": SINE, "dm1_z_v": Waveform("triangle", 0.0, 1.0, 3600.0)})
    taken = started.waveforms["dm1_y_v"]
    assert (taken.shape, taken.offset_v, taken.amplitude_v, taken.phase_deg) == ("sine", 0.25, 1.0, 90.0)
    assert taken.period_s == pytest.approx(1.0 / 0.016667, rel=1e-12)
    assert started.waveforms["dm1_z_v"].period_s == pytest.approx(1.0 / 278e-6, rel=1e-12)


def test_a_foreign_state_does_not_stand_in_the_way() -> None:
    bench = Bench(limit_v=10.0).opened()
    bench.source.start({})
    bench.tell("SOUR1:VOLT 10", "SOUR1:FUNC DC", "SOUR1:VOLT:OFFS 9", "OUTP1:LOAD 50", "NONSENSE", "*CLS")
    started = bench.source.start({"dm1_y_v": Waveform("sine", 0.0, 9.0, 10.0)})
    assert started.waveforms["dm1_y_v"].amplitude_v == pytest.approx(9.0)


def test_stop_opens_both_relays_and_may_come_at_any_time() -> None:
    bench = Bench()
    asked = ["OUTP1 OFF", "OUTP2 OFF", "OUTP1?", "OUTP2?"]
    bench.source.stop()
    assert bench.lines == asked
    assert bench.tap.closed
    bench.opened()
    bench.source.stop()
    bench.source.stop()
    assert bench.lines == asked * 2
    bench.source.close()
    bench.source.close()
    assert bench.tap.closed


@pytest.mark.parametrize(
    ("waveforms", "fault"),
    [
        ({"dm1_x_v": Waveform()}, "there is no output 'dm1_x_v'; there are dm1_y_v, dm1_z_v"),
        ({"dm1_y_v": Waveform(offset_v=2.1)}, r"dm1_y_v: 2.1 V asked for, beyond the limit of 2 V \(limit_v\)"),
        ({"dm1_y_v": Waveform("sine", -1.5, 1.0, 60.0)}, "2.5 V asked for"),
        ({"dm1_y_v": Waveform(offset_v=float("nan"))}, "nan V asked for"),
        ({"dm1_y_v": Waveform("sine", 0.0, 1.0)}, "a period of inf s; possible are 5e-06 s to 1e"),
        ({"dm1_y_v": Waveform("triangle", 0.0, 1.0, 1e-6)}, "a period of 1e-06 s"),
        ({"dm1_y_v": Waveform("sine", 0.0, 5e-4, 60.0)}, "an amplitude of 0.0005 V; at least 0.001 V"),
        ({"dm1_y_v": Waveform("sine", 0.0, -1.0, 60.0)}, "an amplitude of -1 V; .* phase of 180 deg"),
        ({"dm1_y_v": Waveform("sine", 0.0, 1.0, 60.0, 400.0)}, "a phase of 400 deg"),
    ],
)
def test_what_it_cannot_make_is_refused_before_a_byte_is_sent(waveforms: Any, fault: str) -> None:
    bench = Bench(limit_v=2.0).opened()
    with pytest.raises(LimitError, match=f"^source: .*{fault}"):
        bench.source.start(waveforms)
    assert bench.lines == []


def test_settings_that_were_bent_are_an_error_and_the_output_stays_off() -> None:
    bench = Bench().opened()
    bench.source.start({})
    bench.source.stop()
    bench.tap.heard.clear()
    bench.tap.once = {"SYST:ERR?": b'-222,"Data out of range; value clipped to upper limit"\n'}
    with pytest.raises(InstrumentError, match=r"source: -222,.*clipped to upper.*after OUTP1:LOAD INF") as caught:
        bench.source.start({"dm1_y_v": SINE})
    assert (caught.value.instrument, caught.value.code) == ("source", "-222")
    assert "OUTP1 ON" not in bench.lines


@pytest.mark.parametrize(
    "answer",
    [
        b"Agilent Technologies,33521B,MY1,5.00\n",
        b"Keysight Technologies,34465A,MY1,A.03\n",
        b"SIGLENT,33522B,1,2\n",
        b"NEWPORT XPS\n",
        b"\xff\xfe\n",
    ],
)
def test_another_instrument_is_named(answer: bytes) -> None:
    bench = Bench({"*IDN?": answer})
    expected = "expected a Keysight or Agilent 33510B or 33512B or 33520B or 33522B, but"
    with pytest.raises(WrongInstrument, match=f"source at tcp://source:5025: {expected}") as caught:
        bench.source.open()
    assert caught.value.text == answer.decode("ascii", "replace").strip()
    assert bench.tap.closed


@pytest.mark.parametrize("maker", ["Agilent Technologies", "Keysight Technologies"])
@pytest.mark.parametrize("model", ["33510B", "33512B", "33520B", "33522B"])
def test_both_names_on_the_door_and_all_models_with_two_outputs_are_taken(maker: str, model: str) -> None:
    bench = Bench(simulator={"manufacturer": maker, "model": model})
    bench.source.open()
    assert bench.source.identify().model == model


def test_silence_is_a_time_out_and_an_unopened_source_says_so() -> None:
    bench = Bench({"*IDN?": b""})
    with pytest.raises(LinkTimeout, match="tcp://source:5025: waited 2 s"):
        bench.source.open()
    assert bench.tap.closed
    with pytest.raises(LinkLost, match="source: not connected; open it first"):
        Bench().source.start({})


@pytest.mark.parametrize("reply", [b"nonsense\n", b"+0.000E+00\n", b"+NAN\n"])
def test_a_frequency_that_is_none_is_a_bad_reply(reply: bytes) -> None:
    bench = Bench().opened()
    bench.tap.script = {"SOUR1:FREQ?": reply}
    with pytest.raises(BadReply, match=r"source: SOUR1:FREQ\? was answered"):
        bench.source.start({"dm1_y_v": SINE})


TRIANGLE = Waveform("triangle", 0.25, 1.0, 60.0)


@pytest.mark.parametrize(
    ("waveform", "told", "query"),
    [
        (SINE, "SOUR1:FUNC RAMP", r"SOUR1:FUNC\?"),
        (Waveform(offset_v=1.0), "SOUR1:FUNC SIN", r"SOUR1:FUNC\?"),
        (SINE, "OUTP1:POL INV", r"OUTP1:POL\?"),
        (TRIANGLE, "SOUR1:FUNC:RAMP:SYMM 100", r"SOUR1:FUNC:RAMP:SYMM\?"),
    ],
)
def test_another_shape_than_was_set_is_noticed(waveform: Waveform, told: str, query: str) -> None:
    bench = Bench().opened()
    bench.source.start({"dm1_y_v": waveform})
    bench.source.require_running()
    bench.tell(told)
    with pytest.raises(BadReply, match=f"source: {query} was answered"):
        bench.source.require_running()
    bench.source.start({"dm1_y_v": waveform})
    bench.source.require_running()


def test_a_ramp_of_symmetry_50_may_be_called_a_triangle() -> None:
    bench = Bench({"SOUR1:FUNC?": b"TRI\n"}).opened()
    bench.source.start({"dm1_y_v": TRIANGLE})
    bench.source.require_running()


@pytest.mark.parametrize("outputs", [{}, {"a": 1, "b": 1}, {"a": 3}, {"a": 1, "b": 2, "c": 2}])
def test_outputs_that_make_no_sense_are_refused(outputs: dict[str, int]) -> None:
    with pytest.raises(ValidationError, match="outputs must name 1, 2 or both"):
        SourceSettings(outputs=outputs)
