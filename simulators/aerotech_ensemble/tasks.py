"""The tasks of the controller: AeroBasic programs of its file system, run beside the ASCII interface."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from enum import IntEnum
from pathlib import Path

from simulators.aerotech_ensemble.aerobasic import Perform, Program, compiled
from simulators.aerotech_ensemble.grammar import Command, Invalid, exactly, whole
from simulators.aerotech_ensemble.refusals import Blocked, Faulted, Reply
from simulators.aerotech_ensemble.registers import Registers
from simulators.aerotech_ensemble.settings import StageSimulatorSettings
from simulators.clock import SimulationClock

TASKS = 5
"""Four of the user's, and the auxiliary one."""
OURS = "RIGCTL.BCX"
SOURCES = Path(__file__).parents[2] / "drivers" / "aerobasic"
"""What an operator compiles and loads: it is read as the controller has it, line by line."""
HOME_ASYNC = """
PROGRAM
    DIM axis AS INTEGER
    axis = IGLOBAL(33)
    {home}
END PROGRAM
"""
"""The maker's sample program, as EPICS uses it: the axis' number is in IGLOBAL(33)."""
LOOKS_S = 0.2
"""How often a task looks whether the motion it waits for has ended."""


class TaskState(IntEnum):
    """TASKSTATE."""

    IDLE = 1
    RUNNING = 3
    COMPLETE = 5
    ERROR = 6


class Tasks:
    """`perform` carries out a command for the task of that number; `moving` says whether the axis does."""

    def __init__(
        self,
        clock: SimulationClock,
        registers: Registers,
        settings: StageSimulatorSettings,
        perform: Callable[[int, Command], Reply],
        moving: Callable[[], bool],
    ) -> None:
        self._clock = clock
        self._registers = registers
        self._start_s = settings.dialect.program_start_s
        self._perform = perform
        self._moving = moving
        self._files = _files(settings)
        self._states = dict.fromkeys(range(TASKS + 1), TaskState.IDLE)
        self._runs = 0
        self._running: dict[int, int] = {}

    def restart(self) -> None:
        """As after switching on."""
        self._states = dict.fromkeys(self._states, TaskState.IDLE)
        self._running.clear()

    def state(self, words: tuple[str, ...]) -> str:
        """TASKSTATE."""
        (task,) = exactly(1, words)
        return str(int(self._states[whole(task, 0, TASKS)]))

    def command(self, words: tuple[str, ...]) -> None:
        """PROGRAM RUN and PROGRAM STOP."""
        match words:
            case ("STOP", task):
                self._stop(whole(task, 1, TASKS))
            case ("RUN", task, file) | (task, "RUN", file):
                self._run(whole(task, 1, TASKS), file.strip('"').upper())
            case _:
                raise Invalid

    def _stop(self, task: int) -> None:
        self._running.pop(task, None)
        self._states[task] = TaskState.IDLE

    def _run(self, task: int, file: str) -> None:
        if file not in self._files:
            raise Invalid
        if task in self._running:
            raise Faulted
        self._runs += 1
        self._running[task] = self._runs
        run, steps = self._runs, self._files[file].run(self._registers, self._performer(task))
        self._clock.call_at(self._clock.now_s() + self._start_s, lambda: self._begin(task, run, steps))

    def _begin(self, task: int, run: int, steps: Iterator[float]) -> None:
        if self._running.get(task) == run:
            self._states[task] = TaskState.RUNNING
            self._step(task, run, steps)

    def _step(self, task: int, run: int, steps: Iterator[float]) -> None:
        # Stopped meanwhile, or the task runs something else.
        if self._running.get(task) != run:
            return
        try:
            pause_s = next(steps)
        except StopIteration:
            self._end(task, TaskState.COMPLETE)
        except (Invalid, Faulted):
            self._end(task, TaskState.ERROR)
        else:
            self._clock.call_at(self._clock.now_s() + pause_s, lambda: self._step(task, run, steps))

    def _end(self, task: int, state: TaskState) -> None:
        del self._running[task]
        self._states[task] = state

    def _performer(self, task: int) -> Perform:
        def perform(command: Command) -> Iterator[float]:
            reply = self._perform(task, command)
            if isinstance(reply, Blocked):
                while self._moving():
                    yield LOOKS_S

        return perform


def _files(settings: StageSimulatorSettings) -> dict[str, Program]:
    sources = {name.upper(): source for name, source in settings.programs.items()}
    if settings.rigctl_program:
        sources[OURS] = (SOURCES / settings.program_source).read_text(encoding="ascii")
    if settings.dialect.home_async == "program":
        sources["HOMEASYNC.BCX"] = HOME_ASYNC.format(home=settings.home_statement)
    return {name: compiled(source) for name, source in sources.items()}
