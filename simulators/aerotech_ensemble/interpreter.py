"""The commands: what each keyword does to the axis, the registers and the modes."""

from __future__ import annotations

from collections.abc import Callable

from simulators.aerotech_ensemble import inputs
from simulators.aerotech_ensemble.capture import PositionCapture
from simulators.aerotech_ensemble.capture_commands import CaptureCommands
from simulators.aerotech_ensemble.controller import AxisController
from simulators.aerotech_ensemble.grammar import Command, Invalid, exactly, none, number, whole
from simulators.aerotech_ensemble.modes import ABSOLUTE, INPOS, NOWAIT, MotionModes
from simulators.aerotech_ensemble.parameters import Parameters
from simulators.aerotech_ensemble.refusals import Blocked, Faulted, Reply, Restarting
from simulators.aerotech_ensemble.registers import Registers
from simulators.aerotech_ensemble.settings import StageSimulatorSettings
from simulators.aerotech_ensemble.status import AxisStatus, signed_32_bit
from simulators.aerotech_ensemble.tasks import TASKS, Tasks
from simulators.clock import SimulationClock
from simulators.measured import Tap
from simulators.motion import MotionAxis
from simulators.wiring import TriggerLine

PLANES = 4
CYCLES_MAX = 1_000_000_000
OSCILLATE_NUMBERS = {"required": {4}, "optional": {3, 4}, "unknown": {3}}


class Interpreter:
    """The ASCII interface with its axis, and the tasks beside it; raises `Invalid`, `Faulted` or `Restarting`."""

    def __init__(
        self,
        clock: SimulationClock,
        axis: MotionAxis,
        trigger: TriggerLine,
        settings: StageSimulatorSettings,
        tap: Tap,
    ) -> None:
        self._clock = clock
        self._settings = settings
        # Asked of every line, a thousand of them after a run.
        self._not_understood = settings.not_understood
        self._addressing = settings.addressing
        self.parameters = Parameters(settings)
        self.axis = AxisController(clock, axis, self.parameters, settings)
        self.capture = PositionCapture(axis, trigger, settings, tap)
        self._registers = Registers(settings)
        self._acquisition = CaptureCommands(clock, self.axis, self.capture, self._registers, settings)
        self._unit_mm = 1.0
        # Each task has modes of its own; task 0 is the ASCII interface.
        self._all_modes = [MotionModes(self.parameters, self._addressing) for _ in range(TASKS + 1)]
        self._modes = self._all_modes[0]
        self._tasks = Tasks(clock, self._registers, settings, self._execute_in_task, self.axis.moving)
        self._handlers: dict[str, Callable[[tuple[str, ...]], Reply]] = {
            "VERSION": self._version,
            "ACKNOWLEDGEALL": self._acknowledge_all,
            "FAULTACK": self._on_axis(self.axis.acknowledge),
            "ENABLE": self._on_axis(self._enable),
            "DISABLE": self._on_axis(self.axis.disable),
            "ABORT": self._on_axis(self._abort),
            "HOME": self._home,
            "HOMEASYNC": self._home_asynchronously,
            "PROGRAM": self._tasks.command,
            "TASKSTATE": self._tasks.state,
            "WAIT": lambda words: self._modes.set_wait(words),
            "ABS": lambda words: self._modes.set_absolute(words),
            "INC": lambda words: self._modes.set_incremental(words),
            "MOVEABS": self._move_absolute,
            "MOVEINC": self._move_incremental,
            "LINEAR": self._linear,
            "FREERUN": self._free_run,
            "OSCILLATE": self._oscillate,
            "RAMP": lambda words: self._modes.set_ramp(words, self._unit_mm),
            "SCURVE": lambda words: self._modes.set_s_curve(words),
            "VELOCITY": lambda words: self._modes.set_profiling(words),
            "PFBK": self._query(lambda: self._length(self.axis.feedback_mm())),
            "PFBKPROG": self._query(lambda: self._length(self._program_mm(self.axis.feedback_mm()))),
            "PCMD": self._query(lambda: self._length(self.axis.commanded_mm())),
            "PCMDPROG": self._query(lambda: self._length(self._program_mm(self.axis.commanded_mm()))),
            "CMDPOS": self._query(lambda: self._length(self._program_mm(self.axis.commanded_mm()))),
            "PERR": self._query(lambda: self._length(self.axis.commanded_mm() - self.axis.feedback_mm())),
            "VFBK": self._query(lambda: self._length(self.axis.velocity_mm_s())),
            "VCMD": self._query(lambda: self._length(self.axis.velocity_mm_s())),
            "AXISSTATUS": self._query(self._axis_status),
            "AXISFAULT": self._query(lambda: str(signed_32_bit(int(self.axis.fault())))),
            "PLANESTATUS": self._plane_status,
            "POSOFFSET": self._position_offset,
            "GETPARM": self._get_parameter,
            "SETPARM": self._set_parameter,
            "COMMITPARAMETERS": self._commit_parameters,
            "RESET": self._reset,
            "GETMODE": lambda words: self._modes.text(words),
            "DIN": lambda words: inputs.digital_input(self._after_axis(words)),
            "DOUT": lambda words: inputs.digital_output(self._after_axis(words)),
            "AIN": lambda words: inputs.analog_input(self._after_axis(words)),
            "AOUT": lambda words: inputs.analog_output(self._after_axis(words)),
            "DATAACQ": lambda words: self._acquisition.command(self._after_axis(words)),
        }

    def execute(self, command: Command) -> Reply:
        """Do what the ASCII interface is told and say what is answered."""
        if command.keyword in self._not_understood:
            raise Invalid
        self._addressing.check(command)
        return self._execute(command)

    def _execute_in_task(self, task: int, command: Command) -> Reply:
        self._modes = self._all_modes[task]
        try:
            return self._execute(command)
        finally:
            self._modes = self._all_modes[0]

    def _execute(self, command: Command) -> Reply:
        if command.keyword in ("DGLOBAL", "IGLOBAL"):
            return self._registers.access(command)
        handler = self._handlers.get(command.keyword)
        if handler is None or command.value is not None:
            raise Invalid
        return handler(command.words)

    def change_unit(self, name: str, unit_mm: float) -> None:
        """Positions and speeds are in another unit from now on."""
        self.parameters.name_unit(name)
        self._unit_mm = unit_mm

    def restart(self) -> None:
        """As after switching on; parameters not committed are lost."""
        self.parameters.restart()
        self.axis.restart()
        self.capture.reset()
        self._registers.clear()
        self._tasks.restart()
        for modes in self._all_modes:
            modes.restart()

    # shapes that several commands share

    def _on_axis(self, act: Callable[[], None]) -> Callable[[tuple[str, ...]], Reply]:
        def handler(words: tuple[str, ...]) -> Reply:
            self._addressing.require(words)
            act()
            return None

        return handler

    def _query(self, value: Callable[[], str]) -> Callable[[tuple[str, ...]], Reply]:
        def handler(words: tuple[str, ...]) -> Reply:
            none(self._addressing.after(words))
            return value()

        return handler

    def _after_axis(self, words: tuple[str, ...]) -> tuple[str, ...]:
        return self._addressing.after(words)

    def _length(self, length_mm: float) -> str:
        return f"{length_mm / self._unit_mm:.6f}"

    def _move_words(self, words: tuple[str, ...], *, coordinated: bool = False) -> tuple[float, float | None]:
        position, speed = self._addressing.move(words, coordinated=coordinated)
        return position * self._unit_mm, None if speed is None else speed * self._unit_mm

    def _program_mm(self, machine_mm: float) -> float:
        return machine_mm - self._modes.program_zero_mm

    # state

    def _version(self, words: tuple[str, ...]) -> Reply:
        none(words)
        return self._settings.version

    def _acknowledge_all(self, words: tuple[str, ...]) -> Reply:
        none(words)
        self.axis.acknowledge()
        return None

    def _enable(self) -> None:
        self.axis.enable()
        # As EPICS found on real controllers, and sends WAIT MODE NOWAIT after each ENABLE.
        self._modes.default_wait()

    def _abort(self) -> None:
        self.axis.abort()
        if self._settings.dialect.abort_disabled == "refuse" and not self.axis.enabled:
            raise Faulted

    def _axis_status(self) -> str:
        status = self.axis.status()
        if self.capture.active(self._clock.now_s()):
            status |= AxisStatus.POSITION_CAPTURE
        return str(signed_32_bit(int(status)))

    def _plane_status(self, words: tuple[str, ...]) -> Reply:
        (plane,) = exactly(1, words)
        # The axis is in plane 0; the other planes are empty.
        return str(int(self.axis.plane_status())) if whole(plane, 0, PLANES - 1) == 0 else "0"

    # motion

    def _home(self, words: tuple[str, ...]) -> Reply:
        none(self._after_axis(words))
        return Blocked(self.axis.home())

    def _home_asynchronously(self, words: tuple[str, ...]) -> Reply:
        if self._settings.dialect.home_async != "keyword":
            raise Invalid
        none(self._after_axis(words))
        self.axis.home()
        return None

    def _move_absolute(self, words: tuple[str, ...]) -> Reply:
        position_mm, speed_mm_s = self._move_words(words)
        return self._go(position_mm + self._modes.program_zero_mm, position_mm, speed_mm_s)

    def _move_incremental(self, words: tuple[str, ...]) -> Reply:
        distance_mm, speed_mm_s = self._move_words(words)
        return self._go(self.axis.commanded_mm() + distance_mm, distance_mm, speed_mm_s)

    def _linear(self, words: tuple[str, ...]) -> Reply:
        value_mm, speed_mm_s = self._move_words(words, coordinated=True)
        origin_mm = self._modes.program_zero_mm if self._modes.positioning == ABSOLUTE else self.axis.commanded_mm()
        return self._go(origin_mm + value_mm, value_mm, speed_mm_s, linear=True)

    def _go(self, target_mm: float, way_mm: float, speed_mm_s: float | None, *, linear: bool = False) -> Reply:
        speed = self._modes.speed_mm_s if speed_mm_s is None else speed_mm_s
        end_s = self.axis.move(target_mm, speed, self._modes.ramp_mm_s2(speed, abs(way_mm)), linear=linear)
        self._modes.speed_mm_s = speed
        return self._moving_until(end_s)

    def _free_run(self, words: tuple[str, ...]) -> Reply:
        (velocity,) = exactly(1, self._after_axis(words))
        velocity_mm_s = number(velocity) * self._unit_mm
        self.axis.jog(velocity_mm_s, self._modes.ramp_mm_s2(abs(velocity_mm_s), 0.0))
        return None

    def _oscillate(self, words: tuple[str, ...]) -> Reply:
        arguments = self._after_axis(words)
        if len(arguments) not in OSCILLATE_NUMBERS[self._settings.dialect.oscillate_frequencies]:
            raise Invalid
        if len(arguments) == 4:
            # The number of frequencies, of the maker's library: one is all that is offered here.
            whole(arguments[3], 1, 1)
        distance, frequency, cycles = exactly(3, arguments[:3])
        end_s = self.axis.oscillate(number(distance) * self._unit_mm, number(frequency), whole(cycles, 1, CYCLES_MAX))
        waits = self._settings.dialect.oscillate_waits
        if waits == "never":
            return None
        return Blocked(end_s) if waits == "always" and self.axis.moving() else self._moving_until(end_s)

    def _moving_until(self, end_s: float) -> Reply:
        # With a fault, or already there, there is nothing to wait for.
        if self._modes.wait == NOWAIT or self.axis.fault() or not self.axis.moving():
            return None
        return Blocked(end_s + (self._settings.settle_s if self._modes.wait == INPOS else 0.0))

    def _position_offset(self, words: tuple[str, ...]) -> Reply:
        word, *rest = words or ("",)
        arguments = self._after_axis(tuple(rest))
        if word == "SET":
            (position,) = exactly(1, arguments)
            self._modes.program_zero_mm = self.axis.feedback_mm() - number(position) * self._unit_mm
        elif word == "CLEAR":
            none(arguments)
            self._modes.program_zero_mm = 0.0
        else:
            raise Invalid
        return None

    # set-up, inputs and outputs

    def _get_parameter(self, words: tuple[str, ...]) -> Reply:
        (name,) = exactly(1, self._after_axis(words))
        return self.parameters.read(name)

    def _set_parameter(self, words: tuple[str, ...]) -> Reply:
        name, value = exactly(2, self._after_axis(words))
        self.parameters.change(self.parameters.named(name), value)
        return None

    def _commit_parameters(self, words: tuple[str, ...]) -> Reply:
        none(words)
        self.parameters.commit()
        return None

    def _reset(self, words: tuple[str, ...]) -> Reply:
        none(words)
        raise Restarting
