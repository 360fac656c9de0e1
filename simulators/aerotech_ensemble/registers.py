"""The global registers IGLOBAL and DGLOBAL; the way a captured record leaves the controller."""

from __future__ import annotations

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.aerotech_ensemble.grammar import Command, Invalid, number, whole
from simulators.aerotech_ensemble.settings import StageSimulatorSettings

INT32 = (-(1 << 31), (1 << 31) - 1)


class Registers:
    """Whole numbers and doubles, by index from 0."""

    def __init__(self, settings: StageSimulatorSettings) -> None:
        self._integers = [0] * settings.integer_registers
        self._doubles = [0.0] * settings.double_registers

    def clear(self) -> None:
        """As after switching on."""
        self._integers = [0] * len(self._integers)
        self._doubles = [0.0] * len(self._doubles)

    def store(self, first: int, counts: FloatArray) -> None:
        """Put whole numbers into consecutive integers."""
        self._integers[first : first + len(counts)] = counts.astype(np.int64).tolist()

    def value(self, kind: str, index: int) -> float:
        """A register as a program sees it: with all its digits."""
        registers = self._of(kind)
        if not 0 <= index < len(registers):
            raise Invalid
        return float(registers[index])

    def write(self, kind: str, index: int, value: float) -> None:
        """As a program does; a fraction is cut off for an integer."""
        self.value(kind, index)
        if kind == "DGLOBAL":
            self._doubles[index] = value
        else:
            self._integers[index] = int(value)

    def _of(self, kind: str) -> list[int] | list[float]:
        return self._doubles if kind == "DGLOBAL" else self._integers

    def access(self, command: Command) -> str | None:
        """Read (`DGLOBAL(1)`) or write (`DGLOBAL(1) = 0.5`) one register."""
        words = command.words
        # read by the thousand after every run, hence not through the general number parser
        if len(words) != 1 or not words[0].isdecimal() or len(words[0]) > 9:
            raise Invalid
        index = int(words[0])
        if command.keyword == "DGLOBAL":
            if index >= len(self._doubles):
                raise Invalid
            if command.value is None:
                return f"{self._doubles[index]:.6f}"
            self._doubles[index] = number(command.value)
            return None
        if index >= len(self._integers):
            raise Invalid
        if command.value is None:
            return str(self._integers[index])
        self._integers[index] = whole(command.value, *INT32)
        return None
