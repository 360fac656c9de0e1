"""What the meter is set to, and what follows from it: integration, resolution, shortest sample interval."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from simulators.keysight_34465a.settings import MeterSettings

RANGES_V = (0.1, 1.0, 10.0, 100.0, 1000.0)
OVERLOAD_V = (0.12, 1.2, 12.0, 120.0, 1050.0)
"""Readings beyond these are overloads: 120 % of the range, 1050 V on the highest."""

RESOLUTION_BY_NPLC = {
    0.001: 30e-6,
    0.002: 15e-6,
    0.006: 6e-6,
    0.02: 3e-6,
    0.06: 1.5e-6,
    0.2: 0.7e-6,
    1.0: 0.3e-6,
    10.0: 0.1e-6,
    100.0: 0.03e-6,
}
"""Parts of range that an integration time resolves (the maker's resolution table, as qcodes 0.58 has it)."""

TIMER_OVERHEAD_S = 1e-4
"""Between two readings, except when digitising, which has no gaps at 20 us (50 000 readings per second)."""
RANGE_CHANGE_S = 20e-3
TIMER_MAXIMUM_S = 3600.0


@dataclass
class Integration:
    """How long one reading integrates, in power-line cycles or in seconds."""

    nplc: float = 10.0
    aperture_s: float = 0.2
    aperture_enabled: bool = False
    autozero: bool = True


@dataclass
class Configuration:
    """The state of all settings after *RST; CONFigure puts most of them back."""

    settings: MeterSettings
    function: str = "VOLT"
    range_v: float = 10.0
    autorange: bool = True
    asked_resolution_v: float | None = None
    impedance_auto: bool = False
    integrations: dict[str, Integration] = field(
        default_factory=lambda: {"VOLT": Integration(), "TEMP": Integration()}
    )
    probe: str = "FRTD"
    reference_ohm: float = 100.0
    temperature_unit: str = "C"
    trigger_source: str = "IMM"
    trigger_count: float = 1.0
    trigger_delay_s: float | None = None
    trigger_slope: str = "NEG"
    trigger_level_v: float = 0.0
    output_slope: str = "NEG"
    sample_source: str = "IMM"
    sample_count: float = 1.0
    timer_s: float = 1.0
    data_format: str = "ASC"
    byte_order: str = "NORM"
    scaling: bool = False
    scaling_function: str = ""
    scaling_gain: float = 1.0
    scaling_offset: float = 0.0
    smoothing: bool = False
    smoothing_response: str = "FAST"
    display: bool = True
    display_text: str = ""
    label: str = ""
    beeper: bool = True

    def preset_triggering(self) -> None:
        """What CONFigure and MEASure? put back."""
        self.trigger_source, self.trigger_count, self.trigger_delay_s = "IMM", 1.0, None
        self.sample_source, self.sample_count = "IMM", 1.0

    @property
    def aperture_minimum_s(self) -> float:
        """The shortest integration: 20 us when digitising."""
        return 20e-6 if self.settings.digitizes else 300e-6

    @property
    def aperture_maximum_s(self) -> float:
        """100 power-line cycles."""
        return 2.0 if self.settings.line_frequency_hz == 50 else 1.67

    @property
    def nplc_choices(self) -> tuple[float, ...]:
        """The integration times in power-line cycles."""
        return tuple(n for n in RESOLUTION_BY_NPLC if n >= 0.02 or self.settings.digitizes)

    @property
    def integration_s(self) -> float:
        """Of the present function."""
        integration = self.integrations[self.function]
        if integration.aperture_enabled:
            return integration.aperture_s
        return integration.nplc / self.settings.line_frequency_hz

    @property
    def interval_s(self) -> float:
        """The shortest time from one reading to the next without a range change."""
        integration_s = self.integration_s
        overhead_s = 0.0 if integration_s < 300e-6 else TIMER_OVERHEAD_S
        # Autozero measures zero beside each reading, for as long.
        return (integration_s + overhead_s) * (2 if self.integrations[self.function].autozero else 1)

    @property
    def timer_minimum_s(self) -> float:
        """The recommended shortest sample interval: room for one range change where there may be one."""
        ranging = self.function == "VOLT" and self.autorange
        return self.interval_s + (RANGE_CHANGE_S if ranging else 0.0)

    @property
    def period_s(self) -> float:
        """From one sample to the next: never shorter than the meter can."""
        return max(self.timer_s, self.interval_s) if self.sample_source == "TIM" else self.interval_s

    def resolution_v(self, range_v: float) -> float:
        """The least step on a range with the present integration time."""
        cycles = self.integration_s * self.settings.line_frequency_hz
        fitting = [n for n in RESOLUTION_BY_NPLC if n <= cycles * (1 + 1e-9)]
        return RESOLUTION_BY_NPLC[max(fitting, default=0.001)] * range_v


def next_choice(choices: tuple[float, ...], value: float) -> float:
    """The smallest choice that is not below `value`; the largest when there is none."""
    return next((c for c in choices if c >= value or math.isclose(c, value)), choices[-1])
