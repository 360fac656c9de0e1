"""Opens what a rig file names, real or simulated, and brings it to rest on any exit.

The only place that brings drivers and simulators together; both are known by their declarations.
"""

from __future__ import annotations

import threading
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, NoReturn, cast

from pydantic import BaseModel

from drivers.connect import connector
from drivers.transport import Connect, InProcessTransport
from rigctl.campaign.session.operator import OperatorLink
from rigctl.campaign.session.operator_link import TcpOperatorLink
from rigctl.core.clock import Clock, RealClock
from rigctl.core.declarations import DRIVER_CONTRACT, Build, DriverDeclaration
from rigctl.core.entry_points import Registry, resolved
from rigctl.core.errors import ConfigError, LinkLost, RigError
from rigctl.core.interfaces import Identity, Instrument, Stage
from rigctl.core.making_safe import bring_to_rest, let_go, require_rest
from rigctl.files.rig_file import InstrumentTable, RigFile, read_rig
from rigctl.files.toml_files import explain, validated
from rigctl.wire_logs import WireLogs
from simulators.clock import ScaledClock, SimulationClock, VirtualClock
from simulators.declaration import SimulatorDeclaration, Spec
from simulators.rig import LockedInstrument, SimulatedRig, TableError

DRIVERS = Registry("rigctl.drivers", DriverDeclaration, DRIVER_CONTRACT, lambda declaration: declaration.kind)


@dataclass(frozen=True)
class Driver:
    """A driver's own keys, checked, and how to make it."""

    declaration: DriverDeclaration
    settings: BaseModel
    build: Build


class Rig:
    """The instruments of a rig file. Made closed; use it in `with`: everything is at rest when that begins and ends.

    `found_moving` are the stages that somebody had left moving. A rig that is not `reachable` is only asked what it
    could do: no world is behind it, and it cannot be opened.
    """

    def __init__(
        self, file: RigFile, *, seed: int | None = None, start_s: float = 0.0, reachable: bool = True
    ) -> None:
        self.file = file
        self._reachable = reachable
        drivers = drivers_of(file)
        self.simulation, self.clock = _simulate(file, seed, start_s) if reachable else (None, RealClock())
        self.wire_logs = WireLogs(file, self.clock)
        self.instruments: dict[str, Instrument] = {
            name: driver.build(name, driver.settings, self._connect(name, driver.declaration), self.clock)
            for name, driver in drivers.items()
        }
        self._one_stop_at_a_time = threading.RLock()
        self._stops = 0
        self.found_moving: tuple[str, ...] = ()
        self.operator_link: OperatorLink | None = self.simulation
        if file.operator.address and self.simulation is None:
            self.operator_link = _operator_link(file, self.clock)

    @classmethod
    def from_file(cls, path: Path | str, *, seed: int | None = None) -> Rig:
        """A rig from its file, closed; `ConfigError` when the file is wrong."""
        return cls(read_rig(Path(path)), seed=seed)

    def _repr_html_(self) -> str:
        from rigctl.report import html
        from rigctl.report.tables.result_table import ResultTable

        rows = [[name, each.role, each.driver, each.address] for name, each in self.file.instruments.items()]
        instruments = ResultTable("Instruments", ["instrument", "role", "driver", "address"], rows)
        return html.paragraph(self.file.rig.name) + html.table(instruments)

    def __enter__(self) -> Rig:
        # Before anything is connected, by a stop for example.
        self.wire_logs.prepare("in charge")
        try:
            self._open_all()
            # Asked before the stop: afterwards nobody can tell.
            self.found_moving = self.moving()
            self.stop()
        except BaseException as error:
            # `with` does not leave what could not be entered.
            self.__exit__(type(error), error, error.__traceback__)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.stop()
        except RigError as unsafe:
            if error is None:
                raise
            # A lost instrument fails in the stop with the words of the error that is under way.
            if str(unsafe) != str(error):
                error.add_note(str(unsafe))
        finally:
            self.close()

    def open(self) -> None:
        """Connect to every instrument; one `RigError` that names all that do not answer. Moves nothing.

        A `stop` in another thread ends it: no further instrument is connected to.
        """
        self.wire_logs.prepare("asked")
        self._open_all()

    def _open_all(self) -> None:
        stops = self._stops
        failures: list[RigError] = []
        for instrument in self.instruments.values():
            if self._stops != stops:
                failures.append(LinkLost(f"{self.file.path}: stopped while its instruments were being connected"))
                break
            try:
                instrument.open()
            except RigError as error:
                failures.append(error)
        if failures:
            self.close()
            raise _joined(failures)

    def close(self) -> None:
        """Disconnect; may be called twice. A stop that is under way in another thread is awaited."""
        with self._one_stop_at_a_time:
            let_go(self.instruments.values())

    def stop(self) -> None:
        """Bring every instrument to rest, all at once: one that hangs or fails keeps no other moving.

        Any thread, any number of times; `RigError` names those that did not confirm.
        """
        # Before the lock is waited for, so that an `open` in another thread connects to nothing further.
        self._stops += 1
        with self._one_stop_at_a_time:
            rests = bring_to_rest(self.instruments.values())
        require_rest(rests)

    def moving(self) -> tuple[str, ...]:
        """The stages that move now; asks them, and touches nothing."""
        stages = [each for each in self.instruments.values() if isinstance(each, Stage)]
        return tuple(stage.name for stage in stages if stage.is_moving())

    def identities(self) -> dict[str, Identity]:
        """Ask every instrument who it is."""
        return {name: instrument.identify() for name, instrument in self.instruments.items()}

    def by_role(self, role: str) -> list[Any]:
        """The instruments with this role, in the order of the file."""
        return [self.instruments[name] for name, table in self.file.instruments.items() if table.role == role]

    def only(self, role: str) -> Any:
        """The one instrument with this role; `ConfigError` when there is none, or more."""
        instruments = self.by_role(role)
        if len(instruments) != 1:
            raise ConfigError(
                f"{self.file.path}: {len(instruments)} instruments with role '{role}', "
                "needs one; correct [instruments]"
            )
        return instruments[0]

    def _connect(self, name: str, declaration: DriverDeclaration) -> Connect:
        table = self.file.instruments[name]
        if not self._reachable:
            return self._nowhere
        if not declaration.wired:
            return self._ground_segment(name, table)
        if not table.simulated:
            try:
                return self.wire_logs.logged(name, connector(table.address, self.clock))
            except ConfigError as error:
                raise ConfigError(f"{self.file.path}: instruments.{name}.address: {error}") from None
        simulation = self._simulated(name)
        endpoint = LockedInstrument(simulation.instruments[name], simulation.clock)
        return self.wire_logs.logged(
            name, lambda: InProcessTransport(f"{name} (simulated)", endpoint, simulation.clock)
        )

    def _nowhere(self) -> NoReturn:
        raise LinkLost(f"{self.file.path}: this rig is only asked for its limits")

    def _ground_segment(self, name: str, table: InstrumentTable) -> Connect:
        if not table.simulated:
            raise ConfigError(
                f"{self.file.path}: instruments.{name}.address: "
                f"no way to a {table.role} but 'sim:' is known; write that"
            )
        satellite = self._simulated(name).ground_segments[name]
        # A ground segment is handed out as it is: there is no wire, but every driver is given a way to connect.
        return cast(Connect, lambda: satellite)

    def _simulated(self, name: str) -> SimulatedRig:
        if self.simulation is None:
            raise ConfigError(
                f"{self.file.path}: instruments.{name} is simulated but there is no [world] table; add it"
            )
        return self.simulation


def drivers_of(file: RigFile) -> dict[str, Driver]:
    """What the instruments of a rig file are driven with, their keys checked; `ConfigError`."""
    return {name: _driver_of(file, f"instruments.{name}", table) for name, table in file.instruments.items()}


def declaration_of(kind: str, where: str = "driver") -> DriverDeclaration:
    """What the driver of this kind says of itself; `ConfigError`."""
    if kind not in DRIVERS.names():
        raise ConfigError(f"{where} '{kind}' is unknown; one of {', '.join(DRIVERS.names())}")
    return DRIVERS.get(kind)


def simulator_of(declaration: DriverDeclaration) -> SimulatorDeclaration:
    """How this kind of instrument is simulated; `ConfigError`."""
    if not declaration.simulator:
        raise ConfigError(f"there is no simulator of a {declaration.kind}; give its address")
    simulator = resolved(declaration.simulator, f"the simulator of '{declaration.kind}'")
    if not isinstance(simulator, SimulatorDeclaration):
        raise ConfigError(f"{declaration.simulator} is no SimulatorDeclaration; correct `simulator` of its driver")
    return simulator


def on_serial_line(table: InstrumentTable) -> bool:
    """True when it has a serial line, real or, in this process or served, simulated."""
    simulated_line = table.simulated and declaration_of(table.driver).serial_baud is not None
    return simulated_line or table.address.startswith("serial:")


def _driver_of(file: RigFile, where: str, table: InstrumentTable) -> Driver:
    declaration = declaration_of(table.driver, f"{file.path}: {where}.driver")
    if table.role not in declaration.roles:
        raise ConfigError(f"{file.path}: {where}{_no_role(table)}")
    use = declaration.roles[table.role]
    # After the file's own keys: what follows from the kind cannot be set otherwise.
    settings = validated(use.settings, {**table.settings, **declaration.implied}, file.path, where)
    return Driver(declaration, settings, use.build)


def _no_role(table: InstrumentTable) -> str:
    drivers = list(DRIVERS.sound())
    able = [driver.kind for driver in drivers if table.role in driver.roles]
    if able:
        return f": a {table.driver} cannot be the {table.role}; that takes {' or '.join(able)}"
    roles = dict.fromkeys(role for driver in drivers for role in driver.roles)
    return f".role '{table.role}' is unknown; one of {', '.join(roles)}"


def build_simulation(file: RigFile, clock: SimulationClock, *, seed: int | None = None) -> SimulatedRig:
    """All instruments of a rig file as simulators on its world; `ConfigError`."""
    if file.world is None:
        raise ConfigError(f"{file.path}: there is no [world] table to simulate; add it")
    drivers = drivers_of(file)
    world = dict(file.world) if seed is None else {**file.world, "seed": seed}
    specs = {
        name: Spec(
            table.driver,
            table.role,
            simulator_of(drivers[name].declaration),
            table.settings,
            table.simulator,
            table.faults,
            on_serial_line(table),
        )
        for name, table in file.instruments.items()
    }
    try:
        simulation = SimulatedRig(specs, world, clock)
    except TableError as error:
        raise ConfigError(f"{file.path}: {explain(error.model, error.cause, error.table)}") from None
    except ValueError as error:
        raise ConfigError(f"{file.path}: {error}") from None
    _require_in_world(file, simulation.bench.sensors, simulation.bench.heads)
    return simulation


def _require_in_world(file: RigFile, sensors: Collection[str], heads: Collection[str]) -> None:
    """A world without what is to be measured would only be found out in the middle of the night."""
    for name in file.package.axes if file.package else ():
        if name not in sensors:
            raise ConfigError(f"{file.path}: [world.sensors.{name}] is missing; the package has this axis")
    for table in file.instruments.values():
        for name in table.settings.get("heads", {}) if table.role == "displacement" else ():
            if name not in heads:
                raise ConfigError(f"{file.path}: [world.lasers.{name}] is missing; there is a head of this name")


def _simulate(file: RigFile, seed: int | None, start_s: float) -> tuple[SimulatedRig | None, Clock]:
    simulated = [table.simulated for table in file.instruments.values()]
    if not any(simulated):
        return None, RealClock(file.rig.clock_speed, start_s)
    if file.rig.clock == "virtual" and not all(simulated):
        raise ConfigError(f"{file.path}: rig.clock 'virtual' is for rigs that are simulated throughout; use 'real'")
    virtual = file.rig.clock == "virtual"
    clock = VirtualClock(start_s) if virtual else ScaledClock(file.rig.clock_speed, start_s)
    return build_simulation(file, clock, seed=seed), clock


def _operator_link(file: RigFile, clock: Clock) -> OperatorLink:
    try:
        return TcpOperatorLink(file.operator.address, clock)
    except ConfigError as error:
        raise ConfigError(f"{file.path}: {error}") from None


def _joined(failures: list[RigError]) -> RigError:
    """All failures in one: the operator should see all dead instruments, not the first."""
    if len(failures) == 1:
        return failures[0]
    # The kind of the first stands for all; it decides the exit status.
    return type(failures[0])("; ".join(str(failure) for failure in failures))
