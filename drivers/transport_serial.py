"""RS-232 and USB-serial lines, through pyserial."""

from __future__ import annotations

from dataclasses import dataclass

import serial

from drivers.buffered import WALL_FLOOR_S, BufferedTransport
from drivers.transport import lost
from rigctl.clock import Clock
from rigctl.errors import LinkTimeout

BITS_PER_BYTE = 10
"""Start bit, eight data bits, stop bit."""


@dataclass(frozen=True)
class SerialSettings:
    """How a line is set: speed, frame and flow control."""

    baud: int = 9600
    parity: str = "N"
    bytesize: int = 8
    stopbits: float = 1
    rtscts: bool = False
    xonxoff: bool = False


class SerialTransport(BufferedTransport):
    """A serial line; opening it locks the device against other programs that lock, too."""

    def __init__(
        self,
        device: str,
        clock: Clock,
        settings: SerialSettings,
        *,
        address: str = "",
        floor_s: float = WALL_FLOOR_S,
    ) -> None:
        super().__init__(address or f"serial:{device}", clock, floor_s)
        self._baud = settings.baud
        try:
            self._port = serial.Serial(
                device,
                baudrate=settings.baud,
                parity=settings.parity,
                bytesize=settings.bytesize,
                stopbits=settings.stopbits,
                rtscts=settings.rtscts,
                xonxoff=settings.xonxoff,
                exclusive=True,
            )
        except OSError as error:
            raise lost(self.address, f"cannot open {device} ({error.strerror or error})") from error

    def write(self, data: bytes) -> None:
        """Send all of `data`; `LinkTimeout` when flow control holds it back, `LinkLost` when unplugged."""
        limit_s = self._floor_s + len(data) * BITS_PER_BYTE / self._baud
        try:
            self._port.write_timeout = limit_s
            self._port.write(data)
        except serial.SerialTimeoutException as error:
            raise LinkTimeout(
                f"{self.address}: could not send {data[:60]!r} within {limit_s:.3g} s; check flow control"
            ) from error
        except OSError as error:
            raise lost(self.address, f"sending failed ({error})") from error

    def close(self) -> None:
        """End the connection; may be called twice."""
        self._port.close()

    def _receive(self, wait_s: float) -> bytes:
        try:
            self._port.timeout = wait_s
            first = self._port.read(1)
            return first + self._port.read(self._port.in_waiting) if first else b""
        except OSError as error:
            raise lost(self.address, f"reading failed ({error})") from error
