"""How an Ensemble stands in a rig: its capture input hears the trigger line."""

from __future__ import annotations

from simulators.aerotech_ensemble.instrument import SimulatedEnsemble
from simulators.aerotech_ensemble.settings import EnsembleSimulatorSettings
from simulators.declaration import STAGE_FAULTS, SimulatorDeclaration, Site, Spec, position_columns


def _build(spec: Spec, site: Site, settings: EnsembleSimulatorSettings) -> SimulatedEnsemble:
    named = settings.model_copy(update={"axis": spec.settings.get("axis", settings.axis)})
    return SimulatedEnsemble(site.clock, site.axis(spec.role), site.trigger, named, site.tap)


def columns(_: Spec) -> dict[str, str]:
    """The column of a run that its position fills."""
    return position_columns("stage_x_mm")


FAULTS = STAGE_FAULTS | {"air_lost", "wrong_unit", "missing_edges", "clock_drift"}
SIMULATOR = SimulatorDeclaration(EnsembleSimulatorSettings, _build, FAULTS, columns=columns)
