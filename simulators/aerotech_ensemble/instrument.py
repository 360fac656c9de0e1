"""The socket: one client at a time, one reply per line, and an end for those who stay silent."""

from __future__ import annotations

from collections.abc import Callable

from simulators.aerotech_ensemble.controller import AxisController
from simulators.aerotech_ensemble.grammar import Invalid, parse
from simulators.aerotech_ensemble.interpreter import Interpreter
from simulators.aerotech_ensemble.parameters import Parameter
from simulators.aerotech_ensemble.refusals import Blocked, Faulted, Restarting
from simulators.aerotech_ensemble.settings import EnsembleSimulatorSettings, StageSimulatorSettings
from simulators.aerotech_ensemble.status import AxisFault
from simulators.clock import SimulationClock
from simulators.faults.mishaps import AirLost, EmergencyStop, FollowingError, LimitHit, PowerCycle, WrongUnit
from simulators.faults.when import Event
from simulators.measured import Tap, unheard
from simulators.motion import MotionAxis
from simulators.wiring import TriggerLine

MM_PER_INCH = 25.4
LASTING_FAULTS: dict[type[Event], AxisFault] = {
    EmergencyStop: AxisFault.EMERGENCY_STOP,
    AirLost: AxisFault.EXTERNAL,
}
"""Reported as long as the cause is there; the pressure switch of an air bearing is the external fault."""


class SimulatedEnsemble:
    """An Ensemble whose axis is `axis` and whose capture input is `trigger`."""

    kind = "aerotech-ensemble"

    def __init__(
        self,
        clock: SimulationClock,
        axis: MotionAxis,
        trigger: TriggerLine,
        settings: StageSimulatorSettings | None = None,
        tap: Tap | None = None,
    ) -> None:
        self._clock = clock
        self._settings: StageSimulatorSettings = settings or EnsembleSimulatorSettings()
        self._interpreter = Interpreter(clock, axis, trigger, self._settings, tap or unheard())
        # A fault ends a motion, and with it the wait for its end.
        self._interpreter.axis.on_fault = self._end_wait
        self._clients: list[_Client] = []
        self._waits = 0
        self._waiting_client: _Client | None = None
        self._busy = False

    @property
    def controller(self) -> AxisController:
        """The axis' state machine, for those who make faults happen."""
        return self._interpreter.axis

    def befall(self, event: Event) -> None:
        """Something happens to the controller and its stage."""
        match event:
            case PowerCycle():
                self._lose_power()
            case FollowingError():
                if self.controller.enabled:
                    self.controller.trip(AxisFault.POSITION_ERROR)
            case LimitHit():
                self.controller.hit_limit()
            case EmergencyStop() | AirLost():
                self.controller.suffer(LASTING_FAULTS[type(event)])
            case WrongUnit():
                self._interpreter.change_unit("in", MM_PER_INCH)

    def relieve(self, event: Event) -> None:
        """It is over: as after switching on, or free to be acknowledged."""
        match event:
            case PowerCycle():
                self._interpreter.restart()
                self._started()
            case EmergencyStop() | AirLost():
                self.controller.recover(LASTING_FAULTS[type(event)])
            case WrongUnit():
                self._interpreter.change_unit(self._settings.units, 1.0)

    def announce_run(self, *key: int) -> None:
        """Name the run whose encoder noise the next capture has."""
        self._interpreter.capture.run_key = key

    def connect(self, send: Callable[[bytes], None]) -> _Client:
        """Serve one more client: at once when it is the only one, else when those before it have gone."""
        with self._clock.lock:
            client = _Client(self, send, self._clock)
            self._clients.append(client)
            if client is self._clients[0]:
                self._begin_service(client)
            return client

    def received(self, client: _Client) -> None:
        """Interpret the lines of a client whose turn it is."""
        # One line at a time: while a command blocks, the others wait in the client's buffer.
        while not self._busy and self._clients and client is self._clients[0]:
            line = client.take_line()
            if line is None:
                return
            self._answer(client, line)

    def gone(self, client: _Client) -> None:
        """Forget a client; the next one's lines are interpreted."""
        if client not in self._clients:
            return
        served = client is self._clients[0]
        self._clients.remove(client)
        if served and self._clients:
            self._begin_service(self._clients[0])

    def _begin_service(self, client: _Client) -> None:
        client.last_s = self._clock.now_s()
        self._watch(client)
        # Its lines may have come while it waited for its turn.
        self.received(client)

    def _watch(self, client: _Client) -> None:
        timeout_s = self._interpreter.parameters[Parameter.SOCKET2_TIMEOUT] / 1000.0
        if timeout_s > 0:
            self._clock.call_at(client.last_s + timeout_s, lambda: self._check_idle(client, timeout_s))

    def _check_idle(self, client: _Client, timeout_s: float) -> None:
        if client.hung_up:
            return
        # Whoever waits for a reply is not silent.
        if self._busy:
            client.last_s = self._clock.now_s()
        if self._clock.now_s() < client.last_s + timeout_s:
            self._watch(client)
        else:
            client.hang_up()

    def _answer(self, client: _Client, line: bytes) -> None:
        try:
            # Each line has one answer, whatever it is: the status character says which.
            reply = self._interpreter.execute(parse(line))
        except Invalid:
            client.send(self._status(b"!"))
        except Faulted:
            client.send(self._status(b"#"))
        except Restarting:
            self._restart()
        else:
            if reply is None:
                client.send(self._status(b"%"))
            elif isinstance(reply, Blocked):
                self._wait(client, reply.until_s)
            else:
                client.send(b"%" + reply.encode("ascii") + b"\n")

    def _status(self, character: bytes) -> bytes:
        always = int(self._interpreter.parameters[Parameter.COMMAND_SETUP]) & 1
        return character + b"\n" if always else character

    def _wait(self, client: _Client, until_s: float) -> None:
        self._busy = True
        self._waiting_client = client
        self._waits += 1
        wait = self._waits
        # By number: a time-out that comes after the end of its wait must not end the next one.
        self._clock.call_at(until_s, lambda: self._end_wait(wait))
        timeout_s = self._interpreter.parameters[Parameter.COMMAND_TIMEOUT] / 1000.0
        if timeout_s > 0:
            self._clock.call_at(self._clock.now_s() + timeout_s, lambda: self._end_wait(wait, timed_out=True))

    def _end_wait(self, wait: int | None = None, *, timed_out: bool = False) -> None:
        client = self._waiting_client
        if client is None or wait not in (None, self._waits):
            return
        self._busy, self._waiting_client = False, None
        if timed_out:
            client.send(self._status(b"$"))
        else:
            # A motion that ended in a fault is answered by `#`.
            client.send(self._status(b"#" if self.controller.fault() else b"%"))
        if self._clients:
            self.received(self._clients[0])

    def _lose_power(self) -> None:
        # Nobody is answered until it has started again.
        self._busy, self._waiting_client = True, None
        for client in tuple(self._clients):
            client.hang_up()
        self._interpreter.restart()

    def _restart(self) -> None:
        self._lose_power()
        self._clock.call_at(self._clock.now_s() + self._settings.startup_s, self._started)

    def _started(self) -> None:
        self._busy = False
        if self._clients:
            self.received(self._clients[0])


class _Client:
    """The controller's end of one socket."""

    def __init__(self, instrument: SimulatedEnsemble, send: Callable[[bytes], None], clock: SimulationClock) -> None:
        self.hung_up = False
        self.last_s = 0.0
        self._instrument = instrument
        self._send = send
        self._clock = clock
        self._received = b""

    def receive(self, data: bytes) -> None:
        """Take bytes; whole lines are answered in order."""
        with self._clock.lock:
            if not self.hung_up:
                self.last_s = self._clock.now_s()
                self._received += data
                self._instrument.received(self)

    def take_line(self) -> bytes | None:
        """The next complete line without its terminator."""
        line, terminator, rest = self._received.partition(b"\n")
        if not terminator:
            return None
        self._received = rest
        return line

    def send(self, data: bytes) -> None:
        """Reply, if anybody is there."""
        if not self.hung_up:
            self.last_s = self._clock.now_s()
            self._send(data)

    def hang_up(self) -> None:
        """End the connection from this side."""
        self.hung_up = True
        self._instrument.gone(self)

    def close(self) -> None:
        """The client has gone."""
        with self._clock.lock:
            self.hang_up()
