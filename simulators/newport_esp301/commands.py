"""What each two-letter command does; a query returns its answer, a command None."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from simulators.clock import SimulationClock
from simulators.newport_esp301.axis import EspAxis
from simulators.newport_esp301.errors import ErrorQueue, Refused, error_text
from simulators.newport_esp301.grammar import Command, format_number, read_number
from simulators.newport_esp301.parameters import PARAMETERS, Parameter
from simulators.newport_esp301.settings import Esp301SimulatorSettings

STATUS_CHARACTER_BASE = 0x50
"""Bits 4 and 6 are always set, so that the status byte is printable."""


class Controller(Protocol):
    """What commands need of the controller."""

    clock: SimulationClock
    settings: Esp301SimulatorSettings
    errors: ErrorQueue
    axes: list[EspAxis]
    powered_s: float
    stored: list[dict[str, float]]
    keypad_locked: bool

    def reset(self) -> None:
        """Start anew."""
        ...

    def wait_until(self, condition: Callable[[], bool], extra_s: float = 0.0) -> None:
        """Hold the command queue."""
        ...


def execute(controller: Controller, command: Command | None) -> str | None:
    """Execute one command; raises `Refused` for what goes into the error queue."""
    if command is None:
        raise Refused(6)
    if (of_controller := CONTROLLER_COMMANDS.get(command.code)) is not None:
        return of_controller(controller, command)
    axis_command = AXIS_COMMANDS.get(command.code)
    parameter = PARAMETERS.get(command.code)
    # Parameters that nothing here follows are kept, so that a driver may set them.
    known = axis_command or parameter or any(command.code in stored for stored in controller.stored)
    if not known:
        raise Refused(6)
    axis = _axis(controller, command)
    if axis_command is not None:
        return axis_command(axis, command)
    if parameter is not None:
        return _parameter(axis, parameter, command)
    return _stored(controller.stored[axis.number - 1], axis, command)


def _axis(controller: Controller, command: Command) -> EspAxis:
    if command.axis is None:
        raise Refused(37)
    if not 1 <= command.axis <= len(controller.axes):
        raise Refused(9)
    return controller.axes[command.axis - 1]


def _axes(controller: Controller, command: Command) -> list[EspAxis]:
    """The named axis, or all when none is named."""
    return controller.axes if not command.axis else [_axis(controller, command)]


def _parameter(axis: EspAxis, parameter: Parameter, command: Command) -> str | None:
    scale = 1.0 if parameter.whole else axis.units_per_deg
    if command.query:
        return format_number(parameter.get(axis) * scale, 0 if parameter.whole else axis.decimals)
    parameter.put(axis, read_number(command.parameter) / scale)
    return None


def _stored(stored: dict[str, float], axis: EspAxis, command: Command) -> str | None:
    if command.query:
        return format_number(stored[command.code], axis.decimals)
    stored[command.code] = read_number(command.parameter)
    return None


# of an axis


def _spelled(axis: EspAxis, value_deg: float) -> str:
    return format_number(value_deg * axis.units_per_deg, axis.decimals)


def _absolute(axis: EspAxis, command: Command) -> str | None:
    if command.query:
        return _spelled(axis, axis.target_deg)
    axis.move_to(read_number(command.parameter) / axis.units_per_deg)
    return None


def _relative(axis: EspAxis, command: Command) -> None:
    # From the target, not from where the stage happens to stand.
    axis.move_to(axis.target_deg + read_number(command.parameter) / axis.units_per_deg)


def _motor_on(axis: EspAxis, command: Command) -> str | None:
    if command.query:
        return str(int(axis.motor_on))
    if axis.inhibited:
        raise Refused(4)
    axis.motor_on = True
    return None


def _motor_off(axis: EspAxis, command: Command) -> str | None:
    if command.query:
        return str(int(not axis.motor_on))
    axis.switch_off()
    return None


def _home(axis: EspAxis, command: Command) -> None:
    mode = read_number(command.parameter) if command.parameter else axis.home_mode
    if mode != int(mode):
        raise Refused(1, axis.number)
    axis.home(int(mode))


def _direction(command: Command) -> int:
    directions = {"+": 1, "-": -1}
    if not command.parameter:
        raise Refused(38)
    if command.parameter not in directions:
        raise Refused(7)
    return directions[command.parameter]


def _to_limit(axis: EspAxis, command: Command) -> None:
    axis.run_to_hard_limit(_direction(command))


def _jog(axis: EspAxis, command: Command) -> None:
    axis.run_to_soft_limit(_direction(command))


def _done(axis: EspAxis, _: Command) -> str:
    return str(int(axis.done))


def _actual_position(axis: EspAxis, _: Command) -> str:
    return _spelled(axis, axis.reading())


def _commanded_position(axis: EspAxis, _: Command) -> str:
    return _spelled(axis, axis.commanded())


def _actual_velocity(axis: EspAxis, _: Command) -> str:
    return _spelled(axis, axis.velocity())


AXIS_COMMANDS: dict[str, Callable[[EspAxis, Command], str | None]] = {
    "PA": _absolute,
    "PR": _relative,
    "OR": _home,
    "MT": _to_limit,
    "MV": _jog,
    "MO": _motor_on,
    "MF": _motor_off,
    "MD": _done,
    "TP": _actual_position,
    "DP": _commanded_position,
    "TV": _actual_velocity,
}

# of the controller, or of all axes


def _stop(controller: Controller, command: Command) -> None:
    for axis in _axes(controller, command):
        axis.stop()


def _abort(controller: Controller, command: Command) -> None:
    for axis in _axes(controller, command):
        axis.emergency_stop()


def _wait_for_stop(controller: Controller, command: Command) -> None:
    axes = _axes(controller, command)
    # Milliseconds on the wire.
    extra_s = max(0.0, read_number(command.parameter or "0")) * 1e-3
    controller.wait_until(lambda: all(axis.done for axis in axes), extra_s)


def _wait_for_position(controller: Controller, command: Command) -> None:
    axis = _axis(controller, command)
    place_deg = read_number(command.parameter) / axis.units_per_deg
    # The profile may pass the place between two looks, and from either side.
    below = axis.commanded() < place_deg

    def passed_or_at_rest() -> bool:
        return axis.done or axis.commanded() == place_deg or (axis.commanded() < place_deg) is not below

    controller.wait_until(passed_or_at_rest)


def _wait_for_time(controller: Controller, command: Command) -> None:
    controller.wait_until(lambda: True, max(0.0, read_number(command.parameter)) * 1e-3)


def _take_error(controller: Controller, _: Command) -> str:
    code, at_s = controller.errors.take(controller.clock.now_s())
    since_s = at_s - controller.powered_s
    return f"{code}, {int(since_s / controller.settings.timestamp_tick_s)}, {error_text(code)}"


def _take_error_code(controller: Controller, _: Command) -> str:
    return str(controller.errors.take(controller.clock.now_s())[0])


def _version(controller: Controller, _: Command) -> str:
    return controller.settings.version


def _stage(controller: Controller, command: Command) -> str:
    _axis(controller, command)
    return controller.settings.stage


def _status_character(controller: Controller, _: Command) -> str:
    # The byte has three bits for axes only.
    moving = sum(1 << axis.number - 1 for axis in controller.axes[:3] if not axis.done)
    power = 0x8 * any(axis.motor_on for axis in controller.axes)
    return chr(STATUS_CHARACTER_BASE | moving | power)


def _hardware_status(controller: Controller, _: Command) -> str:
    limits = home = 0
    for axis in controller.axes:
        positive, negative = axis.at_hard_limits()
        bit = axis.number - 1
        # Positive limits from bit 0 up, negative ones from bit 8.
        limits |= positive << bit | negative << bit + 8
        home |= axis.past_home() << bit
    return f"{limits:X}H, {home:X}H"


def _configuration(bits: str) -> Callable[[Controller, Command], str]:
    """What only the maker's configuration changes here."""

    def told(controller: Controller, command: Command) -> str:
        _axis(controller, command)
        if not command.query:
            raise Refused(27)
        return bits

    return told


def _update_filter(controller: Controller, command: Command) -> None:
    """The servo's gains are kept as they come."""
    _axis(controller, command)


def _save(_: Controller, __: Command) -> None:
    """Parameters are never lost here."""


def _reset(controller: Controller, _: Command) -> None:
    for axis in controller.axes:
        axis.switch_off()
    controller.reset()


def _keypad(controller: Controller, command: Command) -> str | None:
    if not controller.settings.dialect.keypad_lock:
        raise Refused(6)
    if command.query:
        return str(int(controller.keypad_locked))
    value = read_number(command.parameter)
    if value not in (0.0, 1.0):
        raise Refused(7)
    controller.keypad_locked = bool(value)
    return None


CONTROLLER_COMMANDS: dict[str, Callable[[Controller, Command], str | None]] = {
    "ST": _stop,
    "AB": _abort,
    "WS": _wait_for_stop,
    "WP": _wait_for_position,
    "WT": _wait_for_time,
    "TB": _take_error,
    "TE": _take_error_code,
    "VE": _version,
    "ID": _stage,
    "TS": _status_character,
    "PH": _hardware_status,
    "ZH": _configuration("24H"),
    # Of its feedback, bit 8 the encoder's (EPICS' drvESP300.cc).
    "ZB": _configuration("100H"),
    "UF": _update_filter,
    "SM": _save,
    "RS": _reset,
    "LC": _keypad,
}
