"""The controller's error codes and the queue they wait in.

Source: the error tables of pymeasure and instrumentkit, which agree; the wording of axis errors is inferred.
"""

from __future__ import annotations

from collections import deque

GENERAL_TEXTS = {
    0: "NO ERROR DETECTED",
    4: "EMERGENCY STOP ACTIVATED",
    6: "COMMAND DOES NOT EXIST",
    7: "PARAMETER OUT OF RANGE",
    9: "AXIS NUMBER OUT OF RANGE",
    27: "COMMAND NOT ALLOWED",
    37: "AXIS NUMBER MISSING",
    38: "COMMAND PARAMETER MISSING",
}

AXIS_TEXTS = {
    1: "PARAMETER OUT OF RANGE",
    3: "FOLLOWING ERROR THRESHOLD EXCEEDED",
    4: "POSITIVE HARDWARE LIMIT DETECTED",
    5: "NEGATIVE HARDWARE LIMIT DETECTED",
    6: "POSITIVE SOFTWARE LIMIT DETECTED",
    7: "NEGATIVE SOFTWARE LIMIT DETECTED",
    10: "MAXIMUM VELOCITY EXCEEDED",
    11: "MAXIMUM ACCELERATION EXCEEDED",
    13: "MOTOR NOT ENABLED",
    30: "COMMAND NOT ALLOWED DURING HOMING",
}


class Refused(Exception):
    """A command is not executed; its code goes into the queue. `axis` 0: a general error."""

    def __init__(self, code: int, axis: int = 0) -> None:
        super().__init__(code, axis)
        # As on the wire: 304 is error 4 of axis 3.
        self.code = axis * 100 + code


def error_text(code: int) -> str:
    """The text of a general or an axis error."""
    axis, axis_code = divmod(code, 100)
    return f"AXIS-{axis} {AXIS_TEXTS[axis_code]}" if axis else GENERAL_TEXTS[code]


class ErrorQueue:
    """Errors in the order they happened; a full queue forgets the newest."""

    def __init__(self, length_max: int) -> None:
        self._errors: deque[tuple[int, float]] = deque()
        self._length_max = length_max

    def put(self, code: int, at_s: float) -> None:
        """Queue an error that happened at `at_s`."""
        if len(self._errors) < self._length_max:
            self._errors.append((code, at_s))

    def take(self, now_s: float) -> tuple[int, float]:
        """The oldest error and when it happened; code 0 and now when there is none."""
        return self._errors.popleft() if self._errors else (0, now_s)

    def clear(self) -> None:
        """Forget everything."""
        self._errors.clear()
