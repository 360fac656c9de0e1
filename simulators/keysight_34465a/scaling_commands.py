"""What the meter makes of a reading before it is kept: CALCulate:SCALe, of its functions only M x - B, and SMOothing.

Smoothing after the Truevolt Series Operating and Service Guide, CALCulate:SMOothing (34465A and 34470A).
"""

from __future__ import annotations

from simulators.keysight_34465a.meter import Meter
from simulators.keysight_34465a.stored import stored
from simulators.scpi import Boolean, Choice, Command, Number, ScpiError, setting

LARGEST = 1e15


def scaling_commands(meter: Meter) -> tuple[Command, ...]:
    """The function, its two numbers, and whether it is on; a function has to be chosen first."""

    def switch(on: bool) -> None:
        if on and not meter.configuration.scaling_function:
            raise ScpiError(-221)
        meter.configuration.scaling = on

    switched = stored(meter, "scaling", measurement=False)[0], switch
    function, gain, offset = (
        stored(meter, f"scaling_{name}", measurement=False) for name in ("function", "gain", "offset")
    )
    response = stored(meter, "smoothing_response", measurement=False)
    return (
        *setting("CALCulate:SCALe[:STATe]", Boolean(), *switched),
        *setting("CALCulate:SCALe:FUNCtion", Choice(("SCALe",)), *function),
        *setting("CALCulate:SCALe:GAIN", Number(-LARGEST, LARGEST, 1.0), *gain),
        *setting("CALCulate:SCALe:OFFSet", Number(-LARGEST, LARGEST, 0.0), *offset),
        *setting("CALCulate:SMOothing[:STATe]", Boolean(), *stored(meter, "smoothing", measurement=False)),
        *setting("CALCulate:SMOothing:RESPonse", Choice(("SLOW", "MEDium", "FAST")), *response),
    )
