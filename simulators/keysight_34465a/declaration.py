"""How a meter stands in a rig: it gives the trigger pulses or hears them, and measures volts or degrees."""

from __future__ import annotations

from simulators.declaration import SimulatorDeclaration, Site, Spec, nothing
from simulators.keysight_34465a.instrument import Simulated34465A
from simulators.keysight_34465a.settings import MeterSettings


def _channel(spec: Spec) -> str:
    return str(spec.settings.get("channel", "accel_v"))


def _build(spec: Spec, site: Site, settings: MeterSettings) -> Simulated34465A:
    paces, measures = spec.role == "readout", spec.role in ("readout", "voltmeter")
    return Simulated34465A(
        site.clock,
        site.signal(site.bench.volts(_channel(spec)) if measures else nothing),
        site.signal(site.bench.temperature_c),
        trigger_out=site.pace if paces else None,
        trigger_in=None if paces else site.trigger,
        settings=settings,
        tap=site.tap,
    )


SIMULATOR = SimulatorDeclaration(
    MeterSettings,
    _build,
    frozenset({"power_cycle", "saturation", "stuck", "missing_edges", "clock_jump", "clock_drift"})
    | {"memory_overflow", "wrong_unit"},
    columns=lambda spec: {"VOLT": _channel(spec), "TEMP": "temperature_c"},
)
