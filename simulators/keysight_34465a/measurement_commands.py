"""What is measured and how: function, range, resolution, integration time, probe."""

from __future__ import annotations

from typing import Any

from simulators.keysight_34465a.configuration import (
    RANGES_V,
    RESOLUTION_BY_NPLC,
    Configuration,
    Integration,
    next_choice,
)
from simulators.keysight_34465a.meter import Meter
from simulators.keysight_34465a.settings import MeterSettings
from simulators.keysight_34465a.stored import stored
from simulators.scpi import Boolean, Choice, Command, Number, OnOffOnce, ScpiError, Text, setting

ONCE = OnOffOnce()
PROBES = {"FRTD": "85", "RTD": "85", "FTH": "5000", "THER": "5000"}
"""The one type that each probe can be: alpha 0.00385, or 5 kohm at 25 degC."""
PROBE = Choice(("FRTD", "RTD", "FTHermistor", "THERmistor", "DEFault"))
VOLTAGE_RANGE = Number(RANGES_V[0], RANGES_V[-1], 10.0, unit="V")


class MeasurementCommands:
    """CONFigure and SENSe."""

    def __init__(self, meter: Meter, settings: MeterSettings) -> None:
        self._meter = meter
        self._settings = settings
        self._resolution = Number(
            lambda: self._setup.range_v * min(RESOLUTION_BY_NPLC.values()),
            lambda: self._setup.range_v,
            lambda: self._setup.range_v * RESOLUTION_BY_NPLC[10.0],
            unit="V",
        )

    def table(self) -> tuple[Command, ...]:
        """Their commands."""
        return (
            *self._function(),
            *self._voltage(),
            *self._temperature(),
            *self._integration("VOLTage[:DC]", "VOLT"),
            *self._integration("TEMPerature", "TEMP"),
        )

    @property
    def _setup(self) -> Configuration:
        return self._meter.configuration

    def _function(self) -> tuple[Command, ...]:
        return (
            Command("CONFigure?", self._configured),
            Command("CONFigure[:VOLTage]:DC", self.configure_voltage, 0, 2),
            Command("CONFigure:TEMPerature", self.configure_temperature, 0, 4),
            Command("[SENSe:]FUNCtion[:ON]?", lambda: f'"{self._setup.function}"'),
            Command("[SENSe:]FUNCtion[:ON]", self._select_function, 1),
        )

    def _configured(self) -> str:
        setup = self._setup
        if setup.function == "TEMP":
            return f'"TEMP {setup.probe},{PROBES[setup.probe]},1,{self._settings.resolution_c:+.8E}"'
        return f'"VOLT {setup.range_v:+.8E},{self._resolution_v():+.8E}"'

    def configure_voltage(self, range_v: str = "DEF", resolution_v: str = "DEF") -> None:
        """CONFigure:VOLTage:DC."""
        autorange = range_v.upper() in ("AUTO", "DEF", "DEFAULT")
        chosen_v = 10.0 if autorange else VOLTAGE_RANGE.parse(range_v)
        automatic_resolution = resolution_v.upper() in ("DEF", "DEFAULT")
        # A resolution belongs to a range; with autorange there is none to refer it to.
        if autorange and not automatic_resolution:
            raise ScpiError(-221)
        self._meter.configure("VOLT")
        self._setup.autorange, self._setup.range_v = autorange, next_choice(RANGES_V, chosen_v)
        if not automatic_resolution:
            self._set_resolution(self._resolution.parse(resolution_v))

    def configure_temperature(
        self, probe: str = "DEF", kind: str = "DEF", ones: str = "1", resolution: str = "DEF"
    ) -> None:
        """CONFigure:TEMPerature."""
        chosen = PROBE.parse(probe)
        chosen = "FRTD" if chosen == "DEF" else chosen
        if kind.upper() not in ("DEF", "DEFAULT", PROBES[chosen]):
            raise ScpiError(-224)
        if ones != "1" or resolution.upper() not in ("DEF", "MIN", "MAX"):
            raise ScpiError(-224)
        self._meter.configure("TEMP")
        self._setup.probe = chosen

    def _select_function(self, text: str) -> None:
        names = {"VOLT": "VOLT", "VOLT:DC": "VOLT", "TEMP": "TEMP"}
        name = Text().parse(text).upper().replace("VOLTAGE", "VOLT").replace("TEMPERATURE", "TEMP")
        if name not in names:
            raise ScpiError(-224)
        self._meter.change()
        self._meter.select(names[name])

    def _voltage(self) -> tuple[Command, ...]:
        node = "[SENSe:]VOLTage[:DC]"
        return (
            *setting(f"{node}:RANGe", VOLTAGE_RANGE, lambda: self._setup.range_v, self._set_range),
            *setting(f"{node}:RANGe:AUTO", ONCE, lambda: str(int(self._setup.autorange)), self._set_autorange),
            *setting(f"{node}:RESolution", self._resolution, self._resolution_v, self._set_resolution),
            *setting(f"{node}:IMPedance:AUTO", Boolean(), *stored(self._meter, "impedance_auto")),
        )

    def _set_range(self, range_v: float) -> None:
        self._meter.change()
        self._setup.range_v, self._setup.autorange = next_choice(RANGES_V, range_v), False
        self._setup.asked_resolution_v = None

    def _set_autorange(self, mode: str) -> None:
        last = self._meter.memory.last
        self._meter.change()
        if mode == "ONCE" and last is not None:
            # Ranges reach to 120 % of their name.
            self._setup.range_v = next_choice(RANGES_V, abs(last) / 1.2)
        self._setup.autorange = mode == "ON"

    def _resolution_v(self) -> float:
        return self._setup.asked_resolution_v or self._setup.resolution_v(self._setup.range_v)

    def _set_resolution(self, resolution_v: float) -> None:
        """Integrate as long as that resolution takes."""
        self._meter.change()
        setup = self._setup
        # A little more than asked for: a resolution that was read and sent back is rounded.
        fine = [n for n in setup.nplc_choices if RESOLUTION_BY_NPLC[n] * setup.range_v <= resolution_v * 1.0001]
        integration = setup.integrations["VOLT"]
        integration.nplc, integration.aperture_enabled = fine[0], False
        setup.asked_resolution_v = resolution_v

    def _integration(self, node: str, function: str) -> tuple[Command, ...]:
        setup = self._setup

        def now() -> Integration:
            return self._setup.integrations[function]

        def put(**fields: Any) -> None:
            self._meter.change()
            self._setup.asked_resolution_v = None
            for name, value in fields.items():
                setattr(now(), name, value)

        nplc = Number(setup.nplc_choices[0], 100.0, 10.0)
        aperture = Number(setup.aperture_minimum_s, setup.aperture_maximum_s, 0.1, unit="S")
        return (
            *setting(
                f"[SENSe:]{node}:NPLC",
                nplc,
                lambda: now().nplc,
                lambda value: put(nplc=next_choice(setup.nplc_choices, value), aperture_enabled=False),
            ),
            *setting(
                f"[SENSe:]{node}:APERture",
                aperture,
                lambda: now().aperture_s,
                lambda value: put(aperture_s=value, aperture_enabled=True),
            ),
            *setting(
                f"[SENSe:]{node}:APERture:ENABled",
                Boolean(),
                lambda: now().aperture_enabled,
                lambda value: put(aperture_enabled=value),
            ),
            *setting(
                f"[SENSe:]{node}:ZERO:AUTO",
                ONCE,
                lambda: str(int(now().autozero)),
                lambda mode: put(autozero=mode == "ON"),
            ),
        )

    def _temperature(self) -> tuple[Command, ...]:
        ohms = Number(49.0, 2100.0, 100.0)
        transducer = "[SENSe:]TEMPerature:TRANsducer"
        return (
            *setting(
                f"{transducer}:{{FRTD|RTD}}:RESistance[:REFerence]", ohms, *stored(self._meter, "reference_ohm")
            ),
            *setting(f"{transducer}:TYPE", Choice(PROBE.words[:-1]), *stored(self._meter, "probe")),
            *setting("UNIT:TEMPerature", Choice(("C", "F", "K")), *stored(self._meter, "temperature_unit")),
        )
