"""A connection whose bytes are logged on their way."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import count
from pathlib import Path
from urllib.parse import quote

from drivers.connect import serial_ways
from drivers.transport import Clearable, Connect, Transport
from drivers.transport_serial import SerialSettings
from drivers.wire import lines
from drivers.wire.lines import Header, line_of
from drivers.wire.ring import RingFile
from drivers.wire.secrets import Masking
from rigctl.core.clock import Clock
from rigctl.core.errors import LinkError, LinkTimeout, one_line

HEAD_BYTES = 1 << 20
RING_BYTES = 4 << 20
PIECE = 64
"""A line holds at most this part of the ring in bytes, each of which takes up to four when it is escaped."""


class WireLogger:
    """Writes what goes over the wire of one instrument; any thread.

    Its file is made by the first connection. A log that cannot be written ends, and says so on stderr: no measurement
    fails for it.
    """

    def __init__(self, directory: Path, header: Header, clock: Clock, secrets: Iterable[str] = ()) -> None:
        self.path: Path | None = None
        """The file; None until there is one."""
        self.header = header
        self._directory, self._clock = directory, clock
        self._masking = Masking(secrets)
        # Re-entrant: a signal handler may ask an instrument in the middle of its own thread's exchange.
        self._lock = threading.RLock()
        self._file: RingFile | None = None
        self._failed = False
        self._number = self._total = self._connections = 0
        self._held: dict[int, list[tuple[str, bytes]]] = {}

    def connection(self) -> int:
        """The number of one more connection."""
        with self._lock:
            self._connections += 1
            return self._connections

    def sent(self, connection: int, data: bytes) -> None:
        """What is about to be sent."""
        if not data:
            return
        with self._lock:
            self._release(connection)
            self._write(connection, lines.SENT, data, self._masking.command(data))

    def came(self, connection: int, data: bytes, kind: str = lines.READ) -> None:
        """What was read."""
        if self._masking.aware:
            # An instrument may repeat a secret, which a read may cut in two: kept until the next question.
            with self._lock:
                self._held.setdefault(connection, []).append((kind, data))
        else:
            self._write(connection, kind, data, data)

    def happened(self, connection: int, kind: str, text: str) -> None:
        """Anything but bytes, in words."""
        with self._lock:
            self._release(connection)
            self._write(connection, kind, text.encode(), self._masking.quoted(text.encode()))

    def failed(self, connection: int, kind: str, error: LinkError) -> None:
        """An exchange that failed, and what had come by then."""
        with self._lock:
            self._release(connection)
            if isinstance(error, LinkTimeout) and error.received:
                self._write(connection, lines.PENDING, error.received, self._masking.quoted(error.received))
            self.happened(connection, kind, f"{type(error).__name__} {one_line(str(error))}")

    def _release(self, connection: int) -> None:
        if not (held := self._held.pop(connection, None)):
            return
        whole = b"".join(data for _, data in held)
        masked = self._masking.quoted(whole)
        # Where nothing is masked the pieces stay as they were read.
        for kind, data in [(held[0][0], whole)] if masked != whole else held:
            self._write(connection, kind, data, masked if masked != whole else data)

    def _write(self, connection: int, kind: str, data: bytes, masked: bytes) -> None:
        at_s = self._clock.now_s()
        with self._lock:
            if self._failed:
                return
            marked = kind if masked == data else kind + lines.MASKED
            piece = self.header.ring_bytes // PIECE
            try:
                file = self._file or self._begun()
                for start in range(0, len(masked) or 1, piece):
                    part = masked[start : start + piece]
                    self._number += 1
                    self._total += len(part) if kind in lines.BYTES else 0
                    file.append(line_of(self._number, at_s, connection, marked, self._total, part))
            except OSError as error:
                self._failed = True
                where = self.path or self._directory
                sys.stderr.write(f"{where}: the wire log ends here ({error.strerror}); what goes on is not logged\n")

    def _begun(self) -> RingFile:
        stamp = datetime.now(UTC)
        header = replace(self.header, started=stamp.isoformat(timespec="seconds"))
        # Quoted: a name may hold what no file's name may, and two names stay two.
        stem = f"{quote(header.instrument, safe=' ')}-{stamp:%Y%m%dT%H%M%S}"
        self._directory.mkdir(parents=True, exist_ok=True)
        for again in count(1):
            path = self._directory / (f"{stem}.wire" if again == 1 else f"{stem}-{again}.wire")
            try:
                self._file = RingFile(path, header.head_bytes, header.ring_bytes)
            except FileExistsError:
                continue
            self.path = path
            self._file.append(header.line())
            return self._file
        raise AssertionError("there is always one more number")


class LoggedTransport:
    """A transport of which everything is logged."""

    def __init__(self, inner: Transport, logger: WireLogger, connection: int) -> None:
        self.address = inner.address
        self.guarded = inner.guarded
        self._inner, self._logger, self._connection = inner, logger, connection
        self._open = True

    def write(self, data: bytes) -> None:
        """Send all of `data`."""
        self._logger.sent(self._connection, data)
        try:
            self._inner.write(data)
        except LinkError as error:
            self._logger.failed(self._connection, lines.NOT_SENT, error)
            raise

    def read_until(self, terminator: bytes, timeout_s: float) -> bytes:
        """Bytes up to and including `terminator`."""
        return self._read(lambda: self._inner.read_until(terminator, timeout_s))

    def read_exactly(self, count: int, timeout_s: float) -> bytes:
        """Exactly `count` bytes."""
        return self._read(lambda: self._inner.read_exactly(count, timeout_s))

    def unread(self) -> bytes:
        """Take what has arrived and nobody has read."""
        return self._read(self._inner.unread, lines.UNASKED)

    def device_clear(self) -> bool:
        """No bytes: a replay goes on without it."""
        return isinstance(self._inner, Clearable) and self._inner.device_clear()

    def close(self) -> None:
        """End the connection."""
        if self._open:
            self._open = False
            self._logger.happened(self._connection, lines.CLOSED, "")
        self._inner.close()

    def _read(self, read: Callable[[], bytes], kind: str = lines.READ) -> bytes:
        try:
            data = read()
        except LinkError as error:
            failure = lines.ENDED if kind == lines.UNASKED else lines.NOT_READ
            self._logger.failed(self._connection, failure, error)
            raise
        if data:
            self._logger.came(self._connection, data, kind)
        return data


@dataclass(frozen=True)
class LoggedConnect:
    """Opens logged connections; `way` says with which settings of a line, where several are tried."""

    inner: Connect
    logger: WireLogger
    way: str = ""

    def __call__(self) -> LoggedTransport:
        """One connection."""
        connection = self.logger.connection()
        try:
            transport = self.inner()
        except LinkError as error:
            self.logger.failed(connection, lines.NOT_READ, error)
            raise
        guarded = "guarded" if transport.guarded else "unguarded"
        self.logger.happened(connection, lines.OPENED, f"{guarded} {self.way}".strip())
        return LoggedTransport(transport, self.logger, connection)

    def ways(self, settings: Sequence[SerialSettings]) -> list[tuple[str, Connect]]:
        """As `serial_ways` of what it opens, each logged."""
        ways = serial_ways(self.inner, settings)
        return [(words, replace(self, inner=connect, way=words)) for words, connect in ways]
