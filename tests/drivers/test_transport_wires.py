"""The transports over real sockets and pseudo-terminals, against a served instrument."""

import gc
import os
import re
import socket
import termios
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import pyvisa

from drivers.connect import connector
from drivers.transport import Transport
from drivers.transport_serial import SerialSettings, check_parity
from drivers.transport_visa import VisaTransport
from rigctl.core.clock import RealClock
from rigctl.core.errors import LinkLost, LinkTimeout
from simulators.clock import ScaledClock
from simulators.serve import Address, Server

MEGABYTE = b"0123456789abcdef" * 65536
WIRES = ["tcp", "serial", "asrl", "hislip"]
STREAMS = ["tcp", "serial", "asrl"]


class Parrot:
    """Answers a line with itself, and a few words of its own; `said` is what it was told."""

    kind = "parrot"

    def __init__(self) -> None:
        self.said: list[bytes] = []
        self.clients: list[ParrotConnection] = []

    def connect(self, send: Callable[[bytes], None]) -> "ParrotConnection":
        self.clients.append(ParrotConnection(self, send))
        return self.clients[-1]


class ParrotConnection:
    def __init__(self, parrot: Parrot, send: Callable[[bytes], None]) -> None:
        self.parrot, self.send = parrot, send
        self.hung_up = False
        self.rest = b""

    def receive(self, data: bytes) -> None:
        *lines, self.rest = (self.rest + data).split(b"\n")
        for line in lines:
            self.parrot.said.append(line)
            self.answer(line)

    def answer(self, line: bytes) -> None:
        match line:
            case b"silence":
                pass
            case b"bye":
                self.hung_up = True
            case b"xps":
                self.send(b"0,1.5,EndOf")
                self.send(b"API0,,EndOfAPI\n")
            case b"half":
                self.send(b"half a rep")
            case b"megabyte":
                self.send(MEGABYTE + b"\n")
            case _:
                self.send(line + b"\n")

    def close(self) -> None:
        pass


class Bench:
    """A parrot served in a thread of its own, and how to reach it."""

    def __init__(self, kind: str) -> None:
        self.parrot = Parrot()
        self.server = Server(ScaledClock())
        self.address = self._serve(kind)
        self.thread = threading.Thread(target=self.server.serve)
        self.thread.start()

    def _serve(self, kind: str) -> str:
        served: Address
        match kind:
            case "tcp":
                served = self.server.add_tcp("parrot", self.parrot)
                return f"tcp://127.0.0.1:{served.port}"
            case "hislip":
                served = self.server.add_hislip("parrot", self.parrot)
                return f"TCPIP::127.0.0.1::hislip0,{served.port}::INSTR"
            case "serial":
                served = self.server.add_serial("parrot", self.parrot, 115200)
                return f"serial:{served.device}?baud=115200"
            case _:
                served = self.server.add_serial("parrot", self.parrot, 115200)
                return f"ASRL{served.device}::INSTR"

    def connect(self, floor_s: float = 5.0, speed: float = 1.0) -> Transport:
        if self.address.startswith("ASRL"):
            settings = SerialSettings(baud=115200)
            return VisaTransport(self.address, RealClock(speed), settings=settings, floor_s=floor_s)
        return connector(self.address, RealClock(speed), floor_s=floor_s)()

    def device(self) -> str:
        return re.search(r"/dev/[a-z0-9/]+", self.address).group()

    def line_settings(self) -> list[Any]:
        line = os.open(self.device(), os.O_RDWR | os.O_NOCTTY)
        try:
            return termios.tcgetattr(line)
        finally:
            os.close(line)

    def end(self) -> None:
        self.server.stop()
        self.thread.join(5.0)
        assert not self.thread.is_alive()
        self.server.close()


@contextmanager
def bench(kind: str) -> Iterator[Bench]:
    made = Bench(kind)
    try:
        yield made
    finally:
        made.end()


@contextmanager
def closing(transport: Transport) -> Iterator[Transport]:
    try:
        yield transport
    finally:
        transport.close()


@pytest.mark.parametrize("kind", WIRES)
def test_a_line_comes_back(kind: str) -> None:
    with bench(kind) as b, closing(b.connect()) as wire:
        for text in (b"hello\n", b"again\n"):
            wire.write(text)
            assert wire.read_until(b"\n", 1.0) == text
        assert b.parrot.said == [b"hello", b"again"]


@pytest.mark.parametrize("kind", WIRES)
def test_surplus_bytes_wait_for_the_next_read_and_terminators_may_be_long_and_cut(kind: str) -> None:
    with bench(kind) as b, closing(b.connect()) as wire:
        wire.write(b"xps\n")
        assert wire.read_until(b",EndOfAPI", 1.0) == b"0,1.5,EndOfAPI"
        assert wire.read_exactly(2, 1.0) == b"0,"
        assert wire.read_until(b",EndOfAPI", 1.0) == b",EndOfAPI"


def test_a_connection_can_be_made_after_somebody_closed_the_resource_manager() -> None:
    with bench("tcp") as b:
        b.connect().close()
        pyvisa.ResourceManager("@py").close()
        with closing(b.connect()) as wire:
            wire.write(b"hello\n")
            assert wire.read_until(b"\n", 1.0) == b"hello\n"


@pytest.mark.parametrize("kind", ["tcp", "serial", "hislip"])
def test_a_megabyte_comes_whole_and_soon(kind: str) -> None:
    with bench(kind) as b, closing(b.connect(floor_s=30.0)) as wire:
        wire.write(b"megabyte\n")
        begin = time.monotonic()
        assert wire.read_until(b"\n", 1.0) == MEGABYTE + b"\n"
        assert time.monotonic() - begin < 3.0


@pytest.mark.parametrize("kind", WIRES)
def test_silence_is_a_time_out_and_the_wire_still_works(kind: str) -> None:
    with bench(kind) as b, closing(b.connect(floor_s=0.05)) as wire:
        wire.write(b"silence\n")
        with pytest.raises(LinkTimeout, match="nothing came"):
            wire.read_until(b"\n", 0.05)
    with bench(kind) as b, closing(b.connect(floor_s=5.0)) as wire:
        wire.write(b"silence\n")
        wire.write(b"hello\n")
        assert wire.read_until(b"\n", 1.0) == b"hello\n"


@pytest.mark.parametrize("kind", STREAMS)
def test_a_time_out_shows_what_came_and_keeps_it(kind: str) -> None:
    with bench(kind) as b, closing(b.connect(floor_s=0.2)) as wire:
        wire.write(b"half\n")
        with pytest.raises(LinkTimeout, match="only b'half a rep' came"):
            wire.read_until(b"\n", 0.2)
        wire.write(b"ly\n")
        assert wire.read_until(b"\n", 5.0) == b"half a reply\n"


def test_a_time_out_is_rig_time_but_never_below_the_floor() -> None:
    with bench("tcp") as b, closing(b.connect(floor_s=0.1, speed=100.0)) as wire:
        for timeout_s, wall_s in ((1.0, 0.1), (30.0, 0.3)):
            begin = time.monotonic()
            with pytest.raises(LinkTimeout, match=f"waited {timeout_s:g} s"):
                wire.read_until(b"\n", timeout_s)
            assert wall_s <= time.monotonic() - begin < wall_s + 0.15


def test_a_command_is_not_held_back_until_the_one_before_is_acknowledged() -> None:
    with bench("tcp") as b, closing(b.connect()) as wire:
        assert isinstance(wire, VisaTransport)
        stream = wire._socket
        assert stream is not None
        assert stream.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


@pytest.mark.parametrize("kind", STREAMS)
def test_discarded_input_is_gone(kind: str) -> None:
    with bench(kind) as b, closing(b.connect()) as wire:
        wire.write(b"one\ntwo\n")
        assert wire.read_until(b"\n", 1.0) == b"one\n"
        wire.read_exactly(3, 1.0)
        wire.unread()
        wire.write(b"three\n")
        assert wire.read_until(b"three\n", 1.0)[-6:] == b"three\n"
        assert b.parrot.said == [b"one", b"two", b"three"]


@pytest.mark.parametrize("kind", WIRES)
def test_a_server_that_ends_is_a_lost_link_and_not_a_wait(kind: str) -> None:
    b = Bench(kind)
    with closing(b.connect(floor_s=60.0)) as wire:
        wire.write(b"hello\n")
        wire.read_until(b"\n", 1.0)
        wire.write(b"silence\n")
        b.end()
        begin = time.monotonic()
        with pytest.raises(LinkLost, match="reconnect"):
            wire.read_until(b"\n", 60.0)
        assert time.monotonic() - begin < 1.0


def test_an_ended_connection_is_noticed_before_a_command_is_sent() -> None:
    with bench("tcp") as b:
        with closing(b.connect()) as wire:
            wire.write(b"bye\n")
            with pytest.raises(LinkLost, match="ended the connection"):
                wire.read_until(b"\n", 1.0)
            with pytest.raises(LinkLost, match="ended the connection"):
                wire.write(b"move\n")
        with closing(b.connect()) as wire:
            wire.write(b"hello\n")
            assert wire.read_until(b"\n", 1.0) == b"hello\n"
        assert b.parrot.said == [b"bye", b"hello"]


@pytest.mark.parametrize("kind", WIRES)
def test_closing_twice_is_fine_and_a_closed_wire_is_lost(kind: str) -> None:
    with bench(kind) as b:
        wire = b.connect()
        wire.close()
        wire.close()
        with pytest.raises(LinkLost):
            wire.write(b"hello\n")
        with pytest.raises(LinkLost):
            wire.read_until(b"\n", 1.0)
        assert b.parrot.said == []


@pytest.mark.filterwarnings("ignore::ResourceWarning")  # pyvisa-py leaves the socket that did not connect
@pytest.mark.parametrize("kind", ["tcp", "hislip", "no such host"])
def test_nobody_there_is_a_lost_link_when_connecting(kind: str) -> None:
    if kind == "no such host":
        connect = connector("tcp://xps.invalid:5001", RealClock())
    else:
        with bench(kind) as b:
            connect = b.connect

    with pytest.raises(LinkLost, match=r"(127\.0\.0\.1|xps\.invalid).*check power and cable") as caught:
        connect()
    assert "\n" not in str(caught.value)
    del caught
    gc.collect()


def test_a_missing_device_is_a_lost_link() -> None:
    for address in ("serial:/dev/no-such-line", "ASRL/dev/no-such-line::INSTR"):
        with pytest.raises(LinkLost, match="/dev/no-such-line"):
            connector(address, RealClock())()


def test_a_serial_line_belongs_to_one_program() -> None:
    with bench("serial") as b, closing(b.connect()), pytest.raises(LinkLost, match="lock"):
        b.connect()


def test_a_held_back_line_cannot_be_written_to() -> None:
    with bench("serial") as b:
        b.server.stop()
        b.thread.join(5.0)
        with closing(b.connect(floor_s=0.05)) as wire, pytest.raises(LinkTimeout, match="flow control"):
            wire.write(b"x" * 300000)


def test_line_settings_reach_the_port() -> None:
    with bench("asrl") as b:
        line = SerialSettings(baud=9600, stopbits=2, rtscts=True)
        with closing(VisaTransport(b.address, RealClock(), settings=line)):
            settings = b.line_settings()
        assert settings[4:6] == [termios.B9600, termios.B9600]
        assert settings[2] & termios.CSTOPB
        assert settings[2] & termios.CRTSCTS


@pytest.mark.parametrize("address", ["serial:{}?baud=19200&stopbits=2", "ASRL{}::INSTR?baud=19200&stopbits=2"])
def test_an_address_overrides_how_the_driver_sets_the_line(address: str) -> None:
    with bench("serial") as b:
        line = SerialSettings(baud=9600, rtscts=True)
        with closing(connector(address.format(b.device()), RealClock(), serial=line, floor_s=5.0)()) as wire:
            settings = b.line_settings()
            wire.write(b"megabyte\n")
            assert wire.read_until(b"\n", 1.0) == MEGABYTE + b"\n"
        assert settings[4:6] == [termios.B19200, termios.B19200]
        assert settings[2] & termios.CSTOPB
        assert settings[2] & termios.CRTSCTS


def test_settings_a_line_refuses_are_one_line_to_read() -> None:
    with bench("serial") as b:
        b.address += "&parity=E"
        for _ in range(2):  # the second time the line has been set up before
            with pytest.raises(LinkLost, match=r"does not take .*parity='E'"):
                b.connect()


@pytest.mark.parametrize("kind", ["tcp", "serial"])
def test_who_waits_for_bytes_is_woken_when_another_thread_closes(kind: str) -> None:
    with bench(kind) as b:
        wire = b.connect(floor_s=60.0)
        wire.write(b"silence\n")
        raised: list[LinkLost] = []

        def wait() -> None:
            try:
                wire.read_until(b"\n", 60.0)
            except LinkLost as error:
                raised.append(error)

        waiting = threading.Thread(target=wait)
        waiting.start()
        while not waiting.is_alive():
            pass
        wire.close()
        waiting.join(5.0)
        assert [type(error) for error in raised] == [LinkLost]


def test_wrong_parity_reads_as_a_zero_byte_and_guards_the_line() -> None:
    with bench("serial") as b:
        line = os.open(b.device(), os.O_RDWR | os.O_NOCTTY)
        try:
            assert not check_parity(line)
            flags = termios.tcgetattr(line)[0]
        finally:
            os.close(line)
        assert flags & termios.INPCK
        assert not flags & (termios.IGNPAR | termios.PARMRK | termios.ISTRIP)
        with closing(b.connect()) as wire:
            assert not wire.guarded
    assert SerialSettings(parity="E").guarded
    with bench("tcp") as b, closing(b.connect()) as wire:
        assert wire.guarded
