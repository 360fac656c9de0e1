"""How a 3458A stands in a rig: it gives the trigger edges or hears them."""

from __future__ import annotations

import numpy as np

from simulators.declaration import SimulatorDeclaration, Site, Spec
from simulators.keysight_3458a.instrument import Simulated3458A
from simulators.keysight_3458a.settings import Meter3458ASimulatorSettings


def _channel(spec: Spec) -> str:
    return str(spec.settings.get("channel", "accel_v"))


def _build(spec: Spec, site: Site, settings: Meter3458ASimulatorSettings) -> Simulated3458A:
    paces, measures = spec.role == "readout", spec.role in ("readout", "voltmeter")
    return Simulated3458A(
        site.clock,
        # Terminals that are shorted, where it has no part in the experiment.
        site.signal(site.bench.volts(_channel(spec)) if measures else np.zeros_like),
        trigger_out=site.pace if paces else None,
        trigger_in=None if paces else site.trigger,
        settings=settings,
        tap=site.tap,
    )


SIMULATOR = SimulatorDeclaration(
    Meter3458ASimulatorSettings,
    _build,
    frozenset({"power_cycle", "saturation", "clock_drift"}),
    columns=lambda spec: {"VOLT": _channel(spec)},
)
