"""The controller behind its line: one command queue, one error queue, any number of axes."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

from simulators.clock import SimulationClock
from simulators.faults.mishaps import EmergencyStop, FollowingError, LimitHit, PowerCycle, WrongUnit
from simulators.faults.when import Event
from simulators.measured import Tap, unheard
from simulators.motion import MotionAxis
from simulators.newport_esp301.axis import COUNTS, EspAxis
from simulators.newport_esp301.commands import execute
from simulators.newport_esp301.errors import ErrorQueue, Refused
from simulators.newport_esp301.grammar import Command, LineReader, parse_line
from simulators.newport_esp301.parameters import stored_defaults
from simulators.newport_esp301.settings import Esp301SimulatorSettings
from simulators.wiring import Connection

WAIT_CHECK_S = 0.005
"""How often a waiting controller looks whether it has waited long enough."""


class SimulatedEsp301:
    """An ESP301 with the given axes in degrees, numbered from 1; it wakes up with all motors off."""

    kind = "newport-esp301"

    def __init__(
        self,
        clock: SimulationClock,
        axes: Sequence[MotionAxis],
        settings: Esp301SimulatorSettings | None = None,
        tap: Tap | None = None,
    ) -> None:
        self._tap = tap or unheard()
        self.clock = clock
        self.settings = settings or Esp301SimulatorSettings()
        self.errors = ErrorQueue(self.settings.errors_queued_max)
        self._motions = tuple(axes)
        self._queue: deque[tuple[Command | None, Callable[[bytes], None]]] = deque()
        self._waiting = False
        self.reset()

    @property
    def baud(self) -> int:
        """What its line is set to."""
        return self.settings.dialect.baud

    def connect(self, send: Callable[[bytes], None]) -> Connection:
        """Serve one more client; all of them share the queues."""
        return EspClient(self, send)

    def reset(self) -> None:
        """The state after power on."""
        self.axes = [
            EspAxis(number, motion, self.clock, self.settings, self.report, self._tap)
            for number, motion in enumerate(self._motions, start=1)
        ]
        self.keypad_locked = False
        self.powered_s = self.clock.now_s()
        self.stored = [stored_defaults(self.settings) for _ in self.axes]
        self.errors.clear()

    def report(self, code: int) -> None:
        """Put an error into the queue."""
        self.errors.put(code, self.clock.now_s())

    def befall(self, event: Event) -> None:
        """Something happens to the controller and its stages."""
        if isinstance(event, PowerCycle):
            self._queue.clear()
            self._waiting = False
        if isinstance(event, EmergencyStop):
            self.report(4)
        for axis in self.axes:
            _suffer(axis, event)

    def relieve(self, event: Event) -> None:
        """It is over: without reference, as after switching on, or free to be switched on."""
        if isinstance(event, PowerCycle):
            self.reset()
        for axis in self.axes:
            if isinstance(event, EmergencyStop):
                axis.inhibited = False
            if isinstance(event, WrongUnit):
                axis.unit = self.settings.unit

    def fail_following(self, axis_number: int) -> None:
        """Let an axis run into an obstacle."""
        with self.clock.lock:
            self.axes[axis_number - 1].fail_following()

    def submit(self, line: str, send: Callable[[bytes], None]) -> None:
        """Queue the commands of a line and work through the queue as far as waits allow."""
        if len(line) > self.settings.line_characters_max:
            self.report(6)
            return
        self._queue.extend((command, send) for command in parse_line(line))
        self._work()

    def wait_until(self, condition: Callable[[], bool], extra_s: float = 0.0) -> None:
        """Hold the queue until `condition` holds and `extra_s` more have passed."""
        now_s = self.clock.now_s()
        if not condition():
            self._waiting = True
            self.clock.call_at(now_s + WAIT_CHECK_S, lambda: self._look_again(condition, extra_s))
        elif extra_s > 0.0:
            self._waiting = True
            self.clock.call_at(now_s + extra_s, self._go_on)

    def _look_again(self, condition: Callable[[], bool], extra_s: float) -> None:
        self._waiting = False
        self.wait_until(condition, extra_s)
        self._work()

    def _go_on(self) -> None:
        self._waiting = False
        self._work()

    def _work(self) -> None:
        while self._queue and not self._waiting:
            command, send = self._queue.popleft()
            try:
                answer = execute(self, command)
            except Refused as refused:
                # No reply: a refusal only goes into the queue of errors.
                self.report(refused.code)
            else:
                if answer is not None:
                    send(f"{answer}\r\n".encode("latin-1"))


def _suffer(axis: EspAxis, event: Event) -> None:
    match event:
        case PowerCycle():
            axis.switch_off()
        # Without a closed loop there is nothing to follow.
        case FollowingError() if axis.motor_on:
            axis.fail_following()
        case LimitHit():
            axis.hit_limit()
        case EmergencyStop():
            axis.inhibited = True
            axis.switch_off()
        case WrongUnit():
            axis.unit = COUNTS


class EspClient:
    """One end of the serial line."""

    def __init__(self, controller: SimulatedEsp301, send: Callable[[bytes], None]) -> None:
        self._controller = controller
        self._send = send
        self._open = True
        self._reader = LineReader(controller.settings.line_characters_max)

    def receive(self, data: bytes) -> None:
        """Take bytes; complete lines are queued."""
        with self._controller.clock.lock:
            for line in self._reader.feed(data):
                self._controller.submit(line, self._answer)

    def close(self) -> None:
        """The client has gone; answers still due go nowhere."""
        self._open = False

    def _answer(self, data: bytes) -> None:
        if self._open:
            self._send(data)
