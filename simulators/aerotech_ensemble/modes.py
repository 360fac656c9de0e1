"""What stays as it was said until it is said anew: waiting, positioning, ramps and speed."""

from __future__ import annotations

from simulators.aerotech_ensemble.addressing import Addressing
from simulators.aerotech_ensemble.grammar import Invalid, choice, exactly, none, number, positive, whole
from simulators.aerotech_ensemble.parameters import Parameter, Parameters

NOWAIT, MOVEDONE, INPOS = range(3)
WAIT_WORDS = {"NOWAIT": NOWAIT, "MOVEDONE": MOVEDONE, "INPOS": INPOS}
RAMP_WORDS = {"DIST": 0, "RATE": 1, "TIME": 2}
SWITCH_WORDS = {"OFF": 0, "ON": 1}
ABSOLUTE, INCREMENTAL = range(2)
MODES = 13


class MotionModes:
    """The modes, and the commands that set them; the axis may stand before the value of RAMP."""

    def __init__(self, parameters: Parameters, addressing: Addressing) -> None:
        self._parameters = parameters
        self._addressing = addressing
        self.restart()

    def restart(self) -> None:
        """As after switching on."""
        self.default_wait()
        self.positioning = ABSOLUTE
        self.speed_mm_s = self._parameters[Parameter.DEFAULT_SPEED]
        self.program_zero_mm = 0.0
        self._ramp_mode = RAMP_WORDS["RATE"]
        self._told_ramp_mm_s2: float | None = None
        self._ramp_time_s = 0.1
        self._ramp_distance_mm = 1.0
        self._s_curve_percent = 0.0
        self._profiling = 0

    def default_wait(self) -> None:
        """Enabling brings the default back."""
        self.wait = int(self._parameters[Parameter.DEFAULT_WAIT_MODE])

    @property
    def _ramp_rate_mm_s2(self) -> float:
        """RAMP RATE, or the default as the parameter has it now."""
        return self._told_ramp_mm_s2 or self._parameters[Parameter.DEFAULT_RAMP_RATE]

    def ramp_mm_s2(self, speed_mm_s: float, way_mm: float) -> float:
        """The acceleration of a motion of this speed over this way."""
        if self._ramp_mode == RAMP_WORDS["TIME"]:
            # A speed of zero has no ramp time.
            return speed_mm_s / self._ramp_time_s or self._ramp_rate_mm_s2
        if self._ramp_mode == RAMP_WORDS["DIST"] and way_mm:
            return speed_mm_s**2 / (2.0 * self._ramp_distance_mm)
        return self._ramp_rate_mm_s2

    def set_wait(self, words: tuple[str, ...]) -> None:
        """WAIT MODE."""
        mode, value = exactly(2, words)
        if mode != "MODE":
            raise Invalid
        self.wait = choice(WAIT_WORDS, value)

    def set_absolute(self, words: tuple[str, ...]) -> None:
        """ABS."""
        none(words)
        self.positioning = ABSOLUTE

    def set_incremental(self, words: tuple[str, ...]) -> None:
        """INC."""
        none(words)
        self.positioning = INCREMENTAL

    def set_ramp(self, words: tuple[str, ...], unit_mm: float) -> None:
        """RAMP MODE, RATE, TIME, DIST."""
        word, *rest = words or ("",)
        (value,) = exactly(1, self._addressing.perhaps_after(tuple(rest)))
        if word == "MODE":
            self._ramp_mode = choice(RAMP_WORDS, value)
        elif word == "RATE":
            self._told_ramp_mm_s2 = positive(value) * unit_mm
        elif word == "TIME":
            self._ramp_time_s = positive(value)
        elif word == "DIST":
            self._ramp_distance_mm = positive(value)
        else:
            raise Invalid

    def set_s_curve(self, words: tuple[str, ...]) -> None:
        """SCURVE."""
        (value,) = exactly(1, words)
        percent = number(value)
        if not 0.0 <= percent <= 100.0:
            raise Invalid
        self._s_curve_percent = percent

    def set_profiling(self, words: tuple[str, ...]) -> None:
        """VELOCITY ON, OFF."""
        (value,) = exactly(1, words)
        self._profiling = choice(SWITCH_WORDS, value)

    def text(self, words: tuple[str, ...]) -> str:
        """GETMODE: one of them by its number."""
        (mode,) = exactly(1, words)
        modes = {
            0: self.positioning,
            1: self.wait,
            2: self._ramp_mode,
            3: self._profiling,
            4: self._s_curve_percent,
            6: self.speed_mm_s,
            # Acceleration and deceleration are the same here.
            7: self._ramp_rate_mm_s2,
            10: self._ramp_rate_mm_s2,
        }
        return f"{modes.get(whole(mode, 0, MODES - 1), 0):g}"
