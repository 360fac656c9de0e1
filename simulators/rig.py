"""A whole simulated rig: instruments on one world, wired as a rig file says."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from simulators.aerotech_ensemble import EnsembleSimulatorSettings, SimulatedEnsemble
from simulators.clock import SimulationClock
from simulators.faults import FaultPlan, FaultyInstrument
from simulators.keyence_lkg import Lkg3001Settings, Lkg5000Settings, SimulatedLkg3001, SimulatedLkg5000
from simulators.keysight_34465a import MeterSettings, Simulated34465A
from simulators.motion import MotionAxis
from simulators.newport_esp301 import Esp301SimulatorSettings, SimulatedEsp301
from simulators.newport_xps import SimulatedXps, XpsSimulatorSettings
from simulators.wiring import FloatArray, Signal, SimulatedInstrument, TriggerLine
from simulators.worlds.accelerometer_bench import AccelerometerBench
from simulators.worlds.bench_settings import BenchSettings


@dataclass(frozen=True)
class Spec:
    """One instrument as the rig file has it: `settings` are the driver's keys, `simulator` the simulator's own."""

    kind: str
    role: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    simulator: Mapping[str, Any] = field(default_factory=dict)
    faults: Mapping[str, Any] = field(default_factory=dict)


class SimulatedRig:
    """Instruments by name; raises `ValueError` (pydantic's included) for settings that make no sense."""

    def __init__(self, specs: Mapping[str, Spec], world: Mapping[str, Any], clock: SimulationClock) -> None:
        self.clock = clock
        self._rotation, self._linear, self._pace = MotionAxis(), MotionAxis(), TriggerLine()
        self.nature = BenchSettings.model_validate(world)
        self.world = AccelerometerBench(self.nature, clock, self._rotation, self._linear, self._pace)
        self._meters: list[Simulated34465A] = []
        self.instruments = {name: self._build(spec) for name, spec in specs.items()}

    def operate(self, action: Mapping[str, Any]) -> float:
        """Do what an operator's hands do; returns the rig time at which it is done.

        `{"remount": {"axis", "configuration", "mounting"}}`, `{"level": true}` or `{"run": n}`; `ValueError` otherwise.
        """
        match dict(action):
            case {"remount": {"axis": str(axis), "configuration": str(configuration), "mounting": int(number)}}:
                return self.world.remount(axis, configuration, number)
            case {"level": True}:
                return self.world.level()
            case {"run": int(number)}:
                self.world.announce_run(number)
                for index, meter in enumerate(self._meters):
                    meter.key_noise(self.nature.seed, index, number)
                return self.clock.now_s()
            case _:
                raise ValueError(f"no such action: {dict(action)}; there are remount, level and run")

    def request(self, action: dict[str, Any]) -> dict[str, Any]:
        """`operate`, and wait until it is done: the operator's hands in this process."""
        with self.clock.lock:
            try:
                done_s = self.operate(action)
            except ValueError as error:
                return {"error": str(error)}
        self.clock.sleep_s(done_s - self.clock.now_s())
        return {"done": True}

    def _build(self, spec: Spec) -> SimulatedInstrument:
        if spec.kind not in _BUILDERS:
            raise ValueError(f"no simulator for {spec.kind}; there are {', '.join(_BUILDERS)}")
        instrument = _BUILDERS[spec.kind](self, spec)
        if isinstance(instrument, Simulated34465A):
            self._meters.append(instrument)
        if spec.faults:
            return FaultyInstrument(instrument, FaultPlan.model_validate(spec.faults), self.clock)
        return instrument

    def _axis(self, role: str) -> MotionAxis:
        """The world's axis of this role; an instrument that has no part in the experiment moves its own."""
        return {"rotation": self._rotation, "linear": self._linear}.get(role) or MotionAxis()

    def _xps(self, spec: Spec) -> SimulatedInstrument:
        settings = XpsSimulatorSettings.model_validate(spec.simulator)
        group, positioner = spec.settings.get("group", "Group1"), spec.settings.get("positioner", "Pos")
        return SimulatedXps(self.clock, {group: {positioner: self._axis(spec.role)}}, settings)

    def _esp301(self, spec: Spec) -> SimulatedInstrument:
        settings = Esp301SimulatorSettings.model_validate(spec.simulator)
        return SimulatedEsp301(self.clock, [self._axis(spec.role)], settings)

    def _ensemble(self, spec: Spec) -> SimulatedInstrument:
        settings = EnsembleSimulatorSettings.model_validate(
            {"axis": spec.settings.get("axis", "X"), **spec.simulator}
        )
        return SimulatedEnsemble(self.clock, self._axis(spec.role), self._pace, settings)

    def _lkg3001(self, spec: Spec) -> SimulatedInstrument:
        settings = Lkg3001Settings.model_validate(spec.simulator)
        return SimulatedLkg3001(self.clock, self._heads(spec), self._pace, settings)

    def _lkg5000(self, spec: Spec) -> SimulatedInstrument:
        settings = Lkg5000Settings.model_validate(spec.simulator)
        return SimulatedLkg5000(self.clock, self._heads(spec), self._pace, settings)

    def _meter(self, spec: Spec) -> SimulatedInstrument:
        settings = MeterSettings.model_validate(spec.simulator)
        paces = spec.role == "readout"
        return Simulated34465A(
            self.clock,
            self.world.accelerometer_v,
            self.world.temperature_c,
            trigger_out=self._pace if paces else None,
            trigger_in=None if paces else self._pace,
            settings=settings,
        )

    def _heads(self, spec: Spec) -> list[Signal]:
        """Signals by output number; an output without a head has no target."""
        heads = {int(output): name for name, output in dict(spec.settings.get("heads", {})).items()}
        known = self.nature.lasers
        return [
            self.world.displacement_mm(heads[output]) if heads.get(output) in known else _nothing
            for output in range(1, max(heads, default=1) + 1)
        ]


def _nothing(times_s: FloatArray) -> FloatArray:
    return np.full_like(times_s, np.nan)


_BUILDERS: dict[str, Callable[[SimulatedRig, Spec], SimulatedInstrument]] = {
    "newport-xps": SimulatedRig._xps,
    "newport-esp301": SimulatedRig._esp301,
    "aerotech-ensemble": SimulatedRig._ensemble,
    "keyence-lkg3001": SimulatedRig._lkg3001,
    "keyence-lkg5000": SimulatedRig._lkg5000,
    "keysight-34465a": SimulatedRig._meter,
}
