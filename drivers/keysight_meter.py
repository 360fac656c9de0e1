"""What the uses of a Keysight 34465A share: the connection, who it is, and how it is stopped."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress

from drivers.keysight_34465a_examined import who
from drivers.keysight_memory import OVERLOAD
from drivers.scpi import NotUnderstood, ScpiLink
from drivers.transport import Connect
from rigctl.core.clock import Clock
from rigctl.core.errors import InstrumentError
from rigctl.core.findings import Finding
from rigctl.core.interfaces import Identity, Reading

MAKERS, MODELS = ("Keysight",), ("34465A",)
ALTERING = {"scaling": "CALC:SCAL", "smoothing": "CALC:SMO"}
"""What makes other numbers of readings, and stays on when a measurement is set up anew; by its name in messages."""


class Keysight34465A:
    """What the three uses of the meter share: the connection, who it is, and how it is stopped."""

    def __init__(self, name: str, connect: Connect, clock: Clock, link_timeout_s: float) -> None:
        self.name = name
        self._clock = clock
        self._link = ScpiLink(name, connect, link_timeout_s)
        self._absent: set[str] = set()

    def open(self) -> None:
        """Connect, make sure it is a 34465A, end what it is doing and clear its errors."""
        self._link.open(MAKERS, MODELS)
        self._link.configure("ABOR", "*CLS")

    def examine(self) -> Iterator[Finding]:
        """Connect, end what it is doing, and look at firmware, options, errors and one reading."""
        identity = self._link.open(MAKERS, MODELS)
        self._link.send("ABOR")
        yield from who(identity, self._link, self._link.errors())
        yield from self._examine(identity)

    def _examine(self, identity: Identity) -> Iterator[Finding]:
        """What it is asked in its use."""
        raise NotImplementedError

    def close(self) -> None:
        """Disconnect; may be called twice."""
        self._link.close()

    def identify(self) -> Identity:
        """Ask the meter who it is."""
        return self._link.identify(MAKERS, MODELS)

    def confirm_in_step(self) -> None:
        """`OutOfStep` when replies may have been taken for others."""
        self._link.confirm_in_step()

    def stop(self) -> None:
        """End the acquisition and return when the meter says that it is idle; readings taken so far stay in it."""
        with self._link.urgently():
            self._link.send("ABOR")
            # Answered only when nothing is pending, so the reply is the confirmation.
            if self._link.query_whole("*OPC?") != 1:
                raise InstrumentError(f"{self.name}: not idle after ABOR; look at its panel", instrument=self.name)

    def _configure(self, *commands: str) -> None:
        """Set up a measurement, without what another client may have switched on and CONF leaves on.

        The error queue is asked last: its reply can be taken for no reading, as that of a switch could.
        """
        self._link.send(*commands)
        for name in self._altered():
            self._link.send(f"{ALTERING[name]}:STAT OFF")
        self._link.check(f"after {'; '.join(commands)}")

    def _altered(self) -> list[str]:
        """What is on of `ALTERING`."""
        return [name for name, node in ALTERING.items() if self._is_on(node)]

    def _is_on(self, node: str) -> bool:
        """Whether it is, or False where this firmware has no such thing."""
        # Asked twice before that is believed: a question that was garbled on its way is not understood either.
        for _ in range(0 if node in self._absent else 2):
            with suppress(NotUnderstood):
                return bool(self._link.query_whole(f"{node}:STAT?"))
        self._absent.add(node)
        return False

    def _read_one(self, unit: str, extra_s: float) -> Reading:
        value = self._link.query_number("READ?", extra_s)
        return Reading(math.nan if abs(value) >= OVERLOAD else value, unit, self._clock.now_s())
