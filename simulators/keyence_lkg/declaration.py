"""How the two controllers stand in a rig: with heads that look at the world."""

from __future__ import annotations

from collections.abc import Callable

from simulators.declaration import SimulatorDeclaration, Site, Spec, nothing
from simulators.keyence_lkg.controller import Controller
from simulators.keyence_lkg.lkg3001 import Lkg3001Settings, SimulatedLkg3001
from simulators.keyence_lkg.lkg5000 import Lkg5000Settings, SimulatedLkg5000
from simulators.keyence_lkg.model import LkgSettings
from simulators.wiring import Signal


def _heads(spec: Spec, site: Site) -> list[Signal]:
    """Signals by output number; an output without a head has no target."""
    heads = {output: name for name, output in spec.numbered("heads").items()}
    known = site.bench.heads
    return [
        site.signal(site.bench.displacement_mm(heads[output]) if heads.get(output) in known else nothing)
        for output in range(1, max(heads, default=1) + 1)
    ]


def _columns(spec: Spec) -> dict[str, str]:
    return {str(output): name for name, output in spec.numbered("heads").items()}


HEAD_FAULTS = frozenset({"power_cycle", "target_lost", "saturation", "stuck"})


def _declared(
    settings: type[LkgSettings], make: Callable[..., Controller], faults: frozenset[str]
) -> SimulatorDeclaration:
    return SimulatorDeclaration(
        settings,
        lambda spec, site, settings: make(site.clock, _heads(spec, site), site.trigger, settings, site.tap),
        faults,
        _columns,
    )


LKG3001 = _declared(Lkg3001Settings, SimulatedLkg3001, HEAD_FAULTS)
LKG5000 = _declared(Lkg5000Settings, SimulatedLkg5000, HEAD_FAULTS | {"missing_edges"})
