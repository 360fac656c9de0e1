"""What a generator's front panel shows and sounds: nothing of it reaches the outputs."""

from __future__ import annotations

from dataclasses import dataclass

from simulators.scpi import Boolean, Command, Text, setting


@dataclass
class _Panel:
    display: bool = True
    text: str = ""
    beeper: bool = True


def panel_commands() -> tuple[Command, ...]:
    """Display and beeper; *RST leaves them as they are."""
    panel = _Panel()

    def show(text: str) -> None:
        panel.text = text

    return (
        *setting("DISPlay[:STATe]", Boolean(), lambda: panel.display, lambda on: setattr(panel, "display", on)),
        *setting("DISPlay:TEXT[:DATA]", Text(), lambda: panel.text, show),
        Command("DISPlay:TEXT:CLEar", lambda: show("")),
        Command("SYSTem:BEEPer[:IMMediate]", lambda: None),
        *setting("SYSTem:BEEPer:STATe", Boolean(), lambda: panel.beeper, lambda on: setattr(panel, "beeper", on)),
    )
