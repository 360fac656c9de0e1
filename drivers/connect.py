"""Addresses as an operator writes them, turned into connections.

    tcp://host:port                              a raw TCP socket
    serial:/dev/ttyUSB0?baud=115200&parity=N     a serial line
    TCPIP::host::hislip0,4880::INSTR             any VISA resource name
    visa:GPIB0::12::INSTR?backend=@ivi           the same, with options

Options of a serial line: baud, parity (N E O M S), bytesize, stopbits, rtscts, xonxoff (0 or 1). A VISA
resource takes `backend` as well.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Protocol, runtime_checkable
from urllib.parse import parse_qsl

from drivers.buffered import WALL_FLOOR_S
from drivers.transport import Connect
from drivers.transport_serial import SerialSettings, SerialTransport
from rigctl.core.clock import Clock
from rigctl.core.errors import ConfigError

EXAMPLES = "tcp://host:port, serial:/dev/ttyUSB0?baud=115200 or a VISA resource such as GPIB0::12::INSTR"


@dataclass(frozen=True)
class SerialConnect:
    """Opens a serial line; `said` are the options that its address fixes."""

    device: str
    clock: Clock
    line: SerialSettings
    address: str
    floor_s: float
    said: frozenset[str]

    def __call__(self) -> SerialTransport:
        """One connection."""
        return SerialTransport(self.device, self.clock, self.line, address=self.address, floor_s=self.floor_s)

    def ways(self, settings: Sequence[SerialSettings]) -> list[tuple[str, Connect]]:
        """These settings, but for what the address says."""
        ways: dict[SerialSettings, tuple[str, Connect]] = {}
        for line in settings:
            # What the address says wins over what the instrument may be set to.
            fixed = {option: getattr(self.line, option) for option in self.said}
            tried = replace(line, **fixed)
            ways[tried] = (f"{tried.baud} baud", replace(self, line=tried))
        return list(ways.values())


@runtime_checkable
class HasWays(Protocol):
    """What opens connections to a serial line, or stands for it: a log of one, for example."""

    def ways(self, settings: Sequence[SerialSettings]) -> list[tuple[str, Connect]]:
        """The connections to try, with words for them."""
        ...


def serial_ways(connect: Connect, lines: Sequence[SerialSettings]) -> list[tuple[str, Connect]]:
    """The connections to try, with words for them: of a serial line these settings, but for what its address says."""
    return connect.ways(lines) if isinstance(connect, HasWays) else [("", connect)]


def connector(
    address: str,
    clock: Clock,
    *,
    serial: SerialSettings | None = None,
    floor_s: float = WALL_FLOOR_S,
) -> Connect:
    """What opens connections to `address`; nothing is opened yet.

    `serial` is how the instrument's line is set when the address does not say. `floor_s` is the shortest
    wall-clock time a read waits. Raises `ConfigError` when the address cannot be understood; the returned
    callable raises `LinkLost` when nothing answers there.
    """
    settings = serial or SerialSettings()
    scheme, _, rest = address.partition(":")
    match scheme:
        case "sim":
            raise ConfigError(f"address {address!r}: a simulated instrument has no wire to open here")
        case "tcp":
            return _visa(address, _socket_resource(address), {}, clock, settings, floor_s)
        case "serial":
            device, options = _split(address, rest)
            if not device:
                raise ConfigError(f"address {address!r}: no device; write serial:/dev/ttyUSB0?baud=115200")
            line = _line(address, options, settings)
            return SerialConnect(device, clock, line, address, floor_s, frozenset(options))
        case "visa":
            return _visa(address, *_split(address, rest), clock, settings, floor_s)
        case _:
            return _visa(address, *_split(address, address), clock, settings, floor_s)


def _visa(
    address: str,
    resource: str,
    options: Mapping[str, str],
    clock: Clock,
    settings: SerialSettings,
    floor_s: float,
) -> Connect:
    # pyvisa takes a quarter of a second to import: not for a rig without VISA
    from pyvisa.rname import ASRLInstr, InvalidResourceName, parse_resource_name

    from drivers.transport_visa import PYVISA_PY, VisaTransport

    try:
        parsed = parse_resource_name(resource)
    except InvalidResourceName as error:
        raise ConfigError(f"address {address!r} is not understood; write {EXAMPLES}") from error
    backend = options.get("backend", PYVISA_PY)
    line_options = {key: value for key, value in options.items() if key != "backend"}
    if line_options and not isinstance(parsed, ASRLInstr):
        raise ConfigError(f"address {address!r}: {', '.join(line_options)} is for serial lines only")
    line = _line(address, line_options, settings)
    if isinstance(parsed, ASRLInstr) and backend == PYVISA_PY:
        # pyvisa-py takes serial bytes one by one from pyserial; a megabyte of them takes it ten seconds
        return SerialConnect(parsed.board, clock, line, address, floor_s, frozenset(line_options))
    return partial(VisaTransport, resource, clock, backend=backend, settings=line, address=address, floor_s=floor_s)


def _socket_resource(address: str) -> str:
    host, colon, port = address.removeprefix("tcp://").rpartition(":")
    if not (address.startswith("tcp://") and host and colon and port.isdecimal() and 0 < int(port) < 65536):
        raise ConfigError(f"address {address!r} is not understood; write tcp://host:port, port 1 to 65535")
    return f"TCPIP::{host}::{port}::SOCKET"


def _split(address: str, text: str) -> tuple[str, dict[str, str]]:
    target, _, query = text.partition("?")
    try:
        return target, dict(parse_qsl(query, keep_blank_values=True, strict_parsing=bool(query)))
    except ValueError as error:
        raise ConfigError(f"address {address!r}: write options as ?key=value&key=value") from error


def _line(address: str, options: Mapping[str, str], settings: SerialSettings) -> SerialSettings:
    changes: dict[str, Any] = {}
    for key, text in options.items():
        if key not in LINE_OPTIONS:
            raise ConfigError(f"address {address!r}: unknown option {key!r}; known: {', '.join(LINE_OPTIONS)}")
        try:
            changes[key] = LINE_OPTIONS[key](text)
        except (KeyError, ValueError) as error:
            raise ConfigError(f"address {address!r}: option {key} cannot be {text!r}") from error
    line = replace(settings, **changes)
    if line.rtscts and line.xonxoff:
        raise ConfigError(f"address {address!r}: choose one flow control, rtscts or xonxoff")
    return line


def _baud(text: str) -> int:
    if (baud := int(text)) <= 0:
        raise ValueError(text)
    return baud


LINE_OPTIONS: dict[str, Callable[[str], Any]] = {
    "baud": _baud,
    "parity": {letter: letter for letter in "NEOMS"}.__getitem__,
    "bytesize": {"5": 5, "6": 6, "7": 7, "8": 8}.__getitem__,
    "stopbits": {"1": 1, "1.5": 1.5, "2": 2}.__getitem__,
    "rtscts": {"0": False, "1": True}.__getitem__,
    "xonxoff": {"0": False, "1": True}.__getitem__,
}
