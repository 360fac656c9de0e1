"""The settings (SW writes, SR reads): which there are, what they take, and the eight programs that hold them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from simulators.keyence_lkg.faults import Fault, Refused

PROGRAMS = 8

Field = Callable[[str], str]
"""Takes a parameter as written and gives it as read back; raises `Refused` for what it cannot be."""


def digits(width: int, low: int, high: int) -> Field:
    """A whole number, read back with `width` digits."""
    return lambda text: f"{whole(text, low, high):0{width}d}"


def exactly(width: int, low: int, high: int) -> Field:
    """A whole number of exactly `width` digits, of any number of them when that is 0; read back as written."""

    def check(text: str) -> str:
        whole(text, low, high)
        if width and len(text) != width:
            raise Refused(Fault.PARAMETER)
        return text

    return check


def switch(text: str) -> str:
    """0 or 1."""
    return digits(1, 0, 1)(text)


def six_digits(decimals: int) -> Field:
    """A sign and six digits in units of the last place; read back with the point in its place."""

    def check(text: str) -> str:
        if not re.fullmatch(r"[+-]\d{6}", text, re.ASCII):
            raise Refused(Fault.PARAMETER)
        return f"{text[: 7 - decimals]}.{text[7 - decimals :]}"

    return check


def number(text: str) -> str:
    """A decimal number of up to eight characters, read back as written."""
    if len(text) > 8 or not re.fullmatch(r"[+-]?\d+\.?\d*", text, re.ASCII):
        raise Refused(Fault.PARAMETER)
    return text


def whole(text: str, low: int, high: int) -> int:
    """A whole number from `low` to `high`; raises `Refused` otherwise."""
    if not re.fullmatch(r"\d{1,10}", text, re.ASCII) or not low <= int(text) <= high:
        raise Refused(Fault.PARAMETER)
    return int(text)


@dataclass(frozen=True)
class Register:
    """A setting: its name (`HB`, `M`), how many outputs or heads have one each (0: not by output), its values."""

    name: tuple[str, ...]
    outputs: int
    fields: tuple[Field, ...]
    default: tuple[str, ...]


@dataclass
class Registers:
    """The settings of all programs; `program` is the one in use."""

    table: dict[tuple[str, ...], Register]
    program: int = 0
    _written: dict[tuple[int, tuple[str, ...], int], tuple[str, ...]] = field(default_factory=dict)

    @classmethod
    def of(cls, registers: Iterable[Register]) -> Registers:
        """All at their defaults."""
        return cls({register.name: register for register in registers})

    def write(self, parameters: list[str]) -> None:
        """What follows `SW`: name, output if by output, values."""
        register, output, values = self._find(parameters)
        if len(values) != len(register.fields):
            raise Refused(Fault.COUNT)
        checked = tuple(check(value) for check, value in zip(register.fields, values, strict=True))
        self._written[self.program, register.name, output] = checked

    def read(self, parameters: list[str]) -> tuple[str, ...]:
        """What follows `SR`: name, output if by output."""
        register, output, values = self._find(parameters)
        if values:
            raise Refused(Fault.COUNT)
        return self.value(*register.name, output=output)

    def value(self, *name: str, output: int = 0) -> tuple[str, ...]:
        """The values of a setting in the program in use."""
        return self._written.get((self.program, name, output), self.table[name].default)

    def _find(self, parameters: list[str]) -> tuple[Register, int, list[str]]:
        # The longer name first: HB,M is another setting than HB with output M.
        for length in (2, 1):
            register = self.table.get(tuple(parameters[:length]))
            if register is not None:
                break
        else:
            raise Refused(Fault.PARAMETER)
        rest = parameters[length:]
        if not register.outputs:
            return register, 0, rest
        if not rest:
            raise Refused(Fault.COUNT)
        return register, whole(rest[0], 1, register.outputs), rest[1:]
