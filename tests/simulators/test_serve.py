"""The server over real loopback sockets and pseudo-terminals, with plain clients of the standard library."""

import json
import os
import select
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import pytest
import pyvisa
import serial

from rigctl.core.errors import ConfigError
from simulators.clock import ScaledClock
from simulators.faults import Event, FaultPlan, FaultyInstrument
from simulators.faults.wire import Exchange
from simulators.operator_port import Done
from simulators.port import LOOPBACK
from simulators.serve import Server

MEGABYTE = b"0123456789abcdef" * 65536
PATIENCE_S = 10.0


class Counter:
    """Every client has a number; answers lines, some of them later, and keeps a diary."""

    kind = "counter"

    def __init__(self, clock: ScaledClock) -> None:
        self.clock = clock
        self.diary: list[str] = []
        self.kilobytes = 0
        self.left = threading.Event()

    def connect(self, send: Callable[[bytes], None]) -> "CounterConnection":
        self.diary.append("connect")
        return CounterConnection(self, self.diary.count("connect"), send)


class CounterConnection:
    def __init__(self, counter: Counter, number: int, send: Callable[[bytes], None]) -> None:
        self.counter, self.number, self.send = counter, number, send
        self.hung_up = False
        self.rest = b""

    def receive(self, data: bytes) -> None:
        *lines, self.rest = (self.rest + data).split(b"\n")
        for line in lines:
            self.answer(line.decode())

    def answer(self, line: str) -> None:
        match line.split():
            case ["who"]:
                self.send(b"%d\n" % self.number)
            case ["megabyte"]:
                self.send(MEGABYTE + b"\n")
            case ["kilobyte"]:
                self.counter.kilobytes += 1
                self.send(MEGABYTE[:1023] + b"\n")
            case ["later", delay_s]:
                due_s = self.counter.clock.now_s() + float(delay_s)
                self.counter.clock.call_at(due_s, lambda: self.send(b"%.3f\n" % (self.counter.clock.now_s() - due_s)))
            case ["bye"]:
                self.send(b"farewell\n")
                self.hung_up = True
            case ["bye", delay_s]:
                self.counter.clock.call_at(self.counter.clock.now_s() + float(delay_s), self.hang_up)

    def hang_up(self) -> None:
        self.hung_up = True

    def close(self) -> None:
        self.counter.diary.append(f"close {self.number}")
        self.counter.left.set()


class Running:
    """A server in a thread."""

    def __init__(self, speed: float, unread_s: float) -> None:
        self.clock = ScaledClock(speed)
        self.counter = Counter(self.clock)
        self.server = Server(self.clock, unread_s=unread_s)
        self.thread = threading.Thread(target=self.server.serve)

    def start(self) -> None:
        self.thread.start()

    def stop(self) -> None:
        self.server.stop()
        self.thread.join(PATIENCE_S)
        assert not self.thread.is_alive()


@contextmanager
def running(speed: float = 1.0, unread_s: float = 60.0) -> Iterator[Running]:
    made = Running(speed, unread_s)
    try:
        yield made
    finally:
        if made.thread.is_alive():
            made.stop()
        made.server.close()
        made.server.close()


class Client:
    """A plain socket that reads lines."""

    def __init__(self, port: int | None) -> None:
        assert port is not None
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
        self.lines = self.socket.makefile("rb")

    def say(self, text: bytes) -> None:
        self.socket.sendall(text)

    def ask(self, text: bytes) -> bytes:
        self.say(text)
        return self.lines.readline()

    def __enter__(self) -> "Client":
        return self

    def __exit__(self, *_: object) -> None:
        self.lines.close()
        self.socket.close()


def test_addresses_say_where() -> None:
    with running() as r:
        tcp = r.server.add_tcp("rotation", r.counter)
        line = r.server.add_serial("lasers", r.counter, 115200)
        hislip = r.server.add_hislip("meter", r.counter)
        operator = r.server.add_operator(lambda _: {})
        assert tcp.as_dict() == {
            "name": "rotation", "kind": "counter", "transport": "tcp", "host": "127.0.0.1", "port": tcp.port,
        }  # fmt: skip
        assert line.as_dict() == {
            "name": "lasers", "kind": "counter", "transport": "serial", "device": line.device, "baud": 115200,
        }  # fmt: skip
        assert (hislip.kind, hislip.transport) == ("counter", "hislip")
        assert (operator.name, operator.kind, operator.transport) == ("operator", "operator", "tcp")
        assert len({tcp.port, hislip.port, operator.port}) == 3


def test_only_loopback_is_bound_and_a_fixed_port_is_kept() -> None:
    with running() as r:
        free = r.server.add_tcp("rotation", r.counter).port
        with socket.socket() as outside:
            outside.settimeout(PATIENCE_S)
            with pytest.raises(OSError, match="refused"):
                outside.connect(("127.0.0.2", free))
        with pytest.raises(ConfigError, match=f"translation: .* port {free} .*choose another"):
            r.server.add_tcp("translation", r.counter, free)
        with pytest.raises(ConfigError, match="translation"):
            r.server.add_tcp("translation", r.counter, 70000)
    with running() as r:
        assert r.server.add_tcp("rotation", r.counter, free).port == free


def test_clients_are_served_at_once_and_each_has_its_own_connection() -> None:
    with running() as r:
        port = r.server.add_tcp("rotation", r.counter).port
        r.start()
        with Client(port) as first, Client(port) as second:
            assert first.ask(b"who\n") == b"1\n"
            assert second.ask(b"who\n") == b"2\n"
            assert first.ask(b"who\n") == b"1\n"
            first.say(b"wh")
            assert second.ask(b"who\n") == b"2\n"
            assert first.ask(b"o\n") == b"1\n"


def test_a_client_that_leaves_is_told_to_its_instrument_and_may_come_again() -> None:
    with running() as r:
        port = r.server.add_tcp("rotation", r.counter).port
        r.start()
        with Client(port) as client:
            client.ask(b"who\n")
        assert r.counter.left.wait(PATIENCE_S)
        with Client(port) as client:
            assert client.ask(b"who\n") == b"2\n"
        r.stop()
        assert r.counter.diary[:3] == ["connect", "close 1", "connect"]


def test_the_end_of_the_server_ends_every_connection_once() -> None:
    with running() as r:
        port = r.server.add_tcp("rotation", r.counter).port
        r.server.add_serial("lasers", r.counter, 9600)
        r.start()
        with Client(port) as client:
            assert client.ask(b"who\n") == b"2\n"
            r.stop()
            r.server.close()
            assert client.lines.read() == b""
        assert sorted(r.counter.diary) == ["close 1", "close 2", "connect", "connect"]


def test_a_slow_reader_gets_its_megabytes_and_holds_nobody_up() -> None:
    with running() as r:
        port = r.server.add_tcp("rotation", r.counter).port
        r.start()
        with Client(port) as slow, Client(port) as quick:
            slow.say(b"megabyte\n" * 8)
            assert quick.ask(b"who\n") == b"2\n"
            for _ in range(8):
                assert slow.lines.readline() == MEGABYTE + b"\n"


def test_a_client_that_reads_nothing_is_not_listened_to() -> None:
    with running() as r:
        port = r.server.add_tcp("rotation", r.counter).port
        r.start()
        with Client(port) as deaf, Client(port) as quick:
            deaf.socket.settimeout(0.2)
            with pytest.raises(TimeoutError):
                deaf.say(b"kilobyte\n" * 2_000_000)
            answered = r.counter.kilobytes
            for _ in range(100):
                assert quick.ask(b"who\n") == b"2\n"
            assert r.counter.kilobytes - answered < 5000


def test_a_client_that_vanishes_amid_a_reply_harms_nobody() -> None:
    with running() as r:
        port = r.server.add_tcp("rotation", r.counter).port
        r.start()
        with Client(port) as rude:
            rude.say(b"megabyte\n" * 8)
            rude.socket.recv(10)
        assert r.counter.left.wait(PATIENCE_S)
        with Client(port) as client:
            assert client.ask(b"who\n") == b"2\n"


def test_a_client_that_has_said_all_still_gets_its_replies() -> None:
    with running() as r:
        port = r.server.add_tcp("rotation", r.counter).port
        r.start()
        with Client(port) as client:
            client.say(b"megabyte\n" * 4)
            client.socket.shutdown(socket.SHUT_WR)
            assert client.lines.read() == (MEGABYTE + b"\n") * 4


def test_an_instrument_that_hangs_up_is_heard_to_the_end() -> None:
    with running() as r:
        port = r.server.add_tcp("rotation", r.counter).port
        r.start()
        with Client(port) as client:
            client.say(b"megabyte\n" * 12 + b"bye\n")
            assert client.lines.read() == (MEGABYTE + b"\n") * 12 + b"farewell\n"


def test_an_instrument_hangs_up_after_its_last_words() -> None:
    with running(speed=100.0) as r:
        port = r.server.add_tcp("rotation", r.counter).port
        r.start()
        with Client(port) as client:
            assert client.ask(b"bye\n") == b"farewell\n"
            assert client.lines.read() == b""
        with Client(port) as client:
            assert client.ask(b"bye 2.0\n") == b""
        assert r.counter.diary == ["connect", "close 1", "connect", "close 2"]


def test_events_happen_in_rig_time_while_nobody_speaks() -> None:
    with running(speed=100.0) as r:
        port = r.server.add_tcp("rotation", r.counter).port
        r.start()
        with Client(port) as client:
            begin_s = r.clock.now_s()
            late_s = float(client.ask(b"later 10.0\n"))
            assert late_s >= 0.0
            assert 10.0 <= r.clock.now_s() - begin_s < 40.0


def test_serving_ends_when_its_condition_is_met_or_was_asked_for_before() -> None:
    with running() as r:
        due = threading.Event()
        r.clock.call_at(r.clock.now_s() + 0.01, due.set)
        r.server.serve(due.is_set)
        assert due.is_set()
        r.server.stop()
        r.server.serve()
        r.thread = threading.Thread(target=r.server.serve)
        r.start()
        assert r.thread.is_alive()


@contextmanager
def plain_terminal(device: str | None) -> Iterator[int]:
    """A client that takes the line as it finds it."""
    assert device is not None
    line = os.open(device, os.O_RDWR | os.O_NOCTTY)
    try:
        yield line
    finally:
        os.close(line)


def read_to(line: int, end: bytes) -> bytes:
    came = b""
    while not came.endswith(end):
        assert select.select([line], [], [], PATIENCE_S)[0]
        came += os.read(line, 65536)
    return came


def test_a_terminal_is_raw_before_anybody_sets_it() -> None:
    with running() as r:
        device = r.server.add_serial("lasers", Echo(), 115200).device
        r.start()
        with plain_terminal(device) as line:
            os.write(line, b"\x03\x11\r\x7f\n")
            assert read_to(line, b"\n") == b"\x03\x11\r\x7f\n"


def test_a_terminal_outlives_its_clients_and_changes_no_byte() -> None:
    every_byte = bytes(range(256)).replace(b"\n", b"")
    with running() as r:
        echo = Echo()
        device = r.server.add_serial("lasers", echo, 115200).device
        r.start()
        for _ in range(3):
            with serial.Serial(device, 115200, timeout=PATIENCE_S) as line:
                line.write(every_byte)
                assert line.read(len(every_byte)) == every_byte
        assert echo.connections == 1


class Echo:
    kind = "echo"

    def __init__(self) -> None:
        self.connections = 0

    def connect(self, send: Callable[[bytes], None]) -> "EchoConnection":
        self.connections += 1
        return EchoConnection(send)


class EchoConnection:
    def __init__(self, send: Callable[[bytes], None]) -> None:
        self.receive = send

    def close(self) -> None:
        pass


def test_a_terminal_carries_a_megabyte() -> None:
    with running() as r:
        device = r.server.add_serial("lasers", r.counter, 115200).device
        r.start()
        with serial.Serial(device, 115200, timeout=PATIENCE_S) as line:
            line.write(b"megabyte\n")
            assert line.read(len(MEGABYTE) + 1) == MEGABYTE + b"\n"


def test_what_nobody_reads_on_a_line_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    full, now_s = threading.Event(), [1.0]

    def monotonic() -> float:
        full.set()
        return now_s[0]

    monkeypatch.setattr("simulators.serve.time", SimpleNamespace(monotonic=monotonic))
    with running(unread_s=2.0) as r:
        device = r.server.add_serial("lasers", r.counter, 115200).device
        r.start()
        with plain_terminal(device) as dead:
            os.write(dead, b"megabyte\n")
            assert full.wait(PATIENCE_S)
        while full.wait(0.3):  # the kernel moves bytes on by itself until its own buffers are full
            full.clear()
        now_s[0] = 3.5
        with plain_terminal(device) as line:
            os.write(line, b"who\n")
            assert len(read_to(line, b"1\n")) < len(MEGABYTE) // 2


def test_a_line_whose_instrument_restarts_is_a_line_still() -> None:
    with running() as r:
        device = r.server.add_serial("lasers", r.counter, 115200).device
        r.start()
        with serial.Serial(device, 115200, timeout=PATIENCE_S) as line:
            line.write(b"bye\n")
            assert line.readline() == b"farewell\n"
            line.write(b"who\n")
            assert line.readline() == b"2\n"


def test_pyvisa_talks_to_a_socket_and_to_a_line() -> None:
    with running() as r:
        port = r.server.add_tcp("rotation", r.counter).port
        device = r.server.add_serial("lasers", r.counter, 115200).device
        r.start()
        manager = pyvisa.ResourceManager("@py")
        for name, number in ((f"TCPIP::127.0.0.1::{port}::SOCKET", "2"), (f"ASRL{device}::INSTR", "1")):
            resource: Any = manager.open_resource(name, read_termination="\n", write_termination="\n")
            try:
                assert resource.query("who") == number
            finally:
                resource.close()


def operate(request: dict[str, Any], clock: ScaledClock) -> dict[str, Any] | Done:
    match request:
        case {"level": True}:
            return {"tilt_rad": 0.0}
        case {"remount": {"axis": "X" | "Y" | "Z" as axis}}:
            return Done(clock.now_s() + 120.0, {"axis": axis})
        case _:
            raise ValueError("known: level, remount, run")


@contextmanager
def operator() -> Iterator[tuple[Client, Running]]:
    with running(speed=1000.0) as r:
        port = r.server.add_operator(lambda request: operate(request, r.clock)).port
        r.start()
        with Client(port) as client:
            yield client, r


def test_the_operator_answers_when_it_is_done() -> None:
    with operator() as (client, r):
        assert json.loads(client.ask(b'{"level": true}\n')) == {"done": True, "tilt_rad": 0.0}
        begin_s = r.clock.now_s()
        answer = json.loads(client.ask(b'{"remount": {"axis": "X", "configuration": "pendulum", "mounting": 3}}\n'))
        assert answer == {"done": True, "axis": "X"}
        assert r.clock.now_s() - begin_s >= 120.0


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        (b"hello\n", "Expecting value"),
        (b"[1, 2]\n", "one JSON object per line"),
        (b"\xff\xfe\n", "utf-8"),
        (b'{"level": tru\n', "Expecting value"),
        (b'{"dance": true}\n', "known: level, remount, run"),
        (b"[" * 50000 + b"\n", "recursion"),
    ],
)
def test_a_request_that_cannot_be_done_is_told_so_and_the_port_goes_on(line: bytes, complaint: str) -> None:
    with operator() as (client, _):
        answer = json.loads(client.ask(line))
        assert list(answer) == ["error"]
        assert complaint in answer["error"]
        client.say(b"\n")
        client.say(b"\r\n")
        assert json.loads(client.ask(b'{"level": true}\n'))["done"] is True


def test_a_line_without_an_end_ends_the_connection() -> None:
    with operator() as (client, _):
        assert "at most 65536 bytes" in json.loads(client.ask(b"x" * 65537))["error"]
        assert client.lines.read() == b""


def test_an_operator_who_left_is_not_waited_for() -> None:
    with operator() as (client, r):
        client.say(b'{"remount": {"axis": "X"}}\n{"level": true}\n')
        assert json.loads(client.lines.readline())["tilt_rad"] == 0.0
        assert r.clock.next_event_s() < float("inf")
    with operator() as (client, _):
        assert json.loads(client.ask(b'{"level": true}\n'))["done"] is True


def test_a_port_at_which_nobody_listens_refuses_and_opens_again() -> None:
    clock = ScaledClock()
    plan = FaultPlan.model_validate({"power_cycle": {"at_s": 0.0, "lasting_s": 1e6}})
    counter = PoweredCounter(clock)
    faulty = FaultyInstrument(counter, plan, clock)
    server = Server(clock)
    try:
        address = (LOOPBACK, server.add_tcp("counter", faulty).port)
        server.serve(stop=lambda: True)
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(address, PATIENCE_S)
        faulty._relieve(plan.power_cycle)
        server.serve(stop=lambda: True)
        with socket.create_connection(address, PATIENCE_S) as client:
            client.sendall(b"who\n")
            server.serve(stop=lambda: bool(select.select([client], [], [], 0.0)[0]))
            assert client.recv(10) == b"1\n"
            faulty._befall(plan.power_cycle)
            server.serve(stop=lambda: bool(select.select([client], [], [], 0.0)[0]))
            assert client.recv(10) == b""
    finally:
        server.close()


class PoweredCounter(Counter):
    """One whose power may fail."""

    def befall(self, event: Event) -> None:
        self.diary.append("off")

    def relieve(self, event: Event) -> None:
        self.diary.append("on")


@pytest.mark.parametrize("wire", ["tcp", "serial"])
@pytest.mark.parametrize(
    "fault", ["duplicated", "truncated", "garbage", "non_ascii", "echo", "wrong_terminator", "bits"]
)
def test_a_served_wire_is_as_bad_as_one_in_this_process(wire: str, fault: str) -> None:
    clock = ScaledClock()
    plan = FaultPlan.model_validate({"seed": 12, fault: {"nth": [1]}})
    heard = b"".join(plan.copies({fault}, Exchange(1, b"1\n", b"who\n")))
    assert heard != b"1\n"
    faulty = FaultyInstrument(Counter(clock), plan, clock, serial=wire == "serial")
    server = Server(clock)
    try:
        if wire == "tcp":
            end = socket.create_connection((LOOPBACK, server.add_tcp("counter", faulty).port), PATIENCE_S)
            number = end.detach()
        else:
            number = os.open(str(server.add_serial("counter", faulty, 9600).device), os.O_RDWR | os.O_NOCTTY)
        os.write(number, b"who\n")
        came = b""
        while len(came) < len(heard):
            server.serve(stop=lambda: bool(select.select([number], [], [], 0.0)[0]))
            came += os.read(number, 100)
        os.close(number)
    finally:
        server.close()
    assert came == heard
