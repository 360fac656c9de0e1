"""Settings of the meter that a command simply stores."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from simulators.keysight_34465a.meter import Meter

Access = tuple[Callable[[], Any], Callable[[Any], None]]


def stored(meter: Meter, name: str, *, measurement: bool = True) -> Access:
    """Getter and setter of a field of the configuration.

    A setting of the measurement ends the acquisition and clears the memory when it is sent.
    """

    def put(value: Any) -> None:
        if measurement:
            meter.change()
        setattr(meter.configuration, name, value)

    return lambda: getattr(meter.configuration, name), put
