"""The second generation: LK-G5000, up to twelve outputs, numbers of two digits."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

from simulators.clock import SimulationClock
from simulators.keyence_lkg.controller import STORAGE_CYCLES, Command, Controller
from simulators.keyence_lkg.faults import Fault, Refused
from simulators.keyence_lkg.model import LkgSettings, Model, common_registers
from simulators.keyence_lkg.registers import Register, digits, number, switch, whole
from simulators.keyence_lkg.storage import Plan
from simulators.measured import Tap, unheard
from simulators.wiring import Signal, TriggerLine

MODEL = Model(
    kind="keyence-lkg5000",
    outputs=12,
    sampling_us=(2.55, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0),
    codes={
        Fault.COMMAND: "50",
        Fault.STATUS: "51",
        Fault.LENGTH: "60",
        Fault.COUNT: "61",
        Fault.PARAMETER: "62",
    },
)

_ALL = tuple(range(MODEL.outputs))


class Lkg5000Settings(LkgSettings):
    """The second generation's defaults: 1 200 000 values shared by the outputs chosen with SW,OK."""

    storage_values: int = 1_200_000
    refusal_names_setting: bool = False
    mode_return_s: float = 0.6


class SimulatedLkg5000(Controller):
    """An LK-G5000 with one to twelve heads.

    `heads` are displacements in mm at rig times (NaN without a target), `trigger` is wired to the TIMING
    input.
    """

    def __init__(
        self,
        clock: SimulationClock,
        heads: Sequence[Signal],
        trigger: TriggerLine,
        settings: LkgSettings | None = None,
        tap: Tap | None = None,
    ) -> None:
        settings = settings or Lkg5000Settings()
        super().__init__(MODEL, _registers(settings), clock, heads, trigger, settings, tap or unheard())

    def measurement_commands(self) -> dict[str, Command]:
        """Measurement and control: S takes one output, M twelve flags, A takes all."""
        commands = {
            "MS": Command(lambda p: f"MS,{p[0]},{self.values([self.output(p[0])])}", parameters=1),
            "MM": Command(lambda p: f"MM,{p[0]},{self.values(_flagged(p[0]))}", parameters=1),
            "MA": Command(lambda _: f"MA,{self.values(_ALL)}"),
            "TS": Command(self._hold, parameters=2),
        }
        for letter, control in (("V", self.zero), ("W", self.unzero), ("D", self.reset)):
            commands |= self._by_outputs(letter, control)
        return commands

    def storage_commands(self) -> dict[str, Command]:
        """Status of all outputs at once, values by output."""
        return {"AN": Command(self._status), "AO": Command(self._values_of, parameters=1)}

    def plan(self) -> Plan:
        """Outputs are chosen apart (SW,OK); cycle 10 is the TIMING input."""
        count, cycle = (int(value) for value in self.registers.value("CF"))
        stored = tuple(
            index for index in range(len(self.outputs)) if self.registers.value("OK", output=index + 1) == ("1",)
        )
        # One memory for all outputs that are stored.
        share = self.settings.storage_values // max(len(stored), 1)
        cycle_s = STORAGE_CYCLES[cycle] * self.cycle_s() if cycle < len(STORAGE_CYCLES) else None
        return Plan(min(count, share), cycle_s, stored)

    def _status(self, _: list[str]) -> str:
        running = int(self.storage.running)
        return ",".join(["AN", str(running), *self.counts()])

    def _values_of(self, parameters: list[str]) -> str:
        text = self.stored(self.output(parameters[0]))
        return f"AO,{text}" if text else "AO"

    def _by_outputs(self, letter: str, control: Callable[[Sequence[int]], None]) -> dict[str, Command]:
        def single(parameters: list[str]) -> str:
            control([self.output(parameters[0])])
            return f"{letter}S"

        def multiple(parameters: list[str]) -> str:
            control(_flagged(parameters[0]))
            return f"{letter}M"

        def everything(_: list[str]) -> str:
            control(_ALL)
            return f"{letter}A"

        return {
            f"{letter}S": Command(single, parameters=1),
            f"{letter}M": Command(multiple, parameters=1),
            f"{letter}A": Command(everything),
        }

    def _hold(self, parameters: list[str]) -> str:
        on, output = whole(parameters[0], 0, 1), self.output(parameters[1])
        self.hold([output], on=bool(on))
        return "TS"


def _flagged(flags: str) -> list[int]:
    if not re.fullmatch(rf"[01]{{{MODEL.outputs}}}", flags) or "1" not in flags:
        raise Refused(Fault.PARAMETER)
    return [index for index, flag in enumerate(flags) if flag == "1"]


def _registers(settings: LkgSettings) -> list[Register]:
    outputs, count = MODEL.outputs, settings.storage_values
    choice = digits(1, 0, 9)
    zero = "+000.000"
    return [
        *common_registers(MODEL, settings),
        Register(("CF",), 0, (digits(7, 1, count), digits(2, 0, 10)), (f"{count:07d}", "00")),
        Register(("OK",), outputs, (switch,), ("0",)),
        Register(("OC",), outputs, (digits(1, 0, 2), choice), ("0", "0")),
        Register(("OA", "T"), outputs, (choice,), ("0",)),
        Register(("OB",), outputs, (number,) * 4, (zero, zero, "+999.999", "+999.999")),
        Register(("OD",), outputs, (choice,), ("0",)),
        Register(("OE", "M"), outputs, (switch,), ("0",)),
        Register(("OI",), outputs, (choice,), ("0",)),
        Register(("OJ",), outputs, (switch,), ("0",)),
        Register(("LM",), outputs, (number,) * 3, (zero, zero, zero)),
        Register(("HA", "M"), outputs, (switch,), ("0",)),
        Register(("HB", "M"), outputs, (digits(1, 0, 4),), ("0",)),
        Register(("CH",), 0, (digits(1, 0, 2),), ("0",)),
        Register(("EF",), 0, (digits(2, 1, outputs),), ("01",)),
    ]
