"""The controller behind its sockets: clients, names, and the way of a request to its function."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import TypeVar

from simulators.clock import SimulationClock
from simulators.faults.mishaps import EmergencyStop, FollowingError, LimitHit, PowerCycle
from simulators.faults.when import Event
from simulators.measured import Tap, unheard
from simulators.motion import MotionAxis
from simulators.newport_xps.codes import GroupState, Refused
from simulators.newport_xps.controller_functions import CONTROLLER_FUNCTIONS
from simulators.newport_xps.functions import Call, Function, Selection
from simulators.newport_xps.gathering import Gathering
from simulators.newport_xps.grammar import RequestReader, format_reply, parse_request
from simulators.newport_xps.group import Done, Group
from simulators.newport_xps.motion_functions import GROUP_FUNCTIONS, POSITIONER_FUNCTIONS
from simulators.newport_xps.positioner import Positioner
from simulators.newport_xps.settings import XpsSimulatorSettings
from simulators.wiring import Connection

Object = TypeVar("Object")


class SimulatedXps:
    """An XPS with the given groups, each a mapping of positioner names to axes in degrees.

    It wakes up with no group initialised.
    """

    kind = "newport-xps"

    def __init__(
        self,
        clock: SimulationClock,
        groups: Mapping[str, Mapping[str, MotionAxis]],
        settings: XpsSimulatorSettings | None = None,
        tap: Tap | None = None,
    ) -> None:
        self._tap = tap or unheard()
        self.clock = clock
        self.settings = settings or XpsSimulatorSettings()
        self._axes = groups
        self._clients: list[XpsClient] = []
        self._power_on()

    def connect(self, send: Callable[[bytes], None]) -> Connection:
        """Serve one more socket; beyond `sockets_max` it is closed at once."""
        with self.clock.lock:
            client = XpsClient(self, send)
            client.hung_up = len(self._clients) >= self.settings.sockets_max
            if not client.hung_up:
                self._clients.append(client)
            return client

    def disconnect(self, client: XpsClient) -> None:
        """Forget a socket; what it started goes on."""
        if client in self._clients:
            self._clients.remove(client)

    def state(self, group: str) -> GroupState:
        """The state of a group."""
        return self._groups[group].state

    def fail_following(self, group: str) -> None:
        """Let a group run into an obstacle: following error."""
        with self.clock.lock:
            self._groups[group].fail_following()

    def befall(self, event: Event) -> None:
        """Something happens to the controller and its stages."""
        if isinstance(event, PowerCycle):
            for client in list(self._clients):
                client.hang_up()
        for group in self._groups.values():
            match event:
                case PowerCycle():
                    group.lose_power()
                case FollowingError():
                    with suppress(Refused):  # without a servo loop there is nothing to follow
                        group.fail_following()
                case LimitHit():
                    group.hit_limit()
                case EmergencyStop():
                    group.press_emergency_stop()

    def relieve(self, event: Event) -> None:
        """It is over: without reference, as after switching on, or free to be initialised."""
        if isinstance(event, PowerCycle):
            self._power_on()
        for group in self._groups.values():
            if isinstance(event, EmergencyStop):
                group.release_emergency_stop()

    def uptime_s(self) -> float:
        """Time since power on."""
        return self.clock.now_s() - self._powered_s

    def kill_all(self, done: Done) -> None:
        """Kill every group; done when the last one stands."""
        waiting = len(self._groups)

        def killed(_: int) -> None:
            nonlocal waiting
            waiting -= 1
            if waiting == 0:
                done(0)

        for group in self._groups.values():
            group.kill(killed)

    def close_sockets(self, *, keep: object) -> None:
        """Close all sockets but `keep`, telling each -108."""
        # A list of its own: hanging up takes clients out.
        for client in [c for c in self._clients if c is not keep]:
            client.hang_up(-108)

    def reboot(self) -> None:
        """Motors off, every socket closed, nothing initialised."""
        for group in self._groups.values():
            group.kill(lambda _: None)
        for client in list(self._clients):
            client.hang_up()
        self._power_on()

    def execute(self, text: str, client: XpsClient) -> Sequence[str] | None:
        """Run one request; its values, or None when `client.finish` answers it. Raises `Refused`."""
        request = parse_request(text)
        name, arguments = request.name, request.arguments
        if (of_controller := CONTROLLER_FUNCTIONS.get(name)) is not None:
            return self._call(of_controller, self, arguments, client)
        if (of_group := GROUP_FUNCTIONS.get(name)) is not None:
            selected = self._select(arguments)
            return self._call(of_group, selected, arguments[1:], client, len(selected.positioners))
        if (of_positioner := POSITIONER_FUNCTIONS.get(name)) is not None:
            return self._call(of_positioner, self._positioner(arguments), arguments[1:], client)
        raise Refused(-4)

    def _call(
        self,
        function: Function[Object],
        on: Object,
        arguments: tuple[str, ...],
        client: XpsClient,
        axes: int = 1,
    ) -> Sequence[str] | None:
        inputs = function.signature.read(arguments, axes)
        call = Call(inputs.numbers, inputs.words, self.clock.now_s(), client, client.finish)
        values = function.run(call, on)
        # A blocking call is answered by `finish`, perhaps already within `run`.
        return None if function.blocks else values or ()

    def _select(self, arguments: tuple[str, ...]) -> Selection:
        name = _first(arguments)
        group = self._groups.get(name.partition(".")[0])
        if group is None:
            raise Refused(-19)
        if "." not in name:
            return Selection(group, tuple(group.positioners.values()))
        return Selection(group, (self._positioner(arguments),))

    def _positioner(self, arguments: tuple[str, ...]) -> Positioner:
        name = _first(arguments)
        group = self._groups.get(name.partition(".")[0])
        if group is None or name not in group.positioners:
            raise Refused(-18)
        return group.positioners[name]

    def _power_on(self) -> None:
        self._powered_s = self.clock.now_s()
        self._groups = {group: self._wire_up(group, axes) for group, axes in self._axes.items()}
        sources = {
            f"{positioner.name}.{item}": source
            for group in self._groups.values()
            for positioner in group.positioners.values()
            for item, source in positioner.gatherings().items()
        }
        self.gathering = Gathering(sources, self.clock, self.settings)

    def _wire_up(self, group: str, axes: Mapping[str, MotionAxis]) -> Group:
        names = {f"{group}.{name}": axis for name, axis in axes.items()}
        positioners = {
            name: Positioner(name, axis, self._powered_s, self.settings, self._tap) for name, axis in names.items()
        }
        return Group(positioners, self.clock, self.settings)


class XpsClient:
    """One socket: one call at a time, each answered with one `send`."""

    def __init__(self, controller: SimulatedXps, send: Callable[[bytes], None]) -> None:
        self.hung_up = False
        self._controller = controller
        self._send = send
        self._reader = RequestReader()
        self._unanswered: str | None = None

    def receive(self, data: bytes) -> None:
        """Take bytes; a call that is complete is executed, or refused while another one blocks."""
        with self._controller.clock.lock:
            for text in self._reader.feed(data):
                if self.hung_up:
                    return
                if self._unanswered is not None:
                    # A socket takes one call at a time: the second is told that the first has not finished.
                    self._send(format_reply(-1, (text,)))
                else:
                    self._execute(text)

    def close(self) -> None:
        """The client has gone; a motion it started goes on."""
        with self._controller.clock.lock:
            # What its call still has to say is for nobody.
            self._unanswered = None
            self.hung_up = True
            self._controller.disconnect(self)

    def finish(self, code: int) -> None:
        """Answer the call that blocks this socket; nothing happens when none does any more."""
        if self._unanswered is not None:
            self._answer(code, () if code == 0 else (self._unanswered,))

    def hang_up(self, code: int = 0) -> None:
        """End the connection from this side, saying why with `code` if negative."""
        if code:
            self._answer(code, (self._unanswered or "",))
        self.hung_up = True
        self._unanswered = None
        self._controller.disconnect(self)

    def _execute(self, text: str) -> None:
        # First: a call may finish before `execute` returns.
        self._unanswered = text
        try:
            values = self._controller.execute(text, self)
        except Refused as refused:
            self.finish(refused.code)
        else:
            if values is not None:
                self._answer(0, values)

    def _answer(self, code: int, values: Sequence[str]) -> None:
        self._unanswered = None
        self._send(format_reply(code, values))


def _first(arguments: tuple[str, ...]) -> str:
    if not arguments:
        raise Refused(-9)
    return arguments[0]
