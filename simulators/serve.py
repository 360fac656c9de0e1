"""Simulated instruments on real ports: loopback TCP and pseudo-terminals, one thread, one clock."""

from __future__ import annotations

import math
import os
import pty
import selectors
import socket
import termios
import time
import tty
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Protocol

from simulators.clock import ScaledClock
from simulators.hislip import HislipPort
from simulators.operator_port import Handler, OperatorPort
from simulators.port import LOOPBACK, Port
from simulators.wiring import Connection, SimulatedInstrument

READ_BYTES = 4096
HIGH_WATER_BYTES = 1 << 20
"""A client that owes this much reading is not listened to until it has read."""

UNREAD_S = 2.0
"""A serial line waits for nobody: bytes that no program has taken for so long are lost."""


@dataclass(frozen=True)
class Address:
    """Where one instrument is served."""

    name: str
    kind: str
    transport: str
    host: str | None = None
    port: int | None = None
    device: str | None = None
    baud: int | None = None

    def as_dict(self) -> dict[str, str | int]:
        """The fields that apply."""
        return {key: value for key, value in asdict(self).items() if value is not None}


class Stream(Protocol):
    """A non-blocking descriptor with a client at its far end."""

    def fileno(self) -> int:
        """The descriptor to wait on."""
        ...

    def recv(self, limit: int) -> bytes:
        """What has come, b"" at the end; `BlockingIOError` when nothing has."""
        ...

    def send(self, data: bytearray) -> int:
        """Send what fits; `BlockingIOError` when nothing does."""
        ...

    def close(self) -> None:
        """End it."""
        ...


NOISE = bytes(byte ^ 0xFF for byte in range(256))
"""What a byte becomes at a wrong rate, as far as it matters: no character of any command."""


class _Terminal:
    """The instrument's side of a pseudo-terminal; clients may come and go.

    The far side is held open here as well: otherwise the first client that closes it would end it for all.
    """

    def __init__(self, unread_s: float, baud: int | None = None) -> None:
        self._baud = baud
        self._near, self._far = pty.openpty()
        # A terminal would echo what comes and make other line ends of it.
        tty.setraw(self._far)
        os.set_blocking(self._near, False)
        self.device = os.ttyname(self._far)
        self._unread_s = unread_s
        self._full_since: float | None = None

    def fileno(self) -> int:
        return self._near

    def recv(self, limit: int) -> bytes:
        return self._as_heard(os.read(self._near, limit))

    def send(self, data: bytearray) -> int:
        if self._full_since is not None and time.monotonic() - self._full_since > self._unread_s:
            self._full_since = None
            # As if sent: the caller then forgets it.
            return len(data)
        try:
            sent = os.write(self._near, self._as_heard(bytes(data)))
        except BlockingIOError:
            self._full_since = self._full_since or time.monotonic()
            raise
        self._full_since = None
        return sent

    def _as_heard(self, data: bytes) -> bytes:
        """What comes through when the client's end is set to another rate: bytes all the same, but not these."""
        if self._baud is None or termios.tcgetattr(self._near)[5] == getattr(termios, f"B{self._baud}"):
            return data
        return data.translate(NOISE)

    def close(self) -> None:
        os.close(self._near)
        os.close(self._far)


class _Client:
    """Carries bytes between a stream and an instrument."""

    def __init__(
        self,
        stream: Stream,
        instrument: SimulatedInstrument,
        clock: ScaledClock,
        selector: selectors.BaseSelector,
    ) -> None:
        self._stream = stream
        self._instrument = instrument
        self._clock = clock
        self._selector = selector
        self._unsent = bytearray()
        self._ended = False
        self._broken = False
        self._watched = selectors.EVENT_READ
        selector.register(stream, self._watched, self.ready)
        with clock.lock:
            self._connection = self._connect()

    @property
    def over(self) -> bool:
        """True when the stream can be closed: one side has ended it and nothing is left to send."""
        return self._broken or (self._ended and not self._unsent)

    def ready(self, events: int) -> None:
        """The stream can be read or written."""
        if events & selectors.EVENT_WRITE:
            self._flush()
        if events & selectors.EVENT_READ:
            self._read()

    def look(self) -> None:
        """See whether the instrument has ended the connection."""
        # Only connections that may end themselves have it.
        if self._ended or not getattr(self._connection, "hung_up", False):
            return
        if isinstance(self._stream, _Terminal):  # a wire has no connection to end: the next one begins
            with self._clock.lock:
                self._connection.close()
                self._connection = self._connect()
        else:
            self._end()

    def close(self) -> None:
        """End the stream."""
        self._end()
        self._selector.unregister(self._stream)
        self._stream.close()

    def _connect(self) -> Connection:
        return self._instrument.connect(self._send)

    def _read(self) -> None:
        try:
            data = self._stream.recv(READ_BYTES)
        except BlockingIOError:
            return
        except OSError:
            self._broken = True
            return
        if not data:
            self._end()
        elif not self._ended:
            with self._clock.lock:
                self._connection.receive(data)

    def _send(self, data: bytes) -> None:
        if not self._ended and not self._broken:
            if self._unsent:
                self._flush()  # what a line has lost must not take this with it
            self._unsent += data
            self._flush()

    def _flush(self) -> None:
        try:
            while self._unsent:
                del self._unsent[: self._stream.send(self._unsent)]
        except BlockingIOError:
            pass
        except OSError:
            self._broken = True
        self._watch()

    def _watch(self) -> None:
        wanted = selectors.EVENT_WRITE if self._unsent else 0
        if not self._ended and len(self._unsent) < HIGH_WATER_BYTES:
            wanted |= selectors.EVENT_READ
        # A selector cannot watch for nothing; a client with nothing left to do is over.
        if wanted and wanted != self._watched:
            self._selector.modify(self._stream, wanted, self.ready)
            self._watched = wanted

    def _end(self) -> None:
        if not self._ended:
            self._ended = True
            self._watch()
            with self._clock.lock:
                self._connection.close()


class Server:
    """Serves any number of instruments from the thread that calls `serve`, all on `clock`.

    Everything is bound to 127.0.0.1. Instruments are called under the clock's lock. What an instrument sends
    in one call goes out in one piece if the client has room for it.
    """

    def __init__(self, clock: ScaledClock, *, unread_s: float = UNREAD_S) -> None:
        self._clock = clock
        self._unread_s = unread_s
        # epoll waits whole milliseconds, which on a fast clock are rig seconds
        self._selector = selectors.SelectSelector()
        self._clients: set[_Client] = set()
        self._ports: list[Port] = []
        self._stopping = False
        # A byte on it ends the wait: `stop` may come from another thread or a signal handler.
        self._bell, self._rope = socket.socketpair()
        self._bell.setblocking(False)
        self._rope.setblocking(False)
        self._selector.register(self._bell, selectors.EVENT_READ, lambda _: self._bell.recv(READ_BYTES))

    def add_tcp(self, name: str, instrument: SimulatedInstrument, port: int = 0) -> Address:
        """Serve raw TCP; a free port unless one is given. `ConfigError` when the port is taken."""
        return self._listen(name, instrument, port, "tcp")

    def add_hislip(self, name: str, instrument: SimulatedInstrument, port: int = 0) -> Address:
        """Serve HiSLIP, sub-address `hislip0`, an instrument whose messages end with LF."""
        return self._listen(name, HislipPort(instrument), port, "hislip")

    def add_operator(self, handler: Handler, port: int = 0, name: str = "operator") -> Address:
        """Serve the operator's port: one JSON object per line, see `simulators.operator_port`."""
        return self._listen(name, OperatorPort(handler, self._clock), port, "tcp")

    def add_serial(self, name: str, instrument: SimulatedInstrument, baud: int) -> Address:
        """Serve a pseudo-terminal; `baud` is told to clients, bytes travel as fast as they can.

        An instrument whose line has a rate of its own (`baud`) hears and says noise at any other.
        """
        own = getattr(instrument, "baud", None)
        baud = own or baud
        terminal = _Terminal(self._unread_s, own)
        self._clients.add(_Client(terminal, instrument, self._clock, self._selector))
        return Address(name, instrument.kind, "serial", device=terminal.device, baud=baud)

    def serve(self, stop: Callable[[], bool] | None = None) -> None:
        """Serve until `stop()` is true (looked at after every event) or `stop` is called."""
        while True:
            # Before connections are looked at: an event may end them.
            self._clock.run_due()
            self._settle()
            if self._stopping or (stop and stop()):
                break
            for key, events in self._selector.select(self._idle_s()):
                key.data(events)
        self._stopping = False

    def stop(self) -> None:
        """Make `serve` return at once; any thread, also a signal handler."""
        self._stopping = True
        self.wake()

    def wake(self) -> None:
        """Make `serve` look at its clock and its stop condition now."""
        with suppress(BlockingIOError):  # it is awake already
            self._rope.send(b"\0")

    def close(self) -> None:
        """End all connections and give the ports back; may be called twice."""
        for client in self._clients:
            client.close()
        self._clients.clear()
        for port in self._ports:
            port.close()
        for stream in (self._bell, self._rope):
            stream.close()
        self._selector.close()

    def _listen(self, name: str, instrument: SimulatedInstrument, port: int, transport: str) -> Address:
        opened = Port(name, instrument, port, self._accept, self._selector)
        self._ports.append(opened)
        return Address(name, instrument.kind, transport, host=LOOPBACK, port=opened.number)

    def _accept(self, listener: socket.socket, instrument: SimulatedInstrument) -> None:
        try:
            stream, _ = listener.accept()
        except OSError:
            return  # it left again before we came to it
        stream.setblocking(False)
        # Or the second of two short replies would wait for the client's acknowledgement of the first.
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._clients.add(_Client(stream, instrument, self._clock, self._selector))

    def _settle(self) -> None:
        for port in self._ports:
            port.look()
        for client in list(self._clients):
            client.look()
            if client.over:
                self._clients.remove(client)
                client.close()

    def _idle_s(self) -> float | None:
        due_s = self._clock.next_event_s()
        return None if math.isinf(due_s) else max(0.0, (due_s - self._clock.now_s()) / self._clock.speed)
