"""How an ESP301 stands in a rig: with one axis."""

from __future__ import annotations

from simulators.declaration import STAGE_FAULTS, SimulatorDeclaration, Site, Spec, position_columns
from simulators.newport_esp301.controller import SimulatedEsp301
from simulators.newport_esp301.settings import Esp301SimulatorSettings


def _build(spec: Spec, site: Site, settings: Esp301SimulatorSettings) -> SimulatedEsp301:
    return SimulatedEsp301(site.clock, [site.axis(spec.role)], settings, site.tap)


SIMULATOR = SimulatorDeclaration(
    Esp301SimulatorSettings, _build, STAGE_FAULTS | {"wrong_unit"}, columns=lambda _: position_columns("theta_deg")
)
