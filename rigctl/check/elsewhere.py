"""An instrument that does not answer where the rig file says: looked for at the other rates and the usual port."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from pydantic import BaseModel

from drivers.connect import connector
from rigctl.core.declarations import DriverDeclaration
from rigctl.core.errors import RigError
from rigctl.core.interfaces import Instrument
from rigctl.rig import Rig, drivers_of

PATIENCE_S = 0.3
"""How long an answer is awaited at each place: most come within some ms."""

CHANGE_S = 1.0
"""How long a change of state at most: at a dead place nothing comes, however long, and each is asked twice."""

BAUDS = (115200, 9600, 19200, 38400, 57600, 921600)
PARITIES = ("N", "E")


@dataclass(frozen=True)
class Elsewhere:
    """Where it answers, as a rig file writes it and in words; the instrument there, closed."""

    address: str
    words: str
    instrument: Instrument


def found_elsewhere(rig: Rig, name: str, say: Callable[[str], None]) -> Elsewhere | None:
    """The first other place at which this instrument answers; None when there is none, or it is simulated.

    Of several each is said before it is tried: at a dead one a driver's questions wait for seconds.
    """
    table = rig.file.instruments[name]
    if table.simulated:
        return None
    driver = drivers_of(rig.file)[name]
    hasty = _hasty(driver.settings)
    places = list(_places(table.address, driver.declaration))
    for number, (address, words) in enumerate(places, 1):
        if len(places) > 1:
            say(f"{name}: no answer yet; asked at {words}, {number} of {len(places)}")
        tried = driver.build(name, hasty, connector(address, rig.clock, floor_s=PATIENCE_S), rig.clock)
        # Twice: what the instrument has heard at another rate may spoil the first question.
        if not (_answers(tried) or _answers(tried)):
            continue
        connect = rig.wire_logs.logged(name, connector(address, rig.clock))
        return Elsewhere(address, words, driver.build(name, driver.settings, connect, rig.clock))
    return None


def tried_besides(rig: Rig, name: str) -> str:
    """Where `found_elsewhere` has looked, as the end of a sentence; "" for nowhere."""
    table = rig.file.instruments[name]
    if table.simulated or not any(_places(table.address, drivers_of(rig.file)[name].declaration)):
        return ""
    if table.address.startswith("serial:"):
        return f"; tried besides: {', '.join(map(str, BAUDS))} baud with parity {' and '.join(PARITIES)}"
    return f"; tried besides: port {drivers_of(rig.file)[name].declaration.port}"


def _answers(instrument: Instrument) -> bool:
    try:
        instrument.open()
    except RigError:
        return False
    finally:
        instrument.close()
    return True


def _hasty(settings: BaseModel) -> BaseModel:
    """The same settings, but for how long an answer is awaited."""
    waits = [name for name in type(settings).model_fields if name.endswith("_timeout_s")]
    longest = {"link_timeout_s": PATIENCE_S}
    shorter = {name: min(getattr(settings, name), longest.get(name, CHANGE_S)) for name in waits}
    return settings.model_copy(update=shorter)


def _places(address: str, declaration: DriverDeclaration) -> Iterator[tuple[str, str]]:
    """Other addresses to try, with words for them."""
    if address.startswith("serial:"):
        device, _, options = address.partition("?")
        kept = [option for option in options.split("&") if option and not option.startswith(("baud=", "parity="))]
        said = dict(option.partition("=")[::2] for option in options.split("&") if option)
        usual = (int(said.get("baud", 0)), said.get("parity", "N"))
        for parity in PARITIES:
            for baud in BAUDS:
                if (baud, parity) != usual:
                    tried = "&".join([f"baud={baud}", *([f"parity={parity}"] if parity != "N" else []), *kept])
                    yield f"{device}?{tried}", f"{baud} baud, parity {parity}"
        return
    match = re.fullmatch(r"(tcp://[^?]*:)(\d+)(.*)", address)
    if match and declaration.port and int(match[2]) != declaration.port:
        yield f"{match[1]}{declaration.port}{match[3]}", f"port {declaration.port}"
