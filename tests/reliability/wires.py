"""Wires that keep a record: what a program sends to served instruments, with the time of each piece."""

from __future__ import annotations

import os
import pty
import selectors
import socket
import termios
import threading
import time
import tty
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

READ_BYTES = 65536


@dataclass(frozen=True)
class Sent:
    """What a program wrote to one instrument in one piece; `at_s` of the monotonic clock."""

    at_s: float
    instrument: str
    data: bytes


class RecordedWires:
    """Between programs and instruments: TCP and serial lines, carried by one thread.

    `sent` and `connections` (how often each instrument was connected to, by TCP) grow while it runs.
    """

    def __init__(self) -> None:
        self.sent: list[Sent] = []
        self.connections: Counter[str] = Counter()
        self._selector = selectors.DefaultSelector()
        self._descriptors: set[int] = set()
        self._sockets: set[socket.socket] = set()
        self._ended = False
        self._news = threading.Condition()
        self._thread = threading.Thread(target=self._carry, name="wires", daemon=True)

    def __enter__(self) -> RecordedWires:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended = True
        self._thread.join()
        for open_socket in list(self._sockets):
            self._close(open_socket)
        for descriptor in self._descriptors:
            os.close(descriptor)
        self._selector.close()

    def tcp(self, instrument: str, port: int) -> int:
        """A port of 127.0.0.1 that leads to `port`."""
        listener = socket.create_server(("127.0.0.1", 0))
        self._sockets.add(listener)
        self._selector.register(listener, selectors.EVENT_READ, partial(self._accept, instrument, port, listener))
        return int(listener.getsockname()[1])

    def serial(self, instrument: str, device: str, baud: int) -> str:
        """A pseudo-terminal that leads to the one at `device`, which is served at `baud`."""
        served = os.open(device, os.O_RDWR | os.O_NOCTTY)
        ours, theirs = pty.openpty()
        for descriptor in (served, theirs):
            tty.setraw(descriptor)
        modes = termios.tcgetattr(served)
        modes[4] = modes[5] = getattr(termios, f"B{baud}")
        termios.tcsetattr(served, termios.TCSANOW, modes)
        self._descriptors |= {served, ours, theirs}
        self._watch(ours, partial(self._pass_on, instrument, ours, partial(os.write, served)))
        self._watch(served, partial(self._pass_on, "", served, partial(os.write, ours)))
        return os.ttyname(theirs)

    def until(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Wait for what something sent brings about; False when it did not come."""
        with self._news:
            return self._news.wait_for(condition, timeout_s)

    def _note(self, instrument: str, data: bytes) -> None:
        with self._news:
            self.sent.append(Sent(time.monotonic(), instrument, data))
            self._news.notify_all()

    def _watch(self, descriptor: int, ready: Callable[[], None]) -> None:
        self._selector.register(descriptor, selectors.EVENT_READ, ready)

    def _carry(self) -> None:
        while not self._ended:
            for key, _ in self._selector.select(0.05):
                if key.fd in self._selector.get_map():
                    key.data()

    def _pass_on(self, instrument: str, source: int, write: Callable[[bytes], int]) -> None:
        data = os.read(source, READ_BYTES)
        if instrument:
            self._note(instrument, data)
        while data:
            data = data[write(data) :]

    def _accept(self, instrument: str, port: int, listener: socket.socket) -> None:
        client, _ = listener.accept()
        self.connections[instrument] += 1
        try:
            server = socket.create_connection(("127.0.0.1", port))
        except OSError:
            client.close()
            return
        for end, other, name in ((client, server, instrument), (server, client, "")):
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._sockets.add(end)
            self._selector.register(end, selectors.EVENT_READ, partial(self._forward, name, end, other))

    def _forward(self, instrument: str, source: socket.socket, target: socket.socket) -> None:
        try:
            data = source.recv(READ_BYTES)
            if instrument and data:
                self._note(instrument, data)
            target.sendall(data)
        except OSError:
            data = b""
        if not data:
            self._close(source)
            self._close(target)

    def _close(self, end: socket.socket) -> None:
        if end in self._sockets:
            self._sockets.remove(end)
            if end.fileno() in self._selector.get_map():
                self._selector.unregister(end)
            end.close()
