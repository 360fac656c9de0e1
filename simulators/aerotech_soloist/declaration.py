"""How a Soloist stands in a rig: as an Ensemble does."""

from __future__ import annotations

from simulators.aerotech_ensemble.declaration import FAULTS, columns
from simulators.aerotech_soloist.instrument import SimulatedSoloist
from simulators.aerotech_soloist.settings import SoloistSimulatorSettings
from simulators.declaration import SimulatorDeclaration, Site, Spec


def _build(spec: Spec, site: Site, settings: SoloistSimulatorSettings) -> SimulatedSoloist:
    return SimulatedSoloist(site.clock, site.axis(spec.role), site.trigger, settings, site.tap)


SIMULATOR = SimulatorDeclaration(SoloistSimulatorSettings, _build, FAULTS, columns=columns)
