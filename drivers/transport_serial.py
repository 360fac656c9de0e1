"""RS-232 and USB-serial lines, through pyserial."""

from __future__ import annotations

import select
import socket
import termios
from dataclasses import dataclass

import serial

from drivers.buffered import WALL_FLOOR_S, BufferedTransport
from drivers.transport import lost
from rigctl.core.clock import Clock
from rigctl.core.errors import LinkLost, LinkTimeout

READ_BYTES = 65536
LONGEST_WRITE_BITS = 10 * 4096
"""What a line may take to swallow one command: its bits, with start and stop bits."""


@dataclass(frozen=True)
class SerialSettings:
    """How a line is set: speed, frame and flow control."""

    baud: int = 9600
    parity: str = "N"
    bytesize: int = 8
    stopbits: float = 1
    rtscts: bool = False
    xonxoff: bool = False

    @property
    def guarded(self) -> bool:
        """Parity shows that a bit has turned."""
        return self.parity in ("E", "O")


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
        super().__init__(address or f"serial:{device}", clock, floor_s, guarded=settings.guarded)
        self._write_timeout_s = floor_s + LONGEST_WRITE_BITS / settings.baud
        try:
            self._port = serial.Serial(
                device,
                baudrate=settings.baud,
                parity=settings.parity,
                bytesize=settings.bytesize,
                stopbits=settings.stopbits,
                rtscts=settings.rtscts,
                xonxoff=settings.xonxoff,
                # Non-blocking: waiting is done by `select`, which a closing can interrupt.
                timeout=0.0,
                write_timeout=self._write_timeout_s,
                exclusive=True,
            )
        except OSError as error:
            raise lost(self.address, f"cannot open {device} ({error})") from error
        except termios.error as error:
            raise self._refused(settings, str(error)) from error
        if settings.guarded and not check_parity(self._port.fileno()):
            self._port.close()
            raise self._refused(settings, "no parity")
        # Closing a device does not wake who selects on it; an end of this pair does.
        self._woken, self._wake = socket.socketpair()

    def _refused(self, settings: SerialSettings, why: str) -> LinkLost:
        reason = f"it does not take {settings} ({why}; a pseudo-terminal knows 8 bits, no parity)"
        return lost(self.address, reason)

    def write(self, data: bytes) -> None:
        """Send all of `data`; `LinkTimeout` when flow control holds it back, `LinkLost` when unplugged."""
        try:
            self._port.write(data)
        except serial.SerialTimeoutException as error:
            limit = f"{self._write_timeout_s:.3g} s"
            raise LinkTimeout(
                f"{self.address}: could not send {data[:60]!r} within {limit}; check flow control"
            ) from error
        except OSError as error:
            raise lost(self.address, f"sending failed ({error})") from error

    def close(self) -> None:
        """End the connection; may be called twice. Who waits for bytes is woken, and told."""
        # First: a thread that waits must be woken before its descriptors are gone.
        self._wake.close()
        self._port.close()
        self._woken.close()

    def _receive(self, wait_s: float) -> bytes:
        try:
            line, woken = self._port.fileno(), self._woken.fileno()
            ready, _, _ = select.select([line, woken], [], [], wait_s)
            if woken in ready:
                raise lost(self.address, "it is closed here")
            return self._port.read(READ_BYTES) if ready else b""
        except (OSError, ValueError) as error:  # ValueError: closed by another thread just now
            raise lost(self.address, f"reading failed ({error})") from error


def check_parity(line: int) -> bool:
    """Have a byte of wrong parity read as a zero byte, which stands in no reply; pyserial lets it pass as it came.

    False when the line has taken no parity, which some do without a word.
    """
    modes = termios.tcgetattr(line)
    # Parity is checked, and without IGNPAR and PARMRK a wrong byte is read as zero.
    modes[0] = modes[0] & ~(termios.IGNPAR | termios.PARMRK | termios.ISTRIP) | termios.INPCK
    termios.tcsetattr(line, termios.TCSANOW, modes)
    return bool(modes[2] & termios.PARENB)
