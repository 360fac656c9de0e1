"""What other clients ask of a generator (QCoDeS at every snapshot, PyMeasure, Auspex, lantz), and is never changed.

Gated bursts, other triggers than the bus's, modulation, sweeps, squares and pulses, limits, couplings, sync and
trigger outputs are not simulated: they have the values of *RST, which may be set again; any other is a settings
conflict, so that nobody takes for done what was not.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from simulators.scpi import Boolean, Choice, Command, Number, resting
from simulators.scpi.commands import ParameterType, require_resting

OF_AN_OUTPUT: Mapping[str, tuple[ParameterType, object]] = {
    "[SOURce<n>:]FREQuency:MODE": (Choice(("CW", "LIST", "SWEep", "FIXed")), "CW"),
    "[SOURce<n>:]FUNCtion:SQUare:DCYCle": (Number(0.01, 99.99, 50.0), 50.0),
    "[SOURce<n>:]FUNCtion:PULSe:WIDTh": (Number(16e-9, 1e6, 1e-4, unit="S"), 1e-4),
    "[SOURce<n>:]FUNCtion:PULSe:PERiod": (Number(33e-9, 1e6, 1e-3, unit="S"), 1e-3),
    "[SOURce<n>:]FUNCtion:PULSe:DCYCle": (Number(0.01, 99.99, 10.0), 10.0),
    "[SOURce<n>:]FUNCtion:PULSe:HOLD": (Choice(("WIDTh", "DCYCle")), "WIDT"),
    "[SOURce<n>:]VOLTage:RANGe:AUTO": (Boolean(), True),
    "[SOURce<n>:]VOLTage:LIMit:STATe": (Boolean(), False),
    "[SOURce<n>:]VOLTage:COUPle[:STATe]": (Boolean(), False),
    "[SOURce<n>:]FREQuency:COUPle[:STATe]": (Boolean(), False),
    "[SOURce<n>:]{AM|FM|PM|BPSK|PWM|SUM}:STATe": (Boolean(), False),
    "[SOURce<n>:]FSKey:STATe": (Boolean(), False),
    "[SOURce<n>:]SWEep:STATe": (Boolean(), False),
    "[SOURce<n>:]BURSt:MODE": (Choice(("TRIGgered", "GATed")), "TRIG"),
    "[SOURce<n>:]BURSt:GATE:POLarity": (Choice(("NORMal", "INVerted")), "NORM"),
    "[SOURce<n>:]BURSt:INTernal:PERiod": (Number(1e-6, 8e3, 1e-2, unit="S"), 1e-2),
    "TRIGger<n>:SLOPe": (Choice(("POSitive", "NEGative")), "POS"),
    "TRIGger<n>:COUNt": (Number(1.0, 1e6, 1.0), 1.0),
    "TRIGger<n>:DELay": (Number(0.0, 1e3, 0.0, unit="S"), 0.0),
    "TRIGger<n>:TIMer": (Number(1e-6, 8e3, 1.0, unit="S"), 1.0),
    "OUTPut<n>:MODE": (Choice(("NORMal", "GATed")), "NORM"),
    "OUTPut<n>:SYNC:MODE": (Choice(("NORMal", "CARRier", "MARKer")), "NORM"),
    "OUTPut<n>:SYNC:POLarity": (Choice(("NORMal", "INVerted")), "NORM"),
}
OF_THE_CONNECTOR: Mapping[str, tuple[ParameterType, object]] = {
    "OUTPut:SYNC[:STATe]": (Boolean(), True),
    "OUTPut:SYNC:SOURce": (Choice(("CH1", "CH2")), "CH1"),
    "OUTPut:TRIGger[:STATe]": (Boolean(), False),
    "OUTPut:TRIGger:SOURce": (Choice(("CH1", "CH2")), "CH1"),
    "OUTPut:TRIGger:SLOPe": (Choice(("POSitive", "NEGative")), "POS"),
    "ROSCillator:SOURce": (Choice(("INTernal", "EXTernal")), "INT"),
}


def commands(require_output: Callable[[int], object]) -> tuple[Command, ...]:
    """Their commands; `require_output` raises for an output that does not exist."""
    table: list[Command] = []
    for header, (kind, value) in OF_AN_OUTPUT.items():
        table += _of_an_output(header, kind, value, require_output)
    for header, (kind, value) in OF_THE_CONNECTOR.items():
        table += resting(header, kind, value)
    return tuple(table)


def _of_an_output(
    header: str, kind: ParameterType, value: object, require_output: Callable[[int], object]
) -> tuple[Command, Command]:
    def put(number: int, text: str) -> None:
        require_output(number)
        require_resting(kind.parse(text), value)

    def query(number: int) -> str:
        require_output(number)
        return kind.format(value)

    return Command(header, put, 1), Command(header + "?", query)
