"""VISA resources, through pyvisa: raw TCP sockets, HiSLIP, GPIB, USB and serial lines.

The backend is pyvisa-py unless another is named; with an installed VISA library that is `@ivi`.
"""

from __future__ import annotations

import math
import os
import select
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import pyvisa
from pyvisa import constants
from pyvisa.resources import MessageBasedResource, SerialInstrument

from drivers.buffered import WALL_FLOOR_S, BufferedTransport
from drivers.transport import lost
from drivers.transport_serial import SerialSettings
from rigctl.core.clock import Clock
from rigctl.core.errors import LinkLost, LinkTimeout

PYVISA_PY = "@py"
PEEK_BYTES = 4096
"""What pyvisa-py takes from a socket at once; asked for more, it may take what came since and keep it to itself."""

OPEN_TIMEOUT_S = 5.0
_ONE_AT_A_TIME = threading.Lock()

PARITIES = {
    "N": constants.Parity.none,
    "E": constants.Parity.even,
    "O": constants.Parity.odd,
    "M": constants.Parity.mark,
    "S": constants.Parity.space,
}
STOP_BITS = {
    1: constants.StopBits.one,
    1.5: constants.StopBits.one_and_a_half,
    2: constants.StopBits.two,
}
FLOW_CONTROL = {
    (False, False): constants.ControlFlow.none,
    (True, False): constants.ControlFlow.rts_cts,
    (False, True): constants.ControlFlow.xon_xoff,
}


class VisaTransport(BufferedTransport):
    """A VISA session as a byte stream; a message-based session's messages follow each other in it.

    On a raw socket of pyvisa-py a connection that the instrument ended is noticed before anything is sent.
    Other backends deliver raw sockets byte by byte and report a loss as their library does.
    """

    def __init__(
        self,
        resource_name: str,
        clock: Clock,
        *,
        backend: str = PYVISA_PY,
        settings: SerialSettings | None = None,
        address: str = "",
        floor_s: float = WALL_FLOOR_S,
    ) -> None:
        super().__init__(address or resource_name, clock, floor_s)
        self._socket: socket.socket | None = None
        self._resource = self._open(resource_name, backend)
        if settings is not None and isinstance(self._resource, SerialInstrument):
            self.guarded = settings.guarded
        try:
            with self._failures("cannot connect"):
                if settings is not None and isinstance(self._resource, SerialInstrument):
                    _set_line(self._resource, settings)
                self._socket = _socket_of(self._resource)
                if self._socket is not None:
                    _check_connected(self._socket)
                    # Or a command without an answer holds the next one back until the instrument acknowledges the
                    # packet, which takes it up to 40 ms.
                    self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        except LinkLost:
            self.close()
            raise

    def write(self, data: bytes) -> None:
        """Send all of `data`; `LinkLost` when the other end is gone, `LinkTimeout` when it takes nothing."""
        with self._failures("sending failed"):
            if self._socket is not None:
                # Looks whether the instrument has ended the connection: bytes sent into it would vanish without an
                # error.
                self._arrived(self._socket, 0.0)
            _set_timeout(self._resource, self._floor_s)
            try:
                self._resource.write_raw(data)
            except pyvisa.VisaIOError as error:
                if error.error_code != constants.StatusCode.error_timeout:
                    raise
                raise LinkTimeout(f"{self.address}: could not send {data[:60]!r}; is it switched on?") from error

    def close(self) -> None:
        """End the connection; may be called twice. Who waits for bytes on a socket is woken, and told."""
        if self._socket is not None:
            with suppress(OSError):
                # Closing alone does not wake a thread that waits on the socket.
                self._socket.shutdown(socket.SHUT_RDWR)
        self._resource.close()

    def device_clear(self) -> bool:
        """VISA's `clear`, of a session that carries messages (GPIB, USB, VXI-11, HiSLIP)."""
        if not self._message_based():
            return False
        self._received.clear()
        with self._failures("device clear failed"):
            _set_timeout(self._resource, self._floor_s)
            try:
                self._resource.clear()
            except NotImplementedError:
                return False
            except pyvisa.VisaIOError as error:
                if error.error_code != constants.StatusCode.error_nonsupported_operation:
                    raise
                return False
        return True

    def unread(self) -> bytes:
        """Take what has arrived and nobody has read; a message-based protocol drops stale messages by itself."""
        return self._take(len(self._received)) if self._message_based() else super().unread()

    def _receive(self, wait_s: float) -> bytes:
        with self._failures("reading failed"):
            if self._socket is not None:
                # Not more than is there, or pyvisa-py waits for the rest.
                count = self._arrived(self._socket, wait_s)
                return self._resource.read_bytes(count) if count else b""
            _set_timeout(self._resource, wait_s)
            try:
                if self._message_based():
                    return bytes(self._resource.read_raw())
                first = self._resource.read_bytes(1)
            except pyvisa.VisaIOError as error:
                if error.error_code != constants.StatusCode.error_timeout:
                    raise
                return b""
            if isinstance(self._resource, SerialInstrument) and (more := self._resource.bytes_in_buffer):
                return first + self._resource.read_bytes(more)
            return first

    def _arrived(self, stream: socket.socket, wait_s: float) -> int:
        """How many bytes can be read at once; pyvisa-py itself takes a closed connection for silence."""
        if not select.select([stream], [], [], wait_s)[0]:
            return 0
        if not (waiting := len(stream.recv(PEEK_BYTES, socket.MSG_PEEK))):
            raise lost(self.address, "the instrument ended the connection")
        return waiting

    def _message_based(self) -> bool:
        return self._resource.resource_class == "INSTR" and not isinstance(self._resource, SerialInstrument)

    def _open(self, resource_name: str, backend: str) -> MessageBasedResource:
        try:
            resource = _manager(backend).open_resource(resource_name, open_timeout=round(OPEN_TIMEOUT_S * 1000))
        except Exception as error:  # pyvisa-py raises bare Exception when it cannot connect
            raise lost(self.address, f"VISA cannot open it ({_one_line(error)})") from error
        if isinstance(resource, MessageBasedResource):
            return resource
        resource.close()
        raise lost(self.address, "VISA cannot exchange messages with this kind of resource")

    @contextmanager
    def _failures(self, what: str) -> Iterator[None]:
        # pyvisa-py lets socket and serial errors through, and raises RuntimeError for a dropped HiSLIP link
        try:
            yield
        except (pyvisa.Error, OSError, RuntimeError, ValueError) as error:
            raise lost(self.address, f"{what} ({_one_line(error)})") from error


def _manager(backend: str) -> pyvisa.ResourceManager:
    # pyvisa has one per library, makes it without a lock, and anybody in the process may have closed it.
    with _ONE_AT_A_TIME:
        return pyvisa.ResourceManager(backend)


def _socket_of(resource: MessageBasedResource) -> socket.socket | None:
    sessions = getattr(resource.visalib, "sessions", {})
    # pyvisa has no public way to the socket of a session; without it the loss is noticed later.
    interface = getattr(sessions.get(resource.session), "interface", None)
    return interface if isinstance(interface, socket.socket) else None


def _check_connected(stream: socket.socket) -> None:
    # pyvisa-py takes a refused connection for an open one
    if code := stream.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
        raise OSError(code, os.strerror(code))


def _set_timeout(resource: MessageBasedResource, wait_s: float) -> None:
    # VISA counts whole milliseconds, and 0 would not wait at all.
    resource.timeout = max(1, math.ceil(wait_s * 1000.0))


def _set_line(line: SerialInstrument, settings: SerialSettings) -> None:
    line.baud_rate = settings.baud
    line.parity = PARITIES[settings.parity]
    line.data_bits = settings.bytesize
    line.stop_bits = STOP_BITS[settings.stopbits]
    line.flow_control = FLOW_CONTROL[settings.rtscts, settings.xonxoff]


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
