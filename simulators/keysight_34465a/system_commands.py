"""Who the meter is, and its front panel."""

from __future__ import annotations

from simulators.keysight_34465a.meter import Meter
from simulators.keysight_34465a.settings import MeterSettings
from simulators.keysight_34465a.stored import stored
from simulators.scpi import Boolean, Command, Text, setting


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
    )
