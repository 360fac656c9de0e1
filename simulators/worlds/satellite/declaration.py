"""How a satellite stands in a rig: it is its world, and its driver talks with that."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict

from simulators.declaration import SimulatorDeclaration, Site, Spec
from simulators.faults.telemetry import FaultyTelemetry
from simulators.worlds.satellite.world import Satellite


class NoSettings(BaseModel):
    """A satellite is what its world says."""

    model_config = ConfigDict(frozen=True, extra="forbid")


def _build(spec: Spec, site: Site, settings: NoSettings) -> Any:
    del settings
    world: Any = site.bench.world
    if not isinstance(world, Satellite):
        raise ValueError(  # noqa: TRY004 - a value of the rig file is wrong
            f'a {spec.kind} needs a world of its own; write world.kind = "drag-free-satellite"'
        )
    if spec.faults:
        return FaultyTelemetry(site.bench.world, site.plan, site.clock, site.tap)
    world.tap = site.tap
    return world


SIMULATOR = SimulatorDeclaration(NoSettings, _build, frozenset({"saturation", "stuck"}), wired=False)
