"""HiSLIP: message by message in memory, and through pyvisa over a real port."""

import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import pyvisa

from simulators.clock import ScaledClock, VirtualClock
from simulators.faults import FaultPlan, FaultyInstrument
from simulators.hislip import HEADER, Channel, HislipPort, Kind
from simulators.serve import Server

MEGABYTES = "0123456789abcdef" * 65536 * 3


class Meter:
    """A little SCPI: remembers what it was told, answers `*IDN?`, echoes what ends with `?`."""

    kind = "meter"

    def __init__(self) -> None:
        self.told: list[str] = []
        self.links: list[MeterLink] = []

    def connect(self, send: Callable[[bytes], None]) -> "MeterLink":
        self.links.append(MeterLink(self, send))
        return self.links[-1]


class MeterLink:
    def __init__(self, meter: Meter, send: Callable[[bytes], None]) -> None:
        self.meter, self.send = meter, send
        self.hung_up = False
        self.closed = False
        self.rest = b""

    def receive(self, data: bytes) -> None:
        *lines, self.rest = (self.rest + data).split(b"\n")
        for line in lines:
            self.meter.told.append(line.decode())
            if line == b"*IDN?":
                self.send(b"Maker,Meter,")
                self.send(b"1,2.0\n")
            elif line == b"megabytes?":
                self.send(MEGABYTES.encode() + b"\n")
            elif line.endswith(b"?"):
                self.send(line + b"\n")
            elif line == b"off":
                self.hung_up = True

    def close(self) -> None:
        self.closed = True


class Far:
    """The client's end of one channel, in memory."""

    def __init__(self, port: HislipPort) -> None:
        self.received = bytearray()
        self.channel: Channel = port.connect(self.received.extend)

    def send(self, kind: int, control: int = 0, parameter: int = 0, payload: bytes = b"") -> None:
        self.channel.receive(HEADER.pack(b"HS", kind, control, parameter, len(payload)) + payload)

    def messages(self) -> list[tuple[int, int, int, bytes]]:
        found = []
        while self.received:
            prologue, kind, control, parameter, length = HEADER.unpack_from(self.received)
            assert prologue == b"HS"
            payload = bytes(self.received[HEADER.size : HEADER.size + length])
            assert len(payload) == length
            del self.received[: HEADER.size + length]
            found.append((kind, control, parameter, payload))
        return found


class Pair:
    """An initialised session."""

    def __init__(self, **faults: object) -> None:
        self.meter = Meter()
        faulty = FaultyInstrument(self.meter, FaultPlan.model_validate(faults), VirtualClock())
        self.port = HislipPort(faulty if faults else self.meter)
        self.data, self.side = Far(self.port), Far(self.port)
        self.data.send(Kind.INITIALIZE, 0, 0x0100 << 16, b"hislip0")
        ((kind, control, parameter, payload),) = self.data.messages()
        assert (kind, control, payload) == (Kind.INITIALIZE_RESPONSE, 0, b"")
        assert parameter >> 16 == 0x0100
        self.side.send(Kind.ASYNC_INITIALIZE, 0, parameter & 0xFFFF)
        ((kind, *_),) = self.side.messages()
        assert kind == Kind.ASYNC_INITIALIZE_RESPONSE

    def status(self, delivered: bool = False) -> int:
        self.side.send(Kind.ASYNC_STATUS_QUERY, int(delivered))
        ((kind, status, _, _),) = self.side.messages()
        assert kind == Kind.ASYNC_STATUS_RESPONSE
        return status


def test_a_response_carries_the_identifier_of_its_command() -> None:
    pair = Pair()
    pair.data.send(Kind.DATA_END, 0, 0xFFFFFF00, b"*IDN?\n")
    assert pair.data.messages() == [(Kind.DATA_END, 0, 0xFFFFFF00, b"Maker,Meter,1,2.0\n")]
    pair.data.send(Kind.DATA_END, 1, 0xFFFFFF02, b"volt?\n")
    assert pair.data.messages() == [(Kind.DATA_END, 0, 0xFFFFFF02, b"volt?\n")]


@pytest.mark.parametrize("terminator", [b"", b"\n"])
def test_the_end_of_a_message_ends_the_command_with_or_without_a_line_feed(terminator: bytes) -> None:
    pair = Pair()
    pair.data.send(Kind.DATA, 0, 2, b"conf:")
    pair.data.send(Kind.DATA, 0, 4, b"volt" + terminator)
    pair.data.send(Kind.DATA_END, 0, 6, b"")
    assert pair.meter.told == ["conf:volt"]


def test_messages_may_come_byte_by_byte_or_many_at_once() -> None:
    pair = Pair()
    stream = b"".join(HEADER.pack(b"HS", Kind.DATA_END, 0, number, 4) + b"cmd%d" % number for number in range(3))
    for position in range(len(stream)):
        pair.data.channel.receive(stream[position : position + 1])
    pair.data.channel.receive(stream)
    assert pair.meter.told == ["cmd0", "cmd1", "cmd2"] * 2


def test_a_trigger_is_a_command() -> None:
    pair = Pair()
    pair.data.send(Kind.TRIGGER, 0, 2)
    assert pair.meter.told == ["*TRG"]


def test_long_responses_are_cut_to_what_the_client_takes() -> None:
    pair = Pair()
    pair.side.send(Kind.ASYNC_MAX_MSG_SIZE, payload=struct.pack("!Q", HEADER.size + 8))
    assert pair.side.messages() == [(Kind.ASYNC_MAX_MSG_SIZE_RESPONSE, 0, 0, struct.pack("!Q", 1 << 20))]
    pair.data.send(Kind.DATA_END, 0, 2, b"*IDN?")
    assert pair.data.messages() == [
        (Kind.DATA, 0, 2, b"Maker,Me"),
        (Kind.DATA, 0, 2, b"ter,1,2."),
        (Kind.DATA_END, 0, 2, b"0\n"),
    ]


def test_status_says_whether_a_response_waits() -> None:
    pair = Pair()
    assert pair.status() == 0
    pair.data.send(Kind.DATA_END, 0, 2, b"volt?")
    assert pair.status() == 0x10
    assert pair.status(delivered=True) == 0
    pair.data.send(Kind.DATA_END, 0, 4, b"volt?")
    pair.data.send(Kind.DATA_END, 0, 6, b"off-line")
    assert pair.status() == 0


def test_device_clear_forgets_what_was_half_said_on_both_sides() -> None:
    pair = Pair()
    pair.data.send(Kind.DATA, 0, 2, b"half a comm")
    pair.side.send(Kind.ASYNC_DEVICE_CLEAR)
    assert pair.side.messages() == [(Kind.ASYNC_DEVICE_CLEAR_ACKNOWLEDGE, 0, 0, b"")]
    pair.data.send(Kind.DATA_END, 0, 4, b"ignored?")
    assert pair.data.messages() == []
    pair.data.send(Kind.DEVICE_CLEAR_COMPLETE)
    assert pair.data.messages() == [(Kind.DEVICE_CLEAR_ACKNOWLEDGE, 0, 0, b"")]
    pair.data.send(Kind.DATA_END, 0, 0xFFFFFF00, b"volt?")
    assert pair.data.messages() == [(Kind.DATA_END, 0, 0xFFFFFF00, b"volt?\n")]
    assert pair.meter.told == ["volt?"]
    assert [link.closed for link in pair.meter.links] == [True, False]


def test_remote_local_control_is_acknowledged() -> None:
    pair = Pair()
    pair.side.send(Kind.ASYNC_REMOTE_LOCAL_CONTROL, 1)
    assert pair.side.messages() == [(Kind.ASYNC_REMOTE_LOCAL_RESPONSE, 0, 0, b"")]


def test_unknown_messages_are_named_and_the_session_goes_on() -> None:
    pair = Pair()
    for far in (pair.data, pair.side):
        far.send(99, 0, 0, b"whatever")
        ((kind, code, _, text),) = far.messages()
        assert (kind, code, text) == (Kind.ERROR, 1, b"message type 99")
    pair.data.send(Kind.DATA_END, 0, 2, b"volt?")
    assert len(pair.data.messages()) == 1


def test_too_large_a_message_is_skipped_and_the_session_goes_on() -> None:
    pair = Pair()
    size = (1 << 20) + 1
    pair.data.channel.receive(HEADER.pack(b"HS", Kind.DATA_END, 0, 2, size))
    ((kind, code, _, _),) = pair.data.messages()
    assert (kind, code) == (Kind.ERROR, 4)
    for _ in range(size // 1000):
        pair.data.channel.receive(bytes(1000))
    pair.data.channel.receive(bytes(size % 1000))
    pair.data.send(Kind.DATA_END, 0, 4, b"volt?")
    assert pair.data.messages() == [(Kind.DATA_END, 0, 4, b"volt?\n")]


@pytest.mark.parametrize(
    ("stream", "code"),
    [
        (b"GET / HTTP/1.1\r\n\r\n", 1),
        (HEADER.pack(b"HS", Kind.DATA_END, 0, 2, 0), 3),
        (HEADER.pack(b"HS", Kind.INITIALIZE, 0, 0x01000000, 5) + b"inst0", 3),
        (HEADER.pack(b"HS", Kind.ASYNC_INITIALIZE, 0, 77, 0), 3),
        (HEADER.pack(b"HS", Kind.INITIALIZE, 0, 0x01000000, 0) + HEADER.pack(b"HS", Kind.DATA_END, 0, 2, 0), 2),
    ],
)
def test_what_breaks_the_protocol_ends_the_connection(stream: bytes, code: int) -> None:
    far = Far(HislipPort(Meter()))
    far.channel.receive(stream)
    kind, control, _, text = far.messages()[-1]
    assert (kind, control) == (Kind.FATAL_ERROR, code)
    assert text
    assert far.channel.hung_up


def test_a_second_client_cannot_take_over_a_session() -> None:
    pair = Pair()
    thief = Far(pair.port)
    thief.send(Kind.ASYNC_INITIALIZE, 0, 1)
    assert thief.channel.hung_up
    assert not pair.side.channel.hung_up


@pytest.mark.parametrize("first", ["data", "side"])
def test_with_one_channel_the_other_ends_and_the_instrument_hears_of_it(first: str) -> None:
    pair = Pair()
    far, other = (pair.data, pair.side) if first == "data" else (pair.side, pair.data)
    far.channel.close()
    assert other.channel.hung_up
    other.channel.close()
    assert [link.closed for link in pair.meter.links] == [True]


def test_an_instrument_that_hangs_up_ends_both_channels() -> None:
    pair = Pair()
    pair.data.send(Kind.DATA_END, 0, 2, b"off")
    assert pair.data.channel.hung_up
    assert pair.side.channel.hung_up


@contextmanager
def visa(meter: Meter) -> Iterator[Callable[[], Any]]:
    server = Server(ScaledClock())
    port = server.add_hislip("meter", meter).port
    thread = threading.Thread(target=server.serve)
    thread.start()
    opened = []

    def connect() -> Any:
        name = f"TCPIP::127.0.0.1::hislip0,{port}::INSTR"
        resource: Any = pyvisa.ResourceManager("@py").open_resource(name)
        resource.read_termination = resource.write_termination = "\n"
        opened.append(resource)
        return resource

    try:
        yield connect
    finally:
        for resource in opened:
            resource.close()
        server.stop()
        thread.join(10.0)
        server.close()


def test_pyvisa_asks_clears_and_reads_the_status() -> None:
    meter = Meter()
    with visa(meter) as connect:
        resource = connect()
        assert resource.query("*IDN?") == "Maker,Meter,1,2.0"
        assert resource.read_stb() == 0
        resource.write("volt?")
        assert resource.read() == "volt?"
        resource.clear()
        assert resource.query("found?") == "found?"
        assert resource.query("megabytes?") == MEGABYTES
        resource.write("y" * 100 + "," + MEGABYTES)
        assert resource.query("still?") == "still?"
        assert meter.told[-2] == "y" * 100 + "," + MEGABYTES


def test_pyvisa_sessions_are_independent() -> None:
    meter = Meter()
    with visa(meter) as connect:
        first, second = connect(), connect()
        first.write("one?")
        second.write("two?")
        assert (first.read(), second.read()) == ("one?", "two?")
        first.close()
        assert second.query("three?") == "three?"
        assert connect().query("four?") == "four?"


@pytest.mark.parametrize(
    ("fault", "responses"),
    [
        ("silent", []),
        ("duplicated", [b"volt?\n", b"volt?\n"]),
        ("truncated", [b"vol"]),
        ("wrong_terminator", [b"volt?\r"]),
        ("echo", [b"volt?\n", b"volt?\n"]),
    ],
)
def test_spoilt_replies_are_whole_messages(fault: str, responses: list[bytes]) -> None:
    pair = Pair(**{fault: {"nth": [1]}})
    pair.data.send(Kind.DATA_END, 0, 2, b"volt?")
    assert pair.data.messages() == [(Kind.DATA_END, 0, 2, response) for response in responses]
    pair.data.send(Kind.DATA_END, 0, 4, b"volt?")
    assert pair.data.messages() == [(Kind.DATA_END, 0, 4, b"volt?\n")]


def test_a_session_ends_with_its_faulty_connection_and_the_port_with_the_instrument() -> None:
    pair = Pair(disconnect={"nth": [1]}, refused={"between_s": [0.0, 1.0]})
    assert not pair.port.listening
    pair = Pair(disconnect={"nth": [1]})
    assert pair.port.listening
    pair.data.send(Kind.DATA_END, 0, 2, b"volt?")
    assert len(pair.data.messages()) == 1
    assert pair.data.channel.hung_up
    assert pair.side.channel.hung_up
