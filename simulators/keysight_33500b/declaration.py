"""How a generator stands in a rig: it drives inputs of the world."""

from __future__ import annotations

from simulators.declaration import SimulatorDeclaration, Site, Spec
from simulators.keysight_33500b.instrument import Simulated33500B
from simulators.keysight_33500b.settings import GeneratorSettings

USUAL_OUTPUTS = {"dm1_y_v": 1, "dm1_z_v": 2}
"""What a generator drives unless the rig file says otherwise."""


def _outputs(spec: Spec) -> dict[str, int]:
    """What a source drives, by input of the world; a spare drives nothing."""
    return spec.numbered("outputs", USUAL_OUTPUTS) if spec.role == "source" else {}


def _build(spec: Spec, site: Site, settings: GeneratorSettings) -> Simulated33500B:
    outputs = _outputs(spec)
    if unknown := set(outputs) - set(site.bench.inputs):
        names = ", ".join(site.bench.inputs) or "none"
        raise ValueError(f"nothing is driven by '{min(unknown)}' in this world; inputs are: {names}")
    lines = {number: site.bench.inputs[name] for name, number in outputs.items()}
    return Simulated33500B(site.clock, lines, settings, site.tap)


SIMULATOR = SimulatorDeclaration(
    GeneratorSettings,
    _build,
    frozenset({"power_cycle", "clock_drift"}),
    columns=lambda spec: {str(output): name for name, output in _outputs(spec).items()},
)
