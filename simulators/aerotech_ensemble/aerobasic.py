"""AeroBasic programs, as far as ours and those of public drivers go: read from their source, run line by line.

HEADER ... DEFINE name number ... END HEADER
PROGRAM ... END PROGRAM
DIM name AS INTEGER | DOUBLE, name = expression, IGLOBAL(expression) = expression, DGLOBAL(...) = ...
IF expression THEN ... ELSEIF ... ELSE ... END IF, WHILE expression ... WEND, DWELL seconds
any other line is a command of the controller, whose axis is `@name` and whose numbers are expressions
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from simulators.aerotech_ensemble.aerobasic_expression import Expression, expression, tokens_of
from simulators.aerotech_ensemble.grammar import Command, Invalid
from simulators.aerotech_ensemble.registers import Registers

LINE_S = 0.001
"""How long a line takes: chosen, no source says."""

_AXIS = re.compile(r"^@([A-Z_]\w*|\d+)\s*,?\s*", re.ASCII | re.IGNORECASE)
WORDS = frozenset(["MODE", "NOWAIT", "MOVEDONE", "INPOS", "ON", "OFF", "READ", "INPUT", "TRIGGER"])


RESERVED = frozenset(["ELSE", "ELSEIF", "END", "WEND", "HEADER", "PROGRAM", "DEFINE"])
"""Words that belong to another line, which is missing."""


@dataclass
class Scope:
    """The constants and variables of one running program, and the registers all programs share."""

    constants: dict[str, float]
    registers: Registers
    whole: set[str] = field(default_factory=set)
    variables: dict[str, float] = field(default_factory=dict)

    def value(self, name: str) -> float:
        """A variable or a constant; `Invalid` when there is none of this name."""
        for names in (self.variables, self.constants):
            if name in names:
                return names[name]
        raise Invalid

    def register(self, kind: str, index: float) -> float:
        """IGLOBAL or DGLOBAL."""
        return self.registers.value(kind, int(index))

    def declare(self, name: str, kind: str) -> None:
        """DIM; variables begin at zero."""
        self.variables[name] = 0.0
        if kind == "INTEGER":
            self.whole.add(name)

    def assign(self, name: str, value: float) -> None:
        """A whole number for an INTEGER; `Invalid` for what was not declared."""
        if name not in self.variables:
            raise Invalid
        self.variables[name] = float(int(value)) if name in self.whole else value


Perform = Callable[[Command], Iterator[float]]
"""Carries out a command of the controller for a program; yields as `Step` does."""
Step = Callable[[Scope, Perform], Iterator[float]]
"""Runs; yields for how long [s] nothing more happens in the program."""


@dataclass(frozen=True)
class Program:
    """A compiled program."""

    constants: dict[str, float]
    body: Sequence[Step]

    def run(self, registers: Registers, perform: Perform) -> Iterator[float]:
        """From the first line to the last."""
        return _all(self.body)(Scope(self.constants, registers), perform)


def compiled(source: str) -> Program:
    """The program of a source; `Invalid` when it cannot be compiled."""
    lines = [line for line in (_without_comment(text) for text in source.splitlines()) if line]
    constants: dict[str, float] = {}
    if lines and lines[0].upper() == "HEADER":
        end = _place(lines, "END HEADER")
        for line in lines[1:end]:
            word, name, number = line.upper().split()
            if word != "DEFINE":
                raise Invalid
            constants[name] = float(number)
        lines = lines[end + 1 :]
    if not lines or lines[0].upper() != "PROGRAM" or lines[-1].upper() != "END PROGRAM":
        raise Invalid
    body, rest = _block(lines[1:-1], ())
    if rest:
        raise Invalid
    return Program(constants, body)


def _without_comment(line: str) -> str:
    return line.partition("'")[0].strip()


def _place(lines: Sequence[str], wanted: str) -> int:
    places = [place for place, line in enumerate(lines) if line.upper() == wanted]
    if not places:
        raise Invalid
    return places[0]


def _block(lines: Sequence[str], ends: tuple[str, ...]) -> tuple[list[Step], Sequence[str]]:
    """The steps up to a line that begins with one of `ends`, and the lines from there."""
    steps: list[Step] = []
    while lines:
        word = lines[0].upper()
        if ends and word.startswith(ends):
            return steps, lines
        if word.startswith("IF "):
            step, lines = _if(lines)
        elif word.startswith("WHILE "):
            body, lines = _block(lines[1:], ("WEND",))
            step, lines = _while(expression(tokens_of(word.removeprefix("WHILE "))), _all(body)), lines[1:]
        else:
            step, lines = _statement(lines[0]), lines[1:]
        steps.append(step)
    if ends:
        raise Invalid
    return steps, lines


def _if(lines: Sequence[str]) -> tuple[Step, Sequence[str]]:
    branches: list[tuple[Expression, Step]] = []
    while True:
        head = lines[0].upper()
        if head == "END IF":
            return _choice(branches), lines[1:]
        match = re.fullmatch(r"(?:IF|ELSEIF) (.*) THEN|ELSE", head)
        if match is None:
            raise Invalid
        condition = expression(tokens_of(match[1] or "1"))
        body, lines = _block(lines[1:], ("ELSEIF ", "ELSE", "END IF"))
        branches.append((condition, _all(body)))


def _statement(line: str) -> Step:
    upper = line.upper()
    declared = re.fullmatch(r"DIM (\w+) AS (INTEGER|DOUBLE)", upper)
    if declared:
        name, kind = declared.groups()
        return _at_once(lambda scope: scope.declare(name, kind))
    assigned = re.fullmatch(r"(IGLOBAL|DGLOBAL)\s*\((.*?)\)\s*=(.*)|([A-Z_]\w*)\s*=(.*)", upper)
    if assigned:
        return _assignment(assigned)
    if upper.startswith("DWELL "):
        seconds = expression(tokens_of(upper.removeprefix("DWELL ")))
        return lambda scope, _: iter((seconds(scope),))
    return _command(upper)


def _assignment(match: re.Match[str]) -> Step:
    kind, index_text, register_text, name, text = match.groups()
    value = expression(tokens_of(register_text or text))
    if name:
        return _at_once(lambda scope: scope.assign(name, value(scope)))
    index = expression(tokens_of(index_text))

    def write(scope: Scope) -> None:
        scope.registers.write(kind, int(index(scope)), value(scope))

    return _at_once(write)


def _command(line: str) -> Step:
    keyword, _, rest = line.partition(" ")
    if keyword in RESERVED:
        raise Invalid
    rest = rest.strip()
    axis: Expression | None = None
    if match := _AXIS.match(rest):
        axis, rest = expression(tokens_of(match[1])), rest[match.end() :]
    words: list[str] = []
    while rest.split(" ")[0] in WORDS:
        word, _, rest = rest.partition(" ")
        words.append(word)
    numbers = [expression(tokens_of(part)) for part in rest.split(",")] if rest else []

    def perform_it(scope: Scope, perform: Perform) -> Iterator[float]:
        named = [f"@{int(axis(scope))}"] if axis else []
        command = Command(keyword, (*named, *words, *(f"{number(scope):.12g}" for number in numbers)))
        yield LINE_S
        yield from perform(command)

    return perform_it


# how steps are put together


def _at_once(act: Callable[[Scope], None]) -> Step:
    def step(scope: Scope, _: Perform) -> Iterator[float]:
        act(scope)
        yield LINE_S

    return step


def _all(steps: Sequence[Step]) -> Step:
    def step(scope: Scope, perform: Perform) -> Iterator[float]:
        for each in steps:
            yield from each(scope, perform)

    return step


def _while(condition: Expression, body: Step) -> Step:
    def step(scope: Scope, perform: Perform) -> Iterator[float]:
        while condition(scope):
            yield LINE_S
            yield from body(scope, perform)

    return step


def _choice(branches: Sequence[tuple[Expression, Step]]) -> Step:
    def step(scope: Scope, perform: Perform) -> Iterator[float]:
        for condition, body in branches:
            yield LINE_S
            if condition(scope):
                yield from body(scope, perform)
                return

    return step
