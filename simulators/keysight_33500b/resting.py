"""What other clients ask of a generator at every snapshot (QCoDeS), and what is never changed here.

Gated bursts, other triggers than the bus's, pulses and the sync connector are not simulated: they have the values of
*RST, which may be set again; any other is a settings conflict, so that nobody takes for done what was not.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from simulators.scpi import Boolean, Choice, Command, Number, ScpiError
from simulators.scpi.commands import ParameterType

OF_AN_OUTPUT: Mapping[str, tuple[ParameterType, object]] = {
    "[SOURce<n>:]FREQuency:MODE": (Choice(("CW", "LIST", "SWEep", "FIXed")), "CW"),
    "[SOURce<n>:]FUNCtion:PULSe:WIDTh": (Number(16e-9, 1e6, 1e-4, unit="S"), 1e-4),
    "[SOURce<n>:]BURSt:MODE": (Choice(("TRIGgered", "GATed")), "TRIG"),
    "[SOURce<n>:]BURSt:GATE:POLarity": (Choice(("NORMal", "INVerted")), "NORM"),
    "[SOURce<n>:]BURSt:INTernal:PERiod": (Number(1e-6, 8e3, 1e-2, unit="S"), 1e-2),
    "TRIGger<n>:SLOPe": (Choice(("POSitive", "NEGative")), "POS"),
    "TRIGger<n>:COUNt": (Number(1.0, 1e6, 1.0), 1.0),
    "TRIGger<n>:DELay": (Number(0.0, 1e3, 0.0, unit="S"), 0.0),
    "TRIGger<n>:TIMer": (Number(1e-6, 8e3, 1.0, unit="S"), 1.0),
}
OF_THE_CONNECTOR: Mapping[str, tuple[ParameterType, object]] = {
    "OUTPut:SYNC[:STATe]": (Boolean(), True),
    "OUTPut:SYNC:SOURce": (Choice(("CH1", "CH2")), "CH1"),
}


def commands(require_output: Callable[[int], object]) -> tuple[Command, ...]:
    """Their commands; `require_output` raises for an output that does not exist."""
    table: list[Command] = []
    for header, (kind, value) in OF_AN_OUTPUT.items():
        table += _of_an_output(header, kind, value, require_output)
    for header, (kind, value) in OF_THE_CONNECTOR.items():
        table += _resting(header, kind, value)
    return tuple(table)


def _of_an_output(
    header: str, kind: ParameterType, value: object, require_output: Callable[[int], object]
) -> tuple[Command, Command]:
    def put(number: int, text: str) -> None:
        require_output(number)
        _keep(kind, value, text)

    def query(number: int) -> str:
        require_output(number)
        return kind.format(value)

    return Command(header, put, 1), Command(header + "?", query)


def _resting(header: str, kind: ParameterType, value: object) -> tuple[Command, Command]:
    return (
        Command(header, lambda text: _keep(kind, value, text), 1),
        Command(header + "?", lambda: kind.format(value)),
    )


def _keep(kind: ParameterType, value: object, text: str) -> None:
    if kind.parse(text) != value:
        raise ScpiError(-221, "not simulated")
