"""The first generation: LK-G3001, two outputs, numbers of one digit."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from simulators.clock import SimulationClock
from simulators.keyence_lkg.controller import STORAGE_CYCLES, Command, Controller
from simulators.keyence_lkg.dialect import BY_OUTPUT, Lkg3001Dialect
from simulators.keyence_lkg.faults import Fault
from simulators.keyence_lkg.model import LkgSettings, Model, common_registers
from simulators.keyence_lkg.registers import Field, Register, digits, exactly, switch, whole
from simulators.keyence_lkg.storage import Plan
from simulators.keyence_lkg.values import format_values
from simulators.measured import Tap, unheard
from simulators.wiring import Signal, TriggerLine

MODEL = Model(
    kind="keyence-lkg3001",
    outputs=2,
    sampling_us=(20.0, 50.0, 100.0, 200.0, 500.0, 1000.0),
    codes={
        Fault.COMMAND: "00",
        Fault.STATUS: "01",
        Fault.LENGTH: "20",
        Fault.COUNT: "21",
        Fault.PARAMETER: "22",
    },
)

_STATISTICS_SPAN_S = 60.0
"""How far back the statistics reach; less than the world remembers."""


class Lkg3001Settings(LkgSettings):
    """The first generation's defaults: 65 536 values per output; `dialect` is what the manual may say besides."""

    clock_ppm: float = 40.0
    dialect: Lkg3001Dialect = Lkg3001Dialect()


class SimulatedLkg3001(Controller):
    """An LK-G3001 with one or two heads.

    `heads` are displacements in mm at rig times (NaN without a target), `trigger` is wired to the TIMING input, which
    its storage does not follow: it stores by its own clock. Sources: LK-G Series User's Manual, chapter 5; storage
    cycles and targets as in the maker's header LkIF.h, `SW,CI` as in mecode and a C# program.
    """

    def __init__(
        self,
        clock: SimulationClock,
        heads: Sequence[Signal],
        trigger: TriggerLine,
        settings: Lkg3001Settings | None = None,
        tap: Tap | None = None,
    ) -> None:
        settings = settings or Lkg3001Settings()
        self._dialect = settings.dialect
        super().__init__(MODEL, _registers(settings), clock, heads, trigger, settings, tap or unheard())

    def measurement_commands(self) -> dict[str, Command]:
        """Measurement and control, by output in the command's name: 1, 2, or 0 for both."""
        commands = {
            "VR": Command(self._reset, parameters=1),
            "T0": Command(lambda p: self._hold(p, on=False), parameters=1),
            "T1": Command(lambda p: self._hold(p, on=True), parameters=1),
            "DO": Command(self._statistics, parameters=1),
            "DQ": Command(self._clear_statistics, parameters=1),
        }
        for number, indices in ((0, (0, 1)), (1, (0,)), (2, (1,))):
            commands |= self._by_output(number, indices)
        return commands

    def storage_commands(self) -> dict[str, Command]:
        """Status and values, as the dialect has them."""
        asked = 1 if self._dialect.status_by_output else 0
        return {"AN": Command(self._status, parameters=asked), "AO": Command(self._values_of, parameters=1)}

    def plan(self) -> Plan:
        """The outputs of the target, so many sampling cycles apart."""
        if self._dialect.target == BY_OUTPUT:
            chosen, count, cycle = self._chosen_by_output()
        else:
            target, count, cycle = (int(value) for value in self.registers.value("CI"))
            chosen = self._dialect.targets[target]
        stored = tuple(index for index in chosen if index < len(self.outputs))
        return Plan(count, STORAGE_CYCLES[cycle] * self.cycle_s(), stored, self._dialect.start_delay_s)

    def _chosen_by_output(self) -> tuple[tuple[int, ...], int, int]:
        """The outputs that were set up as the first of them, its count and its cycle."""
        values = [self.registers.value("CI", output=index + 1) for index in range(MODEL.outputs)]
        count, cycle = (int(value) for value in next((each for each in values if int(each[0])), values[0]))
        chosen = tuple(
            index for index, each in enumerate(values) if tuple(map(int, each)) == (count, cycle) and count
        )
        return chosen, count, cycle

    def _status(self, parameters: list[str]) -> str:
        running = str(int(self.storage.running))
        if not parameters:
            return ",".join(["AN", running, *self.counts()])
        whose = parameters if self._dialect.status_repeats_output else []
        return ",".join(["AN", *whose, running, self.counts()[self.output(parameters[0])]])

    def _values_of(self, parameters: list[str]) -> str:
        text = self.stored(self.output(parameters[0]))
        whose = parameters if self._dialect.values_repeat_output else []
        return ",".join(["AO", *whose, *([text] if text else [])])

    def _by_output(self, number: int, indices: tuple[int, ...]) -> dict[str, Command]:
        def measure(_: list[str]) -> str:
            return f"M{number},{self.values(indices)}"

        def zero(_: list[str]) -> str:
            self.zero(indices)
            return f"V{number}"

        def unzero(_: list[str]) -> str:
            self.unzero(indices)
            return f"W{number}"

        return {f"M{number}": Command(measure), f"V{number}": Command(zero), f"W{number}": Command(unzero)}

    def _chosen(self, text: str) -> tuple[int, ...]:
        number = whole(text, 0, MODEL.outputs)
        return (number - 1,) if number else (0, 1)

    def _reset(self, parameters: list[str]) -> str:
        self.reset(self._chosen(parameters[0]))
        return "VR"

    def _hold(self, parameters: list[str], on: bool) -> str:
        self.hold(self._chosen(parameters[0]), on)
        return f"T{int(on)}"

    def _clear_statistics(self, parameters: list[str]) -> str:
        for output in self.wired([self.output(parameters[0])]):
            output.statistics_from_s = self.clock.now_s()
        return f"DQ,{parameters[0]}"

    def _statistics(self, parameters: list[str]) -> str:
        """Maximum, minimum, peak to peak and mean; no source gives the form, this one is chosen."""
        values = [math.nan] * 4
        for output in self.wired([self.output(parameters[0])]):
            now_s = self.clock.now_s()
            since_s = max(output.statistics_from_s, now_s - _STATISTICS_SPAN_S)
            seen = output.at(np.linspace(since_s, now_s, 257))
            seen = seen[np.isfinite(seen)]
            if len(seen):
                values = [float(v) for v in (seen.max(), seen.min(), np.ptp(seen), seen.mean())]
        return f"DO,{parameters[0]},{format_values(values, self.settings.decimals)}"


def _storage_register(settings: Lkg3001Settings) -> Register:
    """Target, count and cycle; there is no cycle 10: the storage knows nothing of the TIMING input."""
    dialect, most = settings.dialect, settings.storage_values
    count: Field = exactly(dialect.count_digits, 1, most)
    cycle: Field = exactly(dialect.cycle_digits, 0, len(STORAGE_CYCLES) - 1)
    if dialect.target == BY_OUTPUT:
        return Register(("CI",), MODEL.outputs, (count, cycle), ("0", "0"))
    target = digits(1, 0, len(dialect.targets) - 1)
    return Register(("CI",), 0, (target, count, cycle), ("0", f"{most:0{dialect.count_digits}d}", "0"))


def _registers(settings: Lkg3001Settings) -> list[Register]:
    return [
        *common_registers(MODEL, settings),
        _storage_register(settings),
        Register(("OC",), MODEL.outputs, (digits(1, 0, 0), digits(1, 0, 9)), ("0", "0")),
        Register(("HA", "M"), MODEL.outputs, (switch,), ("0",)),
        Register(("HB",), MODEL.outputs, (digits(1, 0, 4),), ("0",)),
    ]
