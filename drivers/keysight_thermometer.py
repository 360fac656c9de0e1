"""A Keysight 34465A as a thermometer."""

from __future__ import annotations

from collections.abc import Iterator

from drivers.keysight_34465a_examined import reads
from drivers.keysight_meter import Keysight34465A
from drivers.keysight_settings import PROBES, ThermometerSettings
from drivers.transport import Connect
from rigctl.core.clock import Clock
from rigctl.core.findings import Finding
from rigctl.core.interfaces import Identity, Reading

TEMPERATURE_READING_S = 2.0
"""Longer than one reading at 10 power-line cycles with autozero and offset compensation."""


class MeterThermometer(Keysight34465A):
    """Reads a platinum probe or a thermistor."""

    def __init__(self, name: str, settings: ThermometerSettings, connect: Connect, clock: Clock) -> None:
        super().__init__(name, connect, clock, settings.link_timeout_s)
        self.settings = settings

    def _examine(self, _: Identity) -> Iterator[Finding]:
        yield reads("probe", self.temperature)

    def temperature(self) -> Reading:
        """One reading, triggered at once [degC]; NaN when the probe is open."""
        s = self.settings
        reference: tuple[str, ...] = ()
        if s.probe in ("frtd", "rtd"):
            # Only platinum has a resistance at 0 degC to be told.
            reference = (f"SENS:TEMP:TRAN:{s.probe.upper()}:RES {s.reference_ohm:g}",)
        self._configure(f"CONF:TEMP {PROBES[s.probe]}", *reference, "UNIT:TEMP C", "FORM:DATA ASC")
        return self._read_one("degC", TEMPERATURE_READING_S)
