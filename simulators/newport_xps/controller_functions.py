"""Functions that name no group and no positioner."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from simulators.newport_xps.codes import (
    ERROR_TEXTS,
    HARDWARE_STATUS_TEXTS,
    POSITIONER_ERROR_TEXTS,
    STATUS_TEXTS,
    Refused,
    bit_texts,
)
from simulators.newport_xps.functions import Call, Function, numbers
from simulators.newport_xps.gathering import Gathering
from simulators.newport_xps.grammar import Signature
from simulators.newport_xps.group import Done
from simulators.newport_xps.settings import XpsSimulatorSettings


class Controller(Protocol):
    """What these functions need of the controller."""

    settings: XpsSimulatorSettings
    gathering: Gathering

    def uptime_s(self) -> float:
        """Time since power on."""
        ...

    def kill_all(self, done: Done) -> None:
        """Kill every group."""
        ...

    def close_sockets(self, *, keep: object) -> None:
        """Close all sockets but one."""
        ...

    def reboot(self) -> None:
        """Start anew."""
        ...


def _get(*outputs: str) -> Signature:
    return Signature(outputs=outputs)


def _look_up(texts: dict[int, str], form: Callable[[int, str], str]) -> Function[Controller]:
    def run(call: Call, _: Controller) -> Sequence[str]:
        code = int(call.numbers[0])
        if code not in texts:
            raise Refused(-17)
        return (form(code, texts[code]),)

    return Function(Signature(("int",), ("char",)), run)


def _spell_bits(texts: dict[int, str]) -> Function[Controller]:
    return Function(Signature(("int",), ("char",)), lambda call, _: (bit_texts(int(call.numbers[0]), texts),))


def _error_list(_: Call, __: Controller) -> Sequence[str]:
    return ("".join(f"Error {code}: {text};" for code, text in ERROR_TEXTS.items()),)


def _log_in(call: Call, controller: Controller) -> None:
    if call.words != ("Administrator", controller.settings.administrator_password):
        raise Refused(-106)


def _kill_all(call: Call, controller: Controller) -> None:
    controller.kill_all(call.finish)


def _close_others(call: Call, controller: Controller) -> None:
    controller.close_sockets(keep=call.client)


def _reboot(_: Call, controller: Controller) -> None:
    controller.reboot()


def _gathering_reset(_: Call, controller: Controller) -> None:
    controller.gathering.reset()


def _gathering_configure(call: Call, controller: Controller) -> None:
    controller.gathering.configure(call.words)


def _gathering_run(call: Call, controller: Controller) -> None:
    controller.gathering.run(int(call.numbers[0]), int(call.numbers[1]))


def _gathering_stop(_: Call, controller: Controller) -> None:
    controller.gathering.stop()


def _gathering_number(_: Call, controller: Controller) -> Sequence[str]:
    return numbers(controller.gathering.count(), controller.gathering.capacity)


def _gathering_line(call: Call, controller: Controller) -> Sequence[str]:
    return (controller.gathering.lines(int(call.numbers[0]), 1).rstrip("\n"),)


def _gathering_lines(call: Call, controller: Controller) -> Sequence[str]:
    return (controller.gathering.lines(int(call.numbers[0]), int(call.numbers[1])),)


CONTROLLER_FUNCTIONS: dict[str, Function[Controller]] = {
    "FirmwareVersionGet": Function(_get("char"), lambda _, controller: (controller.settings.firmware,)),
    "InstallerVersionGet": Function(_get("char"), lambda _, controller: (controller.settings.installer_version,)),
    "ElapsedTimeGet": Function(_get("double"), lambda _, controller: numbers(controller.uptime_s())),
    "ErrorListGet": Function(_get("char"), _error_list),
    "ErrorStringGet": _look_up(ERROR_TEXTS, lambda code, text: f"Error {code}: {text}"),
    "GroupStatusStringGet": _look_up(STATUS_TEXTS, lambda _, text: text),
    "PositionerErrorStringGet": _spell_bits(POSITIONER_ERROR_TEXTS),
    "PositionerHardwareStatusStringGet": _spell_bits(HARDWARE_STATUS_TEXTS),
    "Login": Function(Signature(("word", "word")), _log_in),
    "KillAll": Function(Signature(), _kill_all, blocks=True),
    "CloseAllOtherSockets": Function(Signature(), _close_others),
    "Reboot": Function(Signature(), _reboot, blocks=True),
    "GatheringReset": Function(Signature(), _gathering_reset),
    "GatheringConfigurationSet": Function(Signature(("word",), variadic=True), _gathering_configure),
    "GatheringConfigurationGet": Function(
        _get("char"), lambda _, controller: (";".join(controller.gathering.mnemonics),)
    ),
    "GatheringRun": Function(Signature(("int", "int")), _gathering_run),
    "GatheringStop": Function(Signature(), _gathering_stop),
    # The file stays on the controller's disk, which is not simulated.
    "GatheringStopAndSave": Function(Signature(), _gathering_stop),
    "GatheringCurrentNumberGet": Function(_get("int", "int"), _gathering_number),
    "GatheringDataGet": Function(Signature(("int",), ("char",)), _gathering_line),
    "GatheringDataMultipleLinesGet": Function(Signature(("int", "int"), ("char",)), _gathering_lines),
}
