"""How the two controllers stand in a rig: with heads that look at the world."""

from __future__ import annotations

from collections.abc import Callable

from simulators.declaration import SimulatorDeclaration, Site, Spec, nothing
from simulators.keyence_lkg.controller import Controller
from simulators.keyence_lkg.lkg3001 import Lkg3001Settings, SimulatedLkg3001
from simulators.keyence_lkg.lkg5000 import Lkg5000Settings, SimulatedLkg5000
from simulators.keyence_lkg.model import LkgSettings
from simulators.wiring import Signal, StretchedLine, TriggerLine


def _heads(spec: Spec, site: Site) -> list[Signal]:
    """Signals by output number; an output without a head has no target."""
    heads = {output: name for name, output in spec.numbered("heads").items()}
    known = site.bench.heads
    return [
        site.signal(site.bench.displacement_mm(heads[output]) if heads.get(output) in known else nothing)
        for output in range(1, max(heads, default=1) + 1)
    ]


def _timing(spec: Spec, site: Site) -> TriggerLine:
    """The line at the TIMING input, behind the pulse stretcher that the rig file says is there."""
    pulse_s = spec.settings.get("timing_pulse_s")
    return site.trigger if pulse_s is None else StretchedLine(site.trigger, float(pulse_s))


def _columns(spec: Spec) -> dict[str, str]:
    return {str(output): name for name, output in spec.numbered("heads").items()}


HEAD_FAULTS = frozenset({"power_cycle", "target_lost", "saturation", "stuck"})


def _declared(
    settings: type[LkgSettings], make: Callable[..., Controller], faults: frozenset[str]
) -> SimulatorDeclaration:
    return SimulatorDeclaration(
        settings,
        lambda spec, site, settings: make(site.clock, _heads(spec, site), _timing(spec, site), settings, site.tap),
        faults,
        _columns,
    )


LKG3001 = _declared(Lkg3001Settings, SimulatedLkg3001, HEAD_FAULTS)
LKG5000 = _declared(Lkg5000Settings, SimulatedLkg5000, HEAD_FAULTS | {"missing_edges"})
