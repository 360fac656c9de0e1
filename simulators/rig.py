"""A whole simulated rig: instruments on one world, wired as a rig file says."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from rigctl.core.errors import ConfigError, LinkLost
from simulators.benches import WORLDS, Bench
from simulators.clock import SimulationClock
from simulators.declaration import DrawsNoise, Site, Spec
from simulators.faults import FaultPlan, FaultyInstrument
from simulators.measured import Measured, into_file
from simulators.wiring import Connection, SimulatedInstrument, TriggerLine


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


class SimulatedRig:
    """Instruments by name; `TableError` or another `ValueError` for settings that make no sense."""

    def __init__(self, specs: Mapping[str, Spec], world: Mapping[str, Any], clock: SimulationClock) -> None:
        self.clock = clock
        self.measured = Measured()
        """What the instruments really measure, for who wants to hear it."""
        world = self._heard_by_file(world)
        self._pace = TriggerLine()
        self.bench = _bench(world, clock, self._pace)
        self._noisy: list[DrawsNoise] = []
        built = {name: self._build(name, spec) for name, spec in specs.items()}
        wireless = {name for name, spec in specs.items() if not spec.declaration.wired}
        self.instruments: dict[str, SimulatedInstrument] = {n: each for n, each in built.items() if n not in wireless}
        self.ground_segments: dict[str, Any] = {name: built[name] for name in wireless}
        """What has no wire, as its driver finds it."""

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
                for index, meter in enumerate(self._noisy):
                    # By the meter's place and the run's number: a resumed campaign meets the same noise.
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
        # Outside the lock, or nobody could be served while the hands are at work.
        self.clock.sleep_s(done_s - self.clock.now_s())
        return {"done": True, **answer}

    def answer(self, done_s: float) -> dict[str, Any]:
        """What is told of an action that is done at `done_s`: that, and what hands have made so far."""
        return {"rig_time_s": done_s, "stands": self.bench.stands()}

    def _build(self, name: str, spec: Spec) -> Any:
        declared = spec.declaration
        settings = _checked(declared.settings, spec.simulator, f"instruments.{name}.simulator")
        plan = _plan(name, spec)
        if plan.clock_drift is not None:
            # On top of what the instrument has anyway.
            ppm = getattr(settings, "clock_ppm", 0.0) + plan.clock_drift.ppm
            settings = settings.model_copy(update={"clock_ppm": ppm})
        tap = self.measured.tap(name, declared.columns(spec))
        instrument = declared.build(spec, Site(tap, plan, self._pace, self.clock, self.bench), settings)
        if isinstance(instrument, DrawsNoise):
            self._noisy.append(instrument)
        # What has no wire suffers its faults itself.
        if not spec.faults or not declared.wired:
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


def _plan(name: str, spec: Spec) -> FaultPlan:
    plan = _checked(FaultPlan, spec.faults, f"instruments.{name}.faults")
    why_not = plan.unsupported(spec.kind, spec.declaration.possible_faults(serial=spec.serial))
    if why_not:
        raise ValueError(f"instruments.{name}.faults.{why_not}")
    return plan


def _bench(world: Mapping[str, Any], clock: SimulationClock, pace: TriggerLine) -> Bench:
    kind = world.get("kind", "sensing-axis")
    if kind not in WORLDS.names():
        raise ValueError(f"world.kind '{kind}' is unknown; one of {', '.join(WORLDS.names())}")
    try:
        declared = WORLDS.get(kind)
    except ConfigError as error:
        raise ValueError(f"world.kind: {error}") from None
    return declared.build(_checked(declared.settings, world, "world"), clock, pace)


Settings = TypeVar("Settings", bound=BaseModel)


def _checked(model: type[Settings], data: Mapping[str, Any], table: str) -> Settings:
    try:
        return model.model_validate(dict(data))
    except ValidationError as error:
        raise TableError(table, model, error) from None
