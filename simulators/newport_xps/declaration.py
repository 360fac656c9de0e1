"""How an XPS stands in a rig: one positioner in a group of its own."""

from __future__ import annotations

from simulators.declaration import STAGE_FAULTS, SimulatorDeclaration, Site, Spec, position_columns
from simulators.newport_xps.controller import SimulatedXps
from simulators.newport_xps.settings import XpsSimulatorSettings


def _build(spec: Spec, site: Site, settings: XpsSimulatorSettings) -> SimulatedXps:
    group, positioner = spec.settings.get("group", "Group1"), spec.settings.get("positioner", "Pos")
    return SimulatedXps(site.clock, {group: {positioner: site.axis(spec.role)}}, settings, site.tap)


SIMULATOR = SimulatorDeclaration(
    XpsSimulatorSettings, _build, STAGE_FAULTS, columns=lambda _: position_columns("theta_deg")
)
