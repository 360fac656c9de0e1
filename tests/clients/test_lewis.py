"""Our driver of the LK-G3001 on the emulator of ISIS (github.com/ISISComputingGroup/EPICS-DeviceEmulator).

It is made for lewis, knows measured values, modes and offsets, and no storage. RIGCTL_EMULATORS names a checkout.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.connect import connector
from drivers.keyence_controller import KeyenceController
from drivers.keyence_settings import KeyenceSettings
from rigctl.core.clock import RealClock
from rigctl.core.errors import InstrumentError, LinkTimeout

CHECKOUT = os.environ.get("RIGCTL_EMULATORS")
pytestmark = pytest.mark.skipif(CHECKOUT is None, reason="RIGCTL_EMULATORS names no checkout of EPICS-DeviceEmulator")

PATIENCE_S = 20.0


@pytest.fixture
def emulator() -> Iterator[int]:
    """Its TCP port."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = int(free.getsockname()[1])
    lewis = Path(sys.executable).with_name("lewis")
    protocol = f"stream: {{bind_address: 127.0.0.1, port: {port}}}"
    arguments = [lewis, "-a", str(CHECKOUT), "-k", "lewis_emulators", "keylkg", "-p", protocol]
    process = subprocess.Popen(arguments, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    until_s = time.monotonic() + PATIENCE_S
    try:
        while True:
            try:
                socket.create_connection(("127.0.0.1", port), 1.0).close()
                break
            except OSError:
                assert process.poll() is None, "the emulator has ended"
                assert time.monotonic() < until_s, "the emulator does not listen"
                time.sleep(0.05)
        yield port
    finally:
        process.terminate()
        process.wait(PATIENCE_S)


@pytest.fixture
def controller(emulator: int) -> Iterator[KeyenceController]:
    clock = RealClock()
    settings = KeyenceSettings(
        generation="lkg3001", heads={"one_mm": 1, "two_mm": 2}, link_timeout_s=0.5, mode_timeout_s=0.5
    )
    lasers = KeyenceController("lasers", settings, connector(f"tcp://127.0.0.1:{emulator}", clock), clock)
    yield lasers
    lasers.close()


def test_its_generation_is_known_and_both_values_are_read(controller: KeyenceController) -> None:
    controller.open()
    assert controller.identify().model == "LK-G3001"
    assert [reading.value for reading in controller.displacements()] == [0.0, 0.0]


def test_what_it_does_not_know_is_an_error_and_no_value(controller: KeyenceController) -> None:
    controller.open()
    with pytest.raises((InstrumentError, LinkTimeout)):
        controller.stop()
