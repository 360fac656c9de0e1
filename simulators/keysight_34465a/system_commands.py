"""Who the meter is, and its front panel."""

from __future__ import annotations

from collections.abc import Mapping

from simulators.keysight_34465a.meter import Meter
from simulators.keysight_34465a.settings import MeterSettings
from simulators.keysight_34465a.stored import stored
from simulators.scpi import Boolean, Choice, Command, Number, Text, resting, setting
from simulators.scpi.commands import ParameterType

RESTING: Mapping[str, tuple[ParameterType, object]] = {
    "CALCulate:AVERage[:STATe]": (Boolean(), False),
    "CALCulate:LIMit[:STATe]": (Boolean(), False),
    "CALCulate:TRANsform:HISTogram[:STATe]": (Boolean(), False),
    "[SENSe:]VOLTage[:DC]:NULL[:STATe]": (Boolean(), False),
    "[SENSe:]VOLTage[:DC]:NULL:VALue": (Number(-1200.0, 1200.0, 0.0, unit="V"), 0.0),
    "[SENSe:]TEMPerature:NULL[:STATe]": (Boolean(), False),
    "DISPlay:VIEW": (Choice(("NUMeric", "HISTogram", "TCHart", "METer")), "NUM"),
}
"""Statistics, limits, histogram and null are not simulated, nor what the display shows of them."""


def system_commands(meter: Meter, settings: MeterSettings) -> tuple[Command, ...]:
    """Identification, reset, display."""
    fitted = ["0", "0", *(o if o in settings.options else "0" for o in ("DIG", "MEM")), "0"]
    licences = ",".join(f'"{o}"' for o in settings.options) or '""'
    get_text, put_text = stored(meter, "display_text", measurement=False)
    return (
        Command("*IDN?", lambda: settings.identity),
        Command("*OPT?", lambda: ",".join(fitted)),
        Command("*TST?", lambda: "+0"),
        Command("*RST", meter.reset),
        Command("SYSTem:PRESet", meter.reset),
        Command("SYSTem:LICense:CATalog?", lambda: licences),
        Command("SYSTem:LFRequency?", lambda: f"{settings.line_frequency_hz:+d}"),
        Command("SYSTem:COMMunicate:TCPip:CONTrol?", lambda: f"{settings.control_port:+d}"),
        Command("ROUTe:TERMinals?", lambda: "FRON"),
        *setting("DISPlay[:STATe]", Boolean(), *stored(meter, "display", measurement=False)),
        *setting("DISPlay:TEXT[:DATA]", Text(), get_text, put_text),
        Command("DISPlay:TEXT:CLEar", lambda: put_text("")),
        Command("SYSTem:BEEPer[:IMMediate]", lambda: None),
        *setting("SYSTem:BEEPer:STATe", Boolean(), *stored(meter, "beeper", measurement=False)),
        *setting("SYSTem:LABel", Text(), *stored(meter, "label", measurement=False)),
        *(command for header, (kind, value) in RESTING.items() for command in resting(header, kind, value)),
    )
