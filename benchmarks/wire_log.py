"""What a wire log costs: exchanges with it and without, in turn.

An XPS asked for its angle in this process, and over loopback TCP with the simulator in a process of its own: both
answer quicker than any instrument. Over loopback TCP what answers after a millisecond: what a laboratory has at best.
And an endpoint that only answers, where nothing else takes time. Logs are kept in the directory given, else here.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.machine import conditions
from benchmarks.paired import Pairs, pairs
from drivers.connect import connector
from drivers.transport import Connect, Connection, InProcessTransport, Transport
from drivers.wire.lines import Header
from drivers.wire.logged import HEAD_BYTES, RING_BYTES, LoggedConnect, WireLogger
from rigctl.core.clock import Clock, RealClock
from rigctl.files.rig_file import parse_rig
from rigctl.rig import Rig
from simulators.clock import VirtualClock

CAMPAIGNS = Path(__file__).parents[1] / "campaigns"
EXCHANGES = 200
TURNS = 25
HOST = "127.0.0.1"
ANSWERS_AFTER_S = 1e-3
TARGET = 1.1
"""Of an exchange with an instrument that answers after a millisecond."""
ANSWERING = f"""
import select, socket, time
server = socket.create_server(("{HOST}", 0))
print(server.getsockname()[1], flush=True)
clients = [server.accept()[0] for _ in range(2)]
while True:
    for each in select.select(clients, [], [])[0]:
        if not each.recv(4096): raise SystemExit
        time.sleep({ANSWERS_AFTER_S})
        each.sendall(b"0,12.5,EndOfAPI")
"""


class Answering:
    """An endpoint that gives the same answer to everything."""

    def __init__(self, answer: bytes) -> None:
        self._answer = answer

    def connect(self, send: Callable[[bytes], None]) -> Connection:
        """Serve one more client."""
        return _Client(send, self._answer)


class _Client:
    def __init__(self, send: Callable[[bytes], None], answer: bytes) -> None:
        self._send, self._answer = send, answer

    def receive(self, _: bytes) -> None:
        """Answer."""
        self._send(self._answer)

    def close(self) -> None:
        """The client has gone."""


def bare(connect: Connect, clock: Clock, directory: Path) -> Pairs:
    """Two transports, one of them logged, that ask and read."""
    header = Header("bare", "none", "", "asked", "", "", HEAD_BYTES, RING_BYTES)
    plain, logged = connect(), LoggedConnect(connect, WireLogger(directory, header, clock))()
    try:
        return compared(lambda: exchange(plain), lambda: exchange(logged))
    finally:
        plain.close()
        logged.close()


def in_process() -> tuple[Connect, Clock]:
    """What connects to an endpoint that only answers."""
    clock = VirtualClock()
    return (lambda: InProcessTransport("bare", Answering(b"0,12.5,EndOfAPI"), clock)), clock


def exchange(transport: Transport) -> None:
    transport.unread()
    transport.write(b"GroupPositionCurrentGet(Group1,double *)")
    transport.read_until(b"EndOfAPI", 1.0)


def compared(floor: Callable[[], object], ours: Callable[[], object]) -> Pairs:
    def often(act: Callable[[], object]) -> None:
        for _ in range(EXCHANGES):
            act()

    return pairs(lambda: often(floor), lambda _: often(ours), TURNS)


def driven(text: str, directory: Path) -> Pairs:
    """An XPS asked for its angle by two drivers, one of them logged."""
    file = parse_rig(text, CAMPAIGNS / "isa-rig.toml")
    plain, logged = (Rig(each).instruments["rotation"] for each in (file, file.with_wire_log(directory)))
    plain.open()
    logged.open()
    try:
        return compared(plain.angle, logged.angle)  # type: ignore[attr-defined]
    finally:
        plain.close()
        logged.close()


@contextmanager
def printing(*command: str) -> Iterator[str]:
    """The first line of a program that goes on until it is ended."""
    with subprocess.Popen([sys.executable, *command], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield process.stdout.readline()
        finally:
            process.terminate()


def client_of(places: str) -> str:
    """The rig file of a client of `rigctl simulate`."""
    port = next(each["port"] for each in json.loads(places)["instruments"] if each["name"] == "rotation")
    return (
        f'[rig]\nname = "client"\nclock = "real"\n[instruments.rotation]\ndriver = "newport-xps"\n'
        f'address = "tcp://{HOST}:{port}"\nrole = "rotation"\n'
    )


def main() -> int:
    base = Path(sys.argv[1]) if len(sys.argv) > 1 else Path.cwd()
    print(conditions())
    print(f"  {f'{EXCHANGES} exchanges':<44} {'without':>10} {'logged':>10} {'ratio':>7}")
    rig = CAMPAIGNS / "isa-rig.toml"
    with tempfile.TemporaryDirectory(dir=base) as name:
        directory = Path(name)
        print(bare(*in_process(), directory).line("an endpoint that only answers", None))
        print(driven(rig.read_text(), directory).line("XPS: angle(), simulated in this process", None))
        with printing("-m", "rigctl", "simulate", str(rig), "--json") as places:
            print(driven(client_of(places), directory).line("XPS: angle(), over loopback TCP", None))
        with printing("-c", ANSWERING) as port:
            clock = RealClock()
            slow = bare(connector(f"tcp://{HOST}:{port.strip()}", clock), clock, directory)
        print(slow.line("TCP, answered after 1 ms", TARGET))
    return 0 if slow.ratio <= TARGET else 1


if __name__ == "__main__":
    sys.exit(main())
