"""DATAACQ: position capture as it is set up, started and read."""

from __future__ import annotations

from simulators.aerotech_ensemble.capture import PositionCapture
from simulators.aerotech_ensemble.controller import AxisController
from simulators.aerotech_ensemble.grammar import Invalid, whole
from simulators.aerotech_ensemble.refusals import Faulted
from simulators.aerotech_ensemble.registers import Registers
from simulators.aerotech_ensemble.settings import StageSimulatorSettings
from simulators.clock import SimulationClock


class CaptureCommands:
    """What stands behind `DATAACQ X`."""

    def __init__(
        self,
        clock: SimulationClock,
        axis: AxisController,
        capture: PositionCapture,
        registers: Registers,
        settings: StageSimulatorSettings,
    ) -> None:
        self._clock = clock
        self._axis = axis
        self._capture = capture
        self._registers = registers
        self._settings = settings

    def command(self, words: tuple[str, ...]) -> None:
        """Carry it out; `words` are those after the axis."""
        match words:
            case ("TRIGGER", source):
                self._capture.trigger = whole(source, 0, 255)
            case ("INPUT", source):
                self._capture.input = whole(source, 0, 255)
            case ("ON", points):
                count = whole(points, 1, self._settings.capture_points_max)
                self._capture.arm(self._clock.now_s(), count, self._axis.zero_mm)
            case ("OFF",):
                self._capture.off(self._clock.now_s())
            case ("READ", first, points):
                self._read(first, points)
            case _:
                raise Invalid

    def _read(self, first: str, points: str) -> None:
        s, now_s = self._settings, self._clock.now_s()
        count = whole(points, 1, s.integer_registers)
        start = whole(first, 0, s.integer_registers - count)
        if s.dialect.capture_short_read == "refuse" and self._capture.left(now_s) < count:
            raise Faulted
        self._registers.store(start, self._capture.take(now_s, count))
