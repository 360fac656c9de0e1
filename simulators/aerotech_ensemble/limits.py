"""The limits of the axis: switches at the ends of its travel, and those of its parameters."""

from __future__ import annotations

import math

import numpy as np

from simulators.aerotech_ensemble.parameters import Parameter, Parameters
from simulators.aerotech_ensemble.settings import StageSimulatorSettings
from simulators.aerotech_ensemble.status import AxisFault, AxisStatus
from simulators.motion import MotionAxis

SAMPLES = 512
BISECTIONS = 50


def first_crossing_s(axis: MotionAxis, from_s: float, until_s: float, bound: float, side: int) -> float:
    """When the axis first is farther out than now and beyond `bound` (side 1: above it, -1: below); inf if never."""
    # Motions are smooth, so 512 looks find a crossing; bisection then finds its time to the last bit.
    times_s = np.linspace(from_s, until_s, SAMPLES)
    position = axis.sample(times_s)[0]
    # Only outwards: an axis that stands beyond a switch may move off it.
    crossed = np.flatnonzero((side * (position - bound) > 0.0) & (side * (position - position[0]) > 0.0))
    if len(crossed) == 0:
        return math.inf
    late_s = float(times_s[crossed[0]])
    early_s = float(times_s[max(crossed[0] - 1, 0)])
    for _ in range(BISECTIONS):
        middle_s = 0.5 * (early_s + late_s)
        if side * (axis.position(middle_s) - bound) > 0.0:
            late_s = middle_s
        else:
            early_s = middle_s
    return late_s


class AxisLimits:
    """Where the axis must not go, how fast it must not be, and what its switches say."""

    def __init__(self, axis: MotionAxis, parameters: Parameters, settings: StageSimulatorSettings) -> None:
        self._axis = axis
        self._parameters = parameters
        self._settings = settings

    def crossing(self, now_s: float, until_s: float, zero_mm: float, *, soft: bool) -> tuple[float, AxisFault]:
        """When the motion just begun runs into a limit, and which; `soft`: into one of the parameters too."""
        s = self._settings
        bounds = [
            (s.travel_max_mm, 1, AxisFault.CW_HARD_LIMIT),
            (s.travel_min_mm, -1, AxisFault.CCW_HARD_LIMIT),
        ]
        low_and_high = self._soft()
        if low_and_high and soft:
            bounds.append((low_and_high[1] + zero_mm, 1, AxisFault.CW_SOFT_LIMIT))
            bounds.append((low_and_high[0] + zero_mm, -1, AxisFault.CCW_SOFT_LIMIT))
        crossings = [
            (first_crossing_s(self._axis, now_s, until_s, bound, side), fault) for bound, side, fault in bounds
        ]
        return min(crossings, key=lambda crossing: crossing[0])

    def of_set_point(self, speed_mm_s: float, position_mm: float | None) -> AxisFault:
        """The faults of a commanded speed and, where there is one, position."""
        fault = AxisFault(0)
        soft = self._soft()
        if soft and position_mm is not None and not soft[0] <= position_mm <= soft[1]:
            fault |= AxisFault.CW_SOFT_LIMIT if position_mm > soft[1] else AxisFault.CCW_SOFT_LIMIT
        if speed_mm_s > self._parameters[Parameter.VELOCITY_COMMAND_THRESHOLD]:
            fault |= AxisFault.MAX_VELOCITY_COMMAND
        return fault

    def levels(self, position_mm: float, *, emergency_stop: bool) -> AxisStatus:
        """The inputs of limit switches and emergency stop in the status word."""
        s = self._settings
        setup = int(self._parameters[Parameter.END_OF_TRAVEL_LIMIT_SETUP])
        levels = AxisStatus.ESTOP_LEVEL if s.estop_level != emergency_stop else AxisStatus(0)
        # The parameter says at which level each switch is closed; the status has the raw levels.
        if (position_mm >= s.travel_max_mm) == bool(setup & 4):
            levels |= AxisStatus.CW_LIMIT_LEVEL
        if (position_mm <= s.travel_min_mm) == bool(setup & 2):
            levels |= AxisStatus.CCW_LIMIT_LEVEL
        return levels

    def _soft(self) -> tuple[float, float] | None:
        low = self._parameters[Parameter.SOFTWARE_LIMIT_LOW]
        high = self._parameters[Parameter.SOFTWARE_LIMIT_HIGH]
        # Both zero: no soft limits are set up.
        return None if low == high == 0.0 else (low, high)
