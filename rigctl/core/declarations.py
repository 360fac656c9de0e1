"""What a driver says of itself, in its own module: the only place that knows its name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from pydantic import BaseModel

from rigctl.core.clock import Clock
from rigctl.core.interfaces import Instrument

DRIVER_CONTRACT = 1
"""Version of what is between this program and a driver: declaration, constructor, interfaces, simulator."""

USUAL_BAUD = 115200

Build = Callable[[str, Any, Any, Clock], Instrument]
"""Constructor: name, checked settings, `drivers.transport.Connect`, clock. Touches nothing."""


@dataclass(frozen=True)
class Use:
    """An instrument in one role: its keys in a rig file, and what is made of them."""

    settings: type[BaseModel]
    build: Build


@dataclass(frozen=True)
class DriverDeclaration:
    """One kind of instrument; `contract` is the `DRIVER_CONTRACT` it was written for.

    `roles` says what it may be used as. `simulator` is the text `package.module:OBJECT` of a
    `simulators.declaration.SimulatorDeclaration`; "" when there is none. `implied` are settings that follow from the
    kind. `serial_baud` is the rate of an instrument whose own line is a serial one; None for one in a network, whose
    usual TCP `port` may be known. An instrument that is not `wired` talks with its simulator, or whatever stands for
    it, as an object of Python.
    """

    kind: str
    contract: int
    roles: Mapping[str, Use]
    simulator: str = ""
    implied: Mapping[str, Any] = field(default_factory=dict)
    serial_baud: int | None = None
    port: int | None = None
    wired: bool = True
