"""Bits of the status and fault words, as named in Aerotech's library headers (EPICS motorAerotech)."""

from __future__ import annotations

from enum import IntFlag


class AxisStatus(IntFlag):
    """AXISSTATUS; bits 22 to 24 are raw levels of the limit switches."""

    ENABLED = 1 << 0
    HOMED = 1 << 1
    IN_POSITION = 1 << 2
    MOVE_ACTIVE = 1 << 3
    ACCELERATING = 1 << 4
    DECELERATING = 1 << 5
    POSITION_CAPTURE = 1 << 6
    NEGATIVE_DIRECTION = 1 << 9
    HOMING = 1 << 14
    SERVO_CONTROL = 1 << 21
    CW_LIMIT_LEVEL = 1 << 22
    CCW_LIMIT_LEVEL = 1 << 23
    ESTOP_LEVEL = 1 << 31


class AxisFault(IntFlag):
    """AXISFAULT."""

    POSITION_ERROR = 1 << 0
    OVER_CURRENT = 1 << 1
    CW_HARD_LIMIT = 1 << 2
    CCW_HARD_LIMIT = 1 << 3
    CW_SOFT_LIMIT = 1 << 4
    CCW_SOFT_LIMIT = 1 << 5
    AMPLIFIER = 1 << 6
    POSITION_FEEDBACK = 1 << 7
    VELOCITY_FEEDBACK = 1 << 8
    HALL = 1 << 9
    MAX_VELOCITY_COMMAND = 1 << 10
    EMERGENCY_STOP = 1 << 11
    VELOCITY_ERROR = 1 << 12
    EXTERNAL = 1 << 15
    MOTOR_TEMPERATURE = 1 << 17
    AMPLIFIER_TEMPERATURE = 1 << 18
    ENCODER = 1 << 19
    COMMUNICATION_LOST = 1 << 20
    FEEDBACK_SCALING = 1 << 23
    MARKER_SEARCH = 1 << 24
    VOLTAGE_CLAMP = 1 << 27
    POWER_SUPPLY = 1 << 28
    INTERNAL = 1 << 30


class PlaneStatus(IntFlag):
    """PLANESTATUS."""

    MOTION = 1 << 0
    ACCELERATING = 1 << 2
    DECELERATING = 1 << 3


def signed_32_bit(word: int) -> int:
    """The word as the controller prints it."""
    return word - (1 << 32) if word & (1 << 31) else word
