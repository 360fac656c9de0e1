"""A wire log in place of its instrument: a driver's questions get the recorded answers, in order.

What a driver may do differently from when it was recorded: read in other pieces. Whatever else it does is told once,
with what was expected, what came and where in the log, and again at every further call.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence

from drivers.connect import connector, serial_ways
from drivers.transport import Connect, Transport
from drivers.transport_serial import SerialSettings
from drivers.wire import lines
from drivers.wire.lines import Record
from drivers.wire.reading import WireLog
from drivers.wire.secrets import Masking
from rigctl.core.errors import ConfigError, DataError, LinkError, LinkLost, LinkTimeout, one_line

SHOWN = 120
FAILURES: dict[str, type[LinkError]] = {each.__name__: each for each in (LinkTimeout, LinkLost)}


class ReplayClock:
    """Rig time as the log has it: it is as late as the latest record that was replayed, and waiting takes no time."""

    speed = float("inf")

    def __init__(self, start_s: float = 0.0) -> None:
        self._now_s = start_s
        self._lock = threading.Lock()

    def now_s(self) -> float:
        """Seconds of rig time."""
        return self._now_s

    def sleep_s(self, duration_s: float) -> None:
        """Time has passed."""
        with self._lock:
            self._now_s += max(duration_s, 0.0)

    def reach(self, at_s: float) -> None:
        """Not earlier than a record."""
        with self._lock:
            self._now_s = max(self._now_s, at_s)


class Replay:
    """One log, replayed once; `connect` is given to a driver.

    `deviation` is the first thing that the driver did differently: drivers may take an error for a fault of the wire,
    so whoever replays asks for it in the end.
    """

    def __init__(self, log: WireLog, secrets: Sequence[str] = ()) -> None:
        self.log = log
        self.clock = ReplayClock(log.records[0].at_s if log.records else 0.0)
        self.masking = Masking(secrets)
        self.deviation: DataError | None = None
        self.replayed = 0
        """How many records were used."""
        by_connection: dict[int, deque[Record]] = {}
        for record in log.contiguous:
            # What had come when a read gave up is read later, or never.
            if record.kind != lines.PENDING:
                by_connection.setdefault(record.connection, deque()).append(record)
        self._connections = deque(by_connection[number] for number in sorted(by_connection))
        self._gap = next(iter(log.gaps().values()), None)

    def connect(self) -> Transport:
        """The next connection of the log."""
        self.require_followed()
        if not self._connections:
            raise self.deviates(None, "a further connection was made")
        records = self._connections.popleft()
        opened = self.used(records)
        if opened.kind == lines.NOT_READ:
            raise failure(opened)
        return ReplayedTransport(self, records, guarded=opened.data.startswith(b"guarded"))

    def require_followed(self) -> None:
        """`DataError` when the driver has done something else than was recorded."""
        if self.deviation is not None:
            raise self.deviation

    def used(self, records: deque[Record]) -> Record:
        """Take the next record of a connection."""
        record = records.popleft()
        self.clock.reach(record.at_s)
        self.replayed += 1
        return record

    def deviates(self, expected: Record | None, came: str) -> DataError:
        """The error to raise where the log goes on with `expected`, or ends, and the driver does something else."""
        path, header = self.log.path, self.log.header
        if expected is None:
            end = str(self._gap) if self._gap else "the log ends here"
            where, wanted = f"after record {len(self.log.contiguous)}", f"nothing more, {end}"
        else:
            where, wanted = f"record {expected.number} ({expected.at_s:.6f} s)", _words(expected)
        mend = f"compare driver and settings with those recorded ({header.driver} of rigctl {header.rigctl})"
        self.deviation = self.deviation or DataError(
            f"{path}: {where}: {header.instrument}: expected {wanted}; {came}; {mend}"
        )
        return self.deviation


class ReplayedTransport:
    """One recorded connection."""

    def __init__(self, replay: Replay, records: deque[Record], *, guarded: bool) -> None:
        self.address = f"{replay.log.path}"
        self.guarded = guarded
        self._replay, self._records = replay, records
        self._received = bytearray()
        self._sent = b""

    def write(self, data: bytes) -> None:
        """Compare `data` with what was sent here when it was recorded."""
        self._replay.require_followed()
        sent = rest = self._replay.masking.command(data)
        while rest:
            record = self._records[0] if self._records else None
            if record is None or record.kind != lines.SENT or not rest.startswith(record.data):
                raise self._replay.deviates(record, f"{_shown(sent)} was sent")
            # A long command is several records.
            rest = rest[len(self._replay.used(self._records).data) :]
        if self._next_is(lines.NOT_SENT):
            raise failure(self._replay.used(self._records))

    def read_until(self, terminator: bytes, timeout_s: float) -> bytes:  # noqa: ARG002 - the log knows how it ended
        """Bytes up to and including `terminator`."""
        self._fill(lambda: terminator in self._received, repr(terminator))
        return self._take(self._received.index(terminator) + len(terminator))

    def read_exactly(self, count: int, timeout_s: float) -> bytes:  # noqa: ARG002
        """Exactly `count` bytes."""
        self._fill(lambda: len(self._received) >= count, f"{count} bytes")
        return self._take(count)

    def unread(self) -> bytes:
        """What had arrived here unasked."""
        self._replay.require_followed()
        while self._next_is(lines.UNASKED):
            self._received += self._replay.used(self._records).data
        if self._next_is(lines.ENDED) and not self._received:
            raise failure(self._replay.used(self._records))
        return self._take(len(self._received))

    def close(self) -> None:
        """The driver may leave earlier than it did."""
        if self._next_is(lines.CLOSED):
            self._replay.used(self._records)
        self._records.clear()

    def _fill(self, complete: Callable[[], bool], wanted: str) -> None:
        self._replay.require_followed()
        while not complete():
            record = self._records[0] if self._records else None
            if record is not None and record.kind == lines.NOT_READ:
                raise failure(self._replay.used(self._records))
            if record is None or record.kind not in (lines.READ, lines.UNASKED):
                raise self._replay.deviates(record, f"{wanted} was waited for, with {_shown(bytes(self._received))}")
            self._received += self._replay.used(self._records).data

    def _next_is(self, kind: str) -> bool:
        return bool(self._records) and self._records[0].kind == kind

    def _take(self, count: int) -> bytes:
        taken = bytes(self._received[:count])
        del self._received[:count]
        return taken


class ReplayedConnect:
    """What a driver connects with; where it would try settings of a serial line, the log answers to each in turn."""

    def __init__(self, replay: Replay) -> None:
        self._replay = replay

    def __call__(self) -> Transport:
        """The next recorded connection."""
        return self._replay.connect()

    def ways(self, settings: Sequence[SerialSettings]) -> list[tuple[str, Connect]]:
        """As many as were tried at the recorded address."""
        try:
            recorded = connector(self._replay.log.header.address, self._replay.clock)
        except ConfigError:  # it was simulated, or had no line
            return [("", self)]
        return [(words, self) for words, _ in serial_ways(recorded, settings)]


def failure(record: Record) -> LinkError:
    """A recorded failure, to be raised again."""
    kind, _, text = record.data.decode("utf-8", "replace").partition(" ")
    return FAILURES.get(kind, LinkError)(text)


def _words(record: Record) -> str:
    match record.kind:
        case lines.SENT:
            return f"{_shown(record.data)} to be sent"
        case lines.READ | lines.UNASKED:
            return f"{_shown(record.data)} to be read"
        case lines.CLOSED:
            return "the end of the connection"
        case _:
            return f"a failure, {one_line(record.data.decode('utf-8', 'replace'))[:SHOWN]}"


def _shown(data: bytes) -> str:
    return repr(data[:SHOWN]) + (f" and {len(data) - SHOWN} bytes more" if len(data) > SHOWN else "")
