"""Oscillation and capture by our AeroBasic program (`aerobasic/rigctl.ab`), which the controller runs on its tasks.

OSCILLATE and DATAACQ are known to work in programs; over the ASCII interface nobody has shown it. Parameters and
results are in registers, the numbers of which stand at the head of the program.
"""

from __future__ import annotations

from collections.abc import Callable

from drivers.aerotech_ascii import FAULT, SUCCESS, Answer
from drivers.aerotech_axis import AsciiAxis
from drivers.aerotech_settings import StageSettings
from drivers.numbers import plain
from rigctl.core.clock import Clock
from rigctl.core.errors import InstrumentError

VERSION = 1
# IGLOBAL
ACTION, RESULT, AXIS, FIRST, TRIGGER, POINTS, PROGRAM_VERSION = range(7)
# DGLOBAL
DISTANCE, FREQUENCY = range(2)
TELL_VERSION, OSCILLATE, ARM, READ, END = range(1, 6)
TASK_ERROR = 6
"""TASKSTATE of a task whose program has failed."""
DECIMALS = 9
"""Of mm and Hz in commands."""


class ProgramCommands:
    """The program by the name `program`; one action at a time in `capture_task`, oscillations in `program_task`."""

    def __init__(self, name: str, program: str, settings: StageSettings, wire: AsciiAxis, clock: Clock) -> None:
        self._name = name
        self._program = program
        self._settings = settings
        self._wire = wire
        self._clock = clock
        self._axis_number: int | None = None

    def check(self, integers: int, doubles: int) -> bool:
        """True when the controller has the program; moves nothing.

        `integers` and `doubles` are how many registers it has. `InstrumentError` for too few of them, or for another
        version of the program.
        """
        if integers <= PROGRAM_VERSION or doubles <= FREQUENCY:
            raise InstrumentError(
                f"{self._name}: the controller has {integers} integer and {doubles} double registers, "
                f"{self._program} needs {PROGRAM_VERSION + 1} and {FREQUENCY + 1}; raise GlobalIntegers and "
                "GlobalDoubles (its parameters 124 and 125), or set program to nothing",
                instrument=self._name,
            )
        task = self._settings.capture_task
        if self._prepared(TELL_VERSION, {}, {}).status != SUCCESS:
            return False
        if self._run(task).status != SUCCESS:
            return False
        self._await_result(TELL_VERSION, task)
        version = self._wire.ask_whole(f"IGLOBAL({PROGRAM_VERSION})")
        if version != VERSION:
            raise InstrumentError(
                f"{self._name}: {self._program} in the controller is version {version}, this driver's is {VERSION}; "
                f"compile and load {self._wire.words.source} anew",
                instrument=self._name,
            )
        return True

    def oscillation(self, distance_mm: float, frequency_hz: float, cycles: int) -> str:
        """Make it ready; the line that starts it."""
        task = self._settings.program_task
        # What ran before there has been aborted, but its task may not have noticed yet.
        self.halt()
        numbers = {DISTANCE: plain(distance_mm, DECIMALS), FREQUENCY: plain(frequency_hz, DECIMALS)}
        self._wire.succeed("IGLOBAL", self._prepared(OSCILLATE, {POINTS: cycles}, numbers))
        return self._run_line(task)

    def begun(self, check: Callable[[], None]) -> None:
        """Return when the program has come to its oscillation; `check` raises when it was stopped."""
        self._await_result(OSCILLATE, self._settings.program_task, check=check)

    def halt(self) -> None:
        """No program of ours commands another motion."""
        # Whatever the answer: whether the axis stands is asked of the axis.
        self._wire.link.insist(f"PROGRAM STOP {self._settings.program_task}")

    def arm(self, samples: int) -> None:
        """Wait for so many edges."""
        s = self._settings
        self._do(ARM, {FIRST: s.capture_input, TRIGGER: s.capture_trigger, POINTS: samples})

    def read(self, first: int, count: int) -> bool:
        """Put so many counts into the registers from `first`; False when there are fewer."""
        return self._do(READ, {FIRST: first, POINTS: count}, may_fail=True)

    def end(self) -> None:
        """Wait for no more edges."""
        self._do(END, {})

    def _do(self, action: int, numbers: dict[int, int], *, may_fail: bool = False) -> bool:
        task = self._settings.capture_task
        self._wire.succeed("IGLOBAL", self._prepared(action, numbers, {}))
        self._wire.succeed(self._run_line(task), self._run(task))
        return self._await_result(action, task, may_fail=may_fail)

    def _prepared(self, action: int, numbers: dict[int, int], doubles: dict[int, str]) -> Answer:
        """The registers written; the last answer, or the first that is no success."""
        registers = {ACTION: action, RESULT: 0, AXIS: self._number_of_axis(), **numbers}
        lines = [f"IGLOBAL({register}) = {number}" for register, number in registers.items()]
        lines += [f"DGLOBAL({register}) = {number}" for register, number in doubles.items()]
        answer = Answer(SUCCESS)
        for line in lines:
            answer = self._wire.link.insist(line)
            if answer.status != SUCCESS:
                break
        return answer

    def _run(self, task: int) -> Answer:
        """Run it where nothing moves by it; what a session before this one left running there is stopped."""
        answer = self._wire.link.tell(self._run_line(task))
        if answer.status == FAULT:
            self._wire.link.insist(f"PROGRAM STOP {task}")
            answer = self._wire.link.tell(self._run_line(task))
        return answer

    def _run_line(self, task: int) -> str:
        return f'PROGRAM RUN {task}, "{self._program}"'

    def _await_result(
        self, action: int, task: int, *, may_fail: bool = False, check: Callable[[], None] = lambda: None
    ) -> bool:
        deadline_s = self._clock.now_s() + self._settings.program_timeout_s
        while self._wire.ask_whole(f"IGLOBAL({RESULT})") != action:
            check()
            taken = self._wire.ask_whole(f"IGLOBAL({ACTION})") == -action
            state = self._wire.ask_whole(f"TASKSTATE({task})")
            # Before it has taken the action up, the state may be that of what ran before.
            if taken and state == TASK_ERROR:
                if may_fail and not self._wire.fault_word():
                    return False
                raise self._wire.ended(self._run_line(task), f"action {action} ended in an error of task {task}")
            if self._clock.now_s() > deadline_s:
                raise InstrumentError(
                    f"{self._name}: {self._program} has not done action {action} after "
                    f"{self._settings.program_timeout_s:g} s (TASKSTATE({task}) is {state}); "
                    "is the task enabled in TaskExecutionSetup?",
                    instrument=self._name,
                    code=FAULT,
                )
            self._clock.sleep_s(self._settings.poll_interval_s)
        return True

    def _number_of_axis(self) -> int:
        if self._axis_number is None:
            self._axis_number = self._wire.number_of_axis()
        return self._axis_number
