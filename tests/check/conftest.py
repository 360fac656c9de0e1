"""Rigs whose instruments are served as if they were real ones: no simulator says that it is one."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, nullcontext
from pathlib import Path
from typing import Any

import pytest

from rigctl.files.rig_file import parse_rig
from rigctl.serving import Served

FASTER = ("clock_speed = 1.0", "clock_speed = 20.0")
"""A change to most shipped rigs."""

Serve = Callable[..., Path]
"""Serves a shipped rig with changes, and writes the rig file of a client."""


@pytest.fixture
def real_rig(desk: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[Serve]:
    """`real_rig(*changes, of=...)` gives the path of a rig file whose instruments answer on ports and lines."""
    monkeypatch.setattr("rigctl.serving.announced", nullcontext)
    with ExitStack() as stack:

        def serve(*changes: tuple[str, str], of: str = "isa-rig.toml") -> Path:
            file = desk.rig(*changes, of=of, name="served.toml")
            served = stack.enter_context(Served(parse_rig(file.read_text(), file)))
            serving = threading.Thread(target=served._server.serve)
            serving.start()
            stack.callback(serving.join)
            stack.callback(served.stop)
            client = desk.directory / "rig.toml"
            client.write_text(served.rig_text())
            return client

        yield serve


@pytest.fixture
def dead_port() -> int:
    """A port at which nobody listens."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return int(probe.getsockname()[1])
