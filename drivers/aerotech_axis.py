"""One axis behind Aerotech's ASCII interface: its status, its faults, and what a refusal means."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import IntFlag
from typing import TypeVar

from drivers.aerotech_ascii import FAULT, INVALID, SUCCESS, Answer, AsciiLink
from drivers.aerotech_words import Words
from drivers.numbers import decimal, whole
from rigctl.core.errors import BadReply, InstrumentError, LinkError, SafetyStop

Number = TypeVar("Number", int, float)


class AxisStatus(IntFlag):
    """The bits of AXISSTATUS used here."""

    ENABLED = 1 << 0
    HOMED = 1 << 1
    IN_POSITION = 1 << 2
    MOVE_ACTIVE = 1 << 3
    HOMING = 1 << 14


FAULTS = {
    0: "position error",
    1: "over-current",
    2: "positive hard limit",
    3: "negative hard limit",
    4: "positive soft limit",
    5: "negative soft limit",
    6: "amplifier",
    7: "position feedback",
    8: "velocity feedback",
    9: "Hall sensor",
    10: "maximum velocity command",
    11: "emergency stop",
    12: "velocity error",
    15: "external",
    17: "motor temperature",
    18: "amplifier temperature",
    19: "encoder",
    20: "communication lost",
    23: "feedback scaling",
    24: "marker search",
    27: "voltage clamp",
    28: "power supply",
    30: "internal",
}

TASK_RUNNING = 3
"""TASKSTATE."""
AXES_MAX = 10
SAFETY_FAULTS = 1 << 2 | 1 << 3 | 1 << 4 | 1 << 5 | 1 << 11
"""Limits and the emergency stop."""


class AsciiAxis:
    """Questions and commands to one axis; failures are raised as errors that say what to do.

    `words` is how its controller is spoken to, as far as that is known by now; `task` is the controller's task that
    oscillates the axis, if one does.
    """

    def __init__(self, name: str, words: Words, link: AsciiLink, task: int | None) -> None:
        self.link = link
        self.words = words
        self._task = task
        self._name = name

    def enable(self) -> None:
        """Enable, and have motions answered at once: enabling sets the wait mode back."""
        self.tell(self.words.order("ENABLE"))
        self.tell("WAIT MODE NOWAIT")

    def number_of_axis(self) -> int:
        """The number by which programs know the axis; 0 where it is the only one."""
        words = self.words
        if words.number is not None:
            return words.number
        for number in range(AXES_MAX):
            answer = self.link.ask(f"GETPARM(@{number}, {words.numbers.axis_name})")
            if answer.status != SUCCESS:
                break
            if answer.value.strip('"').upper() == words.axis.upper():
                return number
        raise InstrumentError(
            f"{self._name}: no axis of the controller is called {words.axis!r}; set `axis`", instrument=self._name
        )

    def parameter(self, number: int) -> str:
        """The line that asks for this parameter."""
        return self.words.question("GETPARM", number)

    def status(self) -> int:
        """AXISSTATUS; bits as in `AxisStatus`."""
        return self.ask_whole(self.words.question("AXISSTATUS"))

    def moving(self, status: int) -> bool:
        """True when this AXISSTATUS, the coordinated-motion plane, or the task that oscillates says so."""
        return self.shown_moving(status) or self.task_runs()

    def shown_moving(self, status: int) -> bool:
        """True when this AXISSTATUS or the coordinated-motion plane says that the axis moves."""
        if status & AxisStatus.MOVE_ACTIVE:
            return True
        # Both have to be asked: coordinated motions show in the plane's status only (EPICS motorAerotech).
        plane = self.words.plane
        return plane is not None and bool(self.ask_whole(f"PLANESTATUS({plane})") & 1)

    def task_runs(self) -> bool:
        """True while a program runs in the task that oscillates: whether AXISSTATUS shows it no source says."""
        return self._task is not None and self.ask_whole(f"TASKSTATE({self._task})") == TASK_RUNNING

    def position_mm(self) -> float:
        """The encoder in program coordinates, those of moves."""
        return self.ask_number(self.words.question("PFBKPROG"))

    def ask_number(self, line: str) -> float:
        """The answer to a query as a number; `BadReply` when it is none."""
        return self._number(line, self.ask(line), decimal)

    def ask_whole(self, line: str) -> int:
        """The answer to a query as a whole number; `BadReply` when it is none."""
        return self._number(line, self.ask(line), whole)

    def ask_whole_numbers(self, lines: Sequence[str]) -> list[int]:
        """The answers to queries that are sent in one go, one by one."""
        return [
            self._number(line, self.succeed(line, answer), whole)
            # `ask_each` stops after the first query that fails, so there may be fewer answers than lines.
            for line, answer in zip(lines, self.link.ask_each(lines), strict=False)
        ]

    def _number(self, line: str, text: str, parse: Callable[[str], Number]) -> Number:
        try:
            # some locale settings of the controller give a decimal comma
            return parse(text.replace(",", "."))
        except ValueError as error:
            raise BadReply(f"{self._name}: to {line!r}: {error}", instrument=self._name) from error

    def ask(self, line: str) -> str:
        """The answer to a query."""
        return self.succeed(line, self.link.ask(line))

    def tell(self, line: str) -> None:
        """A command, given once."""
        self.succeed(line, self.link.tell(line))

    def abort(self) -> None:
        """Decelerate to rest; sent again on a new connection when the old one fails.

        A disabled axis may answer with a fault: whether it moves is to be asked afterwards.
        """
        line = self.words.order("ABORT")
        answer = self.link.insist(line)
        # ABORT on a disabled axis may answer `#` and is no failure of stopping.
        if answer.status != FAULT:
            self.succeed(line, answer)

    def insist(self, line: str) -> None:
        """A command that does no harm when given twice; repeated once on a new connection."""
        self.succeed(line, self.link.insist(line))

    def succeed(self, line: str, answer: Answer) -> str:
        """The value of a success; otherwise `InstrumentError` with the axis' fault or the status character."""
        if answer.status == SUCCESS:
            return answer.value
        if answer.status == FAULT:
            raise self.ended(line, "it was refused")
        meaning = "did not understand" if answer.status == INVALID else "timed out on"
        raise InstrumentError(
            f"{self._name}: the controller {meaning} {line!r} (answer {answer.status}); "
            "check the axis name, the registers and the firmware's commands",
            instrument=self._name,
            code=answer.status,
        )

    def ended(self, command: str, how: str) -> InstrumentError:
        """The error for a command that came to nothing, with the axis' fault as code and text."""
        try:
            fault = self.fault_word()
        # Why a command failed must not hide behind a second failure: the first is told, with what is known.
        except (LinkError, BadReply) as error:
            return InstrumentError(
                f"{self._name}: {command!r}: {how}, and the fault could not be read ({error})",
                instrument=self._name,
                code=FAULT,
            )
        mend = (
            "remove the cause, then home to acknowledge and enable"
            if fault
            else "is it enabled, or did another client stop it?"
        )
        kind = SafetyStop if fault & SAFETY_FAULTS else InstrumentError
        return kind(
            f"{self._name}: {command!r}: {how} ({fault_text(fault)}, AXISFAULT {fault}); {mend}",
            instrument=self._name,
            code=str(fault),
            text=fault_text(fault),
        )

    def fault_word(self) -> int:
        """AXISFAULT as an unsigned number."""
        answer = self.link.ask(self.words.question("AXISFAULT"))
        try:
            # The controller sends its 32-bit words as signed decimals: negative where bit 31 is set.
            return whole(answer.value) & 0xFFFFFFFF
        except ValueError:
            raise BadReply(
                f"{self._name}: answered AXISFAULT with {answer.status}{answer.value}", instrument=self._name
            ) from None


def fault_text(word: int) -> str:
    """The names of the faults in a fault word."""
    names = [FAULTS.get(bit, f"bit {bit}") for bit in range(32) if word >> bit & 1]
    return ", ".join(names) or "no axis fault"
