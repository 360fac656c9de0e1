"""Functions whose first argument names a group (or one of its positioners), or a positioner."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from simulators.newport_xps.codes import Refused
from simulators.newport_xps.functions import Call, Function, Selection, numbers
from simulators.newport_xps.grammar import Signature
from simulators.newport_xps.group import Done, Group
from simulators.newport_xps.positioner import Positioner

_NONE = Signature()
_DOUBLE_IN = Signature(("double",), per_axis=True)
_CORRECTOR = ("bool", *("double",) * 11)
_DOUBLES_OUT = Signature(outputs=("double", "double"), per_axis=True)


def _per_axis(read: Callable[[Positioner, float], float]) -> Function[Selection]:
    return Function(
        Signature(outputs=("double",), per_axis=True),
        lambda call, selected: numbers(*(read(p, call.now_s) for p in selected.positioners)),
    )


def _blocking(act: Callable[[Group, Done], None]) -> Function[Selection]:
    def run(call: Call, selected: Selection) -> None:
        act(selected.group, call.finish)

    return Function(_NONE, run, blocks=True)


def _at_once(act: Callable[[Group], None]) -> Function[Selection]:
    def run(_: Call, selected: Selection) -> None:
        act(selected.group)

    return Function(_NONE, run)


def _initialise_calibrating(group: Group, done: Done) -> None:
    group.initialise(done, calibrating=True)


def _move_absolute(call: Call, selected: Selection) -> None:
    selected.group.move(selected.by_name(call.numbers), call.finish)


def _move_relative(call: Call, selected: Selection) -> None:
    # From the target, not from where the stage happens to stand.
    targets = [p.target_deg + by for p, by in zip(selected.positioners, call.numbers, strict=True)]
    selected.group.move(selected.by_name(targets), call.finish)


def _home_and_move(call: Call, selected: Selection) -> None:
    selected.group.home_and_move(selected.by_name(call.numbers), call.finish)


def _jog(call: Call, selected: Selection) -> None:
    pairs = zip(selected.positioners, call.numbers[::2], call.numbers[1::2], strict=True)
    selected.group.jog(list(pairs))


def _jog_parameters(_: Call, selected: Selection) -> Sequence[str]:
    return numbers(*(value for p in selected.positioners for value in p.jog))


def _jog_now(call: Call, selected: Selection) -> Sequence[str]:
    at_s = call.now_s
    return numbers(*(v for p in selected.positioners for v in (p.velocity(at_s), p.axis.acceleration(at_s))))


def _reference(call: Call, selected: Selection) -> None:
    if call.words[0] != "SetPosition":
        raise Refused(-17)
    for positioner in selected.positioners:
        selected.group.set_position(positioner, call.numbers[0])


def _of_spindles(_: Call, __: Selection) -> None:
    # For spindle groups only, and none is simulated.
    raise Refused(-8)


GROUP_FUNCTIONS: dict[str, Function[Selection]] = {
    "GroupStatusGet": Function(Signature(outputs=("int",)), lambda _, selected: (str(int(selected.group.state)),)),
    "GroupPositionCurrentGet": _per_axis(Positioner.reading),
    "GroupPositionSetpointGet": _per_axis(Positioner.setpoint),
    "GroupPositionTargetGet": _per_axis(lambda p, _: p.target_deg),
    "GroupVelocityCurrentGet": _per_axis(Positioner.velocity),
    "GroupAccelerationSetpointGet": _per_axis(lambda p, at_s: p.axis.acceleration(at_s)),
    "GroupCurrentFollowingErrorGet": _per_axis(lambda p, at_s: p.setpoint(at_s) - p.current(at_s)),
    "GroupInitialize": _blocking(Group.initialise),
    "GroupInitializeWithEncoderCalibration": _blocking(_initialise_calibrating),
    "GroupHomeSearch": _blocking(Group.home),
    "GroupHomeSearchAndRelativeMove": Function(_DOUBLE_IN, _home_and_move, blocks=True),
    "GroupMoveAbsolute": Function(_DOUBLE_IN, _move_absolute, blocks=True),
    "GroupMoveRelative": Function(_DOUBLE_IN, _move_relative, blocks=True),
    "GroupMoveAbort": _blocking(Group.abort),
    "GroupKill": _blocking(Group.kill),
    "GroupMotionDisable": _at_once(Group.disable),
    "GroupMotionEnable": _at_once(Group.enable),
    "GroupJogModeEnable": _at_once(Group.enable_jog),
    "GroupJogModeDisable": _at_once(Group.disable_jog),
    "GroupJogParametersSet": Function(Signature(("double", "double"), per_axis=True), _jog),
    "GroupJogParametersGet": Function(_DOUBLES_OUT, _jog_parameters),
    "GroupJogCurrentGet": Function(_DOUBLES_OUT, _jog_now),
    "GroupReferencingStart": _at_once(Group.start_referencing),
    "GroupReferencingActionExecute": Function(Signature(("word", "word", "double")), _reference),
    "GroupReferencingStop": _at_once(Group.stop_referencing),
    "GroupSpinParametersSet": Function(Signature(("double", "double")), _of_spindles),
    "GroupSpinModeStop": Function(_DOUBLE_IN, _of_spindles),
    "GroupSpinCurrentGet": Function(Signature(outputs=("double", "double")), _of_spindles),
}


def _read_and_clear_error(_: Call, positioner: Positioner) -> Sequence[str]:
    # PositionerErrorGet clears what it reads, PositionerErrorRead does not.
    word, positioner.error_word = positioner.error_word, 0
    return (str(word),)


def _set_sgamma(call: Call, positioner: Positioner) -> None:
    positioner.set_sgamma(*call.numbers)


def _set_travel(call: Call, positioner: Positioner) -> None:
    positioner.set_travel(*call.numbers)


def _set_corrector(call: Call, positioner: Positioner) -> None:
    positioner.corrector = call.numbers


def _set_motion_done(call: Call, positioner: Positioner) -> None:
    if any(number <= 0 for number in call.numbers):
        raise Refused(-17)
    positioner.motion_done = call.numbers


POSITIONER_FUNCTIONS: dict[str, Function[Positioner]] = {
    "PositionerSGammaParametersSet": Function(Signature(("double",) * 4), _set_sgamma),
    "PositionerSGammaParametersGet": Function(
        Signature(outputs=("double",) * 4),
        lambda _, p: numbers(p.speed_deg_s, p.acceleration_deg_s2, *p.jerk_times_s),
    ),
    "PositionerMaximumVelocityAndAccelerationGet": Function(
        Signature(outputs=("double",) * 2), lambda _, p: numbers(*p.maxima)
    ),
    "PositionerUserTravelLimitsSet": Function(Signature(("double",) * 2), _set_travel),
    "PositionerUserTravelLimitsGet": Function(
        Signature(outputs=("double",) * 2), lambda _, p: numbers(*p.travel_deg)
    ),
    "PositionerMotionDoneSet": Function(Signature(("double",) * 5), _set_motion_done),
    "PositionerMotionDoneGet": Function(Signature(outputs=("double",) * 5), lambda _, p: numbers(*p.motion_done)),
    "PositionerCorrectorTypeGet": Function(
        Signature(outputs=("char",)), lambda _, __: ("PositionerCorrectorPIDFFVelocity",)
    ),
    "PositionerCorrectorPIDFFVelocitySet": Function(Signature(_CORRECTOR), _set_corrector),
    "PositionerCorrectorPIDFFVelocityGet": Function(
        Signature(outputs=_CORRECTOR), lambda _, p: numbers(*p.corrector)
    ),
    "PositionerErrorGet": Function(Signature(outputs=("int",)), _read_and_clear_error),
    "PositionerErrorRead": Function(Signature(outputs=("int",)), lambda _, p: (str(p.error_word),)),
    "PositionerHardwareStatusGet": Function(
        Signature(outputs=("int",)), lambda call, p: (str(p.hardware_status(call.now_s)),)
    ),
}
