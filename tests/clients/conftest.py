"""Instruments served for clients that were written elsewhere; collected where `make clients` has installed them."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator

import pytest

from simulators.clock import ScaledClock
from simulators.serve import Address, Server
from simulators.wiring import SimulatedInstrument

collect_ignore_glob = [] if os.environ.get("RIGCTL_CLIENTS") else ["test_*.py"]


def pytest_configure(config: pytest.Config) -> None:
    """Theirs are warnings of the versions of Python and of libraries that they were written for."""
    for category in ("DeprecationWarning", "FutureWarning", "ResourceWarning"):
        config.addinivalue_line("filterwarnings", f"ignore::{category}")


BAUD = 19200
SPEED = 20.0
"""Rig seconds per second: motions end soon, the clients' own time-outs are far."""

Serve = Callable[[Callable[[ScaledClock], SimulatedInstrument], str], Address]


@pytest.fixture
def serve() -> Iterator[Serve]:
    """Serves what is built on the clock, one instrument, over "tcp" or "serial", until the test ends."""
    clock = ScaledClock(SPEED)
    server = Server(clock)
    serving = threading.Thread(target=server.serve)

    def one(build: Callable[[ScaledClock], SimulatedInstrument], transport: str) -> Address:
        instrument = build(clock)
        address = (
            server.add_tcp("it", instrument) if transport == "tcp" else server.add_serial("it", instrument, BAUD)
        )
        serving.start()
        return address

    yield one
    server.stop()
    serving.join(20.0)
    server.close()
