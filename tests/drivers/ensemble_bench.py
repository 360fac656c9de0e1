"""A simulated Ensemble with a driver on it, or a list of lines and replies that it expects."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from drivers.aerotech_ensemble import AerotechEnsemble, EnsembleSettings
from drivers.transport import Endpoint, InProcessTransport
from rigctl.core.errors import RigError
from simulators.aerotech_ensemble import EnsembleSimulatorSettings, SimulatedEnsemble
from simulators.clock import SimulationClock, VirtualClock
from simulators.faults import FaultPlan, FaultyInstrument
from simulators.motion import MotionAxis
from simulators.wiring import TriggerLine
from tests.drivers.expected import Expected, Send

BY_ASCII = {
    "oscillate_over_ascii": True,
    "capture_over_ascii": True,
    "oscillate_waits": "as moves do",
    "oscillate_shows": True,
}
"""A controller that understands OSCILLATE and DATAACQ as ASCII commands, and answers them at once."""
ASCII: dict[str, Any] = {
    "simulated": {"dialect": BY_ASCII, "rigctl_program": False},
    "program": "",
    "oscillate_answers": "at once",
}
PATIENCE_S = 20.0
"""Wall-clock time after which a test gives up waiting for an event."""


def expected(*exchanges: tuple[str, str]) -> Expected:
    """A controller that expects these lines in this order and gives these replies."""
    return Expected(*((line.encode() + b"\n", reply.encode("latin-1")) for line, reply in exchanges))


class Tap:
    """Passes bytes on to another endpoint, notes the lines, and may meddle."""

    def __init__(self, endpoint: Endpoint) -> None:
        self.lines: list[str] = []
        self.connections = 0
        self.on_line: Callable[[str], bool] = lambda _: True
        self.on_reply: Callable[[bytes], bytes] = lambda data: data
        self._endpoint = endpoint

    def connect(self, send: Send) -> TappedConnection:
        self.connections += 1
        return TappedConnection(self, self._endpoint.connect(lambda data: send(self.on_reply(data))))

    def sent(self, keyword: str) -> list[str]:
        return [line for line in self.lines if line.startswith(keyword)]


class TappedConnection:
    def __init__(self, tap: Tap, inner: Any) -> None:
        self._tap = tap
        self._inner = inner
        self._cut = False

    @property
    def hung_up(self) -> bool:
        return self._cut or self._inner.hung_up

    def receive(self, data: bytes) -> None:
        line = data.decode().removesuffix("\n")
        self._tap.lines.append(line)
        if self._tap.on_line(line):
            self._inner.receive(data)
        else:
            self._cut = True

    def close(self) -> None:
        self._inner.close()


class Bench:
    """A driver, a simulated controller, and the wire that triggers it."""

    def __init__(
        self,
        *,
        clock: SimulationClock | None = None,
        simulated: dict[str, Any] | None = None,
        faults: dict[str, Any] | None = None,
        **configured: Any,
    ) -> None:
        self.clock = clock or VirtualClock()
        self.axis = MotionAxis()
        self.line = TriggerLine()
        self.ensemble = SimulatedEnsemble(
            self.clock, self.axis, self.line, EnsembleSimulatorSettings(**(simulated or {}))
        )
        configured.setdefault("oscillate_distance", "amplitude")
        plan = FaultPlan.model_validate(faults or {})
        self.tap = Tap(FaultyInstrument(self.ensemble, plan, self.clock))
        self.stage = stage(self.tap, self.clock, **configured)

    def opened(self) -> Bench:
        self.stage.open()
        return self

    def homed(self) -> Bench:
        self.opened().stage.home()
        self.tap.lines.clear()
        return self

    def position_mm(self) -> float:
        return self.axis.position(self.clock.now_s())

    def at_rest(self) -> bool:
        return self.axis.velocity(self.clock.now_s()) == 0.0


def stage(endpoint: Endpoint, clock: SimulationClock, **configured: Any) -> AerotechEnsemble:
    return AerotechEnsemble(
        "stage", EnsembleSettings(**configured), lambda: InProcessTransport("sim:stage", endpoint, clock), clock
    )


def talking(*exchanges: tuple[str, str], **configured: Any) -> tuple[AerotechEnsemble, Expected]:
    """A stage just opened whose controller goes on with these exchanges."""
    conversation = expected(*GREETING, *exchanges)
    opened = stage(conversation, VirtualClock(), **configured)
    opened.open()
    return opened, conversation


GREETING = (
    ("NONE", "!\n"),
    ("VERSION", "%4.01.000\n"),
    ("GETPARM(X, 140)", "%X\n"),
    ("GETPARM(X, 129)", "%mm\n"),
    ("GETPARM(X, 2)", "%10000.000\n"),
    ("GETPARM(X, 124)", "%60.000\n"),
    ("GETPARM(X, 125)", "%512.000\n"),
    ("GETPARM(X, 37)", "%-25.000\n"),
    ("GETPARM(X, 38)", "%25.000\n"),
)
UNIT = GREETING[3:5]


@contextmanager
def in_thread(action: Callable[[], None]) -> Iterator[list[BaseException]]:
    """Runs `action` beside the block; its error, if any, is in the list afterwards."""
    raised: list[BaseException] = []

    def run() -> None:
        try:
            action()
        except RigError as error:
            raised.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield raised
    finally:
        thread.join(PATIENCE_S)
    assert not thread.is_alive()


def when_sent(bench: Bench, keyword: str) -> threading.Event:
    seen = threading.Event()

    def look(line: str) -> bool:
        if line.startswith(keyword):
            seen.set()
        return True

    bench.tap.on_line = look
    return seen
