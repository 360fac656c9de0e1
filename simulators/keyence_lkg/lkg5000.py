"""The second generation: LK-G5000, up to twelve outputs, numbers of two digits."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

from simulators.clock import SimulationClock
from simulators.keyence_lkg.controller import Command, Controller
from simulators.keyence_lkg.faults import Fault, Refused
from simulators.keyence_lkg.model import LkgSettings, Model, common_registers
from simulators.keyence_lkg.registers import Register, digits, number, switch, whole
from simulators.measured import Tap, unheard
from simulators.wiring import Signal, TriggerLine

MODEL = Model(
    kind="keyence-lkg5000",
    outputs=12,
    sampling_us=(2.55, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0),
    storage_shared=True,
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
    stores_all_outputs: bool = False
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
    outputs = MODEL.outputs
    choice = digits(1, 0, 9)
    zero = "+000.000"
    return [
        *common_registers(MODEL, settings),
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
