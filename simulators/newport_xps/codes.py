"""The controller's error and group status codes with their texts.

Source: EPICS XPS_C8_errors.h and the group status table of the XPS programmer's manual; the wording varies
between firmware versions.
"""

from __future__ import annotations

from enum import IntEnum


class Refused(Exception):
    """The controller answers a request with an error code."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class GroupState(IntEnum):
    """The group states this simulator can be in."""

    NOT_INITIALISED = 0
    EMERGENCY_BRAKE = 1
    EMERGENCY_STOP = 2
    HOMING_FOLLOWING_ERROR = 3
    KILLED = 7
    READY_FROM_ABORT = 10
    READY_FROM_HOMING = 11
    READY_FROM_MOTION = 12
    READY_FROM_ENABLE = 13
    READY_FROM_JOG = 15
    DISABLED = 20
    READY_FOLLOWING_ERROR = 21
    MOTION_FOLLOWING_ERROR = 22
    JOG_FOLLOWING_ERROR = 25
    EMERGENCY_BRAKING = 40
    MOTOR_INITIALISATION = 41
    NOT_REFERENCED = 42
    HOMING = 43
    MOVING = 44
    JOGGING = 47
    ENCODER_CALIBRATING = 49
    REFERENCING = 64
    NOT_INITIALISED_INTERLOCK = 83
    DISABLED_INTERLOCK = 84

    @property
    def must_initialise(self) -> bool:
        """Nothing but GroupInitialize helps."""
        # Codes go by what a state allows: to 9 not initialised, to 19 ready, to 39 disabled, then what is under way.
        return self < GroupState.READY_FROM_ABORT or self is GroupState.NOT_INITIALISED_INTERLOCK

    @property
    def ready(self) -> bool:
        """Homed, enabled, at rest."""
        return GroupState.READY_FROM_ABORT <= self < GroupState.DISABLED

    @property
    def disabled(self) -> bool:
        """Homed, but the servo loop is open."""
        by_itself = GroupState.DISABLED <= self < GroupState.EMERGENCY_BRAKING
        return by_itself or self is GroupState.DISABLED_INTERLOCK


STATUS_TEXTS = {
    0: "Not initialized state",
    1: "Not initialized state due to an emergency brake",
    2: "Not initialized state due to an emergency stop",
    3: "Not initialized state due to a following error during homing",
    4: "Not initialized state due to a following error",
    5: "Not initialized state due to an homing timeout",
    6: "Not initialized state due to a motion done timeout during homing",
    7: "Not initialized state due to a KillAll command",
    8: "Not initialized state due to an end of run after homing",
    9: "Not initialized state due to an encoder calibration error",
    10: "Ready state due to an AbortMove command",
    11: "Ready state from homing",
    12: "Ready state from motion",
    13: "Ready State due to a MotionEnable command",
    14: "Ready state from slave",
    15: "Ready state from jogging",
    16: "Ready state from analog tracking",
    17: "Ready state from trajectory",
    18: "Ready state from spinning",
    20: "Disable state",
    21: "Disabled state due to a following error on ready state",
    22: "Disabled state due to a following error during motion",
    23: "Disabled state due to a motion done timeout during moving",
    24: "Disabled state due to a following error on slave state",
    25: "Disabled state due to a following error on jogging state",
    26: "Disabled state due to a following error during trajectory",
    27: "Disabled state due to a motion done timeout during trajectory",
    40: "Emergency braking",
    41: "Motor initialization state",
    42: "Not referenced state",
    43: "Homing state",
    44: "Moving state",
    45: "Trajectory state",
    46: "Slave state due to a SlaveEnable command",
    47: "Jogging state due to a JogEnable command",
    48: "Analog tracking state due to a TrackingEnable command",
    49: "Analog interpolated encoder calibrating state",
    50: "Not initialized state due to a mechanical zero inconsistency during homing",
    51: "Spinning state due to a SpinParametersSet command",
    63: "Not initialized state due to a motor initialization error",
    64: "Referencing state",
    83: "Not initialized state due to an interlock",
    84: "Disabled state due to an interlock",
}

ERROR_TEXTS = {
    0: "Successful command",
    1: "TCL interpreter error",
    -1: "Busy socket: previous command not yet finished",
    -2: "TCP timeout",
    -3: "String too long",
    -4: "Unknown command",
    -5: "Not allowed due to a positioner error or hardware status",
    -7: "Wrong format in the command string",
    -8: "Wrong object type for this command",
    -9: "Wrong number of parameters in the command",
    -10: "Wrong parameter type in the command string",
    -11: "Wrong parameter type: bit word expected",
    -12: "Wrong parameter type: bool expected",
    -13: "Wrong parameter type: char * expected",
    -14: "Wrong parameter type: double or double * expected",
    -15: "Wrong parameter type: int or int * expected",
    -16: "Wrong parameter type: unsigned int expected",
    -17: "Parameter out of range",
    -18: "Positioner name doesn't exist or unknown command",
    -19: "Group name doesn't exist or unknown command",
    -20: "Fatal error during initialization: read the error.log file",
    -21: "Controller in initialization",
    -22: "Not allowed action",
    -23: "Position compare not set",
    -24: "Not available in this configuration",
    -25: "Following error",
    -26: "Emergency signal",
    -27: "Move aborted",
    -28: "Home search timeout",
    -29: "Mnemonic gathering type doesn't exist",
    -30: "Gathering not started",
    -31: "Home position is out of user travel limits",
    -32: "Gathering not configured",
    -33: "Motion done timeout",
    -35: "Not allowed: user travel limits",
    -36: "Unknown TCL file",
    -37: "TCL interpreter doesn't run",
    -38: "TCL script can't be killed",
    -42: "Jog parameters out of range",
    -43: "Gathering is running",
    -44: "Slave error",
    -45: "End of run",
    -46: "Not allowed with backlash compensation",
    -47: "Wrong TCL task name",
    -48: "Base velocity out of range",
    -49: "Home search ZM error",
    -50: "Motor initialization error",
    -51: "Spin parameters out of range",
    -60: "Write file error",
    -61: "Read file error",
    -100: "Internal error",
    -106: "Wrong user name or password",
    -107: "Needs administrator rights",
    -108: "TCP socket closed by administrator",
    -109: "Group must be homed at least once",
    -110: "Not allowed for a gantry",
    -111: "Gathering buffer full",
    -113: "Both ends of runs active",
    -114: "Clamping timeout",
    -115: "Function is not supported by current hardware",
    -116: "Error during external driver initialization",
    -117: "Function is only allowed in disabled group state",
    -118: "Driver is not initialized",
}

INHIBITION_BIT, FOLLOWING_ERROR_BIT = 0x1, 0x2
POSITIONER_ERROR_TEXTS = {
    INHIBITION_BIT: "General inhibition detected",
    FOLLOWING_ERROR_BIT: "Fatal following error detected",
    0x4: "Home search time out",
    0x8: "Motion done time out",
    0x100: "Minus end of run detected",
    0x200: "Plus end of run detected",
}

HIGH_ZERO_MARK_BIT, MINUS_END_OF_RUN_BIT, PLUS_END_OF_RUN_BIT = 0x4, 0x100, 0x200
HARDWARE_STATUS_TEXTS = {
    HIGH_ZERO_MARK_BIT: "ZM high level",
    MINUS_END_OF_RUN_BIT: "Minus end of run",
    PLUS_END_OF_RUN_BIT: "Plus end of run",
}


def bit_texts(word: int, texts: dict[int, str]) -> str:
    """The texts of all bits set in `word`, empty when none is."""
    return " - ".join(text for bit, text in texts.items() if word & bit)
