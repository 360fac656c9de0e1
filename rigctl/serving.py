"""`rigctl simulate`: a rig file's instruments on loopback ports and pseudo-terminals."""

from __future__ import annotations

import re
import signal
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl

from rigctl.campaign.session.served import announced
from rigctl.core.declarations import USUAL_BAUD
from rigctl.core.errors import ConfigError
from rigctl.files.rig_file import RigFile, parse_rig
from rigctl.rig import build_simulation, declaration_of, drivers_of, on_serial_line
from simulators.clock import ScaledClock
from simulators.measured import into_file
from simulators.operator_port import Done
from simulators.serve import Address, Server


class Served:
    """The instruments of a rig file, served; use it in `with`.

    What they really measure is appended to `measured`, when given: see `simulators.measured`.
    """

    def __init__(self, file: RigFile, *, measured: Path | None = None) -> None:
        self.file = file
        for name, driver in drivers_of(file).items():
            kind, wired = driver.declaration.kind, driver.declaration.wired
            if not wired:
                raise ConfigError(f"{file.path}: instruments.{name}: a {kind} has no wire that could be served")
        clock = ScaledClock(file.rig.clock_speed)
        self.simulation = build_simulation(file, clock)
        if measured is not None:
            self._write_measured(measured)
        self._server = Server(clock)
        # A port that is taken must not leave the ports before it served by nobody.
        with ExitStack() as undo:
            undo.callback(self._server.close)
            self._addresses: dict[str, Address] = {name: self._serve(name) for name in self.simulation.instruments}
            self._operator = self._server.add_operator(self._operate, _port(file.operator.address))
            undo.enter_context(announced(map(_url, self._addresses.values())))
            self._undo = undo.pop_all()

    def __enter__(self) -> Served:
        return self

    def __exit__(self, *_: object) -> None:
        self._undo.close()

    @property
    def addresses(self) -> list[dict[str, Any]]:
        """Where everything is, as `rigctl simulate --json` prints it."""
        listed: list[dict[str, Any]] = []
        for name, address in self._addresses.items():
            table = self.file.instruments[name]
            named: dict[str, Any] = {
                key: table.settings[key] for key in ("group", "positioner", "axis") if key in table.settings
            }
            listed.append({**address.as_dict(), **named})
        return [*listed, self._operator.as_dict()]

    def serve(self) -> None:
        """Serve until interrupted (Ctrl-C or TERM)."""

        def stop(_: int, __: object) -> None:
            self._server.stop()

        # Handlers, not exceptions: the server ends between two events and closes every line.
        handlers = [(number, signal.signal(number, stop)) for number in _STOPS]
        try:
            self._server.serve()
        finally:
            for number, handler in handlers:
                signal.signal(number, handler)

    def stop(self) -> None:
        """End `serve`; any thread."""
        self._server.stop()

    def rig_text(self) -> str:
        """The rig file with the served addresses and without the world: what a client on this machine needs.

        `ConfigError` when the file is written in a way that this cannot follow.
        """
        text = self.file.text_without_world
        wanted = {f"instruments.{name}": _url(address) for name, address in self._addresses.items()}
        for table, address in {**wanted, "operator": _url(self._operator)}.items():
            text = _with_key(text, table, "address", address)
        text = _with_key(text, "rig", "clock", "real")
        # Read back: a rig file written in an unusual way would keep an address without a word.
        if _addresses_in(text) != wanted:
            raise ConfigError(
                f"{self.file.path}: write every instrument as a table [instruments.NAME] to have it served"
            )
        return text

    def _operate(self, action: dict[str, Any]) -> Done:
        done_s = self.simulation.operate(action)
        return Done(done_s, self.simulation.answer(done_s))

    def _write_measured(self, path: Path) -> None:
        try:
            self.simulation.measured.listen(into_file(path))
        except OSError as error:
            raise ConfigError(f"--measured: cannot write {path} ({error}); name another file") from None

    def _serve(self, name: str) -> Address:
        table, instrument = self.file.instruments[name], self.simulation.instruments[name]
        if on_serial_line(table):
            options = dict(parse_qsl(table.address.partition("?")[2]))
            baud = int(options.get("baud", declaration_of(table.driver).serial_baud or USUAL_BAUD))
            return self._server.add_serial(name, instrument, baud)
        if "hislip" in table.address.lower():
            return self._server.add_hislip(name, instrument, _port(table.address))
        return self._server.add_tcp(name, instrument, _port(table.address))


_STOPS = (signal.SIGINT, signal.SIGTERM)


def _addresses_in(text: str) -> dict[str, str] | None:
    try:
        client = parse_rig(text, Path("client"))
    except ConfigError:
        return None
    return {f"instruments.{name}": table.address for name, table in client.instruments.items()}


def _port(address: str) -> int:
    """The port an address fixes on loopback, 0 for any."""
    match = re.search(r"(?:127\.0\.0\.1|localhost)(?::|::|::hislip0,)(\d+)", address)
    return int(match.group(1)) if match else 0


def _url(address: Address) -> str:
    if address.device is not None:
        return f"serial:{address.device}?baud={address.baud}"
    if address.transport == "hislip":
        return f"TCPIP::{address.host}::hislip0,{address.port}::INSTR"
    return f"tcp://{address.host}:{address.port}"


def _with_key(text: str, table: str, key: str, value: str) -> str:
    """TOML text with a string key of a table replaced, or added as its first; the table is added if need be."""
    line = f'{key} = "{value}"\n'
    head = re.search(rf"^\[{re.escape(table)}\][^\n]*\n", text, re.MULTILINE)
    if head is None:
        return f"{text}\n[{table}]\n{line}"
    end = re.search(r"^\[", text[head.end() :], re.MULTILINE)
    stop = head.end() + end.start() if end else len(text)
    # The old key is taken out of this table only; the same key stands in others.
    body = re.sub(rf"^{key}\s*=[^\n]*\n?", "", text[head.end() : stop], flags=re.MULTILINE)
    return text[: head.end()] + line + body + text[stop:]
