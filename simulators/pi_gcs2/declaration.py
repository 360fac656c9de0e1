"""How a PI controller stands in a rig: with one axis."""

from __future__ import annotations

from simulators.declaration import SimulatorDeclaration, Site, Spec, position_columns
from simulators.pi_gcs2.controller import SimulatedGcs2
from simulators.pi_gcs2.settings import Gcs2SimulatorSettings


def _build(spec: Spec, site: Site, settings: Gcs2SimulatorSettings) -> SimulatedGcs2:
    named = settings.model_copy(update={"axis": spec.settings.get("axis", settings.axis)})
    return SimulatedGcs2(site.clock, site.axis(spec.role), named, site.tap)


SIMULATOR = SimulatorDeclaration(
    Gcs2SimulatorSettings,
    _build,
    frozenset({"power_cycle", "following_error"}),
    columns=lambda _: position_columns("theta_deg"),
)
