"""A whole simulated rig: instruments on one world, wired as a rig file says."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel, ValidationError

from rigctl.errors import LinkLost
from simulators.aerotech_ensemble import EnsembleSimulatorSettings, SimulatedEnsemble
from simulators.benches import BENCHES, Bench
from simulators.clock import SimulationClock
from simulators.faults import FaultPlan, FaultyInstrument
from simulators.faults.signals import FaultySensor, LossyTrigger
from simulators.faults.telemetry import FaultyTelemetry
from simulators.keyence_lkg import Lkg3001Settings, Lkg5000Settings, SimulatedLkg3001, SimulatedLkg5000
from simulators.keysight_33500b import GeneratorSettings, Simulated33500B
from simulators.keysight_34465a import MeterSettings, Simulated34465A
from simulators.measured import Measured, Tap, into_file
from simulators.motion import MotionAxis
from simulators.newport_esp301 import Esp301SimulatorSettings, SimulatedEsp301
from simulators.newport_xps import SimulatedXps, XpsSimulatorSettings
from simulators.wiring import Connection, FloatArray, Signal, SimulatedInstrument, TriggerLine
from simulators.worlds.satellite.world import Satellite

SATELLITE = "drag-free-satellite"
"""An instrument without a wire: it is its world, and its driver talks with that."""

GENERATOR_OUTPUTS = {"dm1_y_v": 1, "dm1_z_v": 2}
"""What a generator drives unless the rig file says otherwise."""


@dataclass(frozen=True)
class Spec:
    """One instrument as the rig file has it: `settings` are the driver's keys, `simulator` the simulator's own."""

    kind: str
    role: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    simulator: Mapping[str, Any] = field(default_factory=dict)
    faults: Mapping[str, Any] = field(default_factory=dict)
    serial: bool = False
    """At the end of a serial line, or of a network."""


class TableError(ValueError):
    """A table of the rig file that `model` does not accept; `cause` says why."""

    def __init__(self, table: str, model: type[BaseModel], cause: ValidationError) -> None:
        super().__init__(f"{table}: {cause}")
        self.table = table
        self.model = model
        self.cause = cause


class LockedInstrument:
    """An instrument for clients in this process, whichever thread they are in: one at a time, as its clock wants."""

    def __init__(self, inner: SimulatedInstrument, clock: SimulationClock) -> None:
        self._inner = inner
        self._clock = clock

    def connect(self, send: Callable[[bytes], None]) -> LockedConnection:
        """Serve one more client."""
        with self._clock.lock:
            if not getattr(self._inner, "listening", True):
                raise LinkLost(f"{self._inner.kind} (simulated): connection refused; check power, cable and address")
            return LockedConnection(self._inner.connect(send), self._clock)


class LockedConnection:
    """One client's end of a `LockedInstrument`."""

    def __init__(self, inner: Connection, clock: SimulationClock) -> None:
        self._inner = inner
        self._clock = clock

    @property
    def hung_up(self) -> bool:
        """True once the instrument has ended the connection."""
        return bool(getattr(self._inner, "hung_up", False))

    def receive(self, data: bytes) -> None:
        """Take bytes from the client."""
        with self._clock.lock:
            self._inner.receive(data)

    def close(self) -> None:
        """The client has gone."""
        with self._clock.lock:
            self._inner.close()


@dataclass(frozen=True)
class Site:
    """Where an instrument stands: what hears it, what may go wrong, and the trigger line as it reaches it."""

    tap: Tap
    plan: FaultPlan
    pace: TriggerLine

    @property
    def trigger(self) -> TriggerLine:
        """The line with the pulses of the pacing instrument."""
        missing = self.plan.missing_edges
        return self.pace if missing is None else LossyTrigger(self.pace, missing, self.plan.seed, self.tap)

    def signal(self, signal: Signal) -> Signal:
        """A quantity of the world as its sensor gives it."""
        plan = self.plan
        spoilt = plan.stuck or plan.saturation or plan.target_lost
        return FaultySensor(plan, self.tap).of(signal) if spoilt else signal


class SimulatedRig:
    """Instruments by name; `TableError` or another `ValueError` for settings that make no sense."""

    def __init__(self, specs: Mapping[str, Spec], world: Mapping[str, Any], clock: SimulationClock) -> None:
        self.clock = clock
        self.measured = Measured()
        """What the instruments really measure, for who wants to hear it."""
        world = self._heard_by_file(world)
        self._pace = TriggerLine()
        self.bench = _bench(world, clock, self._pace)
        self._meters: list[Simulated34465A] = []
        wired = {name: spec for name, spec in specs.items() if spec.kind != SATELLITE}
        if len(wired) < len(specs) and not isinstance(self.world, Satellite):
            raise ValueError(f'a {SATELLITE} needs a world of its own; write world.kind = "{SATELLITE}"')
        self.instruments = {name: self._build(name, spec) for name, spec in wired.items()}
        self.ground_segments = {name: self._ground_segment(name, specs[name]) for name in set(specs) - set(wired)}

    @property
    def nature(self) -> Any:
        """The settings of the world, for those who look behind it."""
        return self.bench.nature

    @property
    def world(self) -> Any:
        """The world itself."""
        return self.bench.world

    def operate(self, action: Mapping[str, Any]) -> float:
        """Do what an operator's hands do; returns the rig time at which it is done.

        `{"run": n}`, `{"clock": at_s}` (as late as a world that went away) and `{"stands": true}` (nothing, for its
        answer) on every bench; on the sensing-axis bench `{"remount": {"axis", "configuration", "mounting"}}`,
        `{"level": true}`, `{"level": {"at_s", "angle_deg"}}` and `{"room": {"temperature_c"}}`, on the platform
        `{"flip": sign}` and the room; else `ValueError`.
        """
        match dict(action):
            case {"run": int(number)}:
                self.measured.run = number
                self.bench.announce_run(number)
                for index, meter in enumerate(self._meters):
                    meter.key_noise(self.bench.seed, index, number)
                return self.clock.now_s()
            case {"clock": int() | float() as at_s} if math.isfinite(at_s):
                self.clock.go_on_from(at_s)
                return self.clock.now_s()
            case {"stands": True}:
                return self.clock.now_s()
            case _:
                return self.bench.operate(action)

    def request(self, action: dict[str, Any]) -> dict[str, Any]:
        """`operate`, and wait until it is done: the operator's hands in this process."""
        with self.clock.lock:
            try:
                done_s = self.operate(action)
            except ValueError as error:
                return {"error": str(error)}
            answer = self.answer(done_s)
        self.clock.sleep_s(done_s - self.clock.now_s())
        return {"done": True, **answer}

    def answer(self, done_s: float) -> dict[str, Any]:
        """What is told of an action that is done at `done_s`: that, and what hands have made so far."""
        return {"rig_time_s": done_s, "stands": self.bench.stands()}

    def _build(self, name: str, spec: Spec) -> SimulatedInstrument:
        if spec.kind not in _KINDS:
            raise ValueError(f"no simulator for {spec.kind}; there are {', '.join(_KINDS)}")
        build, model = _KINDS[spec.kind]
        settings = _checked(model, spec.simulator, f"instruments.{name}.simulator")
        plan = _plan(name, spec)
        if plan.clock_drift is not None:
            ppm = getattr(settings, "clock_ppm", 0.0) + plan.clock_drift.ppm
            settings = settings.model_copy(update={"clock_ppm": ppm})
        tap = self.measured.tap(name, _columns(spec))
        instrument = build(self, spec, settings, Site(tap, plan, self._pace))
        if isinstance(instrument, Simulated34465A):
            self._meters.append(instrument)
        if not spec.faults:
            return instrument
        return FaultyInstrument(instrument, plan, self.clock, serial=spec.serial, tap=tap)

    def _heard_by_file(self, world: Mapping[str, Any]) -> dict[str, Any]:
        """The world without the key that says where to keep what was measured."""
        nature = dict(world)
        file = nature.pop("measured", None)
        if file is not None:
            try:
                self.measured.listen(into_file(Path(str(file))))
            except OSError as error:
                raise ValueError(f"world.measured: cannot write {file} ({error}); name another file") from None
        return nature

    def _ground_segment(self, name: str, spec: Spec) -> Any:
        """A satellite as its driver finds it."""
        plan, tap = _plan(name, spec), self.measured.tap(name)
        if spec.faults:
            return FaultyTelemetry(self.world, plan, self.clock, tap)
        self.world.tap = tap
        return self.world

    def _axis(self, role: str) -> MotionAxis:
        """The world's axis of this role; an instrument that has no part in the experiment moves its own."""
        return self.bench.axes.get(role) or MotionAxis()

    def _xps(self, spec: Spec, settings: XpsSimulatorSettings, site: Site) -> SimulatedInstrument:
        group, positioner = spec.settings.get("group", "Group1"), spec.settings.get("positioner", "Pos")
        return SimulatedXps(self.clock, {group: {positioner: self._axis(spec.role)}}, settings, site.tap)

    def _esp301(self, spec: Spec, settings: Esp301SimulatorSettings, site: Site) -> SimulatedInstrument:
        return SimulatedEsp301(self.clock, [self._axis(spec.role)], settings, site.tap)

    def _ensemble(self, spec: Spec, settings: EnsembleSimulatorSettings, site: Site) -> SimulatedInstrument:
        named = settings.model_copy(update={"axis": spec.settings.get("axis", settings.axis)})
        return SimulatedEnsemble(self.clock, self._axis(spec.role), site.trigger, named, site.tap)

    def _lkg3001(self, spec: Spec, settings: Lkg3001Settings, site: Site) -> SimulatedInstrument:
        return SimulatedLkg3001(self.clock, self._heads(spec, site), site.trigger, settings, site.tap)

    def _lkg5000(self, spec: Spec, settings: Lkg5000Settings, site: Site) -> SimulatedInstrument:
        return SimulatedLkg5000(self.clock, self._heads(spec, site), site.trigger, settings, site.tap)

    def _meter(self, spec: Spec, settings: MeterSettings, site: Site) -> SimulatedInstrument:
        paces, measures = spec.role == "readout", spec.role in ("readout", "voltmeter")
        return Simulated34465A(
            self.clock,
            site.signal(self.bench.volts(spec.settings.get("channel", "accel_v")) if measures else _nothing),
            site.signal(self.bench.temperature_c),
            trigger_out=self._pace if paces else None,
            trigger_in=None if paces else site.trigger,
            settings=settings,
            tap=site.tap,
        )

    def _generator(self, spec: Spec, settings: GeneratorSettings, site: Site) -> SimulatedInstrument:
        outputs = _outputs(spec)
        if unknown := set(outputs) - set(self.bench.inputs):
            there = ", ".join(self.bench.inputs) or "none"
            raise ValueError(f"nothing is driven by '{min(unknown)}' in this world; inputs are: {there}")
        lines = {number: self.bench.inputs[name] for name, number in outputs.items()}
        return Simulated33500B(self.clock, lines, settings, site.tap)

    def _heads(self, spec: Spec, site: Site) -> list[Signal]:
        """Signals by output number; an output without a head has no target."""
        heads = {output: name for name, output in _numbered(spec, "heads").items()}
        known = self.bench.heads
        return [
            site.signal(self.bench.displacement_mm(heads[output]) if heads.get(output) in known else _nothing)
            for output in range(1, max(heads, default=1) + 1)
        ]


def _columns(spec: Spec) -> dict[str, str]:
    """Columns of a run by what the instrument calls the quantity."""
    match spec.kind:
        case "aerotech-ensemble":
            return _position("stage_x_mm")
        case "newport-xps" | "newport-esp301":
            return _position("theta_deg")
        case "keysight-34465a":
            return {"VOLT": spec.settings.get("channel", "accel_v"), "TEMP": "temperature_c"}
        case _:
            return {str(output): name for name, output in {**_numbered(spec, "heads"), **_outputs(spec)}.items()}


def _position(column: str) -> dict[str, str]:
    return {"position": column, "true position": f"true {column}"}


def _numbered(spec: Spec, key: str, default: Mapping[str, int] | None = None) -> dict[str, int]:
    return {name: int(number) for name, number in dict(spec.settings.get(key, default or {})).items()}


def _outputs(spec: Spec) -> dict[str, int]:
    """What a source drives, by input of the world."""
    return _numbered(spec, "outputs", GENERATOR_OUTPUTS) if spec.role == "source" else {}


def _plan(name: str, spec: Spec) -> FaultPlan:
    plan = _checked(FaultPlan, spec.faults, f"instruments.{name}.faults")
    why_not = plan.unsupported(spec.kind, serial=spec.serial)
    if why_not:
        raise ValueError(f"instruments.{name}.faults.{why_not}")
    return plan


def _bench(world: Mapping[str, Any], clock: SimulationClock, pace: TriggerLine) -> Bench:
    kind = world.get("kind", "sensing-axis")
    if kind not in BENCHES:
        raise ValueError(f"world.kind '{kind}' is unknown; one of {', '.join(BENCHES)}")
    model, bench = BENCHES[kind]
    return bench(_checked(model, world, "world"), clock, pace)


def _nothing(times_s: FloatArray) -> FloatArray:
    return np.full_like(times_s, np.nan)


Settings = TypeVar("Settings", bound=BaseModel)


def _checked(model: type[Settings], data: Mapping[str, Any], table: str) -> Settings:
    try:
        return model.model_validate(dict(data))
    except ValidationError as error:
        raise TableError(table, model, error) from None


_Build = Callable[[SimulatedRig, Spec, Any, Site], SimulatedInstrument]

_KINDS: dict[str, tuple[_Build, type[BaseModel]]] = {
    "newport-xps": (SimulatedRig._xps, XpsSimulatorSettings),
    "newport-esp301": (SimulatedRig._esp301, Esp301SimulatorSettings),
    "aerotech-ensemble": (SimulatedRig._ensemble, EnsembleSimulatorSettings),
    "keyence-lkg3001": (SimulatedRig._lkg3001, Lkg3001Settings),
    "keyence-lkg5000": (SimulatedRig._lkg5000, Lkg5000Settings),
    "keysight-34465a": (SimulatedRig._meter, MeterSettings),
    "keysight-33500b": (SimulatedRig._generator, GeneratorSettings),
}
