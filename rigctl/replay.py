"""A driver run against a wire log instead of its instrument: a laboratory's log becomes a test."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from drivers.wire.reading import WireLog, read_wire_log
from drivers.wire.replayed import Replay, ReplayedConnect
from rigctl.check.asking import Moves, questions
from rigctl.core.errors import ConfigError, RigError
from rigctl.core.interfaces import Identity, Instrument, Stage
from rigctl.files.rig_file import RigFile
from rigctl.rig import Driver, drivers_of
from rigctl.wire_logs import secrets_of


@dataclass(frozen=True)
class Replayed:
    """The driver, and the log it talks with."""

    instrument: Instrument
    replay: Replay


@dataclass(frozen=True)
class Outcome:
    """How the beginning of a log was followed; `identity` where it was asked for."""

    instrument: str
    driver: str
    identity: Identity | None
    moving: bool
    replayed: int
    records: int


@contextmanager
def replayed(path: Path, file: RigFile, name: str = "") -> Iterator[Replayed]:
    """The driver of an instrument of a rig file on a wire log; by default of the instrument of the log's name.

    `DataError` at the end, or as soon as the driver lets it through, when it did something else than was recorded.
    """
    log = read_wire_log(path)
    name = name or log.header.instrument
    driver = _driver(log, file, name)
    replay = Replay(log, secrets_of(file.instruments[name].settings))
    instrument = driver.build(name, driver.settings, ReplayedConnect(replay), replay.clock)
    try:
        yield Replayed(instrument, replay)
    except RigError:
        # What a driver makes of a deviation comes after it.
        replay.require_followed()
        raise
    finally:
        instrument.close()
    replay.require_followed()


def follow(path: Path, file: RigFile, name: str = "") -> Outcome:
    """Do with the driver what a log begins with: as `rigctl check` does, or as whoever takes charge of a rig."""
    with replayed(path, file, name) as each:
        instrument, log = each.instrument, each.replay.log
        identity, moving = None, False
        match log.header.opening:
            case "checked":
                shown = list(questions(instrument))
                identity = next((one for one in shown if isinstance(one, Identity)), None)
                moving = Moves.NOW in shown
            case "in charge":
                instrument.open()
                moving = _moving(instrument)
                instrument.stop()
            case _:
                instrument.open()
                identity = instrument.identify()
                moving = _moving(instrument)
    header = log.header
    return Outcome(header.instrument, header.driver, identity, moving, each.replay.replayed, len(log.records))


def _moving(instrument: Instrument) -> bool:
    return isinstance(instrument, Stage) and instrument.is_moving()


def _driver(log: WireLog, file: RigFile, name: str) -> Driver:
    if name not in file.instruments:
        raise ConfigError(
            f"{file.path}: no instrument '{name}'; --instrument names one of {', '.join(file.instruments)}"
        )
    kind = file.instruments[name].driver
    if kind != log.header.driver:
        raise ConfigError(
            f"{file.path}: instruments.{name}.driver is {kind}, {log.path} is of a {log.header.driver}; "
            "name the instrument with --instrument, or another log"
        )
    return drivers_of(file)[name]
