"""What both generations do: modes, refusals, settings, storage and programs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from simulators.clock import SimulationClock
from simulators.faults.mishaps import PowerCycle
from simulators.faults.when import Event
from simulators.keyence_lkg.faults import Fault, Refused
from simulators.keyence_lkg.heads import CUTOFFS_HZ, Kernel, Output, high_pass, low_pass, moving_average
from simulators.keyence_lkg.model import LkgSettings, Model
from simulators.keyence_lkg.registers import PROGRAMS, Register, Registers, whole
from simulators.keyence_lkg.session import LINE_MAX, Answer, Session
from simulators.keyence_lkg.storage import DataStorage, Plan
from simulators.keyence_lkg.values import NO_VALUE, format_value, format_values
from simulators.measured import Tap
from simulators.wiring import Signal, TriggerLine

STORAGE_CYCLES = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
"""Sampling cycles between stored values, by the number that selects them (SW,CF; SW,CI)."""


@dataclass(frozen=True)
class Command:
    """A command: how many parameters it takes, what it does; whether it is one of the settings."""

    run: Callable[[list[str]], str]
    parameters: int | None = 0
    setting: bool = False


class Controller:
    """A controller with its heads; `connect` serves a client in ASCII lines that end with CR."""

    def __init__(
        self,
        model: Model,
        registers: Sequence[Register],
        clock: SimulationClock,
        heads: Sequence[Signal],
        trigger: TriggerLine,
        settings: LkgSettings,
        tap: Tap,
    ) -> None:
        if not 1 <= len(heads) <= model.outputs:
            raise ValueError(f"{model.kind}: {len(heads)} heads, it has outputs for 1 to {model.outputs}")
        self.kind = model.kind
        self.settings = settings
        self.clock = clock
        self.outputs = [Output(signal, settings.range_mm) for signal in heads]
        self._model = model
        self.registers = Registers.of(registers)
        self.storage = DataStorage(clock, trigger, self.outputs, settings, tap)
        self._measuring = True
        self._ready_s = clock.now_s()
        self._return_delay_s = 0.0
        self._apply_registers()
        self._commands: dict[str, Command] = {
            "SW": Command(self._write, parameters=None, setting=True),
            "SR": Command(self._read, parameters=None, setting=True),
            "AQ": Command(self._initialise_storage),
            "AS": Command(self._start_storage),
            "AP": Command(self._stop_storage),
            "PW": Command(self._change_program, parameters=1),
            "PR": Command(lambda _: f"PR,{self.registers.program}"),
            "KL": Command(self._lock_panel, parameters=1),
            **self.storage_commands(),
            **self.measurement_commands(),
        }

    def connect(self, send: Callable[[bytes], None]) -> Session:
        """Serve one more client."""
        return Session(self.clock, self.answer, send)

    def befall(self, event: Event) -> None:
        """It loses its power: settings are kept, zeros and stored values are not."""
        if isinstance(event, PowerCycle):
            self.storage.stop()
            self.storage.clear()
            self._measuring = True
            for output in self.outputs:
                output.unzero()
                output.reset(self.clock.now_s())

    def relieve(self, event: Event) -> None:
        """Nothing comes back by itself; it is ready when it measures again."""
        if isinstance(event, PowerCycle):
            self._ready_s = self.clock.now_s() + self.settings.mode_settle_s

    def measurement_commands(self) -> dict[str, Command]:
        """The commands in which the generations differ."""
        raise NotImplementedError

    def answer(self, line: bytes) -> Answer:
        """The reply to one line; exactly one whatever stands in it."""
        main, *parameters = line.decode("latin-1").upper().split(",")
        if len(line) > LINE_MAX:
            return self._refuse(main, parameters, Fault.LENGTH)
        try:
            if main in ("Q0", "R0"):
                return self._change_mode(main, parameters)
            return Answer(self._run(main, parameters), self.settings.reply_delay_s)
        except Refused as refusal:
            return self._refuse(main, parameters, refusal.fault)

    def output(self, text: str) -> int:
        """The index of the output that a parameter names; it need not have a head."""
        return whole(text, 1, self._model.outputs) - 1

    def values(self, indices: Sequence[int]) -> str:
        """The values of outputs now, comma-separated; no valid value without a head."""
        return ",".join(self._value(index) for index in indices)

    def wired(self, indices: Sequence[int]) -> list[Output]:
        """Those of the outputs that have a head."""
        return [self.outputs[index] for index in indices if index < len(self.outputs)]

    def zero(self, indices: Sequence[int]) -> None:
        """Auto-zero on."""
        # What is stored so far is taken with the zero it was measured with.
        self.storage.take()
        for output in self.wired(indices):
            output.zero(self.clock.now_s())

    def unzero(self, indices: Sequence[int]) -> None:
        """Auto-zero off."""
        self.storage.take()
        for output in self.wired(indices):
            output.unzero()

    def reset(self, indices: Sequence[int]) -> None:
        """Begin held values and statistics anew."""
        for output in self.wired(indices):
            output.reset(self.clock.now_s())

    def hold(self, indices: Sequence[int], on: bool) -> None:
        """Timing: hold the value on display, or let it go."""
        for output in self.wired(indices):
            output.held_at_s = self.clock.now_s() if on else None

    def _value(self, index: int) -> str:
        if index >= len(self.outputs):
            return NO_VALUE
        return format_value(self.outputs[index].now(self.clock.now_s()), self.settings.decimals)

    def _run(self, main: str, parameters: list[str]) -> str:
        command = self._commands.get(main)
        if command is None:
            raise Refused(Fault.COMMAND)
        # After the reply to R0 it still takes a while until measuring commands are taken.
        ready = self.clock.now_s() >= self._ready_s
        if command.setting == self._measuring or (self._measuring and not ready):
            raise Refused(Fault.STATUS)
        if command.parameters is not None and len(parameters) != command.parameters:
            raise Refused(Fault.COUNT)
        return command.run(parameters)

    def _refuse(self, main: str, parameters: list[str], fault: Fault) -> Answer:
        name = main
        if main in ("SW", "SR") and parameters and self.settings.refusal_names_setting:
            name = parameters[0]
        # A refusal quotes what was sent, which may be anything.
        echo = "".join(c if c.isascii() and c.isprintable() else "?" for c in name[:10])
        return Answer(f"ER,{echo},{self._model.codes[fault]}", self.settings.reply_delay_s)

    def _change_mode(self, main: str, parameters: list[str]) -> Answer:
        if parameters:
            raise Refused(Fault.COUNT)
        # A change to the mode it is in is a status error.
        if self._measuring == (main == "R0"):
            raise Refused(Fault.STATUS)
        self._measuring = main == "R0"
        if not self._measuring:
            self.storage.stop()
            # Before settings change: values belong to those they were stored under.
            self.storage.take()
            return Answer(main, self.settings.reply_delay_s)
        self._apply_registers()
        delay_s = self.settings.reply_delay_s + self.settings.mode_return_s
        self._ready_s = self.clock.now_s() + delay_s + self.settings.mode_settle_s
        return Answer(main, delay_s)

    # Settings and programs

    def _write(self, parameters: list[str]) -> str:
        self.registers.write(parameters)
        return f"SW,{parameters[0]}"

    def _read(self, parameters: list[str]) -> str:
        return ",".join(["SR", *parameters, *self.registers.read(parameters)])

    def _change_program(self, parameters: list[str]) -> str:
        self.registers.program = whole(parameters[0], 0, PROGRAMS - 1)
        self.storage.stop()
        self.storage.take()
        self._apply_registers()
        return "PW"

    def _lock_panel(self, parameters: list[str]) -> str:
        whole(parameters[0], 0, 1)
        return "KL"

    def cycle_s(self) -> float:
        """The sampling cycle."""
        return self._model.sampling_us[int(self.registers.value("CA")[0])] * 1e-6

    def _apply_registers(self) -> None:
        for number, output in enumerate(self.outputs, start=1):
            kind, selected = (int(value) for value in self.registers.value("OC", output=number))
            output.kernel = self._kernel(kind, selected)
            output.offset_mm = float(self.registers.value("OF", output=number)[0])

    def _kernel(self, kind: int, selected: int) -> Kernel:
        if kind == 0:
            return moving_average(4**selected, self.cycle_s())
        cutoff_hz = CUTOFFS_HZ[min(selected, len(CUTOFFS_HZ) - 1)]
        return low_pass(cutoff_hz) if kind == 1 else high_pass(cutoff_hz)

    # Storage

    def plan(self) -> Plan:
        """What a storage that is started now takes."""
        raise NotImplementedError

    def storage_commands(self) -> dict[str, Command]:
        """How the storage's status and its values are asked for."""
        raise NotImplementedError

    def counts(self) -> list[str]:
        """How many values are stored of each output, two outputs at least, as they stand in a reply."""
        stored = [self.storage.count(index) for index in range(max(2, len(self.outputs)))]
        return [f"{count:0{self.settings.count_digits}d}" for count in stored]

    def stored(self, index: int) -> str:
        """The stored values of an output, comma-separated."""
        return format_values(self.storage.values(index).tolist(), self.settings.decimals)

    def _initialise_storage(self, _: list[str]) -> str:
        self.storage.clear()
        return "AQ"

    def _start_storage(self, _: list[str]) -> str:
        self.storage.start(self.plan())
        return "AS"

    def _stop_storage(self, _: list[str]) -> str:
        self.storage.stop()
        return "AP"
